"""The ray backend "warp" answers as Embree does, on whatever device JAX has. Needs the extra `warp`."""

import numpy as np
import pytest

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.sampling import sample_rays
from gash_jax.prt.visibility import closest_hit, visibility
from gash_jax.shapes.primitives import bumpy_sphere, spherical_bowl

pytest.importorskip("warp")
MESHES = {"bumpy sphere": bumpy_sphere(6), "bowl": spherical_bowl(np.radians(60), 8)}


@pytest.mark.parametrize("name", MESHES)
def test_it_answers_as_embree_does(name: str) -> None:
    mesh = MESHES[name]
    geometry, shifts = trace_geometry(mesh), np.random.default_rng(0).random((len(mesh.vertices), 1, 2), np.float32)
    rays = sample_rays(geometry.origins, orthonormal_frame(mesh.normals), shifts, 16)
    origins, directions = (np.asarray(array) for array in rays)
    scene = geometry.vertices, geometry.faces
    free = [visibility(*scene, backend)(origins, directions) for backend in ("embree", "warp")]
    assert free[1].dtype == bool and 0.1 < free[0].mean() < 0.99
    assert (free[0] != free[1]).mean() < 1e-3  # a ray that only just misses an edge may be called otherwise
    one, other = (closest_hit(*scene, backend)(origins, directions) for backend in ("embree", "warp"))
    assert (other.face == one.face).mean() > 0.99
    same = (other.face == one.face) & (one.face >= 0)
    for mine, theirs in zip(other[1:], one[1:], strict=True):
        np.testing.assert_allclose(mine[same], theirs[same], atol=1e-4)
    assert np.all(other.distance[other.face < 0] > 1e36) and not other.u[other.face < 0].any()


def test_whole_bakes() -> None:
    mesh = MESHES["bumpy sphere"]
    for options in ({}, {"bounces": 1, "albedo": 0.5}, {"glossy": True}):
        plain, found = (bake_transfer(mesh, rays=32, backend=name, **options) for name in ("embree", "warp"))  # type: ignore[arg-type]
        off = np.abs(found.coefficients - plain.coefficients).max(axis=1)
        assert (off > 1e-5).mean() < 0.05 and off.max() < 0.1
    assert found.metadata["parameters"]["backend"] == "warp"


def test_no_rays() -> None:
    mesh, none = MESHES["bowl"], np.zeros((0, 3), np.float32)
    assert visibility(mesh.vertices, mesh.faces, "warp")(none, none).shape == (0,)
    assert closest_hit(mesh.vertices, mesh.faces, "warp")(none, none).face.shape == (0,)
