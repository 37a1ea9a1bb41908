"""Arrays that live in one file beside their metadata, as JAX pytrees: what `Transfer` and `Light` have in common.

A container is a frozen dataclass of arrays (None where an optional one is missing), a `metadata` mapping and a number
of `bands`. To JAX the arrays are its leaves and `bands` its one static part. Metadata is neither: a function under
`jit` is traced once for two bakes that differ in nothing else, and `jax.tree.map` of two bakes does not mind that they
differ. What a transformation returns is no longer what the metadata described, so its metadata is {}; to give it any,
`_replace(metadata=...)`.

Metadata is read-only throughout, so that nobody changes what another holds; to JSON and pickle it is ordinary.
"""

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from functools import cache, partial
from typing import Any, NoReturn, TypeVar

from jax.tree_util import GetAttrKey, register_pytree_with_keys

C = TypeVar("C", bound="Container")


def _refuse(*_: Any, **__: Any) -> NoReturn:
    raise TypeError("metadata is read-only: make a copy with _replace(metadata={**old.metadata, ...})")


class ReadOnlyDict(dict):
    """A dictionary that refuses to be changed."""

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        return ReadOnlyDict, (dict(self),)


class ReadOnlyList(list):
    """A list that refuses to be changed."""

    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse  # type: ignore[assignment]
    append = clear = extend = insert = pop = remove = reverse = sort = _refuse  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        return ReadOnlyList, (list(self),)


def read_only(value: Any) -> Any:
    """A copy of JSON-like values in which nothing can be changed."""
    if isinstance(value, Mapping):
        return ReadOnlyDict({key: read_only(entry) for key, entry in value.items()})
    return ReadOnlyList(read_only(entry) for entry in value) if isinstance(value, list | tuple) else value


class Container:
    """Base of the frozen dataclasses that are containers (module docstring); it has no fields of its own."""

    metadata: Mapping[str, Any]
    bands: int

    def __init_subclass__(cls) -> None:
        register_pytree_with_keys(cls, _flatten_with_keys, partial(_unflatten, cls), _flatten)

    def _set(self, bands: int) -> None:
        """For `__post_init__`: the number of bands, and the metadata read-only."""
        object.__setattr__(self, "bands", bands)
        object.__setattr__(self, "metadata", read_only(self.metadata))

    def _replace(self: C, **changes: Any) -> C:
        """A copy with some fields changed."""
        return replace(self, **changes)  # type: ignore[type-var]


@cache
def array_names(cls: type[Container]) -> tuple[str, ...]:
    """Names of the fields that are arrays."""
    return tuple(field.name for field in fields(cls) if field.name not in ("metadata", "bands"))  # type: ignore[arg-type]


def _flatten(container: Container) -> tuple[list[Any], int]:
    return [getattr(container, name) for name in array_names(type(container))], container.bands


def _flatten_with_keys(container: Container) -> tuple[list[tuple[GetAttrKey, Any]], int]:
    leaves, bands = _flatten(container)
    return [(GetAttrKey(name), leaf) for name, leaf in zip(array_names(type(container)), leaves, strict=True)], bands


def _unflatten(cls: type[C], bands: int, leaves: Iterable[Any]) -> C:
    """Not by the constructor: while JAX transforms, leaves are no arrays of the right shape, or no arrays at all."""
    container = object.__new__(cls)
    container.__dict__.update(zip(array_names(cls), leaves, strict=True), metadata=ReadOnlyDict(), bands=bands)
    return container
