"""Configs: differences from a base, overrides, and errors that name the key."""

import json
from pathlib import Path
from typing import Any

import pytest

from gash_jax.files.settings import ConfigError
from gash_jax.train.config import RunConfig, load_config, run_from_dict, shipped_configs


def _write(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text)
    return folder / name


def test_a_config_is_a_difference_from_its_base(tmp_path: Path) -> None:
    _write(tmp_path, "base.toml", 'name = "b"\n[data]\nshapes = 5\n[train]\nsteps = 7\n')
    path = _write(tmp_path, "run.toml", 'base = "base.toml"\nname = "r"\n[data]\nseed = 3\n')
    config = load_config(path, ["train.steps=9", "optim.learning_rate=1", "model.name=mlp"])
    assert (config.name, config.data.shapes, config.data.seed) == ("r", 5, 3)
    assert (config.train.steps, config.optim.learning_rate, config.model.name) == (9, 1.0, "mlp")


def test_dictionary_round_trip() -> None:
    config = RunConfig()
    assert run_from_dict(config.to_dict()) == config
    other: Any = run_from_dict({"model": {"name": "two-stage", "dropout": 0}})
    assert other.model.dropout == 0.0 and run_from_dict(other.to_dict()) == other


@pytest.mark.parametrize("name", [n for n in shipped_configs() if n != "base"])
def test_shipped_configs_load(name: str) -> None:
    assert load_config(name).name == name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nam = 'x'", "unknown key 'nam'"),
        ("[train]\nstep = 1", "unknown key 'train.step'"),
        ("[train]\nsteps = 'many'", "'train.steps' must be int"),
        ("[train]\nsteps = true", "'train.steps' must be int"),
        ("train = 3", "'train' must be a table"),
        ("x = ", "not a TOML file"),
        ("[model]\nheads = 4", "unknown key 'model.heads' in config: known here are name, bands, channels"),
        ("model = 3", "'model' must be a table"),
        ("[model]\nname = 'two-stag'", "did you mean 'two-stage'"),
        ("[train]\nsecods = 3", "unknown key 'train.secods' in config, did you mean 'seconds'"),
        ("[train]\nsteps = -5", "steps = -5: must be at least 0"),
        ("[train]\ncheckpoint_every = 0", "checkpoint_every = 0: must be at least 1"),
        ("[train]\nclock = 'sun'", "one of wall, cpu"),
        ("[optim]\nlearning_rate = nan", "learning_rate = nan: must be at least 0"),
        ("[optim]\nwarmup = 1", "warmup = 1.0: must be from 0 to below 1"),
        ("[data]\nmin_vertices = 9\nmax_vertices = 8", "min_vertices = 9: must be at most max_vertices, 8"),
        ("base = 'absent.toml'", "no such config file"),
        ("base = 'run.toml'", "itself as base"),
        ("[model]\nname = 'transformer-xl'", "transformer-xl"),
        ("[model]\nchanels = 3", "unknown key 'model.chanels'"),
        ("[model]\nbands = '3'", "'model.bands' must be int"),
        ("[model]\nlayers = 1.5", "'model.layers' must be int"),
        ("[model]\nname = 'rings'\nblock = true", "'model.block' must be int"),
    ],
)
def test_errors_name_the_key(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_config(_write(tmp_path, "run.toml", text))


def test_overrides_must_be_assignments(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="key=value"):
        load_config(_write(tmp_path, "run.toml", ""), ["steps"])


def test_a_runs_own_config_is_a_config(tmp_path: Path) -> None:
    config = load_config("two-stage", ["train.steps=3"])
    path = _write(tmp_path, "config.json", json.dumps(config.to_dict()))
    assert load_config(path) == config and load_config(path, ["train.steps=4"]).train.steps == 4
    with pytest.raises(ConfigError, match="not a JSON file"):
        load_config(_write(tmp_path, "cut.json", "{"))
    with pytest.raises(ConfigError, match="must be a table"):
        load_config(_write(tmp_path, "list.json", "[]"))
    with pytest.raises(ConfigError, match="did you mean 'two-stage'"):
        load_config("two-stge")
