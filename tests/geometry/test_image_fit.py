import numpy as np
import pytest

from gash_jax.geometry import image_fit as f
from gash_jax.geometry.geometry_image import GeometryImage, geometry_image
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.parameterisation import parameterise
from gash_jax.shapes.primitives import bumpy_sphere, plane

MESH, SIZE = bumpy_sphere(3), 16
VALUES = np.random.default_rng(0).normal(size=(len(MESH.vertices), 2)).astype(np.float32)


@pytest.fixture(scope="module")
def image() -> GeometryImage:
    return geometry_image(parameterise(MESH), SIZE)


def test_fitted_images_give_back_more_than_sampled_ones(image: GeometryImage) -> None:
    errors = [
        np.abs(image.from_image(shown) - VALUES).mean()
        for shown in (image.to_image(VALUES), f.image_fit(image)(VALUES))
    ]
    assert errors[1] < 0.5 * errors[0]


def test_the_correction_is_that_of_dense_least_squares(image: GeometryImage) -> None:
    lookup = np.zeros((len(VALUES), SIZE**2))
    np.add.at(lookup, (np.arange(len(VALUES))[:, None], image.texels), image.bilinear)
    sampled = image.to_image(VALUES).reshape(-1, 2)
    # rows of the normal equations: the lookup over sqrt(STRENGTH), and the size of the correction
    rows = np.concatenate([lookup / np.sqrt(f.STRENGTH), np.eye(SIZE**2)])
    target = np.concatenate([(VALUES - lookup @ sampled) / np.sqrt(f.STRENGTH), np.zeros((SIZE**2, 2))])
    expected = sampled + np.linalg.lstsq(rows, target, rcond=None)[0]
    np.testing.assert_allclose(f.image_fit(image)(VALUES).reshape(-1, 2), expected, atol=1e-5)


def test_it_is_linear_and_leaves_texels_alone_that_serve_nobody(image: GeometryImage) -> None:
    fit = f.image_fit(image)
    np.testing.assert_allclose(
        fit(2 * VALUES[:, :1] - VALUES[:, 1:]), (2 * fit(VALUES)[..., :1] - fit(VALUES)[..., 1:]), atol=1e-5
    )
    free = np.setdiff1d(np.arange(SIZE**2), image.texels[image.bilinear > 0])
    changed = (fit(VALUES) - image.to_image(VALUES)).reshape(-1, 2)
    assert len(free) and not changed[free].any() and changed.any()


def test_one_vertex_by_hand() -> None:
    """A square of four vertices on 2 x 2 texels: each vertex is a texel, and sampling is already exact."""
    mesh = plane(1.0, 1)
    image = geometry_image(parameterise(mesh), 2)
    values = np.array([[1.0], [2], [3], [5]], np.float32)
    np.testing.assert_allclose(image.from_image(f.image_fit(image)(values)), values, atol=1e-6)


def test_loose_vertices_ask_for_nothing() -> None:
    mesh = plane(1.0, 3)
    far = np.array([[9, 9, 9]], np.float32)
    loose = Mesh(np.concatenate([mesh.vertices, far]), np.concatenate([mesh.normals, 0 * far]), mesh.faces)
    image = geometry_image(parameterise(loose), 8)
    values = np.append(np.zeros(16, np.float32), np.float32(1e6))[:, None]
    np.testing.assert_array_equal(f.image_fit(image)(values), np.zeros((8, 8, 1), np.float32))
