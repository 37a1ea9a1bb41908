"""The local network in training: it grows from a smaller one, and its errors are learnt on shapes it has not seen."""

from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from gash_jax.files.settings import ConfigError
from gash_jax.models.examples import Example
from gash_jax.models.families import build_model, labels_of, model_config, model_graph
from gash_jax.models.model import load_model, save_model
from gash_jax.nn.config import ModelConfig
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train import loop
from gash_jax.train.config import OptimConfig, RunConfig, TrainConfig
from gash_jax.train.loop import train_model
from gash_jax.train.run import _start
from tests.helpers.bumpy import random_variables

SMALL = model_config("local", channels=8, layers=1)
LARGE = model_config("local", channels=8, layers=1, known_bands=6, known_bounces=2)
MESH = bumpy_sphere(3)


def _example(config: ModelConfig, value: float) -> Example:
    bands, bounces = labels_of(config)
    count = len(MESH.vertices)
    bounced = np.full((count, bounces, bands**2), value, np.float32) if bounces else None
    labels = np.full((count, bands**2), value, np.float32)
    return Example(model_graph(config, MESH), labels, np.ones((count, 1), np.float32), bounced)


def _run(config: ModelConfig, start: Path | str = "") -> RunConfig:
    budget = TrainConfig(steps=1, batch_vertices=64, start_from=str(start))
    return RunConfig(name="test", model=config, optim=OptimConfig(learning_rate=1e-3), train=budget)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The model file of three bands without bounces."""
    path = tmp_path_factory.mktemp("small") / "small.npz"
    save_model(path, SMALL, random_variables(build_model(SMALL), model_graph(SMALL, MESH))["params"])
    return path


def test_it_starts_from_a_network_of_fewer_bands(small: Path, tmp_path: Path) -> None:
    params = _start(_run(LARGE, small))
    path = train_model(_run(LARGE, small), [_example(LARGE, 0.3)], [_example(LARGE, 0.3)], tmp_path, start=params)
    grown = load_model(path)
    # the first step of a phase, in the warm-up, changes nothing
    assert set(params) < set(grown.params) and any(name.startswith("further") for name in grown.params)
    for name, leaves in params.items():
        jax.tree.map(np.testing.assert_array_equal, leaves, grown.params[name])
    before, after = load_model(small), grown
    np.testing.assert_allclose(after(MESH), before(MESH), atol=1e-5)
    assert load_model(path, bands=6)(MESH).shape == (len(MESH.vertices), 36)


def test_another_network_is_no_start(small: Path, tmp_path: Path) -> None:
    wide = model_config("local", channels=12, layers=1, known_bands=6)
    for config in (wide, model_config("mlp")):
        with pytest.raises(ConfigError, match="holds another network"):
            _start(_run(config, small))
    path = tmp_path / "large.npz"
    save_model(path, LARGE, random_variables(build_model(LARGE), model_graph(LARGE, MESH))["params"])
    with pytest.raises(ConfigError, match="holds another network"):
        _start(_run(SMALL, path))
    assert _start(_run(SMALL)) is None


@pytest.mark.parametrize(("validated", "unlike"), [(True, True), (True, False), (False, False)])
def test_errors_are_learnt_on_shapes_to_validate_on_and_on_others_unlike_them(
    validated: bool, unlike: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn, held = {}, {}

    class Recorded:
        def __init__(self, config: Any, objective: Any, draw: Any, batches: Any, *others: Any) -> None:
            drawn[objective.phase.name] = np.unique(draw(64, 0, 0).coefficients[..., 0]).tolist()
            held[objective.phase.name] = np.unique([batch.coefficients[..., 0] for batch in batches]).tolist()

        def run(self, state: Any) -> Any:
            return state

    monkeypatch.setattr(loop, "PhaseRun", Recorded)
    shapes = [[_example(LARGE, 2.0)] if validated else [], [_example(LARGE, 3.0)] if unlike else []]
    train_model(_run(LARGE), [_example(LARGE, 1.0)], shapes[0], tmp_path, unlike=shapes[1])
    unseen = [2.0] * validated + [3.0] * unlike
    assert drawn == {"coefficients": [1.0], "further": [1.0], "error": unseen or [1.0]}
    assert held == {"coefficients": unseen[:1], "further": unseen[:1], "error": unseen}
