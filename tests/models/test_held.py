"""Meshes that are held: against the compiled path of a deforming mesh, and that nothing is compiled for one of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.geometry.carried_normals import carried_normals, posed_mesh
from gash_jax.geometry.mesh import MeshError
from gash_jax.models.deforming import deforming_predictor
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.models.held import SIDES, TETRAHEDRON, HeldMesh, warm_up
from gash_jax.models.model import Model
from gash_jax.models.pose_normals import normals_of_pose
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.bumpy import random_variables
from tests.helpers.split import split_mesh

MESH = bumpy_sphere(9)
TILT = MESH.normals + 0.4 * np.sin(5 * MESH.vertices[:, [2, 0, 1]])
SMOOTH = MESH._replace(normals=(TILT / np.linalg.norm(TILT, axis=1, keepdims=True)).astype(np.float32))
BENT = (MESH.vertices * (1 + 0.3 * MESH.vertices[:, :1])).astype(np.float32)
CONFIG = model_config("local", channels=8, layers=1)


@pytest.fixture(scope="module")
def model() -> Model:
    variables = random_variables(build_model(CONFIG), model_graph(CONFIG, MESH), spread=0.1)
    return Model(CONFIG, variables["params"])


def test_the_first_pose_gets_what_the_model_predicts(model: Model) -> None:
    held = HeldMesh(model, SMOOTH)
    # the lists of a mesh that is held hold more, of which nothing counts yet
    np.testing.assert_allclose(held.first.coefficients, model.predict(SMOOTH).coefficients, atol=1e-6)
    assert set(held.first.seconds) == {"graph", "network"}
    np.testing.assert_allclose(held.predict(SMOOTH.vertices).coefficients, held.first.coefficients, atol=1e-4)


def test_another_pose_gets_what_the_compiled_path_says(model: Model) -> None:
    held = HeldMesh(model, SMOOTH)
    expected = np.asarray(deforming_predictor(model, SMOOTH)(BENT)[0])
    np.testing.assert_allclose(held.predict(BENT).coefficients, expected, atol=1e-4)
    assert np.abs(expected - held.first.coefficients).max() > 0.01


def test_copies_of_a_vertex_stay_one_and_may_not_part(model: Model) -> None:
    split, of = split_mesh(SMOOTH)
    held, predict = HeldMesh(model, split), deforming_predictor(model, split)
    np.testing.assert_array_equal(held.first.coefficients, HeldMesh(model, SMOOTH).first.coefficients[of])
    bent = HeldMesh(model, SMOOTH).predict(BENT).coefficients[of]
    np.testing.assert_allclose(held.predict(BENT[of]).coefficients, bent, atol=1e-6)
    np.testing.assert_allclose(predict(BENT[of])[0], bent, atol=1e-4)
    torn = BENT[of]
    torn[-1, 0] += 0.1
    for ask in (held.predict, predict):
        with pytest.raises(MeshError, match=f"vertices {of[-1]} and {len(of) - 1} are one point of the surface"):
            ask(torn)
    # from a pose in which they are apart they are two
    assert np.isfinite(HeldMesh(model, split._replace(vertices=torn)).predict(BENT[of]).coefficients).all()


def test_a_mesh_may_travel_far(model: Model) -> None:
    held = HeldMesh(model, MESH)
    away = held.predict(MESH.vertices + np.array([0, 0, 64], np.float32)).coefficients
    np.testing.assert_allclose(away, held.first.coefficients, atol=1e-3)  # float32 has steps of 8e-6 at 64


def test_loose_vertices_and_those_without_normal_get_zero_in_every_pose(model: Model) -> None:
    far = np.array([[900, 0, 0]], np.float32)
    loose = MESH._replace(
        vertices=np.concatenate([MESH.vertices, far]), normals=np.concatenate([MESH.normals, 0 * far])
    )
    held = HeldMesh(model, loose)
    again = held.predict(loose.vertices).coefficients
    np.testing.assert_allclose(again, held.first.coefficients, atol=1e-4)
    bent, flat = held.predict(np.concatenate([BENT, -far])), held.predict(np.zeros_like(loose.vertices))
    for found in (held.first.coefficients, again, bent.coefficients, flat.coefficients):
        assert not found[-1].any() and np.isfinite(found).all()


def test_nothing_is_compiled_for_a_mesh(model: Model, caplog: pytest.LogCaptureFixture) -> None:
    warm_up(model)
    with jax.log_compiles():
        for resolution in (2, 5, 9, 14):
            mesh = bumpy_sphere(resolution)
            HeldMesh(model, mesh).predict(mesh.vertices * np.float32(1.1))
    assert [record.getMessage() for record in caplog.records if "Compiling" in record.getMessage()] == []


def test_normals_of_a_pose_in_numpy_are_those_of_jax() -> None:
    carried = carried_normals(SMOOTH, MESH.faces)
    expected = normals_of_pose(jnp.asarray(BENT), MESH.faces, carried)
    np.testing.assert_allclose(posed_mesh(BENT, MESH.faces, carried).normals, expected, atol=5e-6)


def test_memory_is_that_of_the_arrays_and_grows_by_the_carried_normals(model: Model) -> None:
    held, count = HeldMesh(model, MESH), len(MESH.vertices)
    before = held.nbytes
    lists = sum(array.nbytes for part in held.plan.lists for array in part)
    assert before > sum(array.nbytes for array in MESH) + lists
    held.predict(BENT)
    assert held.nbytes - before == count * (12 + 8 + 12)


def test_what_is_no_pose_is_refused(model: Model) -> None:
    held = HeldMesh(model, MESH)
    with pytest.raises(MeshError, match="positions have shape"):
        held.predict(MESH.vertices[:-1])
    with pytest.raises(MeshError, match="1 of 812 vertices are not finite .first: 7"):
        held.predict(np.where(np.arange(len(MESH.vertices))[:, None] == 7, np.nan, MESH.vertices))
    other = Model(model_config("mlp", channels=8, layers=1), {})
    for call in (lambda: HeldMesh(other, MESH), lambda: warm_up(other)):
        with pytest.raises(ValueError, match="use local"):
            call()


def test_the_tetrahedron_faces_outwards() -> None:
    corners = TETRAHEDRON[SIDES]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.all(np.einsum("fi,fi->f", normals, corners.mean(axis=1)) > 0)
