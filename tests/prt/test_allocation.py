"""Which vertices are doubled."""

from itertools import product

import numpy as np
import scipy.sparse as sp

from gash_jax.prt.allocation import VARIANCE, choose_doublings, choose_rays, lattice_variance, neighbour_mean
from gash_jax.shapes.primitives import icosphere


def test_lattice_variance_by_hand() -> None:
    """8 rays are the unit; beyond the table the variance falls by 2^-1.5 a doubling."""
    last = len(VARIANCE) - 1
    found = lattice_variance(np.array([0.0, 1.0, last, last + 2.0]))
    np.testing.assert_allclose(found, [1.0, VARIANCE[1], VARIANCE[-1], VARIANCE[-1] / 8], rtol=1e-6)


def test_doublings_by_hand() -> None:
    """Equal vertices double together, the urgent before the rest; one without variance never does."""
    rays, alone = np.full(4, 16), sp.csr_matrix(sp.identity(4))
    gain = VARIANCE[2] / VARIANCE[1]
    chosen, expected = choose_doublings(rays, np.array([1.0, 1.0, 1.0, 0.0]), alone, 3.0 * gain * 1.01)
    np.testing.assert_array_equal(chosen, [True, True, True, False])
    assert expected == 3 * 32 + 16
    chosen, _ = choose_doublings(rays, np.array([100.0, 1.0, 1.0, 1.0]), alone, 60.0)
    np.testing.assert_array_equal(chosen, [True, False, False, False])
    chosen, _ = choose_doublings(rays, np.array([4.0, 2.0, 1.0, 0.0]), alone, 7.0 * gain * 1.01)
    np.testing.assert_array_equal(chosen, [True, True, False, False])  # the more urgent half of three


def test_a_round_always_goes_on() -> None:
    """Where neighbours' means meet the budget and the vertices' own do not, the most urgent go on."""
    rays = np.full(40, 16)
    mean = sp.csr_matrix(np.zeros((40, 40)))
    chosen, _ = choose_doublings(rays, np.ones(40), mean, 1.0)
    assert chosen.any()


def test_neighbour_mean_by_hand() -> None:
    """Two triangles on one edge: corners 0 and 3 have two neighbours, 1 and 2 have three; edges count once."""
    mesh = icosphere(0)._replace(
        vertices=np.zeros((5, 3), np.float32),
        normals=np.ones((5, 3), np.float32),
        faces=np.array([[0, 1, 2], [2, 1, 3], [0, 1, 2]], np.int32),
    )
    found = neighbour_mean(mesh, np.array([0, 1, 2, 3, 4])) @ np.array([12.0, 0, 0, 0, 7.0])
    np.testing.assert_allclose(found, [8.0, 1.5, 1.5, 0.0, 7.0], rtol=1e-6)
    without_one = neighbour_mean(mesh, np.array([0, 2, 3])) @ np.array([12.0, 0.0, 0.0])
    np.testing.assert_allclose(without_one, [9.0, 2.0, 0.0], rtol=1e-6)


def test_rays_are_chosen_to_meet_the_budget_with_the_fewest() -> None:
    """Against every combination of up to four doublings of five vertices."""
    rng = np.random.default_rng(0)
    rays, variance, rate = np.full(5, 8), rng.uniform(0.1, 4, 5), 1.2
    for share in (0.6, 0.3, 0.1):
        budget = share * float(variance.sum())
        wanted = choose_rays(rays, variance, budget, rate)
        assert np.sum(variance * (wanted / rays) ** -rate) <= budget * (1 + 1e-9)
        every = 2.0 ** np.array(list(product(range(5), repeat=5)))
        good = np.sum(variance * every**-rate, axis=1) <= budget
        fewest = 8 * every[good].sum(axis=1).min()
        assert fewest <= wanted.sum() <= 1.35 * fewest


def test_rays_that_suffice_stay() -> None:
    rays = np.array([8, 64, 16])
    np.testing.assert_array_equal(choose_rays(rays, np.ones(3), 5.0, 1.0), rays)
