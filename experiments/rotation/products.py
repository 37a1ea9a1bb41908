"""What rotors are as representations of a turn, and what turned error bars are worth."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.algebra_speed import compiled, in_turn
from experiments.rotation.exact import exact_matrix
from gash_jax.algebra import motors
from gash_jax.algebra.sh import band_index
from gash_jax.measure.metrics import calibration
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.rotation import rotate_transfer
from gash_jax.shapes.primitives import bumpy_sphere

CHAINS = 20


def _nearest_rotation(matrix: jax.Array) -> jax.Array:
    """Gram and Schmidt's on the rows."""
    first = matrix[..., 0, :] / jnp.linalg.norm(matrix[..., 0, :], axis=-1, keepdims=True)
    second = matrix[..., 1, :] - jnp.sum(matrix[..., 1, :] * first, axis=-1, keepdims=True) * first
    second = second / jnp.linalg.norm(second, axis=-1, keepdims=True)
    return jnp.stack([first, second, jnp.cross(first, second)], axis=-2)


def _product(a: jax.Array, b: jax.Array) -> jax.Array:
    """Matrix products as sums: XLA's batches of tiny products are slower on a CPU."""
    return jnp.sum(a[..., :, :, None] * b[..., None, :, :], axis=-2)


WAYS: dict[str, tuple[Callable[..., jax.Array], bool]] = {
    "rotor": (motors.compose, True),
    "rotor, renormalised": (lambda a, b: motors.renormalize(motors.compose(a, b)), True),
    "matrix": (_product, False),
    "matrix, Gram-Schmidt": (lambda a, b: _nearest_rotation(_product(a, b)), False),
}


def compositions(steps: int, count: int, repeats: int) -> list[dict[str, Any]]:
    """Random turns composed one after another in float32, 20 chains: rms error of the matrix of the whole, how far that
    is from a rotation, and the seconds of `count` compositions."""
    rng = np.random.default_rng(0)
    turns = Rotation.random(steps * CHAINS, rng=rng).as_matrix().reshape(steps, CHAINS, 3, 3)
    exact = functools.reduce(lambda whole, turn: turn @ whole, turns)
    random = Rotation.random(count, rng=rng).as_matrix().astype(np.float32)
    rows, runs = [], {}
    for name, (compose, is_rotor) in WAYS.items():
        form = motors.matrix_to_rotor if is_rotor else jnp.asarray
        each, many = form(turns.astype(np.float32)), form(random)
        whole, _ = jax.lax.scan(lambda m, turn, compose=compose: (compose(turn, m), None), each[0], each[1:])
        found = np.asarray(motors.rotor_to_matrix(whole) if is_rotor else whole, np.float64)
        unit = float(np.abs(found @ np.swapaxes(found, 1, 2) - np.eye(3)).max())
        rows.append(
            {"way": name, "steps": steps, "error": float(np.sqrt(np.mean((found - exact) ** 2))), "from_a_turn": unit}
        )
        program, _ = compiled(compose, many, many)
        runs[name] = lambda program=program, many=many: program(many, many)
    for row, seconds in zip(rows, in_turn(runs, repeats).values(), strict=True):
        row |= {"count": count, "seconds": seconds}
    return rows


def error_bars(seeds: int, reference_rays: int = 1 << 14) -> list[dict[str, Any]]:
    """Bakes of a bumpy sphere by 64 rays with many seeds, turned: true errors against turned standard errors.

    `ratio` is the rms true error over the rms standard error and `coverage` the share within 95 % intervals (Student's
    t, 3 degrees), of the bakes as they are and turned. `neglect` is what leaving out the correlations does by itself:
    the smallest and largest ratio, over coefficients, of the true spread to that from the true spread of each
    coefficient before.
    """
    mesh, bands, turn = bumpy_sphere(8), 4, np.array([0.7, -1.1, 0.4])
    matrix = Rotation.from_rotvec(turn).as_matrix()
    truth = bake_transfer(mesh, bands, reference_rays)
    bakes = [bake_transfer(mesh, bands, 64, seed=seed) for seed in range(1, seeds + 1)]
    turned_truth, rows = rotate_transfer(truth, matrix), []
    spread = np.std([bake.coefficients for bake in bakes], axis=0, ddof=1)
    turned = [rotate_transfer(bake, matrix) for bake in bakes]
    true = np.sqrt(np.mean(np.var([np.asarray(t.coefficients) for t in turned], axis=0, ddof=1), axis=0))
    assumed = np.sqrt(np.mean(spread**2 @ (exact_matrix(turn, bands) ** 2).T, axis=0))
    for name, results, reference in (("as baked", bakes, truth), ("turned", turned, turned_truth)):
        off = np.stack([np.asarray(r.coefficients) - np.asarray(reference.coefficients) for r in results])
        bars = np.stack([np.asarray(r.standard_error) for r in results])
        for band in range(bands):
            chosen = band_index(bands) == band
            ratio, coverage = calibration(off[..., chosen], bars[..., chosen])
            row = {"bake": name, "band": band, "ratio": ratio, "coverage": coverage}
            neglect = true[chosen] / assumed[chosen]
            rows.append(row | {"neglect": [float(neglect.min()), float(neglect.max())]} if name == "turned" else row)
    return rows
