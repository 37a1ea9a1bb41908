"""A run is described by one TOML file that says only how it differs from its base.

    base = "base.toml"          # optional, relative to this file
    name = "local-16x2"
    [model]
    name = "local"
    channels = 16

Tables are `model` (nn.registry.ModelConfig), `data`, `optim`, `train`. Unknown keys and wrong types are errors.
The resolved config is saved beside the run and inside every model file.
"""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from gash_jax.files.strict import ConfigError, from_dict
from gash_jax.models.config import ModelConfig

CLOCKS = ("wall", "cpu")
PRECISIONS = ("float32", "float16", "auto")


@dataclass(frozen=True)
class DataConfig:
    """Procedural corpus: the first `validation_shapes` shapes validate, the following `shapes` train."""

    shapes: int = 96
    validation_shapes: int = 8
    seed: int = 0
    rays: int = 256
    min_vertices: int = 600
    max_vertices: int = 3000


@dataclass(frozen=True)
class OptimConfig:
    """AdamW with cosine decay to zero after a linear warm-up, gradients clipped to a global norm."""

    learning_rate: float = 2e-3
    weight_decay: float = 1e-4
    clip_norm: float = 1.0
    warmup: float = 0.05


@dataclass(frozen=True)
class TrainConfig:
    """Budget and cadence. The run ends after `steps`, or after `seconds` where steps is 0.

    `clock`: seconds on the "wall", or "cpu": CPU seconds of the process for each core it may use, which is fair where
    other work runs beside it. `precision`: "float32"; "float16": networks compute in half precision under a dynamic
    loss scale, parameters stay float32; "auto": float16 on a GPU, float32 elsewhere. `teacher`: a model (a shipped name
    or a file) whose predictions are learnt instead of the baked labels.
    """

    steps: int = 0
    seconds: float = 80.0
    clock: str = "wall"
    batch_vertices: int = 4096
    checkpoint_every: int = 200
    seed: int = 0
    precision: str = "float32"
    teacher: str = ""

    def __post_init__(self) -> None:
        for key, known in (("clock", CLOCKS), ("precision", PRECISIONS)):
            if getattr(self, key) not in known:
                raise ValueError(f"{key} = {getattr(self, key)!r}: known are {', '.join(known)}")


@dataclass(frozen=True)
class RunConfig:
    """Everything that determines a run."""

    name: str = "run"
    model: ModelConfig = field(default_factory=ModelConfig)
    data: DataConfig = field(default_factory=DataConfig)
    optim: OptimConfig = field(default_factory=OptimConfig)
    train: TrainConfig = field(default_factory=TrainConfig)

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
        raise ConfigError(f"no such config file: {path}")
    if path.resolve() in seen:
        raise ConfigError(f"config {path} has itself as base")
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not a TOML file: {' '.join(str(error).split())}") from None
    base = values.pop("base", None)
    return _merge(_read(path.parent / base, (*seen, path.resolve())), values) if base else values


def _assignment(text: str) -> dict[str, Any]:
    key, equals, raw = text.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"{text!r} is not of the form key=value, such as train.seconds=60")
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
    """Read a config file (or a shipped config by name) with its bases, then apply `key=value` overrides.

    Keys of overrides are dotted, as in train.seconds=60. Raises ConfigError.
    """
    values = _read(shipped_configs().get(str(name), Path(name)))
    for text in overrides:
        values = _merge(values, _assignment(text))
    return from_dict(RunConfig, values)
