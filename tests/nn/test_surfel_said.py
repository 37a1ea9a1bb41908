"""What the local network says: the closed form on convex bodies, the same in any number of bands, errors to expect."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.mesh import Mesh, subdivide_midpoint, transform
from gash_jax.graph.surfel_graph import normalised, plan_surfels, planned_graph
from gash_jax.nn.surfel_net import Said, SurfelNet, by_band, fall_back, split_said
from gash_jax.shapes.primitives import icosphere
from tests.helpers.bumpy import random_rotation
from tests.helpers.surfel_nets import (
    SMALL_SURFELS,
    bumpy_parts,
    filled_parts,
    normals_of,
    surfel_apply,
    surfel_variables,
)


def _box() -> Mesh:
    """A turned cube whose faces have vertices in their middles, which rounding lifts off the plane."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([triangle for a, b, c, d in sides for triangle in ([a, b, c], [a, c, d])], np.int32)
    outward = np.cross(corners[faces[:, 1]] - corners[faces[:, 0]], corners[faces[:, 2]] - corners[faces[:, 0]])
    faces = np.where(np.sum(outward * corners[faces].mean(1), 1)[:, None] < 0, faces[:, ::-1], faces)
    vertices = corners
    for _ in range(3):
        vertices, faces = _halved(vertices, faces)
    normals = np.where(np.abs(vertices) > 1 - 1e-6, np.sign(vertices), 0)
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    return transform(Mesh(vertices, normals, faces), random_rotation(4), np.array([0.3, 0.1, -0.2]), 3.0)


def _halved(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mesh = subdivide_midpoint(Mesh(vertices, np.zeros_like(vertices), faces))
    return mesh.vertices, mesh.faces


@pytest.mark.parametrize("mesh", [icosphere(2), _box()], ids=["sphere", "box"])
def test_on_a_convex_body_any_weights_give_the_closed_form_and_expect_no_error(mesh: Mesh) -> None:
    positions, center, unit = normalised(mesh)
    plan, records = plan_surfels(mesh, positions, moves=True)
    parts = filled_parts(planned_graph(plan, records, positions, mesh.normals, center, unit))
    # it does look at surfels, and none stands above a tangent plane
    assert sum(np.count_nonzero(part["weight"]) for part in parts) > 100
    out = surfel_apply(6, 2)(surfel_variables(), parts)
    np.testing.assert_allclose(out[:, :36], unshadowed_transfer(normals_of(parts), 6), atol=1e-6)
    np.testing.assert_array_equal(out[:, 36:], 0)
    # a dent is seen to
    assert float(surfel_apply(6, 2)(surfel_variables(), bumpy_parts())[:, 108:].min()) >= 0
    assert np.mean(surfel_apply(6, 2)(surfel_variables(), bumpy_parts())[:, 108:] > 0) > 0.5


def test_bands_of_one_network_agree() -> None:
    """Asked for fewer bands or bounces, it says the same of what is asked for."""
    whole = np.asarray(surfel_apply(6, 2)(surfel_variables(), bumpy_parts()))
    counts = [36, 36, 36, 6, 6, 6]
    own, first, second, *errors = np.split(whole, np.cumsum(counts)[:-1], axis=1)
    for bands in range(1, 7):
        for bounces in {0, bands % 3}:
            module = SurfelNet(**SMALL_SURFELS, bands=bands, bounces=bounces)
            shapes = jax.eval_shape(module.init, jax.random.key(0), bumpy_parts())
            assert jax.tree.map(np.shape, shapes) == jax.tree.map(np.shape, surfel_variables())
            out = np.asarray(module.apply(surfel_variables(), bumpy_parts()))
            k = bands**2
            expected = [term[:, :k] for term in (own, first, second)[: bounces + 1]]
            expected += [error[:, :bands] for error in errors[: bounces + 1]]
            np.testing.assert_allclose(out, np.concatenate(expected, axis=1), atol=5e-5)


def test_everything_is_what_training_looks_at() -> None:
    """The parts of `Said` add up to the output after the fallback."""
    module = SurfelNet(**SMALL_SURFELS)
    everything = jax.jit(lambda v: module.apply(v, bumpy_parts(), method="everything"))(surfel_variables())
    said = split_said(everything, 6, 2)
    shapes = [field.shape[1] for field in said]
    assert shapes == [36, 72, 36, 6, 6, 12, 1] and everything.shape[1] == sum(shapes)
    np.testing.assert_allclose(said.formula, unshadowed_transfer(normals_of(bumpy_parts()), 6), atol=1e-6)
    fallen = fall_back(said, jnp.asarray(normals_of(bumpy_parts())), 6)
    np.testing.assert_allclose(fallen, surfel_apply(6, 2)(surfel_variables(), bumpy_parts()), atol=5e-5)


def test_fallback_by_hand() -> None:
    normals = jnp.asarray([[0.0, 0.6, 0.8], [0, 0, 0]])
    exact = unshadowed_transfer(normals, 2)
    # band 0: four times the square error of the closed form, a quarter of the trust; band 1: less, full trust
    own, formula = (jnp.log(jnp.tile(jnp.asarray([row]), (2, 1))) for row in ((4.0, 0.01), (1.0, 1.0)))
    difference, bounced = jnp.asarray([[1.0, 1, 2, 3]] * 2), jnp.asarray([[5.0, 6, 7, 8]] * 2)
    log_bounced, gate = jnp.log(jnp.asarray([[0.09, 0.16]] * 2)), jnp.asarray([[0.5], [1.0]])
    said = Said(exact + difference, bounced, exact, own, formula, log_bounced, gate)
    out = fall_back(said, normals, 2)
    np.testing.assert_allclose(out[0, :4], exact[0] + jnp.asarray([0.25, 1, 2, 3]), atol=1e-6)
    np.testing.assert_allclose(out[0, 4:8], [5, 6, 7, 8], atol=1e-6)
    # half of what is expected stands above the tangent plane; who has no normal expects nothing
    expected = [0.5 * np.sqrt(4 / 16 + 9 / 16), 0.5 * 0.1, 0.5 * 0.3, 0.5 * 0.4]
    np.testing.assert_allclose(out[0, 8:], expected, atol=1e-6)
    np.testing.assert_array_equal(out[1, 8:], 0)


def test_bands_by_hand() -> None:
    expected = [[1, 2, 2, 2, 3, 3, 3, 3, 3], [4, 5, 5, 5, 6, 6, 6, 6, 6]]
    np.testing.assert_array_equal(by_band(jnp.asarray([[1.0, 2, 3], [4, 5, 6]]), 3), expected)
