"""The compiled path of a deforming mesh against the graph of the same pose, and its normals against the mesh's own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.geometry.carried_normals import carried_normals
from gash_jax.geometry.mesh import angle_weighted_normals
from gash_jax.models.deforming import deforming_predictor
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.models.model import Model
from gash_jax.models.pose_normals import normals_of_pose, vertex_normals
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.bumpy import random_rotation, random_variables

MESH = bumpy_sphere(9)
TILT = MESH.normals + 0.4 * np.sin(5 * MESH.vertices[:, [2, 0, 1]])
SMOOTH = MESH._replace(normals=(TILT / np.linalg.norm(TILT, axis=1, keepdims=True)).astype(np.float32))
CONFIG = model_config("local", channels=8, layers=1)


@pytest.fixture(scope="module")
def model() -> Model:
    variables = random_variables(build_model(CONFIG), model_graph(CONFIG, MESH), spread=0.1)
    return Model(CONFIG, variables["params"])


def test_normals_are_those_of_the_mesh_and_have_finite_gradients() -> None:
    found = vertex_normals(jnp.asarray(MESH.vertices), MESH.faces)
    np.testing.assert_allclose(found, angle_weighted_normals(MESH.vertices, MESH.faces), atol=2e-6)
    flat = MESH.vertices.copy()
    flat[MESH.faces[0, 1]] = flat[MESH.faces[0, 0]]
    there = vertex_normals(jnp.asarray(flat), MESH.faces)  # faces of two equal edges, whose products are rounding
    np.testing.assert_allclose(there, angle_weighted_normals(flat.astype(float), MESH.faces), atol=1e-5)
    slope = jax.grad(lambda p: jnp.sum(jnp.sin(vertex_normals(p, MESH.faces))))(jnp.asarray(flat))
    assert np.isfinite(slope).all()


def test_the_pose_it_was_built_from_gets_what_its_graph_gets(model: Model) -> None:
    coefficients, error = deforming_predictor(model, MESH)(MESH.vertices)
    expected = model.with_error(model.graph(MESH))
    np.testing.assert_allclose(coefficients, expected[0], atol=1e-4)
    assert expected[1] is not None
    np.testing.assert_allclose(error, expected[1], rtol=1e-3, atol=1e-5)


def test_a_pose_that_is_moved_and_grown_gets_the_same(model: Model) -> None:
    frame = deforming_predictor(model, MESH)
    still = np.asarray(frame(MESH.vertices)[0])
    np.testing.assert_allclose(frame(MESH.vertices + np.float32(0.5))[0], still, atol=1e-4)
    bent = MESH.vertices * (1 + 0.3 * MESH.vertices[:, :1])
    assert np.abs(np.asarray(frame(bent)[0]) - still).max() > 1e-2


def test_it_compiles_once(model: Model, caplog: pytest.LogCaptureFixture) -> None:
    frame = deforming_predictor(model, MESH)
    compiled = []
    for grown in (1.0, 1.1):
        caplog.clear()
        with jax.log_compiles():
            jax.block_until_ready(frame(MESH.vertices * np.float32(grown)))
        compiled.append(sum("Compiling" in record.getMessage() for record in caplog.records))
    assert compiled[0] > 0 and compiled[1] == 0


def test_only_surfels_has_such_a_path() -> None:
    config = model_config("mlp", channels=8, layers=1)
    with pytest.raises(ValueError, match="use local"):
        deforming_predictor(Model(config, {}), MESH)


def test_gradients_by_positions_are_finite_and_those_of_differences(model: Model) -> None:
    """Empty surfels fill the levels of the tree; they have no size, and a root has no slope there."""
    frame, place = deforming_predictor(model, MESH), jnp.asarray(MESH.vertices)
    loss = jax.jit(jax.value_and_grad(lambda p: jnp.sum(frame(p)[0] ** 2)))
    gradient = np.asarray(loss(place)[1])
    assert np.isfinite(gradient).all()
    # along the gradient the slope is far above what rounding leaves of a difference; the frames are not traced
    motion, step = gradient / np.abs(gradient).max(), 1e-4
    ends = [np.asarray(frame(MESH.vertices + sign * step * motion)[0], np.float64) for sign in (1, -1)]
    slope = float(np.sum(ends[0] ** 2) - np.sum(ends[1] ** 2)) / (2 * step)  # float32 sums are too coarse for it
    assert slope == pytest.approx(float(np.sum(gradient * motion)), rel=2e-3)


def test_own_normals_are_those_of_the_first_pose(model: Model) -> None:
    """Normals of a file differ from angle-weighted ones, here by up to 20 degrees, and so does what is predicted."""
    predicted = model.predict(SMOOTH).coefficients
    np.testing.assert_allclose(deforming_predictor(model, SMOOTH)(SMOOTH.vertices)[0], predicted, atol=1e-4)
    assert np.abs(predicted - model.predict(MESH).coefficients).max() > 0.02


def test_a_pose_that_is_turned_has_its_normals_turned() -> None:
    rotation = random_rotation(3).astype(np.float32)
    carried = carried_normals(SMOOTH, MESH.faces)
    for turn in (np.eye(3, dtype=np.float32), rotation):
        found = normals_of_pose(jnp.asarray(3 * MESH.vertices @ turn.T + 1), MESH.faces, carried)
        np.testing.assert_allclose(found, SMOOTH.normals @ turn.T, atol=2e-5)
    inward = MESH._replace(normals=-MESH.normals)
    found = normals_of_pose(jnp.asarray(MESH.vertices @ rotation.T), MESH.faces, carried_normals(inward, MESH.faces))
    np.testing.assert_allclose(found, inward.normals @ rotation.T, atol=2e-5)


def test_angle_weighted_normals_stay_so_when_the_mesh_bends() -> None:
    bent = (MESH.vertices * (1 + 0.3 * MESH.vertices[:, :1])).astype(np.float32)
    found = normals_of_pose(jnp.asarray(bent), MESH.faces, carried_normals(MESH, MESH.faces))
    np.testing.assert_allclose(found, angle_weighted_normals(bent, MESH.faces), atol=5e-6)


def test_carried_normals_have_finite_gradients_and_vertices_without_a_frame_keep_theirs() -> None:
    """Vertex 0 has no face, 1 to 3 the same face from both sides; the first face of the rest folds to a line."""
    faces = np.concatenate([np.array([[1, 2, 3], [1, 3, 2]]), 4 + MESH.faces]).astype(np.int32)
    vertices = np.concatenate([np.eye(4, 3, dtype=np.float32), MESH.vertices])
    normals = np.concatenate([np.tile(np.array([[0, 0, 1]], np.float32), (4, 1)), SMOOTH.normals])
    normals[0] = 0
    mesh = MESH._replace(vertices=vertices, normals=normals, faces=faces)
    carried = carried_normals(mesh, faces)
    np.testing.assert_array_equal(normals_of_pose(jnp.asarray(vertices), faces, carried)[:4], normals[:4])
    flat = vertices.copy()
    flat[faces[2, 1]] = flat[faces[2, 0]]
    slope = jax.grad(lambda p: jnp.sum(jnp.sin(normals_of_pose(p, faces, carried))))(jnp.asarray(flat))
    assert np.isfinite(slope).all()
