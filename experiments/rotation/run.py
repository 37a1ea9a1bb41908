"""Three ways to turn coefficients, by error and by the clock: rotors and a quadrature, our matrices, e3nn's.

    .venv/bin/python -m experiments.rotation.run --output experiments/rotation/results.json

Needs e3nn-jax, which the project does not (`pip install e3nn-jax`). The README says what is compared.
"""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import e3nn_jax  # pyright: ignore[reportMissingImports]
import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.algebra_speed import compiled, in_turn
from benchmarks.options import options, saved
from experiments.rotation.exact import exact_matrix
from experiments.rotation.products import compositions, error_bars
from gash_jax.algebra import motors
from gash_jax.algebra.rotor_quadrature import rotate_by_rotor
from gash_jax.algebra.sh import evaluate_sh
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.measure.provenance import provenance

ORDER = np.array([1, 2, 0])  # e3nn's polar axis is y: its x, y, z are our y, z, x


def by_rotor(coefficients: jax.Array, quaternions: jax.Array) -> jax.Array:
    """Rotors turn the nodes."""
    return rotate_by_rotor(coefficients, rotors(quaternions))


def by_matrix(coefficients: jax.Array, quaternions: jax.Array) -> jax.Array:
    """Our D."""
    return rotate_coefficients(coefficients, jnp.asarray(motors.quaternion_to_matrix(quaternions)))


def by_e3nn(coefficients: jax.Array, quaternions: jax.Array) -> jax.Array:
    """e3nn's D of every band, multiplied with the coefficients: its own transform_by_matrix takes one rotation."""
    matrix = jnp.asarray(motors.quaternion_to_matrix(quaternions))[..., ORDER[:, None], ORDER]
    parts = []
    for band in range(round(coefficients.shape[-1] ** 0.5)):
        block = e3nn_jax.Irrep(band, (-1) ** band).D_from_matrix(matrix)
        part = coefficients[..., band**2 : (band + 1) ** 2]
        parts.append(part @ block.T if block.ndim == 2 else jnp.einsum("nij,nj->ni", block, part))
    return jnp.concatenate(parts, axis=-1)


WAYS = {"rotors": by_rotor, "matrices": by_matrix, "e3nn": by_e3nn}


def rotors(quaternions: jax.Array) -> jax.Array:
    """Multivectors of quaternions (w, x, y, z)."""
    blades = jnp.array([motors.cga.SCALAR, motors.cga.E23, motors.cga.E13, motors.cga.E12])
    signed = quaternions * jnp.array([1.0, -1.0, 1.0, -1.0])
    return jnp.zeros((*quaternions.shape[:-1], 32)).at[..., blades].set(signed)


def rotation_vectors(count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Rotation vectors of three kinds: any, half turns, and turns by 1e-8 to 1e-2; about any axes and about ours."""
    axes = np.concatenate([rng.normal(size=(count, 3)), np.eye(3)])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    tiny = 10.0 ** rng.uniform(-8, -2, (len(axes), 1))
    return {"any": Rotation.random(count, rng=rng).as_rotvec(), "half": np.pi * axes, "tiny": tiny * axes}


def errors(bands: int, count: int = 40) -> Iterator[dict[str, Any]]:
    """rms and largest error in float32 of coefficients drawn from N(0, 1), against float64 and the exact rotation."""
    rng = np.random.default_rng(bands)
    for kind, vectors in rotation_vectors(count, rng).items():
        quaternions = Rotation.from_rotvec(vectors).as_quat(scalar_first=True)
        coefficients = rng.normal(size=(len(vectors), bands**2)).astype(np.float32)
        exact = np.stack([exact_matrix(v, bands) @ c for v, c in zip(vectors, coefficients, strict=True)])
        for way, turn in WAYS.items():
            found = np.asarray(jax.jit(turn)(coefficients, quaternions.astype(np.float32)), np.float64)
            off = found - exact
            yield {
                "bands": bands,
                "turns": kind,
                "way": way,
                "rms": float(np.sqrt(np.mean(off**2))),
                "largest": float(np.abs(off).max()),
            }


def times(bands: int, repeats: int, count: int) -> Iterator[dict[str, Any]]:
    """Median seconds of a light turned once, many vectors turned alike, and each by a rotation of its own."""
    rng = np.random.default_rng(bands)
    quaternions = Rotation.random(count, rng=rng).as_quat(scalar_first=True).astype(np.float32)
    coefficients = rng.normal(size=(count, bands**2)).astype(np.float32)
    cases: dict[str, tuple[np.ndarray, np.ndarray]] = {
        "one light": (coefficients[:3], quaternions[0]),
        "many alike": (coefficients, quaternions[0]),
        "each its own": (coefficients, quaternions),
    }
    for case, arrays in cases.items():
        arguments = [jnp.asarray(array) for array in arrays]
        programs = {way: compiled(turn, *arguments) for way, turn in WAYS.items()}
        runs: dict[str, Callable[[], Any]] = {way: partial(p, *arguments) for way, (p, _) in programs.items()}
        for way, seconds in in_turn(runs, repeats).items():
            yield {
                "bands": bands,
                "case": case,
                "count": len(arrays[0]),
                "way": way,
                "seconds": seconds,
                "compile_s": programs[way][1],
            }


def check_conventions() -> None:
    """All three follow Y(R n) = D(R) Y(n), or the comparison would mean nothing."""
    quaternion = jnp.array([0.5, 0.5, -0.1, 0.7])
    quaternion /= jnp.linalg.norm(quaternion)
    normals = jnp.eye(3)
    turned = motors.turn_vectors(rotors(quaternion), normals)
    for way, turn in WAYS.items():
        np.testing.assert_allclose(
            turn(evaluate_sh(normals, 10), quaternion), evaluate_sh(turned, 10), 0, 1e-4, err_msg=way
        )


def main(output: Path | None, quick: bool) -> dict[str, Any]:
    check_conventions()
    bands = (1, 3) if quick else range(1, 11)
    repeats, count = (5, 100) if quick else (21, 10_000)
    rows = {
        "errors": [row for b in bands for row in errors(b)],
        "times": [row for b in bands for row in times(b, repeats, count)],
        "compositions": compositions(100 if quick else 10_000, 100 if quick else 100_000, repeats),
        "error_bars": error_bars(8 if quick else 200),
    }
    for name in ("errors", "times", "compositions", "error_bars"):
        print(name, *rows[name], sep="\n  ")
    return saved(output, {**provenance(seed=0, repeats=repeats, count=count, e3nn=e3nn_jax.__version__), **rows})


if __name__ == "__main__":
    main(**options(__doc__, "output", "quick"))
