"""A rotation as people have it: a matrix, a unit quaternion, a rotor or a motor; told apart by their shapes.

    (3, 3)   rotation matrix R: x -> R x
    (4,)     unit quaternion (w, x, y, z): cos(a/2), then sin(a/2) times the axis, of the turn by a, counter-clockwise
             seen from the axis' tip; SciPy's `as_quat` has w last
    (32,)    unit rotor, or unit motor, of which the rotor part counts: directions do not move when places do

A quaternion and its negative, a rotor and its negative, are the same rotation. Their length says nothing about it, so
what misses 1 by less than 1e-3 (three typed digits, a long product of rotors) is divided by it; more is a mistake, and
is refused.
"""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer
from jaxtyping import Float

from gash_jax.algebra import cga
from gash_jax.algebra.arguments import as_array, is_real, proper_rotation
from gash_jax.algebra.motors import quaternion_to_matrix
from gash_jax.algebra.numerics import safe_normalize

_FORMS = {(3, 3): "matrix", (4,): "quaternion", (32,): "rotor"}
_LENGTH_ERROR = 1e-3
# What a quaternion's w, x, y, z are in a rotor, and the blades of a motor's other part, by e+ and by e-.
_ROTOR, _SIGNS = [cga.SCALAR, cga.E23, cga.E13, cga.E12], np.array([1.0, -1.0, 1.0, -1.0], np.float32)
_PLUS, _MINUS = [cga.E1P, cga.E2P, cga.E3P, cga.E123P], [cga.E1M, cga.E2M, cga.E3M, cga.E123M]


def rotation_matrix(rotation: object) -> Float[Array | np.ndarray, "3 3"]:
    """Rotation matrix of a matrix, quaternion, rotor or motor (module docstring).

    float64 NumPy. Of what JAX is tracing, whose numbers cannot be looked at, a JAX array: there quaternions and rotors
    are divided by their length whatever it is, matrices taken as they are. Raises ValueError for other shapes, and for
    what is no rotation.
    """
    found = as_array(rotation)
    if found.shape not in _FORMS or not is_real(found):
        raise ValueError(
            f"rotation has shape {found.shape} {found.dtype}: use a rotation matrix (3, 3), a unit quaternion "
            "(w, x, y, z), or a rotor or motor (32,)"
        )
    form = _FORMS[found.shape]
    if isinstance(found, Tracer):
        if form == "matrix":
            return found
        quaternion = found if form == "quaternion" else found[jnp.array(_ROTOR)] * _SIGNS
        return quaternion_to_matrix(safe_normalize(quaternion))
    if form == "matrix":
        return proper_rotation(found)
    wide = np.asarray(found, np.float64)
    if form == "rotor":
        _check_motor(wide)
        wide = wide[_ROTOR] * _SIGNS
    length = np.linalg.norm(wide)
    if not abs(length - 1.0) < _LENGTH_ERROR:
        raise ValueError(f"rotation is a {form} of length {length:.4g}: divide it by its length, so that this is 1")
    return quaternion_to_matrix(wide / length)


def with_rotation(metadata: Mapping[str, Any], matrix: Float[Array | np.ndarray, "3 3"]) -> Mapping[str, Any]:
    """Metadata whose entry "rotation" is the whole rotation since a result was made; as it is while JAX is tracing."""
    if isinstance(matrix, Tracer):
        return metadata
    before = np.array(metadata.get("rotation", np.eye(3)))
    return {**metadata, "rotation": (np.asarray(matrix) @ before).tolist()}


def _check_motor(m: np.ndarray) -> None:
    """Raise ValueError for blades that no rotor or motor has, or whose e+ and e- parts make no e_inf."""
    others = np.delete(m, [*_ROTOR, *_PLUS, *_MINUS])
    size = max(1.0, float(np.abs(m).max()))
    if not max(np.abs(others).max(), np.abs(m[_PLUS] - m[_MINUS]).max()) < _LENGTH_ERROR * size:
        raise ValueError(
            "rotation is a multivector (32,) but no rotor or motor: use what rotor_from_normal, motor, or products "
            "of these give"
        )
