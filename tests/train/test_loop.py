"""Training: it learns, it resumes bit for bit, it refuses another config, its files come back."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from gash_jax.files.atomic import FileError
from gash_jax.files.settings import ConfigError
from gash_jax.models.examples import Example, WholeShapes
from gash_jax.models.families import make_examples, model_config
from gash_jax.models.model import load_model
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train import phase_run
from gash_jax.train.config import DataConfig, OptimConfig, RunConfig, TrainConfig
from gash_jax.train.corpus import build_corpus
from gash_jax.train.logs import read_lines
from gash_jax.train.loop import initial_state, train_model
from gash_jax.train.objectives import objectives
from gash_jax.train.step import learning_rate, make_optimizer, train_step

DATA = DataConfig(shapes=3, validation_shapes=1, rays=32, min_vertices=150, max_vertices=300)
GNN: dict[str, Any] = {"channels": 8, "layers": 1, "heads": 2, "neighbours": 6}
MODELS = {
    "gnn": model_config(name="gnn", **GNN),
    "teacher": model_config(name="teacher", **GNN),
    "mlp": model_config(name="mlp", channels=16, layers=2),
    "two-stage": model_config(
        name="two-stage", channels=8, layers=1, heads=2, neighbours=6, visibility_channels=8, visibility_layers=1
    ),
    "rings": model_config(name="rings", channels=8, layers=1, heads=2, neighbours=32),
    "versor": model_config(name="versor", channels=4, layers=1),
    "local": model_config(name="local", channels=8, layers=1),
}


def _config(name: str, steps: int) -> RunConfig:
    budget = TrainConfig(steps=steps, batch_vertices=512, checkpoint_every=4)
    return RunConfig(name=name, model=MODELS[name], data=DATA, optim=OptimConfig(learning_rate=3e-3), train=budget)


@pytest.fixture(scope="module")
def items():
    return build_corpus(DATA, 3, np.arange(4))


def _examples(items, name: str) -> tuple[list[Example], list[Example]]:
    examples = make_examples(items, MODELS[name])
    return examples[:3], examples[3:]


def test_batches_are_a_function_of_seed_and_step(items) -> None:
    training, _ = _examples(items, "mlp")
    first, again, other = (WholeShapes(training).draw(512, 0, step) for step in (5, 5, 6))
    np.testing.assert_array_equal(first.coefficients, again.coefficients)
    assert not np.array_equal(first.coefficients, other.coefficients)
    assert first.mask.shape == (1, 512) and not first.coefficients[~first.mask].any()
    with pytest.raises(ValueError, match="batch_vertices"):
        WholeShapes(training).draw(100, 0, 0)


def test_learning_rate_warms_up_and_decays() -> None:
    optim = OptimConfig(learning_rate=1.0, warmup=0.1)
    rates = [learning_rate(optim, f) for f in (0.0, 0.05, 0.1, 0.55, 1.0)]
    np.testing.assert_allclose(rates, [0.0, 0.5, 1.0, 0.5, 0.0], atol=1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_every_model_learns_and_its_file_predicts(
    items, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    training, validation = _examples(items, name)
    monkeypatch.setattr(phase_run, "LOG_EVERY", 1)
    config = _config(name, 40)
    config = replace(config, train=replace(config.train, checkpoint_every=40))
    path = train_model(config, training[:1], validation, tmp_path)  # one shape: every batch is it
    lines = [json.loads(line) for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    losses = [line["loss"] for line in lines if line.get("phase") == "coefficients" and "loss" in line]
    assert np.mean(losses[-3:]) < 0.9 * losses[0]
    model = load_model(path)
    assert model.metadata["run"]["train"]["steps"] == 40
    predicted = model.predict(bumpy_sphere(8))
    assert predicted.coefficients.shape[1] == 9 and np.isfinite(predicted.coefficients).all()


@pytest.mark.parametrize("name", ["rings", "two-stage", "versor", "local"])
def test_an_interrupted_run_ends_as_the_whole_one_bit_for_bit(
    items, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    training, validation = _examples(items, name)
    config = _config(name, 14)
    whole = load_model(train_model(config, training, validation, tmp_path / "whole"))
    saves, original = 0, phase_run.save_checkpoint

    def stop_at_third(folder: Path, state: object) -> None:
        nonlocal saves
        original(folder, state)
        saves += 1
        if saves == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(phase_run, "save_checkpoint", stop_at_third)
    with pytest.raises(KeyboardInterrupt):
        train_model(config, training, validation, tmp_path / "cut")
    monkeypatch.setattr(phase_run, "save_checkpoint", original)
    resumed = load_model(train_model(config, training, validation, tmp_path / "cut"))
    for one, two in zip(jax.tree.leaves(whole.params), jax.tree.leaves(resumed.params), strict=True):
        np.testing.assert_array_equal(one, two)


def test_a_phase_of_less_than_a_step_takes_one_step(items, tmp_path: Path) -> None:
    """And does not go on for as many seconds as would stand in place of steps."""
    train_model(_config("two-stage", 1), *_examples(items, "two-stage"), tmp_path)
    assert {(line["phase"], line["step"]) for line in read_lines(tmp_path)} == {("visibility", 1), ("coefficients", 1)}


def test_a_folder_of_another_config_is_refused(items, tmp_path: Path) -> None:
    training, validation = _examples(items, "mlp")
    config = _config("mlp", 4)
    train_model(config, training, validation, tmp_path)
    with pytest.raises(ConfigError, match="another config"):
        train_model(replace(config, name="other"), training, validation, tmp_path)


def test_the_first_phase_leaves_the_second_net_alone(items) -> None:
    training, _ = _examples(items, "two-stage")
    config = _config("two-stage", 4)
    batch = WholeShapes(training).draw(512, 0, 0)
    state = initial_state(config, batch)
    optimizer = make_optimizer(config.optim)
    phase = objectives(config.model)[0]
    rate, key = np.float32(1e-2), jax.random.key(0)
    params, *_ = train_step(
        *(state.params, state.optimizer, state.scale, batch, rate, key), **{"objective": phase, "optimizer": optimizer}
    )
    same = jax.tree.map(np.array_equal, params["coefficient"], state.params["coefficient"])
    assert all(jax.tree.leaves(same))
    moved = jax.tree.map(np.array_equal, params["visibility"], state.params["visibility"])
    assert not all(jax.tree.leaves(moved))


def test_model_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no model"):
        load_model(tmp_path / "absent.npz")


def test_a_finished_run_goes_on_when_its_budget_is_raised(items, tmp_path: Path) -> None:
    training, validation = _examples(items, "mlp")
    short, long = _config("mlp", 6), _config("mlp", 12)
    train_model(short, training, validation, tmp_path)
    path = train_model(long, training, validation, tmp_path)
    assert load_model(path).metadata["run"]["train"]["steps"] == 12
    steps = [json.loads(line)["step"] for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    assert steps[-1] == 12 and steps == sorted(steps)


def test_training_starts_from_given_weights(items, tmp_path: Path) -> None:
    training, validation = _examples(items, "mlp")
    first = load_model(train_model(_config("mlp", 30), training, validation, tmp_path / "first"))
    again = train_model(_config("mlp", 1), training, validation, tmp_path / "again", start=first.params)
    fresh = train_model(_config("mlp", 1), training, validation, tmp_path / "fresh")
    errors = {name: load_model(path).metadata["validation"] for name, path in (("again", again), ("fresh", fresh))}
    assert errors["again"] < 0.7 * errors["fresh"]
