"""Light from code, in closed form: the same from everywhere, from one direction, from a sphere at a distance.

With Y_k the basis and d the unit direction towards the light,

    constant radiance L      L_00 = 2 sqrt(pi) L, the rest 0
    directional              E Y_k(d)
    sphere                   L c_l Y_k(d),  c_l of the cap of half-angle a = asin(radius / distance) (`closed_forms`)

E is the irradiance of a surface that faces the light: E = pi makes a white one 1. A sphere of constant radiance is
seen as a disk of that radiance, whatever its distance; as every vertex is lit from the same directions, it must be far
from the mesh in comparison to the mesh's size.

Directions need no unit length. Angles are degrees: azimuth from +z towards +x, elevation above the horizon, as those
of cameras.
"""

import math

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer
from jaxtyping import Float

from gash_jax.algebra.arguments import ArrayLike, RealNumber, WholeNumber, as_array, is_real, real_number, shown
from gash_jax.algebra.closed_forms import cap
from gash_jax.algebra.numerics import safe_norm, safe_normalize
from gash_jax.algebra.sh import band_index, evaluate_sh, validate_bands
from gash_jax.light.container import Light, light_metadata


def constant_light(radiance: RealNumber | ArrayLike | Array = 1.0, bands: WholeNumber = 3) -> Light:
    """Light of one radiance, a number or a colour (3,), from everywhere.

    Works under jit, vmap and grad. Raises ValueError for other shapes and negative numbers.

    >>> sky = gash_jax.constant_light([0.5, 0.75, 1.0])
    >>> [round(float(value), 3) for value in sky.coefficients[0]]
    [1.772, 2.659, 3.545]
    """
    bands, colour = validate_bands(bands), checked_colour("radiance", radiance)
    rest = jnp.zeros((bands**2 - 1, 3), colour.dtype)
    return _light(jnp.concatenate([2.0 * math.pi**0.5 * colour[None], rest]), bands, "constant")


def directional_light(
    direction: ArrayLike | Array, irradiance: RealNumber | ArrayLike | Array = math.pi, bands: WholeNumber = 3
) -> Light:
    """Light from one direction, (3,) towards the light, of any length above 0.

    `irradiance`, a number or a colour (3,), is that of a surface facing the light: pi makes a white one 1, but for what
    the bands leave out. Few bands of so small a light ring: see `light_window`. Works under jit, vmap and grad. Raises
    ValueError for other shapes, for a direction of length 0 and negative numbers.

    >>> sun = gash_jax.directional_light([0.0, 2.0, 0.0], irradiance=3.0)
    >>> [round(float(value), 4) for value in sun.coefficients[:4, 0]]
    [0.8463, 1.4658, 0.0, 0.0]
    """
    bands, colour = validate_bands(bands), checked_colour("irradiance", irradiance)
    toward = safe_normalize(_vector("direction", direction))
    return _light(evaluate_sh(toward, bands)[:, None] * colour[None], bands, "directional")


def sphere_light(
    position: ArrayLike | Array,
    radius: RealNumber | Array = 1.0,
    radiance: RealNumber | ArrayLike | Array = 1.0,
    bands: WholeNumber = 3,
) -> Light:
    """Light of a sphere of constant radiance, its centre at `position` (3,) seen from the mesh.

    Every vertex is lit from the same directions, so the sphere must be far from the mesh. Works under jit, vmap and
    grad. Raises ValueError for other shapes, negative numbers, and a sphere that holds the mesh.

    >>> lamp = gash_jax.sphere_light([0.0, 3.0, 4.0], radius=2.5, radiance=10.0)  # a disk of half-angle 30 degrees
    >>> round(float(lamp.coefficients[0, 0]), 4)
    2.3746
    """
    bands, colour = validate_bands(bands), checked_colour("radiance", radiance)
    centre = _vector("position", position)
    size = radius if isinstance(radius, Tracer) else real_number(radius)
    distance = safe_norm(centre)
    if size is None or not isinstance(size, Tracer) and not size > 0:
        raise ValueError(f"radius is {shown(radius)}: use a number above 0")
    ratio = size / distance
    if not isinstance(ratio, Tracer) and ratio >= 1:
        raise ValueError(f"a sphere of radius {size:g} at distance {float(distance):g} holds the mesh: move it away")
    factors = cap(bands, jnp.arcsin(ratio))[band_index(bands)]
    return _light((factors * evaluate_sh(safe_normalize(centre), bands))[:, None] * colour[None], bands, "sphere")


def toward(azimuth: RealNumber, elevation: RealNumber) -> Float[np.ndarray, "3"]:
    """Unit direction of an azimuth and elevation in degrees (module docstring)."""
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])


def checked_colour(name: str, value: object) -> Float[Array, "3"]:
    """A number of 0 or more, or three of them, as a colour. Raises ValueError for anything else."""
    found = as_array(value)
    if found.shape not in ((), (3,)) or not is_real(found):
        raise ValueError(f"{name} is {shown(value)}: use a number, or three for red, green and blue")
    if not isinstance(found, Tracer) and not (np.isfinite(found).all() and np.min(found) >= 0):
        raise ValueError(f"{name} is {shown(value)}: use finite numbers of 0 or more")
    return jnp.broadcast_to(jnp.asarray(found, jnp.float32), (3,))


def _vector(name: str, value: object) -> Float[Array, "3"]:
    found = as_array(value)
    if found.shape != (3,) or not is_real(found):
        raise ValueError(f"{name} is {shown(value)}: give three numbers x, y, z")
    if not isinstance(found, Tracer) and not (np.isfinite(found).all() and np.any(np.asarray(found) != 0)):
        raise ValueError(f"{name} is {shown(value)}: give finite numbers that are not all 0")
    return jnp.asarray(found, jnp.float32)


def _light(coefficients: Float[Array, "k 3"], bands: int, source: str) -> Light:
    return Light(coefficients, light_metadata(bands, source=source))
