"""Configs: defaults, round trips, and every wrong value named."""

from dataclasses import asdict

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.models.config import DEFAULTS, ENCODINGS, ModelConfig, build_model
from gash_jax.models.model_graph import model_graph
from tests.helpers.bumpy import bumpy_mesh


@pytest.mark.parametrize("name", DEFAULTS)
@pytest.mark.parametrize("bands", [1, 4])
def test_every_model_answers_the_contract(name: str, bands: int) -> None:
    config = ModelConfig(name, bands)
    graph = model_graph(config, bumpy_mesh(20))
    module = build_model(config)
    variables = jax.eval_shape(module.init, jax.random.key(0), graph)
    out = jax.eval_shape(lambda v: module.apply(v, graph, deterministic=True), variables)
    # surfels: its nodes fill two blocks of 16, and it says how far off it expects to be in every band
    expected = (32, bands * bands + bands) if name == "local" else (20, bands * bands)
    assert out.shape == expected  # type: ignore[union-attr]


def test_defaults_are_resolved_at_once() -> None:
    config = ModelConfig("two-stage")
    assert (config.channels, config.layers, config.heads, config.neighbours, config.graph) == (96, 5, 4, 16, "knn")
    assert ModelConfig().name == "local" and ModelConfig().graph == "surfels" and ModelConfig("mlp").graph == "none"
    assert ModelConfig("rings").graph == "rings" and ModelConfig("rings").neighbours == 32
    assert ModelConfig("two-stage", graph="rings", neighbours=32).graph == "rings"
    assert ModelConfig("local", channels=16, layers=1).channels == 16


@pytest.mark.parametrize("name", DEFAULTS)
def test_round_trip(name: str) -> None:
    config = ModelConfig(name, bands=4, layers=2)
    assert config.to_dict() == asdict(config)
    assert ModelConfig(**config.to_dict()) == config


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"name": "unet"}, "known are rings, local, two-stage, gnn, teacher, mlp"),
        ({"bands": 0}, "bands = 0"),
        ({"bands": 11}, "bands = 11"),
        ({"layers": -1}, "layers = -1"),
        ({"heads": 5}, "5 heads"),
        ({"name": "two-stage", "heads": 6}, "64 channels"),
        ({"dropout": 1.0}, "dropout"),
        ({"graph": "ring"}, "known are knn, rings, surfels, none"),
        ({"name": "rings", "graph": "knn"}, "cannot use graph knn: it takes rings and no other"),
        ({"name": "local", "graph": "rings"}, "it takes surfels and no other"),
        ({"name": "two-stage", "graph": "none"}, "cannot use graph none: it needs edges"),
        ({"name": "gnn", "graph": "surfels"}, "cannot use graph surfels: it needs edges"),
        ({"name": "mlp", "encoding": "relative-motor"}, "known are motor, motor-7, position-normal"),
        ({"name": "local", "encoding": "motor"}, "local has no encoding 'motor': known are surfels"),
        ({"name": "mlp", "graph": "knn"}, "cannot use graph knn: it takes none and no other"),
    ],
)
def test_wrong_values_are_named(values: dict, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        ModelConfig(**values)


@pytest.mark.parametrize(("name", "encoding"), [(name, each) for name, known in ENCODINGS.items() for each in known])
def test_every_encoding_is_read_and_gives_finite_gradients(name: str, encoding: str) -> None:
    config = ModelConfig(
        name, channels=8, layers=1, visibility_channels=8, heads=2 * (name != "local"), encoding=encoding
    )
    graph = model_graph(config, bumpy_mesh(20))
    module = build_model(config)
    variables = jax.jit(module.init)(jax.random.key(0), graph)
    gradient = jax.jit(jax.grad(lambda v: jnp.sum(jnp.asarray(module.apply(v, graph)) ** 2)))(variables)
    sizes = jax.tree.map(lambda leaf: float(jnp.abs(leaf).max()), gradient)
    assert all(np.isfinite(size) for size in jax.tree.leaves(sizes)) and max(jax.tree.leaves(sizes)) > 0
