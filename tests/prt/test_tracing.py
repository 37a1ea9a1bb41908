"""The row tracer: rows of a bake, chunks, threads, and an integrand that needs to know what rays meet."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt import tracing
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bake_job import draw_shifts
from gash_jax.prt.rays import Hits, trace_geometry
from gash_jax.prt.sampling import COSINE
from gash_jax.prt.tracing import Chunk, Integrand, active_rows, chunk_size, trace_rows
from gash_jax.prt.visibility import closest_hit
from gash_jax.shapes.primitives import bumpy_sphere, icosphere


def _with_gaps(mesh: Mesh) -> Mesh:
    """The mesh with vertices that have no normal: a run of them, and some here and there."""
    normals = mesh.normals.copy()
    normals[100:130] = 0
    normals[np.random.default_rng(0).integers(0, len(normals), 40)] = 0
    return mesh._replace(normals=normals)


MESH = _with_gaps(bumpy_sphere(10))
SLICES = [(0, 1), (0, 1002), (63, 65), (64, 128), (99, 131), (100, 130), (110, 111), (500, 1001), (1001, 1002)]


@pytest.mark.parametrize("options", [{"rays": 64}, {"rays": 10, "bands": 4, "replicates": 1}, {"rays": 32, "bands": 1}])
@pytest.mark.parametrize("cores", [1, 4])
def test_rows_of_a_bake_are_that_slice_of_the_whole(
    monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], cores: int
) -> None:
    """To the last bit, with borders of chunks and vertices without normal in and at the ends of the slice."""
    monkeypatch.setattr(tracing, "RAYS_PER_CHUNK", 64 * options["rays"])
    assert chunk_size(len(MESH.vertices), options["rays"]) == 64
    whole = bake_transfer(MESH, seed=3, **options)
    monkeypatch.setattr(tracing, "available_cores", lambda: cores)
    for first, last in SLICES:
        part = bake_transfer(MESH, seed=3, rows=slice(first, last), **options)
        np.testing.assert_array_equal(part.coefficients, whole.coefficients[first:last])
        np.testing.assert_array_equal(part.vertices, MESH.vertices[first:last])
        np.testing.assert_array_equal(part.normals, MESH.normals[first:last])
        assert len(part.faces) == 0 and part.metadata["parameters"]["rows"] == [first, last]
        assert part.metadata["rays_total"] == options["rays"] * np.any(MESH.normals[first:last], axis=1).sum()
        if whole.standard_error is not None:
            assert part.standard_error is not None
            np.testing.assert_array_equal(part.standard_error, whole.standard_error[first:last])


def test_rows_have_given_frames_and_what_is_no_run_of_rows_is_refused() -> None:
    angle = np.random.default_rng(0).uniform(0, 2 * np.pi, len(MESH.vertices))
    twist = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], -1).reshape(-1, 2, 2)
    frames = np.array(orthonormal_frame(MESH.normals))
    frames[:, :, :2] = frames[:, :, :2] @ twist
    whole = bake_transfer(MESH, rays=16, frames=frames)
    part = bake_transfer(MESH, rays=16, frames=frames, rows=slice(-7, None))
    np.testing.assert_array_equal(part.coefficients, whole.coefficients[-7:])
    for rows in (slice(5, 5), slice(9, 3), slice(0, 10, 2), slice(2000, 3000)):
        with pytest.raises(ValueError, match=r"use slice\(first, last\)"):
            bake_transfer(MESH, rays=16, rows=rows)


SCRIPT = """
import sys, numpy as np
from gash_jax.prt.bake import bake_transfer
from tests.prt.test_tracing import MESH
first, last = int(sys.argv[2]), int(sys.argv[3])
baked = bake_transfer(MESH, rays=64, rows=slice(first, last))
np.savez(sys.argv[1], coefficients=baked.coefficients, error=baked.standard_error)
"""


@pytest.mark.slow
def test_as_users_compile_it_and_at_any_number_of_threads(tmp_path: Path) -> None:
    """With XLA's optimiser on and 1 and 7 threads: the kernels of the tests are compiled without."""
    parts = {"whole": (1, 0, 1002), "part": (7, 40, 75)}
    found = {}
    for name, (threads, first, last) in parts.items():
        environment = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"} | {"NPROC": str(threads)}
        command = [sys.executable, "-c", SCRIPT, str(tmp_path / f"{name}.npz"), str(first), str(last)]
        subprocess.run(command, check=True, env=environment, cwd=Path(__file__).parents[2])
        found[name] = np.load(tmp_path / f"{name}.npz")
    for name in ("coefficients", "error"):
        np.testing.assert_array_equal(found["part"][name], found["whole"][name][40:75])


def test_draws_are_those_of_one_run_of_the_generator() -> None:
    """What vertices before and after draw is passed over, not drawn: PCG64 set forward by one step per shift."""
    whole = np.random.default_rng(5).random((50, 3, 2), np.float32)
    for first, last in ((0, 50), (0, 1), (7, 31), (49, 50)):
        shifts = draw_shifts(5, 50, 3, first, last)
        np.testing.assert_array_equal(shifts[first:last], whole[first:last])
        assert not shifts[:first].any() and not shifts[last:].any()


def _reflected(values: np.ndarray, faces: np.ndarray, vectors: np.ndarray) -> Integrand:
    """Mean over cosine-weighted rays of what the surface sends back where they meet it: values interpolated by
    barycentrics, nothing from a face's back. A new integrand in full."""

    def integrate(chunk: Chunk) -> np.ndarray:
        hits = chunk.answer
        assert isinstance(hits, Hits)
        weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], -1)
        facing = np.einsum("crni,crni->crn", chunk.directions, vectors[hits.face]) < 0
        sent = np.einsum("crnj,crnjk->crnk", weights, values[faces[hits.face]])
        return np.where((facing & (hits.face >= 0))[..., None], sent, 0).mean(2)

    return Integrand(COSINE, "closest", integrate)


def _room() -> Mesh:
    """A ball seen from inside: faces and normals point inward."""
    ball = icosphere(3)
    return Mesh(ball.vertices, -ball.normals, ball.faces[:, ::-1])


@pytest.mark.parametrize(("backend", "rays_per_chunk"), [("embree", 1 << 17), ("embree", 1 << 9), ("jax", 1 << 17)])
def test_an_integrand_may_ask_for_the_nearest_face(
    monkeypatch: pytest.MonkeyPatch, backend: str, rays_per_chunk: int
) -> None:
    """In a ball cosine-weighted rays from any wall meet every part of the wall alike (the integrating sphere): of the
    values (1, x, y, z) they find the mean (1, 0, 0, 0). From behind, or of a ball seen from outside, nothing."""
    monkeypatch.setattr(tracing, "RAYS_PER_CHUNK", rays_per_chunk)
    room = _room()
    geometry = trace_geometry(room)
    values = np.concatenate([np.ones((len(room.vertices), 1)), room.vertices], axis=1).astype(np.float32)
    corners = room.vertices[room.faces]
    vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    shifts = np.random.default_rng(0).random((len(room.vertices), 2, 2), np.float32)
    _, rows = active_rows(room, geometry, None, shifts)
    rows = rows.take(np.arange(0, len(shifts), 60))
    closest = closest_hit(geometry.vertices, geometry.faces, backend)
    sums, free = trace_rows(rows, _reflected(values, room.faces, vectors), 256, closest)
    assert sums.shape == (len(rows.origins), 2, 4) and not free.any()
    np.testing.assert_allclose(sums, np.broadcast_to([1, 0, 0, 0], sums.shape), atol=0.02)
    behind, _ = trace_rows(rows, _reflected(values, room.faces, -vectors), 256, closest)
    assert not behind.any()
    outside = rows._replace(origins=1.5 * rows.origins, frames=-rows.frames)
    sums, free = trace_rows(outside, _reflected(values, room.faces, vectors), 256, closest)
    assert (free == 1).all() and not sums.any()


def test_the_first_failure_ends_the_bake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracing, "RAYS_PER_CHUNK", 256)
    rows = active_rows(MESH, trace_geometry(MESH), None, np.zeros((len(MESH.vertices), 1, 2), np.float32))[1]
    asked = []

    def broken(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        asked.append(len(origins))
        raise RuntimeError("the tracer broke")

    integrand = Integrand(COSINE, "any", lambda chunk: np.zeros((len(chunk.share), 1)))
    with pytest.raises(RuntimeError, match="the tracer broke"):
        trace_rows(rows, integrand, 64, broken)
    assert len(asked) < 200  # of 243 chunks


def test_only_the_rays_of_the_rows_are_traced() -> None:
    """Chunks are filled up so that they have one shape; what fills them costs no ray."""
    rows = active_rows(MESH, trace_geometry(MESH), None, np.zeros((len(MESH.vertices), 1, 2), np.float32))[1]
    asked = []

    def counted(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        asked.append(len(origins))
        return np.ones(len(origins), bool)

    integrand = Integrand(COSINE, "any", lambda chunk: chunk.answer.mean(2))
    result, free = trace_rows(rows, integrand, 8, counted, part=slice(10, 33))
    assert sum(asked) == 8 * 23
    assert (result[10:33] == 1).all() and (free[10:33] == 1).all() and result.sum() == free.sum() == 23


def test_chunks_of_two_shapes_and_of_many() -> None:
    """Few shapes are compiled where asked; else small meshes are cut so that all cores have work."""
    counts = np.geomspace(10, 1e6, 40).astype(int)
    assert len({chunk_size(int(count), 8, two_shapes=True) for count in counts}) == 2
    assert len({chunk_size(int(count), 8) for count in counts}) > 4
    assert 10_000 / chunk_size(10_000, 64) >= 8
    assert chunk_size(1_000_000, 64) * 64 == tracing.RAYS_PER_CHUNK
