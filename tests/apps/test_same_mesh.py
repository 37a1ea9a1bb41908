"""Files of one mesh are compared, of two never."""

import numpy as np
import pytest

from gash_jax.apps.same_mesh import check_same_mesh
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import icosphere

BAKE = bake_transfer(icosphere(1), 2, 4)


def test_the_same_mesh_may_be_stored_a_little_differently() -> None:
    check_same_mesh(BAKE, BAKE._replace(vertices=BAKE.vertices * np.float32(1 + 1e-7)))


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        (bake_transfer(icosphere(2), 2, 4), "different meshes .42 and 162 vertices"),
        (BAKE._replace(faces=BAKE.faces[:, [1, 2, 0]]), "different meshes .42 and 42 vertices"),
        (BAKE._replace(vertices=BAKE.vertices + np.float32(1e-4)), "vertices moved"),
        (bake_transfer(icosphere(1), 3, 4), "2 and 3 bands"),
    ],
    ids=["count", "faces", "moved", "bands"],
)
def test_what_cannot_be_compared_is_refused(other, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        check_same_mesh(BAKE, other)
