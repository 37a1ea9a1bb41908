"""Embree and the brute-force oracle agree ray by ray, except for rays that float32 cannot call."""

import sys
from typing import Any

import numpy as np
import pytest

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.rays import Hits, trace_geometry
from gash_jax.prt.sampling import sample_rays
from gash_jax.prt.visibility import closest_hit, visibility
from gash_jax.shapes.primitives import bumpy_sphere, icosphere, spherical_bowl, two_plates, v_groove
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


@pytest.mark.parametrize("backend", ["embree", "jax"])
def test_closest_hit_by_hand(backend: str) -> None:
    """Two triangles one above the other; u and v weigh the second and the third corner. The second ray passes by."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]], np.float32)
    closest = closest_hit(vertices, np.array([[0, 1, 2], [3, 4, 5]], np.int32), backend)
    hits = closest(np.array([[0.25, 0.5, 3], [2, 2, 3]], np.float32), np.array([[0, 0, -1], [0, 0, -1]], np.float32))
    assert hits.face.tolist() == [1, -1]
    np.testing.assert_allclose([hits.u[0], hits.v[0], hits.distance[0]], [0.25, 0.5, 2.0], atol=1e-6)
    assert hits.u[1] == hits.v[1] == 0 and hits.distance[1] > 1e36


def _disagreement(mesh: Mesh, one: Hits, other: Hits) -> np.ndarray:
    """Per ray, how far two answers are apart: in barycentrics where they name one face, else in the point that is met,
    as on an edge that two faces share."""
    met = []
    for hits in (one, other):
        weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], -1)
        met.append(np.einsum("rj,rjc->rc", weights, trace_geometry(mesh).vertices[mesh.faces[hits.face]]))
    apart = np.linalg.norm(met[0] - met[1], axis=1)
    barycentrics = np.maximum(np.abs(one.u - other.u), np.abs(one.v - other.v))
    hit = (one.face >= 0) & (other.face >= 0)
    answers = np.where(one.face == other.face, barycentrics, apart)
    return np.where(hit, answers, np.where(one.face == other.face, 0.0, np.inf))


@pytest.mark.parametrize("name", MESHES)
def test_nearest_faces_and_barycentrics_agree_ray_by_ray(name: str) -> None:
    mesh = MESHES[name]()
    geometry = trace_geometry(mesh)
    origins, directions = _rays(mesh, seed=1)
    embree, jax = (closest_hit(geometry.vertices, geometry.faces, b)(origins, directions) for b in ("embree", "jax"))
    clear = ~grazing_rays(geometry.vertices, geometry.faces, origins, directions, geometry.offset)
    assert _disagreement(mesh, embree, jax)[clear].max() < 1e-4
    np.testing.assert_array_equal(embree.face[clear], jax.face[clear])
    hit = clear & (embree.face >= 0)
    assert hit.sum() > 50
    np.testing.assert_allclose(embree.distance[hit], jax.distance[hit], rtol=1e-4, atol=1e-5)
    # the check on known-bad input: corners in another order, faces in another order
    swapped = embree._replace(u=embree.v, v=embree.u)
    assert _disagreement(mesh, swapped, jax)[hit].max() > 0.1
    moved = embree._replace(face=np.where(embree.face >= 0, (embree.face + 1) % len(mesh.faces), -1))
    assert _disagreement(mesh, moved, jax)[hit].max() > 0.1


def test_rays_at_shared_edges_and_corners_meet_one_of_their_faces() -> None:
    """Rays aimed at the middle of edges and at corners of a closed ball: which face is a matter of rounding, the point
    is not. Embree lets none through; by the plain formula of the brute force some pass between two faces."""
    ball = icosphere(2)
    geometry = trace_geometry(ball)
    corners = geometry.vertices[ball.faces]
    targets = np.concatenate([(corners[:, 0] + corners[:, 1]) / 2, corners[:, 2]]).astype(np.float32)
    origins = np.broadcast_to(np.array([0.02, -0.05, 0.03], np.float32), targets.shape).copy()
    answers = [closest_hit(geometry.vertices, geometry.faces, b)(origins, targets - origins) for b in ("embree", "jax")]
    for hits, least in zip(answers, (1, 0.9), strict=True):
        met = hits.face >= 0
        assert met.mean() >= least
        weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], -1)[met]
        points = np.einsum("rj,rjc->rc", weights, geometry.vertices[ball.faces[hits.face[met]]])
        np.testing.assert_allclose(points, targets[met], atol=1e-5)
        np.testing.assert_allclose(hits.distance[met], 1, atol=1e-5)
    both = (answers[0].face >= 0) & (answers[1].face >= 0)
    assert _disagreement(ball, *answers)[both].max() < 1e-4


def test_unknown_backend_is_named() -> None:
    with pytest.raises(ValueError, match="choose one of embree, jax, warp"):
        visibility(*TRIANGLE, "optix")


@pytest.mark.parametrize("build", [visibility, closest_hit])
def test_a_backend_that_is_not_installed_says_what_to_install(build: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "warp", None)
    with pytest.raises(ValueError, match=r"pip install warp-lang \(or gash-jax\[warp\]\), or take \"embree\""):
        build(*TRIANGLE, "warp")
