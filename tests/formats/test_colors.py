"""sRGB decoded, and the colours of vertices of whatever is taken as a mesh."""

import numpy as np
import pytest
from trimesh.visual import ColorVisuals

from gash_jax.apps.pictures.views import to_srgb
from gash_jax.formats.colors import linear_rgb
from gash_jax.formats.meshes import vertex_colors
from gash_jax.geometry.mesh import MeshError
from gash_jax.shapes.primitives import icosphere


def test_by_hand_and_as_pictures_are_written() -> None:
    np.testing.assert_allclose(
        linear_rgb(np.array([[0, 0.04045, 0.5], [1, 0.2, 0.8]]))[:, ::2], [[0, 0.214041], [1, 0.603827]], atol=1e-6
    )
    linear = np.random.default_rng(0).random((20, 30, 3))
    written = to_srgb(linear, np.ones((20, 30)), 1.0)
    np.testing.assert_allclose(linear_rgb(written / 255), linear, atol=0.008)


def test_colours_of_a_trimesh() -> None:
    ball = icosphere(1)
    surface = ball.to_trimesh()
    with pytest.raises(MeshError, match="the mesh has no colours of vertices"):
        vertex_colors(surface)
    shades = np.random.default_rng(0).integers(0, 256, (42, 3)).astype(np.uint8)
    surface.visual = ColorVisuals(surface, vertex_colors=shades)
    found = vertex_colors(surface)
    np.testing.assert_allclose(found, linear_rgb(shades / 255), atol=1e-6)
    assert found.dtype == np.float32
    with pytest.raises(MeshError, match="the mesh has no colours of vertices"):
        vertex_colors(ball)
