"""The numbers of docs/model_file.md: what the file holds is what the runtime computes, and what the package says."""

import json
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from flax.traverse_util import unflatten_dict

from docs.model_tables import STAGES
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.files.settings import from_dict
from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.mesh_graph import build_graph
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.families import config_from_dict
from gash_jax.models.model import Model
from gash_jax.models.patch_levels import LEVELS
from gash_jax.prt.hemisphere import hemisphere_directions
from runtimes import worked_example as example

WRITTEN = json.loads((Path(__file__).parents[2] / "docs" / "results" / "model_example.json").read_text())["stages"]
DEFORMING_EXAMPLES = example.deforming_models()
MESH = Mesh(example.VERTICES, example.NORMALS, example.FACES)


@pytest.fixture(scope="module")
def computed() -> dict[str, example.Rows]:
    return example.stages()


@pytest.mark.parametrize("stage", STAGES)
def test_what_is_written_is_what_is_computed(stage: str, computed: dict[str, example.Rows]) -> None:
    assert set(computed) == set(WRITTEN) == set(STAGES)
    for mine, theirs in zip(computed[stage], WRITTEN[stage], strict=True):
        assert mine[0] == theirs[0]
        np.testing.assert_allclose(mine[1], theirs[1], rtol=1e-4, atol=1e-5, err_msg=mine[0])


def _row(stage: str, label: str) -> Any:
    return np.array(next(numbers for name, numbers in WRITTEN[stage] if name == label))


@pytest.mark.parametrize("name", example.CONFIGS)
def test_the_package_says_the_same(name: str) -> None:
    config: Any = config_from_dict(example.CONFIGS[name])
    arrays = example.sine_model(name, example.network_shapes()[name]).arrays
    model = Model(config, unflatten_dict(arrays, sep="/"))
    graph = model.graph(MESH)
    if name == "teacher":
        graph = graph._replace(nodes={**graph.nodes, "visibility": example.VISIBILITY})
    found = np.asarray(model(graph))[example.VERTEX]
    np.testing.assert_allclose(found, _row("models", f"`{name}`"), rtol=1e-4, atol=1e-5)


def test_stages_of_the_package() -> None:
    graph = build_graph(MESH, "knn", 2)
    nodes: Any = graph.nodes
    motor = nodes["motor"][example.VERTEX]
    for label, numbers in WRITTEN["motors"][:-1]:
        np.testing.assert_allclose(motor[int(label.split()[1])], numbers[0], atol=1e-5)
    assert len(WRITTEN["motors"]) - 1 == np.count_nonzero(motor)
    exact = np.asarray(unshadowed_transfer(example.NORMALS, 3))[example.VERTEX]
    np.testing.assert_allclose(exact, _row("closed form", "t, 3 bands"), atol=1e-5)
    for name, label in ((False, "vertex"), (True, "world")):
        told = hemisphere_directions(example.NORMALS, 3, world=name)[example.VERTEX]
        for i in range(3):
            np.testing.assert_allclose(told[i], _row("directions", f"`{label}`, direction {i} of 3"), atol=1e-5)
    np.testing.assert_array_equal(np.asarray(graph.senders).reshape(4, 2)[2], _row("graphs", "row 2"))


@pytest.mark.parametrize("name", DEFORMING_EXAMPLES)
def test_the_package_says_the_same_of_a_pose(name: str) -> None:
    model, arguments = DEFORMING_EXAMPLES[name], (jnp.asarray(example.VERTICES), jnp.asarray(example.NORMALS))
    config = from_dict(DEFORMING[name].config, model.config)
    arrays = {key: jnp.asarray(array) for key, array in model.arrays.items()}
    if name == "deform":
        for level in range(3, len(LEVELS)):  # which no patch of the example has
            arrays |= {f"directions/{level}": jnp.zeros((0, 4, 1)), f"weights/{level}": jnp.zeros((0, 5, 1))}
    found = np.asarray(DEFORMING[name].predict(config, arrays, *arguments))
    for label, numbers in WRITTEN["deforming"]:
        if label.startswith(f"`{name}`"):
            np.testing.assert_allclose(
                found[1 if "vertex 1" in label else example.VERTEX], numbers, rtol=1e-4, atol=1e-5
            )


def test_sine_weights_are_those_of_the_document() -> None:
    np.testing.assert_allclose(example.sine_weights(2, 3)[1, 0], np.sin(4) / np.sqrt(2), rtol=1e-6)
