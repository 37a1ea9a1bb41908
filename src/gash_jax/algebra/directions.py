"""Direction sets on the sphere and local frames.

Hammersley's points of the unit square are (i/n, radical inverse of i in base 2). Spherical Fibonacci sets (Keinert et
al. 2015) have equal steps in z at cell centres and the golden angle in azimuth. A frame is a matrix with the columns
tangent, bitangent, normal: it takes local coordinates, z along the normal, to the world.

Sets are float64 NumPy; what makes or turns frames takes NumPy or JAX arrays and answers in kind.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

GOLDEN_RATIO = (1.0 + 5.0**0.5) / 2.0
# Directions this close to an axis count as on it: frames turn by 1/distance per unit there, beyond float32's range.
POLE = 1e-30


def _namespace(array: Array | np.ndarray) -> Any:
    return jnp if isinstance(array, jax.Array) else np


def _positive(count: int) -> None:
    if count < 1:
        raise ValueError(f"a set of {count} directions cannot be made: use 1 or more")


def radical_inverse_2(index: Int[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Mirror the binary digits of indices in [0, 2^32) at the point: 1 -> 0.5, 2 -> 0.25, 3 -> 0.75."""
    bits = index.astype(np.uint64)
    for shift, mask in ((16, 0x0000FFFF), (8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        low, high = bits & np.uint64(mask), bits >> np.uint64(shift) & np.uint64(mask)
        bits = low << np.uint64(shift) | high
    return bits.astype(np.float64) / 2.0**32


def hammersley(n: int) -> Float[np.ndarray, "n 2"]:
    """Hammersley's n points in [0, 1)^2."""
    _positive(n)
    index = np.arange(n)
    return np.stack([index / n, radical_inverse_2(index)], axis=-1)


def _fibonacci(height: np.ndarray) -> np.ndarray:
    """Golden-angle spiral through the given heights."""
    azimuth = 2.0 * np.pi * np.modf(np.arange(len(height)) / GOLDEN_RATIO)[0]
    radius = np.sqrt((1.0 - height) * (1.0 + height))
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=-1)


def spherical_fibonacci(n: int) -> Float[np.ndarray, "n 3"]:
    """Spherical Fibonacci set of n unit vectors, uniform over the sphere, from +z downwards."""
    _positive(n)
    return _fibonacci(1.0 - (2.0 * np.arange(n) + 1.0) / n)


def fibonacci_hemisphere(n: int) -> Float[np.ndarray, "n 3"]:
    """Spherical Fibonacci set of n unit vectors, uniform in solid angle over the hemisphere about +z."""
    _positive(n)
    return _fibonacci(1.0 - (np.arange(n) + 0.5) / n)


def orthonormal_frame(normals: Float[Array | np.ndarray, "... 3"]) -> Float[Array | np.ndarray, "... 3 3"]:
    """Right-handed frame of each unit normal: a matrix with columns (tangent, bitangent, normal).

    It turns +z to n along the shortest arc, so it is continuous except at n = -z, where the half turn about y
    is taken (Frisvad 2012; Duff et al. 2017 show its loss of accuracy near -z and remove it with a seam along the
    equator). Here 1/(1 + n_z) = (1 - n_z)/(n_x^2 + n_y^2) below the equator keeps both accuracy and continuity.
    A zero normal gives the axes x and y and a zero column.
    """
    xp = _namespace(normals)
    x, y, z = normals[..., 0], normals[..., 1], normals[..., 2]
    one = xp.ones_like(z)
    largest = xp.maximum(xp.abs(x), xp.abs(y))
    # Only the ratio of u and v enters, so their scale is a constant for the derivative.
    largest = largest if xp is np else jax.lax.stop_gradient(largest)
    off_pole = largest > POLE
    scale = xp.where(off_pole, largest, one)
    u, v = xp.where(off_pole, x / scale, one), y / scale
    # The lower formula's (1 - z) / (x^2 + y^2), with the squares of the scaled components so that none underflows.
    lower = (1.0 - z) / (u * u + v * v)
    upper = 1.0 / (1.0 + xp.abs(z))
    below = z < 0.0
    xx = xp.where(below, u * u * lower, x * x * upper)
    xy = xp.where(below, u * v * lower, x * y * upper)
    yy = xp.where(below, v * v * lower, y * y * upper)
    rows = [xp.stack(row, axis=-1) for row in ([1.0 - xx, -xy, x], [-xy, 1.0 - yy, y], [-x, -y, z])]
    return xp.stack(rows, axis=-2)


def turn_about_normal(
    frames: Float[Array | np.ndarray, "... 3 3"], angle: Float[Array | np.ndarray, "..."]
) -> Float[Array | np.ndarray, "... 3 3"]:
    """Frames with tangent and bitangent turned counter-clockwise about the normal; leading shapes broadcast."""
    xp = _namespace(angle)
    cos, sin = xp.cos(angle)[..., None], xp.sin(angle)[..., None]
    tangent, bitangent = frames[..., 0], frames[..., 1]
    normal = xp.broadcast_to(frames[..., 2], (*angle.shape, 3))
    return xp.stack([cos * tangent + sin * bitangent, cos * bitangent - sin * tangent, normal], axis=-1)
