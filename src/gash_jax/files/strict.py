"""Frozen dataclasses from dictionaries, strictly: an unknown key or a wrong type is an error that names it."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, get_type_hints

T = TypeVar("T")


class ConfigError(ValueError):
    """A config cannot be understood; the message names the key and what would be valid."""


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
