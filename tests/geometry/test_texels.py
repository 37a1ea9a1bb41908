import numpy as np
import pytest

from gash_jax.geometry import texels as module
from gash_jax.geometry.bilinear import taps
from gash_jax.geometry.texels import REACH, find_texels
from tests.helpers.textured import SQUARE, SQUARE_UV, dented_sheet, split_square


def _centres(found: module.Texels, size: int) -> np.ndarray:
    row, column = np.divmod(found.texel, size)
    return (np.stack([column, row], axis=1) + 0.5) / size


def _points(found: module.Texels, corners: np.ndarray) -> np.ndarray:
    return np.einsum("ti,tij->tj", found.barycentric, corners[found.face])


def _brute_force(uv: np.ndarray, size: int) -> np.ndarray:
    """Distance in texels of every centre to every face, by its three edges: (n * n, f)."""
    row, column = np.divmod(np.arange(size**2), size)
    p = np.stack([column, row], axis=1)[:, None] - (uv.astype(np.float64) * size - 0.5)[:, 0]
    a = np.zeros(uv.shape[:1] + (2,))
    b, c = ((uv[:, k].astype(np.float64) - uv[:, 0]) * size for k in (1, 2))
    best = np.full(p.shape[:2], np.inf)
    signs = []
    for start, end in ((a, b), (b, c), (c, a)):
        edge, apart = end - start, p - start
        t = np.clip((apart * edge).sum(-1) / np.maximum((edge**2).sum(-1), 1e-300), 0, 1)
        best = np.minimum(best, np.linalg.norm(apart - t[..., None] * edge, axis=-1))
        signs.append(edge[:, 0] * apart[..., 1] - edge[:, 1] * apart[..., 0])
    area = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
    inside = np.all(np.stack(signs) * np.sign(area) >= 0, axis=0) & (area != 0)
    return np.where(inside, 0.0, best)


def test_a_square_by_hand() -> None:
    found = find_texels(SQUARE_UV, 4)
    assert found.inside.all() and found.doubled == 0
    np.testing.assert_array_equal(found.texel, np.arange(16))
    positions = _points(found, SQUARE.vertices[SQUARE.faces])
    # row 0 is the upper edge y = 1 of the square
    np.testing.assert_allclose(positions[0], [0.125, 0.875, 0], atol=1e-6)
    np.testing.assert_allclose(positions[-1], [0.875, 0.125, 0], atol=1e-6)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("size", [1, 3, 16])
def test_against_every_face_for_every_texel(size: int, mirrored: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BLOCK", 37)  # blocks end anywhere
    random = np.random.default_rng(size)
    uv = random.random((12, 1, 2)) * 0.8 + random.random((12, 3, 2)) * 0.2
    uv = (uv[:, ::-1] if mirrored else uv).astype(np.float32)
    distances = _brute_force(uv, size)
    found = find_texels(uv, size)
    np.testing.assert_array_equal(found.texel, np.flatnonzero(distances.min(axis=1) < REACH))
    nearest = distances[found.texel].min(axis=1)
    np.testing.assert_allclose(distances[found.texel, found.face], nearest, atol=1e-5)
    np.testing.assert_array_equal(found.inside, nearest == 0)
    apart = np.linalg.norm(_points(found, uv) - _centres(found, size), axis=1) * size
    np.testing.assert_allclose(apart, nearest, atol=1e-4)
    np.testing.assert_allclose(found.barycentric.sum(axis=1), 1, atol=1e-5)
    assert found.barycentric.min() >= -1e-6


def test_whatever_a_face_looks_up_is_there() -> None:
    mesh, uv = dented_sheet()
    random = np.random.default_rng(3)
    for size in (2, 9, 40):
        found = find_texels(uv, size)
        weights = random.dirichlet([1, 1, 1], (len(mesh.faces), 20))
        index, shares = taps(np.einsum("fsi,fij->fsj", weights, uv).reshape(-1, 2), size)
        assert set(index[shares > 1e-6]) <= set(found.texel)


def test_faces_without_area_and_smaller_than_a_texel() -> None:
    point, line = np.full((3, 2), 0.5), np.array([[0.1, 0.1], [0.3, 0.1], [0.2, 0.1]])
    tiny = np.array([[0.76, 0.76], [0.761, 0.76], [0.76, 0.761]])
    found = find_texels(np.stack([point, line, tiny]).astype(np.float32), 8)
    assert (
        set(found.face) == {0, 1, 2} and np.isfinite(found.barycentric).all() and not found.inside[found.face < 2].any()
    )


def test_overlap_is_counted_and_touching_is_none() -> None:
    assert find_texels(split_square(), 32).doubled == 0
    assert find_texels(SQUARE_UV, 33).doubled == 0  # centres lie on the diagonal
    twice = find_texels(np.concatenate([SQUARE_UV, SQUARE_UV[:1]]), 16)
    assert twice.doubled == 15 * 16 // 2 and (twice.face < 2).all()
