import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, concatenate, face_areas, transform, vector_areas
from gash_jax.geometry.orientation import orient
from gash_jax.geometry.topology import build_edges
from gash_jax.shapes.primitives import box, bumpy_sphere, icosphere, plane, spherical_bowl, torus
from tests.helpers.bumpy import random_rotation

SOLIDS = {"sphere": icosphere(2), "bumpy": bumpy_sphere(6), "torus": torus(1.0, 0.4, 20, 10), "box of six sides": box()}


def _orient(mesh: Mesh):
    return orient(mesh.vertices.astype(np.float64), mesh.faces)


def _reversed(mesh: Mesh, which: slice | np.ndarray = slice(None)) -> Mesh:
    faces = mesh.faces.copy()
    faces[which] = faces[which][:, ::-1]
    return mesh._replace(faces=faces)


def _with_holes(mesh: Mesh, height: float) -> Mesh:
    """The faces whose centre lies below `height`."""
    return mesh._replace(faces=mesh.faces[mesh.vertices[mesh.faces][:, :, 1].mean(axis=1) < height])


@pytest.mark.parametrize("name", SOLIDS)
def test_closed_surfaces_face_outward(name: str) -> None:
    kept = _orient(SOLIDS[name])
    assert not kept.reverse.any() and not kept.inward.any() and kept.solid.all()
    turned = _orient(_reversed(SOLIDS[name]))
    assert turned.reverse.all() and turned.inward.all() and turned.rewound == 0


@pytest.mark.parametrize("name", ["sphere", "bumpy", "torus"])
@pytest.mark.parametrize("share", [0.05, 0.3, 0.5, 0.8])
def test_mixed_winding_is_made_consistent_and_outward(name: str, share: float) -> None:
    mesh = SOLIDS[name]
    wrong = np.random.default_rng(1).random(len(mesh.faces)) < share
    found = _orient(_reversed(mesh, wrong))
    np.testing.assert_array_equal(found.reverse, wrong)
    area = face_areas(mesh.vertices, mesh.faces)
    least = min(area[wrong].sum(), area[~wrong].sum())
    turned = wrong if area[wrong].sum() == least else ~wrong
    assert found.rewound == turned.sum()


def test_edges_may_be_given() -> None:
    mesh = _reversed(bumpy_sphere(4), slice(0, 40))
    edges = build_edges(mesh.faces, len(mesh.vertices))
    given = orient(mesh.vertices.astype(np.float64), mesh.faces, edges)
    np.testing.assert_array_equal(given.reverse, _orient(mesh).reverse)


@pytest.mark.parametrize("seed", range(3))
def test_loose_corners_are_joined_by_position(seed: int) -> None:
    """STL: three vertices of its own for every face, in any order of faces."""
    mesh = transform(torus(1.0, 0.4, 16, 9), random_rotation(seed))
    order = np.random.default_rng(seed).permutation(len(mesh.faces))
    loose = mesh.vertices[mesh.faces[order][:, ::-1]].reshape(-1, 3)
    found = orient(loose.astype(np.float64), np.arange(len(loose)).reshape(-1, 3))
    assert found.reverse.all() and found.seamed.all() and len(found.solid) == 1
    assert not _orient(mesh).seamed.any()


def test_a_seam_between_opposite_windings_is_left() -> None:
    """Two sheets that meet at equal positions but are wound against each other: the file's word for both."""
    left, right = plane(1.0, 2), transform(plane(1.0, 2), translation=np.array([1.0, 0, 0]))
    for joined in (concatenate([left, right]), concatenate([left, _reversed(right)])):
        assert not _orient(joined).reverse.any()
    assert len(_orient(concatenate([left, right])).solid) == 1
    assert len(_orient(concatenate([left, _reversed(right)])).solid) == 2


def test_shells_and_cavities() -> None:
    """A hollow ball with a ball in its hollow: cavity walls keep facing into the cavity, all three follow the file."""
    outer, hollow, core = (transform(icosphere(2), scale=s) for s in (3.0, 2.0, 1.0))
    correct = concatenate([outer, _reversed(hollow), core])
    assert not _orient(correct).reverse.any()
    assert _orient(_reversed(correct)).reverse.all()
    solids = concatenate([outer, core])  # a solid of its own inside another: the file says so
    assert not _orient(solids).reverse.any()
    assert _orient(_reversed(solids)).reverse.all()
    beside = concatenate([outer, transform(_reversed(core), translation=np.array([9.0, 0, 0]))])
    np.testing.assert_array_equal(_orient(beside).inward, [False, True])


@pytest.mark.parametrize("degrees", [35, 60, 90, 140])
def test_open_surfaces_keep_their_winding(degrees: float) -> None:
    bowl = spherical_bowl(np.radians(degrees), 10)
    inside, outside = _orient(bowl), _orient(_reversed(bowl))
    assert not inside.reverse.any() and inside.doubtful.all() and not inside.solid.any()
    assert not outside.reverse.any() and not outside.doubtful.any()


def test_a_scan_with_small_holes_counts_as_closed() -> None:
    scan = _with_holes(icosphere(4), 0.96)
    assert not _orient(scan).reverse.any()
    assert _orient(_reversed(scan)).reverse.all()


def test_open_parts_follow_a_file_that_is_inside_out() -> None:
    part = transform(_reversed(spherical_bowl(1.2, 8)), translation=np.array([5.0, 0, 0]))
    scene = concatenate([icosphere(2), part])
    assert not _orient(scene).reverse.any()
    assert _orient(_reversed(scene)).reverse.all()
    room = concatenate([transform(spherical_bowl(1.2, 8), scale=3.0), transform(icosphere(2), scale=0.3)])
    assert not _orient(room).reverse.any()


def test_open_surface_with_every_face_both_ways_faces_outward() -> None:
    bowl = spherical_bowl(np.radians(60), 8)
    both = bowl._replace(faces=np.concatenate([bowl.faces, bowl.faces[:, ::-1]]))
    found = _orient(both)
    assert found.inward.all() and found.solid.all()
    assert found.reverse.all()  # the repeated face is treated as the first
    flat = plane(1.0, 3)
    assert not _orient(flat._replace(faces=np.concatenate([flat.faces, flat.faces[:, ::-1]]))).reverse.any()


def test_moebius_strip_has_one_side() -> None:
    n = 24
    along, across = np.meshgrid(2 * np.pi * np.arange(n) / n, [-0.3, 0.3], indexing="ij")
    radius = 1 + across * np.cos(along / 2)
    points = np.stack([radius * np.cos(along), radius * np.sin(along), across * np.sin(along / 2)], axis=-1)
    i = np.arange(n - 1)
    quads = np.stack([2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1], axis=1)
    quads = np.concatenate([quads, [[2 * n - 2, 1, 0, 2 * n - 1]]])  # closed with a half-turn
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    found = orient(points.reshape(-1, 3), faces)
    np.testing.assert_array_equal(found.one_sided, [True])
    assert not found.reverse.any() and found.rewound == 0
    cut = orient(points.reshape(-1, 3), faces[: n - 1])
    assert not cut.one_sided.any()


def test_solids_sharing_an_edge_are_told_apart() -> None:
    """Two bars with a common edge, which has four faces; one of them inside out."""
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    assert vector_areas(cube, faces).sum(axis=0) == pytest.approx(0)
    second = np.where(np.isin(np.arange(8), [0, 1]), [6, 7, 0, 0, 0, 0, 0, 0], np.arange(8) + 8)
    points = np.concatenate([cube, cube + [1, 1, 0]]) * [1, 1, 20]  # the common edge is long
    found = orient(points, np.concatenate([faces, second[faces[:, ::-1]]]))
    np.testing.assert_array_equal(found.reverse, [False] * 12 + [True] * 12)
    assert len(found.solid) == 2 and found.solid.all()
    inverted = second[faces[:, ::-1]]
    inverted[0] = inverted[0, ::-1]  # one face, at the common edge, is right
    mixed = orient(points, np.concatenate([faces, inverted]))
    np.testing.assert_array_equal(mixed.reverse, [False] * 13 + [True] * 11)
    assert mixed.solid.all() and mixed.rewound == 1


def test_nothing_to_decide() -> None:
    found = orient(np.eye(3), np.array([[0, 0, 1], [2, 2, 2]]))
    assert not found.reverse.any() and len(found.solid) == 0
    np.testing.assert_array_equal(found.sheet, [-1, -1])


def test_faces_without_sheet_do_not_matter() -> None:
    sphere = _reversed(icosphere(1))
    extra = np.concatenate([[[3, 3, 5]], sphere.faces, sphere.faces[5:6], [[1, 2, 2]]])
    found = orient(sphere.vertices.astype(np.float64), extra)
    np.testing.assert_array_equal(found.reverse, [False] + [True] * 81 + [False])
    np.testing.assert_array_equal(found.sheet, [-1] + [0] * 81 + [-1])
