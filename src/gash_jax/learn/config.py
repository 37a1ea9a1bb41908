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
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from gash_jax.nn.registry import ModelConfig

T = TypeVar("T")


CLOCKS = ("wall", "cpu")
PRECISIONS = ("float32", "float16", "auto")


class ConfigError(ValueError):
    """A config cannot be understood; the message names the key and what would be valid."""


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


def from_dict(cls: type[T], values: Mapping[str, Any], where: str = "") -> T:
    """Build a (nested) config dataclass; raises ConfigError on unknown keys, wrong types or invalid values."""
    hints = get_type_hints(cls)
    known = [f.name for f in fields(cls)]  # type: ignore[arg-type]
    arguments: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{where}{key}"
        if key not in known:
            raise ConfigError(f"unknown key {name!r} in config: known here are {', '.join(known)}")
        kind = hints[key]
        if is_dataclass(kind):
            if not isinstance(value, Mapping):
                raise ConfigError(f"config key {name!r} must be a table")
            value = from_dict(kind, value, f"{name}.")  # type: ignore[arg-type]
        elif kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        elif isinstance(kind, type) and (not isinstance(value, kind) or isinstance(value, bool) != (kind is bool)):
            raise ConfigError(f"config key {name!r} must be {kind.__name__}, not {value!r}")
        arguments[key] = value
    try:
        return cls(**arguments)
    except (TypeError, ValueError) as error:  # TypeError: a field without a default is missing
        raise ConfigError(f"config {where.rstrip('.') or 'file'}: {error}") from None


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
