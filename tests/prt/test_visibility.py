"""Embree and the brute-force oracle agree ray by ray, except for rays that float32 cannot call."""

import numpy as np
import pytest

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.embree import embree_closest_hit
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.sampling import sample_rays
from gash_jax.prt.visibility import visibility
from gash_jax.shapes.primitives import bumpy_sphere, spherical_bowl, two_plates, v_groove
from gash_jax.shapes.procedural import make_shape
from tests.helpers.grazing import grazing_rays

MESHES = {
    "bumpy sphere": lambda: bumpy_sphere(10),
    "bowl": lambda: spherical_bowl(np.radians(60), 10),
    "groove": lambda: v_groove(np.radians(70), 20.0, 6),
    "plates": lambda: two_plates(0.5, 2.0),
    "blobs": lambda: make_shape(3, 0, vertices=(300, 500))[1],
    "bracket": lambda: make_shape(3, 5, vertices=(300, 500))[1],
}
RAYS = 32
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32), np.array([[0, 1, 2]], np.int32)


def _rays(mesh: Mesh, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    geometry = trace_geometry(mesh)
    rng = np.random.default_rng(seed)
    active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    rows = rng.choice(active, min(200, len(active)), replace=False)
    shifts = rng.random((len(rows), 1, 2), np.float32)
    rays = sample_rays(geometry.origins[rows], orthonormal_frame(mesh.normals[rows]), shifts, RAYS)
    return np.asarray(rays[0]), np.asarray(rays[1])


@pytest.mark.parametrize("name", MESHES)
def test_backends_agree_ray_by_ray(name: str, record_property, capsys) -> None:
    mesh = MESHES[name]()
    geometry = trace_geometry(mesh)
    origins, directions = _rays(mesh)
    answers = [visibility(geometry.vertices, geometry.faces, b)(origins, directions) for b in ("embree", "jax")]
    grazing = grazing_rays(geometry.vertices, geometry.faces, origins, directions, geometry.offset)
    different = answers[0] != answers[1]
    with capsys.disabled():
        print(f" {name}: {different.sum()} of {len(different)} rays differ, {grazing.sum()} graze;", end="")
    assert not np.any(different & ~grazing)
    assert grazing.mean() < 0.05  # else the check would excuse too much
    assert different.mean() < 1e-3
    assert 0.02 < (~answers[0]).mean() < 0.98  # the meshes shadow themselves, else nothing was compared


@pytest.mark.parametrize("backend", ["embree", "jax"])
@pytest.mark.parametrize(
    ("origin", "direction", "free"),
    [
        ([0.2, 0.2, 1], [0, 0, -1], False),  # from above
        ([0.2, 0.2, -1], [0, 0, 1], False),  # from below: two-sided
        ([0.2, 0.2, 1], [0, 0, 1], True),  # away
        ([0.9, 0.9, 1], [0, 0, -1], True),  # beside
        ([0.2, 0.2, 1], [1, 0, 0], True),  # parallel
    ],
)
def test_one_triangle_by_hand(backend: str, origin: list, direction: list, free: bool) -> None:
    rays = np.array([origin], np.float32), np.array([direction], np.float32)
    assert visibility(*TRIANGLE, backend)(*rays).tolist() == [free]


def test_the_agreement_check_notices_a_wrong_backend() -> None:
    mesh = MESHES["bowl"]()
    geometry = trace_geometry(mesh)
    origins, directions = _rays(mesh)
    truth = visibility(geometry.vertices, geometry.faces)(origins, directions)
    flipped = visibility(geometry.vertices, geometry.faces[1:])(origins, directions)  # one face forgotten
    grazing = grazing_rays(geometry.vertices, geometry.faces, origins, directions, geometry.offset)
    assert np.any((truth != flipped) & ~grazing)


def test_closest_hit_by_hand() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]], np.float32)
    closest = embree_closest_hit(vertices, np.array([[0, 1, 2], [3, 4, 5]], np.int32))
    hits = closest(np.array([[0.25, 0.5, 3], [2, 2, 3]], np.float32), np.array([[0, 0, -1], [0, 0, -1]], np.float32))
    assert hits.face.tolist() == [1, -1]
    np.testing.assert_allclose([hits.u[0], hits.v[0], hits.distance[0]], [0.25, 0.5, 2.0], atol=1e-6)


def test_unknown_backend_is_named() -> None:
    with pytest.raises(ValueError, match="choose one of embree, jax"):
        visibility(*TRIANGLE, "optix")
