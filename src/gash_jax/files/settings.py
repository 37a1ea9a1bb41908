"""Frozen dataclasses as configs: fields with a meaning and a range, built from dictionaries, strictly.

An unknown key, a wrong type, a value out of its range is a ConfigError that names the key and what would be valid.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, fields, is_dataclass
from difflib import get_close_matches
from math import isfinite
from typing import Any, TypeVar, get_type_hints

T = TypeVar("T")


class ConfigError(ValueError):
    """A config cannot be understood; the message names the key and what would be valid.

    >>> try:
    ...     gash_jax.load_config("mlp", ["train.step=5"])
    ... except gash_jax.ConfigError as error:
    ...     print(error)
    unknown key 'train.step' in config, did you mean 'steps'?: known here are ...
    """


def setting(
    default: Any,
    meaning: str,
    *,
    least: int | float | None = None,
    most: int | float | None = None,
    below: int | float | None = None,
    choices: Sequence[str] = (),
) -> Any:
    """A field of a config: its default, what it means, and which values it takes (`check_settings` holds it to them).

    `least` and `most` belong to the range, `below` does not.
    """
    limits = {"least": least, "most": most, "below": below, "choices": tuple(choices)}
    return field(default=default, metadata={"meaning": meaning, **limits})


def allowed_values(limits: Mapping[str, Any]) -> str:
    """The range of a `setting` in words: "one of a, b", "from 0 to below 1", "at least 1"; "" where all will do."""
    if limits.get("choices"):
        return f"one of {', '.join(limits['choices'])}"
    least, most, below = (limits.get(name) for name in ("least", "most", "below"))
    upper = "" if most is None and below is None else f"to {most}" if below is None else f"to below {below}"
    if least is None:
        return upper and f"up {upper}"
    return f"from {least} {upper}" if upper else f"at least {least}"


def check_settings(config: Any) -> None:
    """Raise ValueError for the first field of a dataclass that is outside the range of its `setting`."""
    for entry in fields(config):
        value, limits = getattr(config, entry.name), entry.metadata
        if limits.get("choices"):
            right = value in limits["choices"]
        elif isinstance(value, int | float) and not isinstance(value, bool):
            least, most, below = (limits.get(name) for name in ("least", "most", "below"))
            right = isfinite(value) and (least is None or value >= least)
            right = right and (most is None or value <= most) and (below is None or value < below)
        else:
            continue
        if not right:
            raise ValueError(f"{entry.name} = {value!r}: must be {allowed_values(limits) or 'a finite number'}")


def near_names(name: str, known: Iterable[str]) -> str:
    """ ", did you mean ...?" where one of the known names is close to the one that was written, else ""."""
    near = get_close_matches(name, list(known), 1, 0.7)
    return f", did you mean {near[0]!r}?" if near else ""


def from_dict(cls: type[T], values: Mapping[str, Any], where: str = "") -> T:
    """Build a (nested) config dataclass; raises ConfigError on unknown keys, wrong types or invalid values.

    A value that is a dataclass of the right type already is taken as it is.
    """
    hints = get_type_hints(cls)
    known = [f.name for f in fields(cls)]  # type: ignore[arg-type]
    arguments: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{where}{key}"
        if key not in known:
            near = near_names(key, known)
            raise ConfigError(f"unknown key {name!r} in config{near}: known here are {', '.join(known)}")
        kind = hints[key]
        if is_dataclass(kind):
            if isinstance(value, Mapping):
                value = from_dict(kind, value, f"{name}.")  # type: ignore[arg-type]
            elif not isinstance(value, kind):  # type: ignore[arg-type]
                raise ConfigError(f"config key {name!r} must be a table")
        elif kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        elif isinstance(kind, type) and (not isinstance(value, kind) or isinstance(value, bool) != (kind is bool)):
            raise ConfigError(f"config key {name!r} must be {kind.__name__}, not {value!r}")
        arguments[key] = value
    try:
        return cls(**arguments)
    except (TypeError, ValueError) as error:  # TypeError: a field without a default is missing
        raise ConfigError(f"config {where.rstrip('.') or 'file'}: {error}") from None
