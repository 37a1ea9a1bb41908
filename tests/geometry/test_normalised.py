"""Centre, units and areas: by hand, under motions, with loose vertices, and computed once."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gash_jax.geometry import normalised
from gash_jax.geometry.mesh import Mesh, face_areas, subdivide_midpoint, transform, vector_areas
from gash_jax.geometry.normalised import SHORT, NormalisedMesh, long_product
from gash_jax.graph.mesh_graph import build_graph
from gash_jax.graph.surfel_graph import surfel_graph
from gash_jax.prt.rays import trace_geometry
from gash_jax.shapes.primitives import bumpy_sphere, icosphere
from tests.helpers.bumpy import random_rotation

# a square of side 2 in two triangles, and a vertex in no face
SQUARE = Mesh(
    np.array([[0, 0, 0], [2, 0, 0], [2, 0, -2], [0, 0, -2], [50, 0.5, 50]], np.float32),
    np.array([[0, 1, 0]] * 4 + [[0, 0, 0]], np.float32),
    np.array([[0, 1, 2], [0, 2, 3]], np.int32),
)


def test_square_by_hand() -> None:
    """Its triangles have their middles (1/3, 1/3) from the centroid; the loose vertex goes to the box's corner."""
    shape = NormalisedMesh(SQUARE)
    np.testing.assert_array_equal(shape.referenced, [True] * 4 + [False])
    np.testing.assert_array_equal(shape.box, [[0, 0, -2], [2, 0, 0]])
    np.testing.assert_array_equal(shape.center, [1, 0, -1])
    assert shape.half_diagonal == pytest.approx(np.sqrt(2), rel=1e-15)
    np.testing.assert_array_equal(shape.vector_areas, [[0, 2, 0], [0, 2, 0]])
    np.testing.assert_array_equal(shape.areas, [2, 2])
    assert shape.radius == pytest.approx(np.sqrt(2) / 3)
    corners = [[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1], [1, 0, 1]]
    np.testing.assert_array_equal(shape.positions(1.0), corners)
    np.testing.assert_array_equal(shape.positions(0.5), np.multiply(corners, 2))


def test_without_area_the_radius_is_zero() -> None:
    line = SQUARE._replace(faces=np.array([[0, 1, 1]], np.int32))
    assert NormalisedMesh(line).radius == 0
    assert NormalisedMesh(line).half_diagonal == 1


def test_areas_are_those_of_the_mesh() -> None:
    mesh = bumpy_sphere(6)
    np.testing.assert_array_equal(NormalisedMesh(mesh).areas, face_areas(mesh.vertices, mesh.faces))
    np.testing.assert_array_equal(NormalisedMesh(mesh).vector_areas, vector_areas(mesh.vertices, mesh.faces))


def test_the_radius_belongs_to_the_surface() -> None:
    """It turns with the mesh; of the same surface in smaller triangles only their middles differ."""
    bumpy = bumpy_sphere(6)
    moved = transform(bumpy, random_rotation(3), np.array([30.0, -10.0, 2.0]), 7.0)
    assert NormalisedMesh(moved).radius == pytest.approx(7 * NormalisedMesh(bumpy).radius, rel=1e-5)
    fine = subdivide_midpoint(subdivide_midpoint(subdivide_midpoint(bumpy)))
    assert NormalisedMesh(fine).radius == pytest.approx(NormalisedMesh(bumpy).radius, rel=0.02)


@settings(max_examples=15, deadline=None)
@given(st.integers(-6, 6), st.integers(0, 1000))
def test_scale_at_any_size(exponent: int, seed: int) -> None:
    scale = 10.0**exponent
    shape = NormalisedMesh(transform(icosphere(2), random_rotation(seed), np.zeros(3), scale))
    assert 1.5 * scale < shape.half_diagonal < np.sqrt(3.01) * scale
    np.testing.assert_allclose(np.linalg.norm(shape.positions(scale), axis=1), 1, atol=1e-2)


def test_what_is_normalised_is_taken_as_it_is() -> None:
    shape = NormalisedMesh(SQUARE)
    assert NormalisedMesh.of(shape) is shape
    assert NormalisedMesh.of(SQUARE).mesh is SQUARE


@pytest.mark.parametrize(
    ("build", "expected"),
    [
        (lambda mesh: build_graph(mesh, "rings", 8), {"vector_areas": 1, "referenced": 1}),
        (lambda mesh: build_graph(mesh, "rings", 8, encoding="relative-motor"), {"vector_areas": 1, "referenced": 1}),
        (lambda mesh: build_graph(mesh, "knn", 8), {"referenced": 1}),
        (lambda mesh: surfel_graph(mesh), {"vector_areas": 1, "referenced": 1}),
        (trace_geometry, {"referenced": 1}),
    ],
)
def test_nothing_is_computed_twice(monkeypatch: pytest.MonkeyPatch, build, expected: dict) -> None:
    """Each room asks once for what it needs of a mesh, and not at all for what it does not."""
    calls: dict[str, int] = {}

    def counted(name: str):
        function = getattr(normalised, name)

        def call(*arguments):
            calls[name] = calls.get(name, 0) + 1
            return function(*arguments)

        return call

    for name in ("vector_areas", "referenced"):
        monkeypatch.setattr(normalised, name, counted(name))
    build(bumpy_sphere(4))
    assert calls == expected


def test_faces_of_one_centroid_have_no_radius() -> None:
    """One face, or the same one many times: the centroid is a sum of rounded terms, and its distance must not count."""
    corners = np.random.default_rng(0).normal(size=(20, 3, 3)).astype(np.float32)
    for count in (1, 1000):
        face = np.tile(np.array([[0, 1, 2]], np.int32), (count, 1))
        assert [NormalisedMesh(Mesh(triangle, 0 * triangle, face)).radius for triangle in corners] == [0] * 20


@pytest.mark.parametrize("length", [0, 1, SHORT, 2 * SHORT + 5])
def test_long_products_are_products(length: int) -> None:
    rng = np.random.default_rng(0)
    left, right = rng.normal(size=(3, length)), rng.normal(size=(length, 2))
    np.testing.assert_allclose(long_product(left, right), left @ right, rtol=1e-12, atol=1e-10)
    np.testing.assert_allclose(long_product(left[0], right[:, 0]), left[0] @ right[:, 0], rtol=1e-12, atol=1e-10)
