"""Rays that are added to: the same lattice as all at once, right on average, finer together than apart."""

import numpy as np
import pytest

from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.few_rays import FewRays, continued_shifts, trace_first, trace_up_to
from gash_jax.prt.integrands import direct, to_world
from gash_jax.prt.sampling import korobov
from gash_jax.prt.scene import make_scene
from gash_jax.prt.tracing import Rows, active_rows, trace_rows
from gash_jax.prt.visibility import visibility
from gash_jax.shapes.primitives import bumpy_sphere


def _rows(count: int = 40) -> Rows:
    rng = np.random.default_rng(0)
    frames = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0].astype(np.float32)
    return Rows(np.zeros((count, 3), np.float32), frames, rng.random((count, 1, 2), np.float32))


def _visible(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    return directions[:, 0] + 0.3 * directions[:, 1] < 0.2


@pytest.mark.parametrize("wanted", [16, 128, 256])
def test_added_rays_are_the_lattice_of_all_of_them(wanted: int) -> None:
    """The free share counts the rays themselves: 8 + 8 + 16 + ... of them are the first `wanted` lattice points."""
    rows = _rows()
    few = trace_up_to(trace_first(rows, 8, 3, _visible), np.full(40, wanted), rows, 3, _visible)
    _, whole = trace_rows(rows, direct(3), wanted, _visible, lattice="korobov")
    np.testing.assert_array_equal(few.rays, wanted)
    np.testing.assert_allclose(few.share, whole, atol=1e-6)


def test_each_vertex_gets_what_it_wants_and_the_others_stay() -> None:
    rows = _rows(3)
    first = trace_first(rows, 8, 2, _visible)
    few = trace_up_to(first, np.array([8, 64, 16]), rows, 2, _visible)
    np.testing.assert_array_equal(few.rays, [8, 64, 16])
    np.testing.assert_array_equal(few.local[0], first.local[0])
    again = trace_up_to(few, np.array([64, 64, 64]), rows, 2, _visible)
    whole = trace_up_to(first, np.array([64, 64, 64]), rows, 2, _visible)
    np.testing.assert_allclose(again.share, whole.share, atol=1e-6)


def test_what_is_given_is_not_changed() -> None:
    rows = _rows(4)
    first = trace_first(rows, 8, 2, _visible)
    held = FewRays(*(array.copy() for array in first))
    trace_up_to(first, np.full(4, 32), rows, 2, _visible)
    for before, after in zip(held, first, strict=True):
        np.testing.assert_array_equal(before, after)


def test_shifts_continue_the_lattice_of_the_vertex_before() -> None:
    """Four vertices of 8 points, in the order given, are the 32 points of one lattice."""
    order = np.array([2, 0, 3, 1])
    shifts = continued_shifts(order, 8, seed=1)[order, 0].astype(np.float64)
    points = (korobov(np.arange(8))[None] + shifts[:, None]).reshape(-1, 2)
    whole = korobov(np.arange(32)) + shifts[0]
    apart = np.abs((points - whole + 0.5) % 1 - 0.5)
    assert apart.max() < 1e-6
    assert np.abs((points - korobov(np.arange(32)) + 0.5) % 1 - 0.5).max() > 1e-3


def test_lattices_that_grow_still_differ_between_neighbours() -> None:
    """Four vertices with 8 rays first: once each has 32, they are the 128 points of one lattice."""
    order = np.array([2, 0, 3, 1])

    def points(later: int | None) -> np.ndarray:
        """Those of all four with 32 rays each, relative to the first shift."""
        shifts = continued_shifts(order, 8, seed=1, later=later)[order, 0].astype(np.float64)
        return ((korobov(np.arange(32))[None] + (shifts - shifts[0])[:, None]).reshape(-1, 2) + 1e-6) % 1

    whole = np.sort((korobov(np.arange(128))[:, 0] + 1e-6) % 1)
    np.testing.assert_allclose(np.sort(points(32)[:, 0]), whole, atol=5e-7)
    assert len(np.unique(np.round(points(None), 5), axis=0)) == 32  # else all four would have the same


def test_halves_are_as_far_apart_as_they_are() -> None:
    """The squared distance between the estimate of half of the rays and that of all, in three bands."""
    rows = _rows()
    few = trace_first(rows, 8, 4, _visible)
    second = rows._replace(shifts=(rows.shifts + korobov(np.array([4])).astype(np.float32)) % 1)
    halves = [
        trace_rows(some, direct(4), 4, _visible, share=few.share, lattice="korobov")[0][:, 0] for some in (rows, second)
    ]
    np.testing.assert_allclose(few.local, (halves[0] + halves[1]) / 2, atol=1e-6)
    np.testing.assert_allclose(few.halves, np.sum((halves[0] - few.local)[:, :9] ** 2, axis=1), rtol=1e-3, atol=1e-9)
    part = trace_up_to(few, np.full(40, 16), rows, 4, _visible)
    once = trace_up_to(part, np.full(40, 32), rows, 4, _visible)
    np.testing.assert_allclose(once.halves, np.sum((once.local - part.local)[:, :9] ** 2, axis=1), rtol=1e-3, atol=1e-9)
    assert not trace_first(rows, 4, 2, _visible).halves.any()


def test_estimates_are_right_on_average() -> None:
    """z-test of the mean over seeds at all vertices, plain mean (share 0); a bake of many rays beside it."""
    mesh, seeds, rays = bumpy_sphere(6), 64, 8
    reference = bake_transfer(mesh, rays=8192, seed=5).coefficients
    geometry = make_scene(mesh).geometry
    visible, order = visibility(geometry.vertices, geometry.faces), np.arange(len(mesh.vertices))
    found = []
    for seed in range(seeds):
        _, rows = active_rows(mesh, geometry, None, continued_shifts(order, rays, seed))
        plain = np.zeros(len(order), np.float32)
        local, _ = trace_rows(rows, direct(3), rays, visible, share=plain, lattice="korobov")
        found.append(np.asarray(to_world(local, rows.frames))[:, 0])
    estimates = np.stack(found)
    error = estimates.std(axis=0, ddof=1) / np.sqrt(seeds)
    partly = error > 1e-3  # elsewhere the reference is off by as much
    assert partly.mean() > 0.5
    score = ((estimates.mean(axis=0) - reference) / error)[partly]
    # one shift moves all vertices, so the scores of one set of seeds lie on one side of 1 together
    assert 0.5 < np.sqrt(np.mean(score**2)) < 1.2
    shifted = ((estimates.mean(axis=0) + 0.01 - reference) / error)[partly]
    assert np.sqrt(np.mean(shifted**2)) > 1.2
