"""A run is described by one TOML file that says only how it differs from its base.

    base = "base.toml"          # optional, relative to this file
    name = "local-16x2"
    [model]
    name = "local"
    channels = 16

Tables are `model` (the config of its family: `models.families`), `data`, `optim`, `train`. Unknown keys, wrong types
and values out of range are errors. The resolved config is saved beside the run and inside every model file.
"""

import json
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from gash_jax.algebra.arguments import shown
from gash_jax.files.atomic import as_path
from gash_jax.files.settings import ConfigError, check_settings, from_dict, near_names, setting
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.families import config_from_dict, model_config
from gash_jax.nn.config import ModelConfig
from gash_jax.prt.sequence import RESTS

POSES = ("auto", "random", "file", "between")


@dataclass(frozen=True)
class DataConfig:
    """Procedural corpus: the first `validation_shapes` shapes validate, the following `shapes` train.

    A folder of meshes takes the place of either; its labels are baked with as many rays. Models of an object that
    deforms are fitted to `frames` frames of its animation, and held against `test_frames` others.
    """

    shapes: int = setting(96, "shapes to train on", least=1)
    validation_shapes: int = setting(8, "shapes to validate on", least=0)
    broken_shapes: int = setting(
        0, "shapes unlike those, torn and thrown about, to learn beside them what errors to expect", least=0
    )
    seed: int = setting(0, "seed of the shapes", least=0)
    rays: int = setting(
        256,
        "rays per vertex of the labels; 0, of models of one object: 64 to 256, the more frames the fewer",
        least=0,
        most=1 << 20,
    )
    min_vertices: int = setting(600, "vertices of the smallest shapes", least=4)
    max_vertices: int = setting(3000, "vertices of the largest shapes", least=4)
    kinds: str = setting("base", "kinds of shapes; all: nine more, dark inside or drawn parts", choices=("base", "all"))
    folder: str = setting("", "folder of meshes to train on, instead of generated shapes")
    validation_folder: str = setting("", "folder of meshes to validate on, instead of generated shapes")
    animation: str = setting("", "animation (.npz, .glb) of the object that deforms, for the models of one")
    light: str = setting("", "light (map, .npz or its name) that it is glossy under; transfer for any light if empty")
    poses: str = setting(
        "auto",
        "random weights of the shapes, or the frames of the file, for the test the last or some between the others; "
        "auto: random for blendshapes, else file",
        choices=POSES,
    )
    frames: int = setting(450, "frames to train on", least=2)
    test_frames: int = setting(50, "frames to test on: other random ones, or some of the file", least=1)
    test_rays: int = setting(4096, "rays per vertex of the test frames", least=1, most=1 << 20)
    vertices: str = setting("", "part of the object to predict, such as 0:11248; all of it if empty")
    rest: str = setting("drop", "whether the other vertices are left out or cast shadow", choices=RESTS)

    def __post_init__(self) -> None:
        check_settings(self)
        if self.min_vertices > self.max_vertices:
            raise ValueError(f"min_vertices = {self.min_vertices}: must be at most max_vertices, {self.max_vertices}")


@dataclass(frozen=True)
class OptimConfig:
    """AdamW with cosine decay to zero after a linear warm-up, gradients clipped to a global norm."""

    learning_rate: float = setting(2e-3, "learning rate after the warm-up", least=0)
    weight_decay: float = setting(1e-4, "weight decay of AdamW", least=0)
    clip_norm: float = setting(1.0, "global norm that gradients are clipped to", least=0)
    warmup: float = setting(0.05, "share of the budget in which the learning rate rises", least=0, below=1)

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class TrainConfig:
    """Budget and cadence. The run ends after `steps`, or after `seconds` where steps is 0.

    CPU seconds are fair where other work runs beside the run. In float16 networks compute in half precision under a
    dynamic loss scale, parameters stay float32; "auto" is float16 on a GPU, float32 elsewhere.
    """

    steps: int = setting(0, "steps of the whole run; 0: as many as fit into `seconds`", least=0)
    seconds: float = setting(80.0, "budget where steps is 0", least=0)
    clock: str = setting("wall", "seconds on the wall, or CPU seconds for each core", choices=("wall", "cpu"))
    batch_vertices: int = setting(4096, "vertices of a batch", least=1)
    batch_frames: int = setting(5, "frames of a batch, of deep-prt", least=1)
    checkpoint_every: int = setting(200, "steps between checkpoints, each with a validation", least=1)
    seed: int = setting(0, "seed of parameters, batches and dropout", least=0)
    precision: str = setting("float32", "what networks compute in", choices=("float32", "float16", "auto"))
    teacher: str = setting("", "a model whose predictions are learnt instead of the baked labels: shipped name or file")
    start_from: str = setting("", "a model whose weights training starts from: shipped name or file")

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class RunConfig:
    """Everything that determines a run.

    >>> gash_jax.RunConfig(name="mine").to_dict()["optim"]["learning_rate"]
    0.002
    """

    name: str = "run"
    model: ModelConfig = field(default_factory=model_config)
    data: DataConfig = field(default_factory=DataConfig)
    optim: OptimConfig = field(default_factory=OptimConfig)
    train: TrainConfig = field(default_factory=TrainConfig)

    def __post_init__(self) -> None:
        kinds = {"model": ModelConfig, "data": DataConfig, "optim": OptimConfig, "train": TrainConfig}
        for name, kind in kinds.items():
            if not isinstance(getattr(self, name), kind):
                raise ConfigError(f"{name} is no {kind.__name__}: take load_config, and change keys by its overrides")
        if not self.data.rays and self.model.name not in DEFORMING:
            raise ConfigError(f"data.rays=0 is for models of an object that deforms: give {self.model.name} some rays")
        glossy = [name for name, family in DEFORMING.items() if family.glossy]
        if self.data.light and self.model.name not in glossy:
            raise ConfigError(
                f"{self.model.name} says transfer, which is for any light: leave out data.light, or train "
                f"{' or '.join(glossy)}"
            )

    def to_dict(self) -> dict[str, Any]:
        """Plain nested dictionary, as saved in runs and model files."""
        return asdict(self)


def _merge(base: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in changes.items():
        nested = isinstance(value, Mapping) and isinstance(merged.get(key), dict)
        merged[key] = _merge(merged[key], value) if nested else value
    return merged


def _read(path: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    if not path.is_file():
        near = near_names(path.name, shipped_configs())
        raise ConfigError(f"no such config file: {path}{near or ', and no config of that name ships'}")
    if path.resolve() in seen:
        raise ConfigError(f"config {path} has itself as base")
    parse, kind = (json.loads, "JSON") if path.suffix == ".json" else (tomllib.loads, "TOML")
    try:
        values = parse(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:  # both parsers' errors, and text that is not UTF-8
        raise ConfigError(f"{path} is not a {kind} file: {' '.join(str(error).split())}") from None
    if not isinstance(values, dict):
        raise ConfigError(f"{path} is not a config: it must be a table")
    base = values.pop("base", None)
    return _merge(_read(path.parent / base, (*seen, path.resolve())), values) if base else values


def _assignment(text: str) -> dict[str, Any]:
    key, equals, raw = text.partition("=") if isinstance(text, str) else ("", "", "")
    if not equals or not key.strip():
        raise ConfigError(f"{shown(text)} is not of the form key=value, such as train.seconds=60")
    try:
        value = tomllib.loads(f"value = {raw}")["value"]
    except tomllib.TOMLDecodeError:
        value = raw.strip()
    *tables, name = key.strip().split(".")
    nested: dict[str, Any] = {name: value}
    for table in reversed(tables):
        nested = {table: nested}
    return nested


def shipped_configs() -> dict[str, Path]:
    """Names and files of the configs inside the package."""
    folder = Path(str(resources.files("gash_jax"))) / "configs"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load_config(name: str | Path, overrides: Iterable[str] = ()) -> RunConfig:
    """Read a config (.toml, a run's config.json, a shipped name) with its bases, then apply `key=value` overrides.

    Keys of overrides are dotted, as in train.seconds=60. Raises ConfigError.

    >>> config = gash_jax.load_config("mlp", ["train.seconds=60", "model.channels=32"])
    >>> config.model.channels, config.train.seconds
    (32, 60.0)
    """
    values = _read(shipped_configs().get(str(name)) or as_path(name))
    if isinstance(overrides, str) or not isinstance(overrides, Iterable):
        raise ConfigError(f"overrides are {shown(overrides)}: give a list, such as ['train.seconds=60']")
    for text in overrides:
        values = _merge(values, _assignment(text))
    return run_from_dict(values)


def run_from_dict(values: Mapping[str, Any]) -> RunConfig:
    """A run from its nested dictionary, as `RunConfig.to_dict` gives it. Raises ConfigError."""
    model = values.get("model", {})
    if not isinstance(model, Mapping):
        raise ConfigError("config key 'model' must be a table")
    return from_dict(RunConfig, {**values, "model": config_from_dict(model)})
