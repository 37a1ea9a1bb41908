"""The table of families: every network answers one contract; configs have defaults, ranges, round trips."""

from dataclasses import asdict, fields
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.files.settings import ConfigError
from gash_jax.models.families import (
    FAMILIES,
    build_model,
    config_from_dict,
    config_from_file,
    family_of,
    labels_of,
    model_config,
    model_graph,
    with_bands,
)
from tests.helpers.bumpy import bumpy_mesh, network_inputs, random_variables


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("bands", [1, 4])
def test_every_model_answers_the_contract(name: str, bands: int) -> None:
    config = model_config(name, bands)
    graph = network_inputs(model_graph(config, bumpy_mesh(20)))
    module = build_model(config)
    variables = jax.eval_shape(module.init, jax.random.key(0), graph)
    out = jax.eval_shape(lambda v: module.apply(v, graph, deterministic=True), variables)
    # surfels: it says how far off it expects to be in every band
    expected = (20, bands * bands + (bands if name == "local" else 0))
    assert out.shape == expected  # type: ignore[union-attr]


def test_every_family_has_defaults_of_its_own() -> None:
    config: Any = model_config("two-stage")
    assert (config.channels, config.layers, config.heads, config.neighbours, config.graph) == (96, 5, 4, 16, "knn")
    assert (config.visibility_channels, config.visibility_layers, config.visibility_directions) == (64, 3, 25)
    rings: Any = model_config("rings")
    assert model_config().name == "local" and (rings.channels, rings.layers, rings.neighbours) == (32, 3, 32)
    chosen: Any = model_config("two-stage", graph="rings", neighbours=32)
    assert chosen.graph == "rings" and not hasattr(model_config("mlp"), "heads")


@pytest.mark.parametrize("name", FAMILIES)
def test_round_trip(name: str) -> None:
    config = model_config(name, bands=4, layers=2)
    assert config.to_dict() == asdict(config)
    assert config_from_dict(config.to_dict()) == config == config_from_file(config.to_dict())
    assert family_of(config) is FAMILIES[name] and type(config) is FAMILIES[name].config


def test_every_setting_says_what_it_means() -> None:
    for family in FAMILIES.values():
        for entry in fields(family.config)[1:]:
            assert len(entry.metadata["meaning"]) > 10, entry.name


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"name": "unet"}, "known are rings, versor, local, two-stage, gnn, teacher, mlp"),
        ({"bands": 0}, "bands = 0: must be from 1 to 10"),
        ({"bands": 11}, "bands = 11"),
        ({"layers": -1}, "layers = -1: must be at least 1"),
        ({"layers": 0}, "layers = 0"),
        ({"layers": 2.5}, "must be int, not 2.5"),
        ({"name": "rings", "heads": 5}, "5 heads"),
        ({"name": "two-stage", "heads": 6}, "64 channels"),
        ({"name": "gnn", "dropout": 1.0}, "dropout = 1.0: must be from 0 to below 1"),
        ({"name": "gnn", "dropout": float("nan")}, "dropout = nan"),
        ({"name": "gnn", "graph": "ring"}, "one of knn, rings"),
        ({"name": "two-stage", "graph": "none"}, "one of knn, rings"),
        (
            {"name": "rings", "graph": "knn"},
            "unknown key 'model.graph' in config: known here are name, bands, channels",
        ),
        ({"name": "mlp", "encoding": "relative-motor"}, "one of motor, motor-7, position-normal"),
        ({"name": "versor", "encoding": "relative"}, "one of relative-motor"),
        ({"name": "local", "encoding": "motor"}, "unknown key 'model.encoding'"),
        ({"name": "mlp", "heads": 4}, "unknown key 'model.heads'"),
    ],
)
def test_wrong_values_are_named(values: dict, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        config_from_dict(values)


def test_the_first_model_files_held_the_fields_of_all_families() -> None:
    old = {"name": "mlp", "bands": 3, "channels": 64, "layers": 2, "heads": 1, "neighbours": 0, "graph": "none"}
    old |= {"visibility_channels": 64, "dropout": 0.2, "block": 128, "encoding": "motor"}
    assert config_from_file(old) == model_config("mlp", channels=64, layers=2)
    with pytest.raises(ConfigError, match="unknown key 'model.width'"):
        config_from_file({**old, "width": 3})


def test_a_network_may_be_asked_for_fewer_bands_than_it_knows() -> None:
    config: Any = model_config("local", 3, known_bands=6, known_bounces=2)
    assert labels_of(config) == (6, 2) and labels_of(model_config("mlp", 4)) == (4, 0)
    # without more that is known it is what is asked for
    assert labels_of(model_config("local", 5)) == (5, 0)
    for bands in (1, 3, 6):
        asked: Any = with_bands(config, bands)
        assert (asked.bands, labels_of(asked)) == (bands, (6, 2)) and with_bands(asked, 3) == config
    fewer: Any = with_bands(model_config("local", 5), 2)
    assert (fewer.bands, labels_of(fewer)) == (2, (5, 0))
    assert with_bands(model_config("mlp", 4), 4) == model_config("mlp", 4)
    for wrong, bands, words in (
        (config, 7, "bands=7: model local knows 6 bands"),
        (model_config("local", 1), 2, "knows 1 band$"),
        (model_config("mlp", 4), 3, "says 4 bands, no other number"),
        (model_config("mlp", 4), 5, "knows 4 bands"),
    ):
        with pytest.raises(ValueError, match=words):
            with_bands(wrong, bands)


ENCODINGS = [
    (name, encoding)
    for name, family in FAMILIES.items()
    for entry in fields(family.config)
    if entry.name == "encoding"
    for encoding in entry.metadata["choices"]
]


@pytest.mark.parametrize(("name", "encoding"), ENCODINGS)
def test_every_encoding_is_read_and_gives_finite_gradients(name: str, encoding: str) -> None:
    small: dict[str, Any] = {"channels": 8, "layers": 1, "encoding": encoding}
    small |= {"heads": 2} if name not in ("mlp", "versor") else {}
    config = model_config(name, **small, **({"visibility_channels": 8} if name == "two-stage" else {}))
    graph = model_graph(config, bumpy_mesh(20))
    module = build_model(config)
    variables = random_variables(module, graph)
    gradient = jax.jit(jax.grad(lambda v: jnp.sum(jnp.asarray(module.apply(v, graph)) ** 2)))(variables)
    sizes = jax.tree.map(lambda leaf: float(jnp.abs(leaf).max()), gradient)
    assert all(np.isfinite(size) for size in jax.tree.leaves(sizes)) and max(jax.tree.leaves(sizes)) > 0
