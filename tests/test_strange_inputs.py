"""What people give to the public API that is not quite it: taken where it can be meant, else refused in one line."""

import json
import os
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import gash_jax
from gash_jax.models.model import shipped_models
from gash_jax.shapes.primitives import bumpy_sphere

MESH = bumpy_sphere(3)
COUNT = len(MESH.vertices)
TRANSFER: Any = gash_jax.Transfer(np.full((COUNT, 9), 0.25, np.float32), None, *MESH, {})
LIGHT = np.linspace(-1, 1, 27, dtype=np.float32).reshape(9, 3)
FRAMES = np.tile(np.eye(3), (COUNT, 1, 1))
RAGGED: Any = [[1.0, 2.0], [3.0]]
ANY: Any = gash_jax  # without the types of its functions: what is given here has others


class Tensor:
    """An array of another library, which NumPy can read."""

    def __init__(self, array: np.ndarray) -> None:
        self.array = array

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self.array, dtype)


REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "ragged light": (lambda: ANY.shade(TRANSFER, RAGGED), "bands.2, 3"),
    "light by its path": (lambda: ANY.shade(TRANSFER, "studio.hdr"), "load_light"),
    "plan by a path of a light": (lambda: ANY.plan_bake(MESH, light="studio.hdr"), "load_light"),
    "plan by a light that is not finite": (lambda: ANY.plan_bake(MESH, light=LIGHT * np.nan), "not finite"),
    "truth values as light": (lambda: ANY.shade(TRANSFER, LIGHT > 0), "real numbers"),
    "a mesh as transfer": (lambda: ANY.shade(MESH, LIGHT), "what a bake or a model returns"),
    "albedo in words": (lambda: ANY.shade(TRANSFER, LIGHT, albedo="white"), r"give numbers \(3,\)"),
    "albedo ragged": (lambda: ANY.shade(TRANSFER, LIGHT, albedo=RAGGED), r"give numbers \(3,\)"),
    "window in other words": (lambda: ANY.shade(TRANSFER, LIGHT, window="box"), "hann, lanczos, irradiance, radiance"),
    "window of truth values": (lambda: ANY.shade(TRANSFER, LIGHT, window=[True] * 9), r"give numbers \(9,\)"),
    "window of a negative light": (
        lambda: ANY.shade(TRANSFER, LIGHT, window="radiance"),
        "mean of the light is negative",
    ),
    "rotation ragged": (lambda: ANY.rotate_light(LIGHT, RAGGED), "rotation matrix"),
    "rotation in words": (lambda: ANY.rotate_light(LIGHT, "x"), "rotation matrix"),
    "traced rotation": (lambda: jax.jit(lambda r: ANY.rotate_light(LIGHT, r))(jnp.eye(4)), "rotation matrix"),
    "exposure in words": (lambda: ANY.render(TRANSFER, LIGHT, exposure="auto"), "a number above 0"),
    "two exposures": (lambda: ANY.render(TRANSFER, LIGHT, exposure=[1.0, 2.0]), "a number above 0"),
    "exposure as truth value": (lambda: ANY.render(TRANSFER, LIGHT, exposure=True), "a number above 0"),
    "camera ragged": (lambda: ANY.render(TRANSFER, LIGHT, camera=[1, [2]]), "azimuth, elevation"),
    "camera as a long array": (lambda: ANY.render(TRANSFER, LIGHT, camera=np.eye(40)), "azimuth, elevation"),
    "picture of nan": (lambda: ANY.render(TRANSFER, LIGHT * np.nan), "nan and inf"),
    "figure of nan": (lambda: ANY.show(TRANSFER, LIGHT * np.nan), "nan and inf"),
    "up as a list": (lambda: ANY.load_mesh(MESH, up=["y"]), "choose one of x, y, z"),
    "rays as an array": (lambda: ANY.bake_transfer(MESH, rays=np.eye(9)), "whole number"),
    "rows as a list": (lambda: ANY.bake_transfer(MESH, rows=[0, 1]), "slice.first, last"),
    "rows of fractions": (lambda: ANY.bake_transfer(MESH, rows=slice(0.5, 2)), "slice.first, last"),
    "frames in words": (lambda: ANY.bake_transfer(MESH, frames="normal"), "one frame per vertex"),
    "frames of other normals": (lambda: ANY.bake_transfer(MESH, frames=FRAMES), "tangent, bitangent and normal"),
    "frames of no length": (lambda: ANY.bake_transfer(MESH, frames=0 * FRAMES), "tangent, bitangent and normal"),
    "error as truth value": (lambda: ANY.bake_to_error(MESH, True), "error must be"),
    "error in words": (lambda: ANY.bake_to_error(MESH, "0.1"), "error must be"),
    "transfer of one row": (lambda: TRANSFER._replace(coefficients=np.zeros(9)), "what a bake"),
    "transfer of nothing": (lambda: TRANSFER._replace(coefficients=None), "what a bake"),
    "array as transfer file": (lambda: ANY.save_transfer("x.npz", LIGHT), "is no Transfer"),
    "path last": (lambda: ANY.save_transfer(TRANSFER, "x.npz"), "is no Transfer"),
    "metadata of arrays": (
        lambda: ANY.save_transfer("x.npz", TRANSFER._replace(metadata={"a": LIGHT})),
        "metadata is no JSON",
    ),
    "transfer as light file": (lambda: ANY.save_light("x.npz", TRANSFER), "bands.2, 3"),
    "light that is not finite": (lambda: ANY.save_light("x.npz", LIGHT * np.nan), "not finite"),
    "map ragged": (lambda: ANY.project_light(RAGGED), "shape .height, width, 3"),
    "map to write ragged": (lambda: ANY.write_hdr("x.hdr", RAGGED), "shape .height, width, 3"),
    "studio of a real number": (lambda: ANY.studio_light(8.0), "whole number from 4"),
    "studio that fits no memory": (lambda: ANY.studio_light(10**9), "whole number from 4"),
    "shape of a range in reverse": (lambda: ANY.make_shape(0, 0, vertices=(300, 200)), "lowest and the highest"),
    "shape of one count": (lambda: ANY.make_shape(0, 0, vertices=300), "lowest and the highest"),
    "shape of a negative seed": (lambda: ANY.make_shape(-1, 0), "whole number of 0"),
    "normals ragged": (lambda: ANY.unshadowed_transfer(RAGGED), "unit vectors"),
    "points in the plane": (lambda: ANY.embed_point(np.zeros((2, 2))), r"give \(..., 3\)"),
    "normals in the plane": (lambda: ANY.rotor_from_normal(np.zeros((2, 2))), r"give \(..., 3\)"),
    "fewer normals": (lambda: ANY.motor(np.zeros((2, 3)), np.zeros((1, 3))), "normal for each position"),
    "no motor": (lambda: ANY.motor_to_rigid(np.zeros(31)), r"give \(..., 32\)"),
    "no multivector": (lambda: ANY.geometric_product(np.zeros(31), np.zeros(32)), r"give \(..., 32\)"),
    "one override": (lambda: ANY.load_config("mlp", "train.steps=5"), "give a list"),
    "override of a number": (lambda: ANY.load_config("mlp", [5]), "key=value"),
    "config of names": (lambda: ANY.RunConfig(model="mlp"), "no ModelConfig"),
    "run of a name": (lambda: ANY.run_config("mlp", "run"), "load_config"),
    "run into a file": (lambda: ANY.run_config(ANY.load_config("mlp"), __file__), "is no folder"),
    "deforming with a name": (lambda: ANY.deforming_predictor("local", MESH), "load_model"),
    "model in a folder without any": (lambda: ANY.load_model(Path.cwd()), "folder of a finished run"),
}


NO_PATHS: Any = [None, 3, b"x.npz", "a\0.npz", "a" * 300 + ".npz", "."]
WITH_PATHS: dict[str, Callable[[Any], Any]] = {
    **{
        name: getattr(gash_jax, name)
        for name in ("load_mesh", "load_light", "load_transfer", "load_model", "load_config")
    },
    "save_mesh": lambda path: gash_jax.save_mesh(path, MESH),
    "save_light": lambda path: gash_jax.save_light(path, LIGHT),
    "save_transfer": lambda path: gash_jax.save_transfer(path, TRANSFER),
    "write_hdr": lambda path: gash_jax.write_hdr(path, np.ones((4, 8, 3), np.float32)),
}


def outcomes() -> dict[str, str]:
    """What each call says that must be refused; the name and the text of errors that are no ValueErrors."""
    calls = {name: call for name, (call, _) in REFUSED.items()}
    for path in NO_PATHS:
        calls |= {f"{name} of {path!r:.9}": partial(call, path) for name, call in WITH_PATHS.items()}
    found = {}
    for name, call in calls.items():
        try:
            found[name] = f"no error, but {call()!r:.200}"
        except ValueError as error:
            found[name] = str(error)
        except Exception as error:
            found[name] = f"{type(error).__name__}\n{error}"
    return found


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """`outcomes` of a process of its own: as users have it, without the checks of types that the tests install."""
    folder = tmp_path_factory.mktemp("refused")
    program = "import json; from tests.test_strange_inputs import outcomes; print(json.dumps(outcomes()))"
    root = Path(__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (root / "src", root)))}
    run = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    assert not list(folder.iterdir())
    return json.loads(run.stdout)


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_meant_is_refused_in_one_line(name: str, said: dict[str, str]) -> None:
    message = said[name]
    assert re.search(REFUSED[name][1], message), message
    assert "\n" not in message and len(message) < 300


def test_what_is_no_path_is_refused_in_one_line(said: dict[str, str]) -> None:
    messages = [message for name, message in said.items() if name not in REFUSED]
    assert len(messages) == len(NO_PATHS) * len(WITH_PATHS)
    for message in messages:
        assert "\n" not in message and len(message) < 400 and not message.startswith("no error"), message


@pytest.mark.parametrize("kind", [list, Tensor, jnp.asarray, np.asfortranarray, lambda a: np.repeat(a, 2, 0)[::2]])
def test_arrays_of_any_make(kind: Callable[[Any], Any]) -> None:
    """The same numbers, whatever they came in."""
    vertices, faces = kind(MESH.vertices), kind(MESH.faces)
    for given in ((vertices, faces), (vertices, np.asarray(MESH.faces, np.uint16)), (vertices, faces, None)):
        found = ANY.load_mesh(given)
        np.testing.assert_array_equal(found.vertices, MESH.vertices)
        np.testing.assert_array_equal(found.faces, MESH.faces)
    radiance = ANY.shade(kind(TRANSFER.coefficients), kind(LIGHT), albedo=kind(np.ones(3)))
    np.testing.assert_array_equal(radiance, gash_jax.shade(TRANSFER, LIGHT))


def test_light_of_whole_numbers_and_of_half_precision() -> None:
    whole, half = np.ones((9, 3), int), jnp.ones((9, 3), jnp.bfloat16)
    expected = gash_jax.shade(TRANSFER, np.ones((9, 3), np.float32))
    np.testing.assert_allclose(ANY.shade(TRANSFER, whole), expected, rtol=1e-6)
    found = ANY.shade(jnp.asarray(TRANSFER.coefficients, jnp.bfloat16), half)
    np.testing.assert_allclose(np.asarray(found, np.float32), expected, rtol=1e-2)


def test_a_light_is_saved_from_its_array(tmp_path: Path) -> None:
    gash_jax.save_light(tmp_path / "studio.npz", LIGHT)
    np.testing.assert_array_equal(gash_jax.load_light(tmp_path / "studio.npz").coefficients, LIGHT)


def test_an_error_of_any_make() -> None:
    for error in (np.float32(0.5), jnp.float32(0.5), np.array(0.5)):
        assert ANY.bake_to_error(MESH, error).metadata["estimated_error"] <= 0.5


def test_a_model_refuses_what_another_one_reads() -> None:
    local, mlp = gash_jax.load_model("local"), gash_jax.load_model("mlp")
    graphs: dict[str, Any] = {"local": mlp.graph(MESH), "mlp": local.graph(MESH)}
    for model in (local, mlp):
        for graph in (graphs[model.config.name], TRANSFER, None, 3, MESH.vertices):
            for call in (model, jax.jit(model)) if graph is graphs[model.config.name] else (model,):
                with pytest.raises(ValueError, match=f"that model {model.config.name} does not read: give a mesh"):
                    call(graph)
        for params in ({}, {"a": 1}, gash_jax.load_model("two-stage").params, "x"):
            with pytest.raises(ValueError, match=f"params are not those of model {model.config.name}"):
                model.with_error(model.graph(MESH), params)


def test_a_model_comes_back_from_a_pickle_and_from_the_folder_of_its_run(tmp_path: Path) -> None:
    model = gash_jax.load_model("mlp")
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again(MESH), model(MESH))
    (tmp_path / "model.npz").write_bytes(shipped_models()["mlp"].read_bytes())
    np.testing.assert_array_equal(gash_jax.load_model(tmp_path)(MESH), model(MESH))


def test_visibility_is_predicted_of_a_mesh_too() -> None:
    model = gash_jax.load_model("two-stage")
    np.testing.assert_array_equal(model.visibility_logits(MESH), model.visibility_logits(model.graph(MESH)))
