"""Numbers and rotations that public functions are given: as they must be, or refused in one line.

The names of types say what fits. They are not checked at run time: what does not fit is refused by the functions here,
in words.
"""

import operator
from typing import TYPE_CHECKING, Any, SupportsIndex, TypeAlias

import numpy as np
from jaxtyping import Float, Shaped

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    WholeNumber: TypeAlias = SupportsIndex  # an int of Python, NumPy or JAX
    RealNumber: TypeAlias = float | int | np.floating
else:
    ArrayLike = WholeNumber = RealNumber = Any


def whole_number(value: object, name: str, low: int, high: int | None = None) -> int:
    """An integer of Python, NumPy or JAX as a Python int. Raises ValueError for anything else or out of range."""
    try:
        number = None if isinstance(value, bool) else operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = None
    if number is None or number < low or (high is not None and number > high):
        span = f"of {low} or more" if high is None else f"from {low} to {high}"
        raise ValueError(f"{name} is {value!r}: use a whole number {span}")
    return number


def proper_rotation(matrix: Shaped[np.ndarray, "..."]) -> Float[np.ndarray, "3 3"]:
    """A rotation matrix in float64. Raises ValueError unless it is (3, 3), orthogonal and of determinant +1."""
    if matrix.shape != (3, 3) or matrix.dtype.kind not in "fiu":
        raise ValueError(f"rotation has shape {matrix.shape} {matrix.dtype}: use a rotation matrix (3, 3)")
    wide = matrix.astype(np.float64)
    if not (np.allclose(wide @ wide.T, np.eye(3), atol=1e-5) and np.linalg.det(wide) > 0):
        raise ValueError("rotation must be a proper rotation matrix: orthogonal with determinant +1")
    return wide
