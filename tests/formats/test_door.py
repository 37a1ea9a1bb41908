"""Whatever is taken as a mesh comes in as itself, checked; what is none is refused in one line that says what to do."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

import gash_jax
from gash_jax.formats.meshes import as_mesh, is_mesh_like
from gash_jax.geometry.mesh import Mesh, MeshError
from gash_jax.shapes.primitives import bumpy_sphere

BALL = bumpy_sphere(5)
V, F, N = BALL.vertices, BALL.faces, BALL.normals


def _scene() -> trimesh.Scene:
    scene = trimesh.Scene()
    scene.add_geometry(BALL.to_trimesh())
    return scene


# one mesh in every form that is taken, its normals given or computed
GIVEN: dict[str, Callable[[], Any]] = {
    "Mesh": lambda: BALL,
    "Mesh of JAX arrays": lambda: Mesh(*map(jnp.asarray, BALL)),  # type: ignore[arg-type]
    "Mesh of float64": lambda: Mesh(V.astype(np.float64), N.astype(np.float64), F.astype(np.int64)),
    "three arrays": lambda: (V, F, N),
    "three of JAX": lambda: (jnp.asarray(V), jnp.asarray(F), jnp.asarray(N)),
    "a list of lists": lambda: [V.tolist(), F.tolist(), N.tolist()],
    "trimesh": BALL.to_trimesh,
    "scene": _scene,
}
COMPUTED: dict[str, Callable[[], Any]] = {
    "two arrays": lambda: (V, F),
    "two of JAX, unsigned": lambda: [jnp.asarray(V), jnp.asarray(F, jnp.uint32)],
    "trimesh without normals": lambda: trimesh.Trimesh(V, F, process=False),
}


@pytest.mark.parametrize("form", [*GIVEN, *COMPUTED])
def test_every_form_of_a_mesh_is_that_mesh(form: str) -> None:
    source = {**GIVEN, **COMPUTED}[form]()
    assert is_mesh_like(source)
    mesh = as_mesh(source)
    assert (mesh.vertices.dtype, mesh.normals.dtype, mesh.faces.dtype) == (np.float32, np.float32, np.int32)
    assert all(type(array) is np.ndarray for array in mesh)
    np.testing.assert_array_equal(mesh.vertices, V)
    np.testing.assert_array_equal(mesh.faces, F)
    if form in GIVEN:
        np.testing.assert_allclose(mesh.normals, N, atol=2e-7)
    else:
        np.testing.assert_array_equal(mesh.normals, gash_jax.load_mesh((V, F)).normals)
    assert gash_jax.read_mesh(source)[1].normals == ("file" if form in GIVEN else "computed")


def test_paths_and_arrays_and_trimesh_give_the_same_bake(tmp_path: Path) -> None:
    gash_jax.save_mesh(tmp_path / "ball.ply", (V, F, N))
    expected = gash_jax.bake_transfer(BALL, 2, 16)
    for source in (str(tmp_path / "ball.ply"), tmp_path / "ball.ply", BALL, (V, F, N)):
        np.testing.assert_allclose(gash_jax.bake_transfer(source, 2, 16).coefficients, expected.coefficients, atol=1e-6)


def test_a_scene_has_its_meshes_in_their_places() -> None:
    scene = _scene()
    scene.add_geometry(BALL.to_trimesh(), transform=trimesh.transformations.translation_matrix([5, 0, 0]))
    mesh = as_mesh(scene)
    np.testing.assert_allclose(mesh.vertices, np.concatenate([V, V + np.array([5, 0, 0], np.float32)]), atol=1e-6)
    np.testing.assert_allclose(mesh.normals, np.concatenate([N, N]), atol=1e-6)
    squeezed = trimesh.Scene()
    squeezed.add_geometry(BALL.to_trimesh(), transform=np.diag([-1, 2, 1, 1]))  # mirrored, and stretched along y
    mesh = as_mesh(squeezed)
    np.testing.assert_array_equal(mesh.faces, F[:, ::-1])
    expected = N * np.array([-1, 0.5, 1], np.float32)  # across the stretched surface: by the inverse transpose
    np.testing.assert_allclose(mesh.normals, expected / np.linalg.norm(expected, axis=1, keepdims=True), atol=1e-6)


def test_there_and_back_through_trimesh() -> None:
    back = as_mesh(BALL.to_trimesh())
    np.testing.assert_array_equal(back.vertices, V)
    np.testing.assert_array_equal(back.faces, F)
    np.testing.assert_allclose(back.normals, N, atol=1e-7)


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_arrays_have_an_up_axis_too(up: str) -> None:
    turned, mesh = gash_jax.load_mesh((V, F, N), up), gash_jax.load_mesh(BALL, up)
    np.testing.assert_allclose(turned.vertices, mesh.vertices, atol=1e-7)
    axis = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}[up]
    point = gash_jax.load_mesh((np.vstack([np.array([axis], float) * 9, V]), F + 1), up).vertices[0]
    np.testing.assert_allclose(point, [0, 9, 0], atol=1e-6)


NAN = V.copy()
NAN[3] = np.nan
BEYOND = F.copy()
BEYOND[7, 1] = 9999
BAD: dict[str, tuple[Any, str]] = {
    "NaN in a Mesh": (Mesh(NAN, N, F), r"1 of \d+ vertices are not finite \(first: 3\)"),
    "NaN in arrays": ((NAN, F), "not finite"),
    "index in a Mesh": (Mesh(V, N, BEYOND), r"name a vertex that does not exist \(first: face 7"),
    "index in arrays": ((V, BEYOND, N), "name a vertex that does not exist"),
    "negative index": ((V, F - 1), "does not exist"),
    "normals of length 2": (Mesh(V, 2 * N, F), r"normals are not of length 1 \(first: 0, 2\): normalise them"),
    "NaN normals": (Mesh(V, N * np.nan, F), "not of length 1"),
    "one normal short": (Mesh(V, N[1:], F), "give one per vertex"),
    "normals of arrays short": ((V, F, N[1:]), "give one per vertex"),
    "Mesh order in arrays": ((V, N, F), "faces must be integers"),
    "quads": ((V, np.zeros((5, 4), int)), "give triangles"),
    "float faces": ((V, F.astype(float)), "faces must be integers"),
    "flat vertices": ((V[:, :2], F), r"vertices must be real numbers of shape \(v, 3\)"),
    "complex vertices": ((V.astype(complex), F), "real numbers"),
    "text": ((np.array([["a"] * 3] * 9), F), "real numbers"),
    "no faces": ((V, F[:0]), "no faces"),
    "no vertices": ((V[:0], F), "no vertices"),
    "one point": ((V * 0, F), "all faces lie in one point"),
    "Mesh of one point": (Mesh(V * 0, N, F), "all faces lie in one point"),
    "one array": ((V,), r"\(vertices, faces\) or \(vertices, faces, normals\), not 1"),
    "four": ((V, F, N, N), "not 4"),
    "ragged": (([[0, 0], [1, 2, 3]], F), "no array"),
    "a number": (7, "a int is no mesh: give a path"),
    "nothing": (None, "is no mesh: give a path"),
    "an array alone": (V, "a ndarray is no mesh"),
    "a cloud": (trimesh.PointCloud(V), "a PointCloud is no mesh"),
    "an empty scene": (trimesh.Scene(), "no vertices"),
    "a missing file": ("absent.ply", "no such file: absent.ply"),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_is_no_mesh_is_refused_in_one_line(kind: str) -> None:
    source, words = BAD[kind]
    with pytest.raises(MeshError, match=words) as caught:
        as_mesh(source)
    assert "\n" not in str(caught.value) and isinstance(caught.value, ValueError)
    with pytest.raises(MeshError, match=words):
        gash_jax.bake_transfer(source, 1, 4)


def test_a_mesh_that_is_traced_is_refused_with_advice() -> None:
    with pytest.raises(MeshError, match="outside of jit"):
        jax.jit(lambda v: as_mesh((v, F)).vertices)(V)


def test_every_function_takes_a_mesh_in_any_form(tmp_path: Path) -> None:
    model = gash_jax.load_model("mlp")
    expected = model(model.graph(BALL))
    for source in (BALL, (V, F, N), BALL.to_trimesh()):
        np.testing.assert_allclose(model(source), expected, atol=1e-5)
        np.testing.assert_allclose(model.predict(source).coefficients, expected, atol=1e-5)
    for work in (
        lambda mesh: gash_jax.bake_to_error(mesh, 0.5, 1),
        lambda mesh: gash_jax.plan_bake(mesh, 0.5, bands=1),
        lambda mesh: gash_jax.deforming_predictor(gash_jax.load_model("local"), mesh),
        lambda mesh: gash_jax.save_mesh(tmp_path / "m.ply", mesh),
        model.graph,
        model.predict,
        model,
    ):
        work((V, F))
        with pytest.raises(MeshError, match="not finite"):
            work((NAN, F))
