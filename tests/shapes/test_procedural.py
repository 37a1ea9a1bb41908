"""The corpus: the same in every process, usable by a bake, every kind in every round, closed where it says so."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, RawMesh
from gash_jax.shapes.procedural import SHAPE_KINDS, make_shape, shape_kind
from gash_jax.shapes.triangles import signed_volume

RANGE = (600, 1500)
ROUND = len(SHAPE_KINDS)
# they may have boundary edges; every other kind is closed
OPEN_KINDS = ("vessel", "sheet", "scene")


@pytest.fixture(scope="module")
def corpus() -> list[tuple[str, Mesh]]:
    return [make_shape(5, index, RANGE) for index in range(3 * ROUND)]


def digest(mesh: Mesh) -> str:
    return hashlib.sha256(mesh.vertices.tobytes() + mesh.normals.tobytes() + mesh.faces.tobytes()).hexdigest()


def directed_edges_cancel(faces: np.ndarray) -> bool:
    """Every directed edge has as many opposites: no boundary, one winding."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    forth, back = edges @ [10**7, 1], edges @ [1, 10**7]
    return bool(np.array_equal(np.sort(forth), np.sort(back)))


def test_each_round_holds_every_kind_once_in_an_order_of_its_own(corpus: list[tuple[str, Mesh]]) -> None:
    kinds = [kind for kind, _ in corpus]
    rounds = [kinds[start : start + ROUND] for start in range(0, len(kinds), ROUND)]
    assert all(sorted(kinds) == sorted(SHAPE_KINDS) for kinds in rounds)
    assert rounds[0] != rounds[1] != rounds[2]
    assert kinds == [shape_kind(5, index) for index in range(len(kinds))]


def test_shapes_are_finite_with_unit_normals_and_valid_faces(corpus: list[tuple[str, Mesh]]) -> None:
    for kind, mesh in corpus:
        assert np.isfinite(mesh.vertices).all(), kind
        assert set(np.unique(mesh.faces)) == set(range(len(mesh.vertices))), kind
        assert (np.diff(np.sort(mesh.faces, axis=1), axis=1) > 0).all(), kind
        length = np.linalg.norm(mesh.normals, axis=1)
        np.testing.assert_allclose(length, 1.0, atol=1e-5, err_msg=kind)


def test_closed_kinds_are_closed_with_the_inside_inside(corpus: list[tuple[str, Mesh]]) -> None:
    for kind, mesh in corpus:
        if kind not in OPEN_KINDS:
            assert directed_edges_cancel(mesh.faces), kind
            assert signed_volume(RawMesh(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64))) > 0, kind


def test_sheets_are_open(corpus: list[tuple[str, Mesh]]) -> None:
    assert not any(directed_edges_cancel(mesh.faces) for kind, mesh in corpus if kind == "sheet")


def test_vertex_budget(corpus: list[tuple[str, Mesh]]) -> None:
    counts = np.array([len(mesh.vertices) for _, mesh in corpus])
    assert counts.min() >= 0.7 * RANGE[0] and counts.max() <= 1.3 * RANGE[1]
    assert counts.min() < 750 and counts.max() > 1250  # the whole range is used


def test_every_shape_meets_its_count() -> None:
    for index in range(2 * ROUND):
        kind, mesh = make_shape(8, index, (700, 700))
        assert 0.7 * 700 <= len(mesh.vertices) <= 1.3 * 700, (kind, len(mesh.vertices))


def test_no_shape_comes_twice(corpus: list[tuple[str, Mesh]]) -> None:
    digests = {digest(mesh) for _, mesh in corpus}
    assert len(digests) == len(corpus)
    assert digest(make_shape(6, 0, RANGE)[1]) not in digests


def test_same_shape_in_another_process(corpus: list[tuple[str, Mesh]]) -> None:
    code = (
        "import hashlib, sys; from gash_jax.shapes.procedural import make_shape\n"
        f"for i in range({ROUND}):\n"
        f"    m = make_shape(5, i, {RANGE})[1]\n"
        "    print(hashlib.sha256(m.vertices.tobytes() + m.normals.tobytes() + m.faces.tobytes()).hexdigest())"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == [digest(mesh) for _, mesh in corpus[:ROUND]]


def test_the_corpus_has_shadows_and_open_faces(corpus: list[tuple[str, Mesh]]) -> None:
    """Half of the bodies or more are clearly not convex: their volume is under 85 % of the hull's."""
    from scipy.spatial import ConvexHull

    closed = [mesh for kind, mesh in corpus if kind not in OPEN_KINDS]
    share = [
        signed_volume(RawMesh(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)))
        / ConvexHull(mesh.vertices).volume
        for mesh in closed
    ]
    assert np.median(share) < 0.85


def test_the_closedness_check_sees_a_missing_and_a_turned_face() -> None:
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    assert directed_edges_cancel(tetrahedron)
    assert not directed_edges_cancel(tetrahedron[1:])
    assert not directed_edges_cancel(np.concatenate([tetrahedron[:1, ::-1], tetrahedron[1:]]))
