"""Which vertices a file has more than once: by hand, against a search over all pairs, and in any order."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.repeated_vertices import STEPS, first_of_repeated
from tests.helpers.split import split_mesh

UP, SIDE = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)


def _first(*rows: tuple[tuple[float, ...], tuple[float, ...]]) -> list[int]:
    places, normals = (np.array(column, np.float32) for column in zip(*rows, strict=True))
    return first_of_repeated(places, normals).tolist()


def test_by_hand() -> None:
    here, there = (0.0, 2.0, 3.0), (1.0, 2.0, 3.0)
    # two sides of a hard edge stay two, and so do two places
    assert _first((here, UP), (there, UP), (here, SIDE), (here, UP), (there, UP)) == [0, 1, 2, 0, 1]
    assert _first((here, UP), (there, UP)) == [0, 1]
    # 0 has no sign, and a normal need not agree to the last bit
    assert _first((here, UP), ((-0.0, 2.0, 3.0), (-0.0, 1 - 1e-6, 0.0))) == [0, 0]
    assert _first((here, UP), (here, (2 / STEPS, 1.0, 0.0))) == [0, 1]


def test_no_vertices() -> None:
    assert first_of_repeated(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32)).tolist() == []


@pytest.mark.parametrize("seed", range(3))
def test_against_all_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places, normals = rng.integers(0, 3, (60, 3)).astype(np.float32), rng.integers(-1, 2, (60, 3)).astype(np.float32)
    rows = np.concatenate([places, normals], axis=1)
    expected = (rows[:, None] == rows[None]).all(axis=2).argmax(axis=1)
    assert len(np.unique(expected)) < 60
    np.testing.assert_array_equal(first_of_repeated(places, normals), expected)
    # in another order the same ones are together
    order = rng.permutation(60)
    shuffled, before = first_of_repeated(places[order], normals[order]), expected[order]
    np.testing.assert_array_equal(shuffled[:, None] == shuffled, before[:, None] == before)


def test_a_split_mesh(bumpy: Mesh) -> None:
    split, of = split_mesh(bumpy)
    assert len(of) > len(bumpy.vertices)
    np.testing.assert_array_equal(first_of_repeated(split.vertices, split.normals), of)
    np.testing.assert_array_equal(first_of_repeated(bumpy.vertices, bumpy.normals), np.arange(len(bumpy.vertices)))
