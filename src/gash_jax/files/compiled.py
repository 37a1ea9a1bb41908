"""Loops that Numba compiles for the types that they are called with, and keeps on disk."""

from collections.abc import Callable
from typing import Any

from numba import njit


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """A decorator: `numba.njit` with these options, for functions that let go of the interpreter.

    What is compiled is kept beside the source, or in the user's folder for caches; where neither may be written to,
    every process compiles anew. Mark the function itself `no_type_check`, as the tests would wrap it otherwise.
    """

    def decorated(function: Callable[..., Any]) -> Any:
        try:
            return njit(nogil=True, error_model="numpy", cache=True, **options)(function)
        except RuntimeError:  # no folder to keep it in
            return njit(nogil=True, error_model="numpy", **options)(function)

    return decorated
