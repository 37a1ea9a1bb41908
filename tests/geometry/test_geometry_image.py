import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.geometry.geometry_image import GeometryImage, geometry_image, locate
from gash_jax.geometry.mesh import Mesh, MeshError
from gash_jax.geometry.parameterisation import parameterise
from gash_jax.shapes.primitives import bumpy_sphere, plane
from tests.geometry.test_disks import holed
from tests.helpers.closed_forms import flat_shaded

SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.fixture(scope="module")
def bumpy() -> tuple[Mesh, GeometryImage]:
    mesh = bumpy_sphere(8)
    return mesh, geometry_image(parameterise(mesh), 24)


def test_two_faces_by_hand() -> None:
    face, weights = locate(SQUARE, HALVES, 3)
    assert face[0, 1] == face[0, 2] == face[1, 2] == 0  # row 0 is v = 0, below the diagonal
    assert face[1, 0] == face[2, 0] == face[2, 1] == 1
    np.testing.assert_allclose(weights[0, 1], [0.5, 0.5, 0])
    np.testing.assert_allclose(weights[2, 1], [0, 0.5, 0.5])
    np.testing.assert_allclose(weights[1, 1] @ SQUARE[HALVES[face[1, 1]]], [0.5, 0.5])


def test_texels_lie_where_a_search_of_all_faces_finds_them() -> None:
    square = parameterise(bumpy_sphere(4))
    uv, faces, size = square.uv, square.disk.faces, 9
    face, weights = locate(uv, faces, size)
    v, u = np.meshgrid(np.arange(size) / (size - 1), np.arange(size) / (size - 1), indexing="ij")
    np.testing.assert_allclose(np.einsum("ntk,ntki->nti", weights, uv[faces[face]]), np.stack([u, v], -1), atol=1e-9)
    for row, column in np.random.default_rng(0).integers(0, size, (12, 2)):
        matrix = np.concatenate([uv[faces].transpose(0, 2, 1), np.ones((len(faces), 1, 3))], axis=1)
        each = np.linalg.solve(matrix, np.array([u[row, column], v[row, column], 1.0])[None, :, None])[..., 0]
        assert each[face[row, column]].min() >= each.min(axis=1).max() - 1e-9


def test_a_map_with_a_hole_or_a_flip_is_noticed() -> None:
    with pytest.raises(MeshError, match="does not cover the square"):
        locate(SQUARE, HALVES[:1], 5)


def test_linear_values_on_a_plane_come_back_exactly() -> None:
    mesh = plane(1.0, 7)
    image = geometry_image(parameterise(mesh, "harmonic"), 12)
    positions = image.to_image(mesh.vertices)
    assert positions.shape == (12, 12, 3)
    np.testing.assert_allclose(
        np.sort(np.abs(positions[[0, 0, -1, -1], [0, -1, 0, -1]]), axis=0), [[0.5, 0, 0.5]] * 4, atol=1e-6
    )
    np.testing.assert_allclose(image.from_image(positions), mesh.vertices, atol=1e-6)


def test_constants_are_kept(bumpy: tuple[Mesh, GeometryImage]) -> None:
    mesh, image = bumpy
    ones = image.to_image(np.ones((len(mesh.vertices), 2), np.float32))
    np.testing.assert_allclose(ones, 1, atol=1e-6)
    np.testing.assert_allclose(image.from_image(ones), 1, atol=1e-6)


def test_the_round_trip_gets_better_with_the_resolution() -> None:
    mesh = bumpy_sphere(8)
    square = parameterise(mesh)
    errors = []
    for size in (12, 48, 192):
        image = geometry_image(square, size)
        errors.append(np.sqrt(np.mean((image.from_image(image.to_image(mesh.vertices)) - mesh.vertices) ** 2)))
    assert errors[0] > 3 * errors[1] > 9 * errors[2]


def test_vertices_at_one_place_get_one_value() -> None:
    mesh = bumpy_sphere(5)
    apart = flat_shaded(mesh)
    image = geometry_image(parameterise(apart), 24)
    noise = np.random.default_rng(0).normal(size=(24, 24, 2)).astype(np.float32)
    values = image.from_image(noise).reshape(-1, 3, 2)
    for vertex in (0, 7, 100):
        here = values[mesh.faces == vertex]
        assert len(here) >= 5 and np.ptp(here, axis=0).max() == 0
    # on the way there the mean of them counts
    numbers = np.arange(len(apart.vertices), dtype=np.float32)[:, None]
    assert image.members.shape[1] >= 6 and np.isfinite(image.to_image(numbers)).all()
    np.testing.assert_allclose(image.shares.sum(axis=1), 1, atol=1e-6)


def test_holes_are_filled_and_marked() -> None:
    mesh = holed(7, 32, 33, 34, 35)
    image = geometry_image(parameterise(mesh), 40)
    assert 0 < (image.face < 0).sum() < 400
    positions = image.to_image(mesh.vertices)
    inside = positions[image.face < 0]
    hole = plane(1.0, 7).vertices[plane(1.0, 7).faces[32:36]].reshape(-1, 3)
    assert (inside >= hole.min(axis=0) - 1e-5).all() and (inside <= hole.max(axis=0) + 1e-5).all()


def test_loose_vertices_get_nothing() -> None:
    mesh = plane(1.0, 3)
    far = np.array([[9, 9, 9]], np.float32)
    loose = Mesh(np.concatenate([mesh.vertices, far]), np.concatenate([mesh.normals, 0 * far]), mesh.faces)
    image = geometry_image(parameterise(loose), 8)
    back = image.from_image(image.to_image(loose.vertices))
    np.testing.assert_array_equal(back[-1], 0)
    np.testing.assert_allclose(back[:-1], mesh.vertices, atol=1e-6)


def test_jit_equals_eager_and_gradients_are_the_transpose(bumpy: tuple[Mesh, GeometryImage]) -> None:
    mesh, image = bumpy
    values = jnp.asarray(mesh.vertices)
    eager = image.to_image(mesh.vertices)
    assert isinstance(eager, np.ndarray)
    np.testing.assert_allclose(jax.jit(image.to_image)(values), eager, atol=1e-6)
    np.testing.assert_allclose(jax.jit(image.from_image)(jnp.asarray(eager)), image.from_image(eager), atol=1e-6)

    def there_and_back(values: jax.Array) -> jax.Array:
        return jnp.sum(image.from_image(image.to_image(values)) ** 2) / 2

    gradient = jax.jit(jax.grad(there_and_back))(values)
    matrix = image.from_image(image.to_image(np.eye(len(values), dtype=np.float32)))
    np.testing.assert_allclose(gradient, matrix.T @ (matrix @ mesh.vertices), atol=1e-4)


def test_vmap_is_a_loop(bumpy: tuple[Mesh, GeometryImage]) -> None:
    mesh, image = bumpy
    frames = np.stack([mesh.vertices, 2 * mesh.vertices])
    mapped = jax.vmap(image.to_image)(jnp.asarray(frames))
    np.testing.assert_allclose(mapped, np.stack([image.to_image(frame) for frame in frames]), atol=1e-6)


@pytest.mark.parametrize("size", [1, 2.5, 5000])
def test_sizes_are_checked(size: object) -> None:
    with pytest.raises(ValueError, match="size is .*: use a whole number from 2 to 4096"):
        geometry_image(parameterise(plane(1.0, 3)), size)  # type: ignore[arg-type]


def test_shapes_are_checked(bumpy: tuple[Mesh, GeometryImage]) -> None:
    mesh, image = bumpy
    for wrong in (mesh.vertices[:, 0], mesh.vertices[1:], mesh.vertices[None]):
        with pytest.raises(ValueError, match=f"give \\({len(mesh.vertices)}, c\\), a row for each vertex"):
            image.to_image(wrong)
    for wrong in (np.zeros((24, 24)), np.zeros((23, 24, 3)), np.zeros((1, 24, 24, 3))):
        with pytest.raises(ValueError, match="give \\(24, 24, c\\)"):
            image.from_image(wrong)
