"""Numbers, arrays and rotations that public functions are given: as they must be, or refused in one line.

The names of types say what fits. They are not checked at run time: what does not fit is refused by the functions here,
in words.
"""

import operator
import sys
from typing import TYPE_CHECKING, Any, SupportsIndex, TypeAlias

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from jax import Array
    from numpy.typing import ArrayLike

    WholeNumber: TypeAlias = SupportsIndex  # an int of Python, NumPy or JAX
    RealNumber: TypeAlias = float | int | np.floating
else:  # importing JAX takes longer than reading most meshes
    Array = ArrayLike = WholeNumber = RealNumber = Any


def shown(value: object) -> str:
    """A value for a message: on one line, and short."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def as_array(value: Any) -> "np.ndarray | Array":
    """The array that a value is or can be made; one of objects, for the caller to refuse, where NumPy cannot make any.

    That is so for lists of unequal lengths, and for lists of arrays that JAX is tracing.
    """
    jax = sys.modules.get("jax")  # without it there are none of its arrays
    if isinstance(value, np.ndarray) or jax is not None and isinstance(value, jax.Array):
        return value
    try:
        return np.asarray(value)
    except (TypeError, ValueError):
        return np.empty((), object)


def is_real(array: "np.ndarray | Array") -> bool:
    """Whether an array holds integers or floats, JAX's bfloat16 too; truth values are neither."""
    return array.dtype.kind in "fiu" or array.dtype.name == "bfloat16"


def real_number(value: object) -> float | None:
    """A finite real number of Python, NumPy or JAX as a Python float; None for anything else."""
    found = as_array(value)
    return float(found) if found.shape == () and is_real(found) and np.isfinite(float(found)) else None


def check_last_axis(name: str, array: "np.ndarray | Array", size: int) -> None:
    """Raise ValueError unless the last axis of an array has the given size."""
    if array.shape[-1:] != (size,):
        raise ValueError(f"{name} have shape {array.shape}: give (..., {size})")


def whole_number(value: object, name: str, low: int, high: int | None = None) -> int:
    """An integer of Python, NumPy or JAX as a Python int. Raises ValueError for anything else or out of range."""
    try:
        number = None if isinstance(value, bool) else operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = None
    if number is None or number < low or (high is not None and number > high):
        span = f"of {low} or more" if high is None else f"from {low} to {high}"
        raise ValueError(f"{name} is {shown(value)}: use a whole number {span}")
    return number


def proper_rotation(rotation: object) -> Float[np.ndarray, "3 3"]:
    """A rotation matrix in float64. Raises ValueError unless it is (3, 3), orthogonal and of determinant +1."""
    matrix = np.asarray(as_array(rotation))
    if matrix.shape != (3, 3) or not is_real(matrix):
        raise ValueError(f"rotation has shape {matrix.shape} {matrix.dtype}: use a rotation matrix (3, 3)")
    wide = matrix.astype(np.float64)
    if not (np.allclose(wide @ wide.T, np.eye(3), atol=1e-5) and np.linalg.det(wide) > 0):
        raise ValueError("rotation must be a proper rotation matrix: orthogonal with determinant +1")
    return wide
