"""Rotation of spherical-harmonic coefficients by rotors alone: no matrix D, no recurrence for one.

A function of B bands, turned by a rotor R, is f'(w) = f(~R w R): again a function of B bands. So its coefficients

    c'_k = integral over the sphere of f(~R w R) Y_k(w) dw

are integrals of polynomials of degree 2B - 2, and a quadrature that is exact to that degree gives them exactly: B
Gauss-Legendre nodes in z times 2B - 1 equal steps of azimuth, B (2B - 1) nodes w_q in all (Atkinson & Han 2012,
section 5.1). The rotor turns the nodes, f is evaluated where they come to lie, and its values are projected again.

`sh_rotation.rotate_coefficients` gives the same numbers with less work: (4 B^2 - 1) B / 3 products for one vector
where this needs 2 B^3 (2B - 1), 29 times as many at B = 10. This is here to hold it to: the two share the basis Y and
nothing else. experiments/rotation has both by the clock.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gash_jax.algebra.cga import reverse
from gash_jax.algebra.motors import turn_vectors
from gash_jax.algebra.sh import bands_of, evaluate_sh, sh_components, validate_bands


@functools.cache
def sphere_quadrature(bands: int) -> tuple[Float[np.ndarray, "q 3"], Float[np.ndarray, "q"]]:
    """Nodes and weights, float64, that integrate products of two functions of `bands` bands exactly.

    q = bands (2 bands - 1); the weights are positive and add up to 4 pi.

    >>> from gash_jax.algebra.rotor_quadrature import sphere_quadrature
    >>> nodes, weights = sphere_quadrature(3)
    >>> nodes.shape, round(float(weights @ nodes[:, 1] ** 4), 6)  # 4 pi / 5
    ((15, 3), 2.513274)
    """
    heights, widths = np.polynomial.legendre.leggauss(validate_bands(bands))
    steps = 2 * bands - 1
    azimuth = 2.0 * np.pi * np.arange(steps) / steps
    radius = np.sqrt((1.0 - heights) * (1.0 + heights))[:, None]
    z = np.broadcast_to(heights[:, None], (bands, steps))
    nodes = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1).reshape(-1, 3)
    return nodes, np.repeat(widths, steps) * 2.0 * np.pi / steps


@functools.cache
def _projection(bands: int) -> np.ndarray:
    """What the values at the nodes are multiplied by to give coefficients, (q, k), float64."""
    nodes, weights = sphere_quadrature(bands)
    x, y, z = nodes.T
    return np.stack(sh_components(x, y, z, bands), axis=-1) * weights[:, None]


@jax.jit
def rotate_by_rotor(
    coefficients: Float[Array | np.ndarray, "*v k"], rotor: Float[Array | np.ndarray, "*r 32"]
) -> Float[Array, "... k"]:
    """Coefficients of the function turned by unit rotors (or the rotor parts of unit motors). Leading shapes broadcast.

    The numbers of `rotate_coefficients` with the rotors' matrices, up to rounding. Raises ValueError unless there are
    bands^2 coefficients, bands from 1 to 10.

    >>> from gash_jax.algebra.rotor_quadrature import rotate_by_rotor
    >>> up = np.array([0.0, 1.0, 0.0, 0.0])  # Y of band 1 along y
    >>> rotate_by_rotor(up, gash_jax.rotor_from_normal(np.array([1.0, 0.0, 0.0]))).round(6).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    coefficients, rotor = jnp.asarray(coefficients), jnp.asarray(rotor)
    bands = bands_of(coefficients.shape[-1])
    nodes = jnp.asarray(sphere_quadrature(bands)[0], coefficients.dtype)
    turned = turn_vectors(reverse(rotor)[..., None, :], nodes)
    if rotor.ndim == 1:
        values = jnp.matmul(coefficients, evaluate_sh(turned, bands).T, precision="highest")
    else:
        values = _evaluated(coefficients, turned, bands)
    return jnp.matmul(values, jnp.asarray(_projection(bands), values.dtype), precision="highest")


def _evaluated(coefficients: Array, directions: Float[Array, "*r q 3"], bands: int) -> Float[Array, "... q"]:
    """sum_k c_k Y_k at directions of their own; XLA fuses the sum, where all Y_k at once would fill the memory."""
    shape = jnp.broadcast_shapes(coefficients.shape[:-1], directions.shape[:-2])
    components = sh_components(directions[..., 0], directions[..., 1], directions[..., 2], bands)
    coefficients = jnp.broadcast_to(coefficients, (*shape, coefficients.shape[-1]))
    values = jnp.zeros((*shape, directions.shape[-2]), coefficients.dtype)
    for k, component in enumerate(components):
        values = values + coefficients[..., k, None] * jnp.broadcast_to(component, values.shape)
    return values
