"""What the network is trained on: generated shapes, each with estimates of several numbers of rays, and a bake.

Half of the shapes are coarse. All estimates and the bake are in six bands; kept in the cache by content, like a corpus.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.files.caches import cache_folder, source_hash
from gash_jax.files.npz import read_npz, write_npz
from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.surfels import curve_codes
from gash_jax.models.reconstruction import make_surface
from gash_jax.nn.reconstruction import by_band
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.few_rays import LARGEST_ROW, FewRays, continued_shifts, trace_first, trace_up_to
from gash_jax.prt.integrands import to_world
from gash_jax.prt.scene import make_scene
from gash_jax.prt.tracing import active_rows
from gash_jax.prt.visibility import visibility
from gash_jax.shapes.procedural import make_shape

BANDS = 6
COUNTS = (4, 8, 16, 32, 64, 128, 256, 512, 1024)
COARSE, FINE = (300, 3000), (2000, 10000)
TRUTH = 2048
ROOMS = ("algebra", "geometry", "shapes", "prt", "graph")


class Example(NamedTuple):
    """The active vertices of a mesh: the surface, then residuals to the closed form and free shares by number of rays,
    and the residual of the bake with the square of its standard error, mean over each band."""

    places: Float[np.ndarray, "a 3"]
    normals: Float[np.ndarray, "a 3"]
    table: Int[np.ndarray, "a m"]
    found: Bool[np.ndarray, "a m"]
    residuals: Float[np.ndarray, "n a k"]
    shares: Float[np.ndarray, "n a"]
    truth: Float[np.ndarray, "a k"]
    doubt: Float[np.ndarray, "a b"]


def make_example(mesh: Mesh, seed: int, truth: int = TRUTH, counts: tuple[int, ...] = COUNTS) -> Example:
    """Estimates of a mesh as `bake_guided` makes them before it reconstructs."""
    geometry = make_scene(mesh).geometry
    visible = visibility(geometry.vertices, geometry.faces)
    order = np.argsort(curve_codes(geometry.vertices, mesh.normals, 30), kind="stable")
    active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    closed = np.asarray(unshadowed_transfer(mesh.normals[active], BANDS))
    estimates: list[FewRays] = []
    rows = active_rows(mesh, geometry, None, continued_shifts(order, counts[0], seed))[1]
    for count in counts:
        if count <= LARGEST_ROW:
            rows = active_rows(mesh, geometry, None, continued_shifts(order, count, seed))[1]
            estimates.append(trace_first(rows, count, BANDS, visible))
        else:  # as a bake does that adds to what it has
            estimates.append(trace_up_to(estimates[-1], np.full(len(active), count), rows, BANDS, visible))
    residuals = [np.asarray(to_world(few.local[:, None], rows.frames))[:, 0] - closed for few in estimates]
    shares = [few.share for few in estimates]
    surface = make_surface(geometry.vertices, mesh.normals, rows.frames, mesh.faces, active)
    baked = bake_transfer(mesh, BANDS, truth, seed=seed + 1)
    assert baked.standard_error is not None
    doubt = np.asarray(by_band(jnp.asarray(baked.standard_error[active].T ** 2), BANDS)).T
    return Example(
        *(surface.places, surface.normals, surface.table.T, surface.found.T),
        *(np.stack(residuals), np.stack(shares)),
        *(baked.coefficients[active] - closed, doubt),
    )


def load_examples(seed: int, shapes: int, report: Callable[[int, int], None] | None = None) -> list[Example]:
    """Examples of generated shapes, made where they are not there yet."""
    found = []
    for index in range(shapes):
        parts = (seed, index, BANDS, COUNTS, COARSE, FINE, TRUTH, source_hash(ROOMS))
        path = cache_folder() / "guided" / f"{hashlib.sha256(repr(parts).encode()).hexdigest()[:24]}.npz"
        found.append(_load(path) if path.exists() else _make(path, seed, index))
        if report:
            report(index + 1, shapes)
    return found


def _make(path: Path, seed: int, index: int) -> Example:
    mesh = make_shape(seed, index, COARSE if index % 2 else FINE)[1]
    example = make_example(mesh, seed=index)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_npz(path, example._asdict(), {"seed": seed, "index": index})
    return example


def _load(path: Path) -> Example:
    arrays, _ = read_npz(path, "example", ())
    return Example(**{name: arrays[name] for name in Example._fields})
