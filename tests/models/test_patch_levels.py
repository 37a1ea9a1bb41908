"""Directions go where they take away most error for their bytes, and their tables give back what they were made of."""

from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gash_jax.models.patch_levels import (
    ENDS,
    LARGEST,
    LEVELS,
    Patches,
    as_whole_numbers,
    level_arrays,
    say_levels,
    share_levels,
)

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
    return sum(ENDS[level] * (K * count + 4 * POSES) for level, count in zip(given, vertices, strict=True))


def test_by_hand_the_next_level_is_the_one_that_takes_away_most_per_byte() -> None:
    energy = np.zeros((2, ENDS[-1]))
    energy[0, :4], energy[1, :4] = [100, 1, 1, 1], [60, 50, 1, 1]
    vertices, one = np.array([10, 10]), K * 10 + 4 * POSES
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
        expected, allowed = patches.mean.astype(float), np.full((8, K), 1e-4)
        for vertex, patch in enumerate(PATCH):
            kept = ENDS[given[patch]]
            scores = kernel[patch] @ patches.weights[patch, :, :kept]
            expected[vertex] += patches.basis[vertex, :, :kept].astype(float) @ scores
            own = np.abs(patches.basis[PATCH == patch][..., :kept].astype(float)).max(axis=(0, 1))
            allowed[vertex] += 0.51 / LARGEST * own @ np.abs(scores)  # directions are rounded to whole numbers
        types = {name: np.int8 if name.startswith("directions") else np.float32 for name in tables}
        held = {name: jnp.asarray(np.asarray(array, types[name])) for name, array in tables.items()}
        found = say_levels(held, jnp.asarray(kernel[tables["order"]]))
        assert np.all(np.abs(found - expected) <= allowed)
        turned = jax.jit(say_levels)(held, jnp.asarray(kernel[tables["order"]]))
        np.testing.assert_allclose(turned, found, rtol=1e-5, atol=1e-5)
        assert sum(len(tables[f"directions/{level}"]) for level in range(len(LEVELS))) == sum(
            given[patch] for patch in PATCH
        )


def test_directions_are_whole_numbers_that_their_weights_know_the_worth_of() -> None:
    patches = some_patches()
    patches.basis[PATCH == 1] = 0  # a patch where nothing changes
    numbers, weights = as_whole_numbers(patches)
    assert numbers.dtype == np.int8 and np.abs(numbers.astype(int)).max() == LARGEST
    for patch in range(3):
        own = PATCH == patch
        told = numbers[own].astype(float)[..., None] * weights[patch].T
        real = patches.basis[own].astype(float)[..., None] * patches.weights[patch].T.astype(float)
        most = np.abs(real).max(axis=(0, 1), keepdims=True)
        assert np.all(np.abs(told - real) <= 0.51 / LARGEST * most + 1e-9)
    assert not numbers[PATCH == 1].any() and np.isfinite(weights).all()
