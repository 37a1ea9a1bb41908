"""Directions go where they take away most error for their bytes, and their tables give back what they were made of."""

from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gash_jax.models.patch_levels import ENDS, LEVELS, Patches, level_arrays, say_levels, share_levels

RNG = np.random.default_rng(7)
PATCH = np.array([2, 0, 0, 1, 2, 2, 0, 2])
K, POSES = 4, 5


def energies(count: int) -> np.ndarray:
    return -np.sort(-(RNG.exponential(size=(count, ENDS[-1])) ** 4), axis=1)


def some_patches() -> Patches:
    mean, basis = RNG.normal(size=(8, K)), RNG.normal(size=(8, K, ENDS[-1]))
    weights = RNG.normal(size=(3, POSES, ENDS[-1])).astype(np.float32)
    return Patches(PATCH, mean.astype(np.float32), basis.astype(np.float16), weights, energies(3))


def bytes_of(given: np.ndarray, vertices: np.ndarray) -> float:
    return sum(ENDS[level] * (2 * K * count + 4 * POSES) for level, count in zip(given, vertices, strict=True))


def test_by_hand_the_next_level_is_the_one_that_takes_away_most_per_byte() -> None:
    energy = np.zeros((2, ENDS[-1]))
    energy[0, :4], energy[1, :4] = [100, 1, 1, 1], [60, 50, 1, 1]
    vertices, one = np.array([10, 10]), 2 * K * 10 + 4 * POSES
    assert share_levels(energy, vertices, K, POSES, 1.0 * one).tolist() == [1, 0]
    assert share_levels(energy, vertices, K, POSES, 2.0 * one).tolist() == [1, 1]
    assert share_levels(energy, vertices, K, POSES, 3.0 * one).tolist() == [1, 2]
    assert share_levels(energy, vertices, K, POSES, 1e9).tolist() == [3, 3]  # nothing is left to take away
    assert share_levels(energy, np.array([10, 0]), K, POSES, 1e9).tolist() == [3, 0]  # no vertex, no level


def test_no_other_choice_of_its_bytes_takes_away_more() -> None:
    """Levels of one direction of the same bytes each: then the first choice is the best."""
    energy, vertices = energies(3), np.array([2, 2, 2])
    energy[:, 2:] = 0
    for room in (50.0, 100.0, 150.0, 200.0):
        given = share_levels(energy, vertices, K, POSES, room)
        spent = bytes_of(given, vertices)
        assert spent <= room
        taken = sum(energy[patch, : ENDS[level]].sum() for patch, level in enumerate(given))
        for other in product(range(3), repeat=3):
            if bytes_of(np.array(other), vertices) <= spent:
                assert sum(energy[patch, : ENDS[level]].sum() for patch, level in enumerate(other)) <= taken + 1e-12


def test_more_room_is_never_fewer_levels() -> None:
    energy, vertices, before = energies(6), RNG.integers(1, 30, 6), 0.0
    for room in np.geomspace(1e2, 1e6, 12).tolist():
        given = share_levels(energy, vertices, K, POSES, room)
        taken = sum(energy[patch, : ENDS[level]].sum() for patch, level in enumerate(given))
        assert taken >= before
        before = taken
    assert share_levels(energy, vertices, K, POSES, 1e6).tolist() == [len(LEVELS)] * 6


def test_tables_give_back_what_was_kept() -> None:
    patches = some_patches()
    kernel = RNG.normal(size=(3, POSES)).astype(np.float32)
    for room in (0.0, 150.0, 700.0, 1e9):
        tables: Any = level_arrays(patches, room)
        given = share_levels(patches.energy, np.bincount(PATCH), K, POSES, room)
        expected = patches.mean.astype(float)
        for vertex, patch in enumerate(PATCH):
            kept = ENDS[given[patch]]
            scores = kernel[patch] @ patches.weights[patch, :, :kept]
            expected[vertex] += patches.basis[vertex, :, :kept].astype(float) @ scores
        held = {name: jnp.asarray(np.asarray(array, np.float32)) for name, array in tables.items()}
        found = say_levels(held, jnp.asarray(kernel[tables["order"]]))
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)
        turned = jax.jit(say_levels)(held, jnp.asarray(kernel[tables["order"]]))
        np.testing.assert_allclose(turned, found, rtol=1e-5, atol=1e-5)
        assert sum(len(tables[f"basis/{level}"]) for level in range(len(LEVELS))) == sum(
            given[patch] for patch in PATCH
        )
