"""Lights and transfers, whole, in the conventions of other programs (`conventions`) and back."""

from collections.abc import Callable

import numpy as np
from jax import Array
from jaxtyping import Float

from gash_jax.algebra.arguments import ArrayLike, as_array, is_real
from gash_jax.light.conventions import Convention, decoded, encoded
from gash_jax.light.engines import convention
from gash_jax.light.environment import Light, LightLike, light_metadata
from gash_jax.prt.transfer import Transfer, TransferLike


def to_convention(value: LightLike | TransferLike, name: str) -> np.ndarray:
    """The numbers that another program has for a light or a transfer, float32, in the shape of its coefficients.

    `value` is a Light or a Transfer, or an array of their coefficients: (k, 3) is a light, (v, k) and (v, k, 3) are
    transfers. `name` is one of those in docs/light.md. Raises ValueError for bands that the other does not read.

    >>> light = gash_jax.project_light(np.ones((32, 64, 3)), bands=3)  # radiance 1 from everywhere
    >>> round(float(gash_jax.to_convention(light, "unity")[0, 0]), 3)  # irradiance over pi
    1.0
    >>> round(float(gash_jax.to_convention(light, "three")[0, 0]), 3)  # 2 sqrt(pi)
    3.545
    """
    coefficients = _numbers(value.coefficients if isinstance(value, Light | Transfer) else value)
    return _along_bands(encoded, coefficients, convention(name), _kind(coefficients))


def from_convention(numbers: ArrayLike | Array, name: str) -> Light | np.ndarray:
    """The way back: (k, 3) numbers of another program as a Light, (v, k) or (v, k, 3) as transfer coefficients.

    >>> sun = np.zeros((9, 3))
    >>> sun[0], sun[1] = 0.25, 0.5  # Unity's L00 and L1-1: brighter from above
    >>> [round(float(value), 3) for value in gash_jax.from_convention(sun, "unity").coefficients[:2, 0]]
    [0.886, 1.535]
    """
    found = _numbers(numbers)
    kind = _kind(found)
    coefficients = _along_bands(decoded, found, convention(name), kind)
    if kind == "transfer":
        return coefficients
    bands = round(len(coefficients) ** 0.5)
    return Light(coefficients, light_metadata(bands, source=convention(name).title))


def _kind(coefficients: np.ndarray) -> str:
    return "light" if coefficients.ndim == 2 and coefficients.shape[1] == 3 else "transfer"


def _numbers(value: object) -> Float[np.ndarray, "..."]:
    found = np.asarray(as_array(value))
    if found.ndim not in (2, 3) or found.shape[2:] not in ((), (3,)) or not is_real(found):
        raise ValueError(
            f"coefficients have shape {found.shape} {found.dtype}: give (bands^2, 3) of a light, or (vertices, "
            "bands^2) or (vertices, bands^2, 3) of a transfer"
        )
    return found.astype(np.float64)


def _along_bands(
    function: Callable[..., np.ndarray], coefficients: np.ndarray, record: Convention, kind: str
) -> np.ndarray:
    """Coefficients stand on axis 0 of a light and on axis 1 of a transfer."""
    axis = 0 if kind == "light" else 1
    turned = function(np.moveaxis(coefficients, axis, -1), record, kind)
    return np.moveaxis(turned, -1, axis).astype(np.float32)
