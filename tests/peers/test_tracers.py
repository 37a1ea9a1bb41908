"""Other ray tracers give the plain bake, live. Needs the extra `peers`; those that are not installed are skipped."""

import numpy as np
import pytest

from gash_jax.apps.frontier.traced import Unavailable, peer_bake
from gash_jax.apps.frontier.tracers import TRACERS
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import bumpy_sphere


@pytest.mark.parametrize("name", TRACERS)
def test_a_tracer_gives_the_plain_bake_of_the_same_seed(name: str) -> None:
    mesh = bumpy_sphere(5)
    try:
        run = peer_bake(name, mesh, 3, 16)
    except Unavailable as reason:
        pytest.skip(str(reason))
    plain = bake_transfer(mesh, 3, 16, replicates=1, seed=5).coefficients
    # a ray that only just misses an edge may be called otherwise: single rays of single vertices
    assert (np.abs(run(5).coefficients - plain).max(axis=1) > 1e-5).mean() < 0.05
