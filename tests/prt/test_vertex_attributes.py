"""Coefficients as vertex attributes: names, columns, what rounding does."""

import numpy as np
import pytest

from gash_jax.prt.vertex_attributes import read_back, stored, vertex_attributes

RNG = np.random.default_rng(4)
COEFFICIENTS = RNG.normal(size=(50, 16)) * 0.3


def _decoded(found, extras, columns: int) -> np.ndarray:
    """As a shader would: scale times what the loader normalised, plus offset."""
    whole = np.concatenate([attribute.values for attribute in found], axis=1)
    plain = whole if whole.dtype.kind == "f" else whole / {1: 127, 2: 32767}[whole.dtype.itemsize]
    if whole.dtype.kind == "u":
        plain = whole / {1: 255, 2: 65535}[whole.dtype.itemsize]
    return (plain * np.array(extras["scale"]) + np.array(extras["offset"]))[:, :columns]


@pytest.mark.parametrize(("store", "levels"), [("float", 2e7), ("short", 32767), ("byte", 127)])
def test_sixteen_numbers_are_four_attributes(store: str, levels: float) -> None:
    found, extras, error = vertex_attributes(COEFFICIENTS, "sh", store, 0)
    assert [attribute.name for attribute in found] == ["_SH0", "_SH1", "_SH2", "_SH3"]
    assert all(attribute.values.shape == (50, 4) for attribute in found)
    assert extras["coefficients"] == 16 and extras["stored"] == store
    difference = np.abs(_decoded(found, extras, 16) - COEFFICIENTS).max(axis=0)
    assert np.all(difference <= 0.51 * np.abs(COEFFICIENTS).max(axis=0) / levels + 1e-7 * (store == "float"))
    assert error == pytest.approx(difference.max(), abs=1e-9)


@pytest.mark.parametrize(("store", "levels"), [("float", 2e7), ("short", 65535), ("byte", 255)])
def test_texture_coordinates_are_unsigned_pairs_after_the_first_sets(store: str, levels: float) -> None:
    found, extras, _ = vertex_attributes(COEFFICIENTS[:, :9], "uv", store, 2)
    assert [attribute.name for attribute in found] == [f"TEXCOORD_{n}" for n in (2, 3, 4, 5, 6)]
    assert all(attribute.values.dtype.kind in "fu" and attribute.values.shape == (50, 2) for attribute in found)
    difference = np.abs(_decoded(found, extras, 9) - COEFFICIENTS[:, :9]).max(axis=0)
    assert np.all(difference <= 0.51 * np.ptp(COEFFICIENTS[:, :9], axis=0) / levels + 1e-7 * (store == "float"))


def test_columns_are_padded_with_zeros_and_colours_follow_each_other() -> None:
    coloured = RNG.normal(size=(5, 9, 3))
    found, extras, _ = vertex_attributes(coloured, "sh", "float", 0)
    assert [attribute.name for attribute in found] == [f"_SH{colour}{i}" for colour in "RGB" for i in range(3)]
    assert extras["channels"] == 3 and len(found) + 3 <= 16  # with position, normal and texture: WebGL's limit
    np.testing.assert_allclose(found[3].values, coloured[:, :4, 1], atol=1e-7)
    np.testing.assert_array_equal(found[2].values[:, 1:], 0.0)


def test_by_hand() -> None:
    values, scale, offset = stored(np.array([[0.5, 0.0], [-1.0, 0.0], [1.0, 0.0]]), "byte", signed=True)
    assert values.tolist() == [[64, 0], [-127, 0], [127, 0]] and scale.tolist() == [1.0, 1.0]
    values, scale, offset = stored(np.array([[0.0, 2.0], [3.0, 2.0]]), "short", signed=False)
    assert values.tolist() == [[0, 0], [65535, 0]] and scale.tolist() == [3.0, 1.0] and offset.tolist() == [0.0, 2.0]
    assert read_back(np.array([[-128]], np.int8), np.ones(1), np.zeros(1)).tolist() == [[-1.0]]  # glTF 2.0, 3.6.2.2


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match=r"5 bands, and a \.glb holds 4: keep the first 4 \(--bands 4\)"):
        vertex_attributes(np.ones((2, 25)), "sh", "float", 0)
    with pytest.raises(ValueError, match="16 numbers need 8 sets of texture coordinates after the first 1"):
        vertex_attributes(np.ones((2, 16)), "uv", "float", 1)
    with pytest.raises(ValueError, match=r"27 numbers need 15 sets .*fewer bands \(--bands 2\)"):
        vertex_attributes(np.ones((2, 9, 3)), "uv", "float", 1)
