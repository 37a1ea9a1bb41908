"""What rays find where they meet surfaces: fronts and backs, interpolation, the sums that are kept."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, face_normals
from gash_jax.prt.rays import Hits
from gash_jax.prt.reflection import Reflector, keep_hits, meets_front, reflector, sums_at_hits, values_at_hits
from gash_jax.shapes.primitives import bumpy_sphere, patch

DOWN, UP = np.array([0.0, -1, 0]), np.array([0.0, 1, 0])
FLOOR = patch(np.zeros(3), np.array([0.0, 0, 1]), np.array([1.0, 0, 0]))  # faces up


def _random(rows: int, n: int, seed: int = 0) -> tuple[Reflector, Hits, np.ndarray]:
    """A bumpy ball and hits anywhere on it, some rays free, from any side."""
    rng, surface = np.random.default_rng(seed), reflector(bumpy_sphere(3))
    face = rng.integers(-1, len(surface.faces), (rows, n)).astype(np.int32)
    u = rng.random((rows, n), np.float32)
    directions = rng.normal(size=(rows, n, 3)).astype(np.float32)
    return (
        surface,
        Hits(face, u, (1 - u) * rng.random((rows, n), np.float32), np.ones((rows, n), np.float32)),
        directions,
    )


def test_fronts_follow_the_normals_and_not_the_winding() -> None:
    wound = FLOOR._replace(faces=FLOOR.faces[:, ::-1])
    for mesh, up in ((FLOOR, 1), (wound, 1), (FLOOR._replace(normals=-FLOOR.normals), -1)):
        np.testing.assert_allclose(reflector(mesh).fronts, np.broadcast_to(up * UP, (2, 3)), atol=1e-7)
    blind = FLOOR._replace(normals=0 * FLOOR.normals)
    np.testing.assert_allclose(reflector(blind).fronts, face_normals(FLOOR.vertices, FLOOR.faces), atol=1e-7)
    point = Mesh(FLOOR.vertices, FLOOR.normals, np.array([[0, 0, 0]], np.int32))
    assert not reflector(point).fronts.any()


def test_a_ray_from_behind_finds_nothing() -> None:
    hits = Hits(np.array([0, 0, -1], np.int32), *(np.full(3, 0.25, np.float32),) * 3)
    directions = np.stack([DOWN, UP, DOWN]).astype(np.float32)
    np.testing.assert_array_equal(meets_front(reflector(FLOOR), hits, directions), [True, False, False])
    along = np.broadcast_to(np.array([1, 0, 0], np.float32), (3, 3))
    assert not meets_front(reflector(FLOOR), hits, along).any()


def test_interpolation_by_hand() -> None:
    """u, v = 1/4, 1/2 of the face (0, 1, 3): a quarter of corner 0, a quarter of 1, half of 3."""
    assert FLOOR.faces[0].tolist() == [0, 1, 3]
    hits = Hits(np.zeros((1, 1), np.int32), np.full((1, 1), 0.25, np.float32), *(np.full((1, 1), 0.5, np.float32),) * 2)
    values = np.array([[1.0, 10], [2, 20], [99, 99], [3, 30]], np.float32)
    found = values_at_hits(reflector(FLOOR), hits, DOWN[None, None].astype(np.float32), values)
    np.testing.assert_allclose(found, [[[2.25, 22.5]]])
    kept = keep_hits(reflector(FLOOR), hits, DOWN[None, None].astype(np.float32))
    np.testing.assert_allclose(sums_at_hits(reflector(FLOOR), kept, values[:, None], 2.0), [[[4.5, 45]]], rtol=3e-5)


@pytest.mark.parametrize("replicates", [1, 3])
def test_sums_are_those_of_the_single_rays(replicates: int) -> None:
    """Oracle: every ray by itself, row j from replicate j mod r; weights are kept to 1/65535."""
    surface, hits, directions = _random(12, 40)
    values = np.random.default_rng(1).normal(size=(92, replicates, 5)).astype(np.float32)
    sums = sums_at_hits(surface, keep_hits(surface, hits, directions), values, 0.1).reshape(12, 5)
    for row in range(12):
        own = Hits(*(array[row] for array in hits))
        single = values_at_hits(surface, own, directions[row], values[:, row % replicates])
        np.testing.assert_allclose(sums[row], 0.1 * single.sum(0), atol=2e-4)
        assert np.abs(single).max() > 0.1


def test_kept_hits_take_eight_bytes_and_weigh_one() -> None:
    surface, hits, directions = _random(50, 64)
    kept = keep_hits(surface, hits, directions)
    assert kept.face.nbytes + kept.weights.nbytes == 8 * len(kept.face) == 8 * kept.starts[-1]
    ones = np.ones((92, 1, 1), np.float32)
    sums = sums_at_hits(surface, kept, ones, 1 / 64)[:, 0, 0]
    np.testing.assert_allclose(sums, np.diff(kept.starts) / 64, rtol=1e-6)
    edge = Hits(np.zeros((1, 2), np.int32), *(np.array([[1.0000001, -1e-7]], np.float32),) * 3)
    rim = keep_hits(surface, edge, -np.broadcast_to(surface.fronts[0], (1, 2, 3)))
    np.testing.assert_array_equal(rim.weights, [[65535, 0], [0, 0]])


def test_nothing_to_find() -> None:
    surface, hits, directions = _random(3, 8)
    free = hits._replace(face=np.full_like(hits.face, -1))
    kept = keep_hits(surface, free, directions)
    assert kept.nbytes < 100 and not sums_at_hits(surface, kept, np.ones((92, 1, 2), np.float32), 1.0).any()
    assert not values_at_hits(surface, free, directions, np.ones((92, 2), np.float32)).any()
