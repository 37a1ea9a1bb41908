"""Sweeps: one config, some keys of it varied, every combination trained with the same budget.

    name = "latent-depth"
    config = "two-stage"                       # a shipped config or a file
    set = ["data.shapes=64", "train.seconds=300"]   # for every run
    seeds = [0]
    [axes.latent]                              # keys that change together
    keys = ["model.channels", "model.visibility_channels"]
    values = [8, 16, 32, 64]
    [[repeats]]                                # further seeds for some points
    seeds = [1, 2]
    points = [{latent = 8, depth = 1}]

A run is known by the hash of its resolved config, names aside, so that a changed sweep keeps what still belongs to it.
"""

import hashlib
import json
import re
import tomllib
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import jax

from gash_jax.files.settings import ConfigError, from_dict
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.deforming_model import load_deforming_model
from gash_jax.models.model import load_model
from gash_jax.train.config import RunConfig, load_config, shipped_configs
from gash_jax.train.deforming_run import run_deforming
from gash_jax.train.logs import CLOCKS, read_lines
from gash_jax.train.phase_run import ReportFn
from gash_jax.train.run import run_config


@dataclass(frozen=True)
class Axis:
    """Dotted config keys that take the same value, and the values."""

    keys: list
    values: list

    def __post_init__(self) -> None:
        if not self.keys or not self.values:
            raise ValueError("an axis needs keys and values")


@dataclass(frozen=True)
class SweepConfig:
    """A sweep file as it stands."""

    name: str
    config: str
    axes: dict
    set: list = field(default_factory=list)
    seeds: list = field(default_factory=lambda: [0])
    repeats: list = field(default_factory=list)


@dataclass(frozen=True)
class Run:
    """One training of a sweep: values by axis, seed, resolved config."""

    point: dict[str, Any]
    seed: int
    config: RunConfig

    @property
    def id(self) -> str:
        """Hash of the resolved config but for its name."""
        values = {**self.config.to_dict(), "name": ""}
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]

    @property
    def folder(self) -> str:
        """Name of the run's folder: its point and seed to read, its id to tell it apart."""
        label = "-".join([*(f"{name}_{value}" for name, value in self.point.items()), f"seed_{self.seed}"])
        return f"{re.sub(r'[^A-Za-z0-9._-]+', '_', label)}-{self.id}"


def load_sweep(path: Path) -> tuple[str, list[Run]]:
    """Name and runs of a sweep file, in order, repeats last. Raises ConfigError."""
    if not path.is_file():
        raise ConfigError(f"no such sweep file: {path}")
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not a TOML file: {' '.join(str(error).split())}") from None
    missing = {"name", "config", "axes"} - set(values)
    if missing:
        raise ConfigError(f"{path} is not a sweep: it lacks {', '.join(sorted(missing))}")
    sweep = from_dict(SweepConfig, values)
    axes = {name: from_dict(Axis, axis, f"axes.{name}.") for name, axis in sweep.axes.items()}
    base = sweep.config if sweep.config in shipped_configs() else path.parent / sweep.config

    def run(point: dict[str, Any], seed: int) -> Run:
        if set(point) != set(axes):
            raise ConfigError(f"point {point} of the sweep must name every axis: {', '.join(axes)}")
        changes = [f"{key}={json.dumps(point[name])}" for name, axis in axes.items() for key in axis.keys]
        label = "-".join(f"{name}{value}" for name, value in point.items())
        changes += [f"train.seed={seed}", f"name={json.dumps(f'{sweep.name}-{label}-seed{seed}')}"]
        return Run(point, seed, load_config(base, [*sweep.set, *changes]))

    combinations = product(*(axis.values for axis in axes.values()))
    points = [dict(zip(axes, values, strict=True)) for values in combinations]
    runs = [run(point, seed) for seed in sweep.seeds for point in points]
    for repeat in sweep.repeats:
        if set(repeat) != {"seeds", "points"}:
            raise ConfigError(f"a [[repeats]] table of {path} needs seeds and points, and nothing else")
        runs += [run(point, seed) for seed in repeat["seeds"] for point in repeat["points"]]
    return sweep.name, runs


def run_folder(folder: Path, id: str) -> Path:
    """The folder of a run by its id. Raises ConfigError where there is none."""
    found = sorted(folder.glob(f"*{id}"))
    if not found:
        raise ConfigError(f"{folder} holds no run {id}: its weights are lost, train it again")
    return found[0]


def train_run(run: Run, folder: Path, report: ReportFn | None = None) -> dict[str, Any]:
    """Train (or continue) one run; its line of results, measured on the validation shapes, or on the test frames of
    one object that deforms."""
    if run.config.model.name in DEFORMING:
        return _deforming_line(run, folder, report)
    path, _ = run_config(run.config, folder, report=report)
    lines, model = read_lines(folder), load_model(path)
    last = [line for line in lines if line["phase"] == lines[-1]["phase"]]
    best = min((line for line in last if "validation" in line), key=lambda line: line["validation"])
    return {
        "id": run.id,
        "name": run.config.name,
        **run.point,
        "seed": run.seed,
        "steps": last[-1]["step"],
        "phase_steps": {line["phase"]: line["step"] for line in lines},
        "best_step": best["step"],
        **{name: lines[-1].get(name) for name in CLOCKS},
        "parameters": sum(leaf.size for leaf in jax.tree.leaves(model.params)),
        **{name: best[name] for name in ("mse", "relrmse", "skill", "shadow_mse")},
    }


def _deforming_line(run: Run, folder: Path, report: ReportFn | None) -> dict[str, Any]:
    """That of a model of one object; its steps are those of what is trained, and 0 of what is fitted."""

    def progress(done: int, total: int) -> None:
        if report:
            report("frames", done / total, {})

    path, scores = run_deforming(run.config, folder, progress)
    lines, known = read_lines(folder), {"id": run.id, "name": run.config.name, **run.point, "seed": run.seed}
    clocks = {f"{clock}_seconds": seconds for clock, seconds in scores["fit_seconds"].items()}
    return {
        **known,
        "steps": lines[-1]["step"] if lines else 0,
        **clocks,
        "parameters": load_deforming_model(path).parameters,
        **{name: scores[name] for name in ("bytes", "relrmse", "accuracy", "l1", "skill") if name in scores},
    }
