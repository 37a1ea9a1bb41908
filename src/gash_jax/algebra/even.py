"""The even half of R(4,1), 16 of its 32 blades, and its products by those terms alone that are not 0.

The pseudoscalar e123+- is odd and commutes with everything, so every odd multivector is an even one times it: a vector
is a 4-vector, a trivector a bivector. Whoever keeps to even ones loses nothing, and a product has 256 terms, not 1024.

An array of even multivectors has the blades EVEN on its last axis but one and any number of channels on the last,
(..., 16, c). The blade at place p has the generators e1, e2, e3, e+ whose bits p has, and e- where these are odd in
number. So the blades at places p and q multiply to that at p xor q: what a left blade does to the right ones is, up to
signs, to reverse some of four axes of length 2. Indices would do the same, but their gradient would be a scatter.

A motor has 8 numbers, m = sum of m_n E_n, as its e- parts repeat the e+ parts. What it makes of x, m x ~m, is linear in
the 36 products of two of them, by a constant table (36, 16, 16) with 480 numbers that are not 0. So a sum over many
motors can be taken before x is met.
"""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gash_jax.algebra import cga

EVEN = np.array([place | (place.bit_count() % 2) * cga.EM for place in range(16)])
BIVECTORS = np.flatnonzero(np.array(cga.BLADE_GRADES)[EVEN] == 2)  # their places

# of a motor, each number once
MOTOR_8 = np.array([cga.SCALAR, cga.E12, cga.E13, cga.E23, cga.E1P, cga.E2P, cga.E3P, cga.E123P])
MOTOR_PAIRS = np.triu_indices(8)
# of the exponential: to 1e-5 of its largest number for bivectors up to a length of 15 (test)
TERMS, SQUARINGS = 10, 4

_PLACES = np.arange(16)

EvenMultivectors = Float[Array | np.ndarray, "*n 16 c"]


@functools.cache
def _signs() -> np.ndarray:
    """Sign of the product of the blades at two places, (16, 16)."""
    return cga.cayley_signs()[np.ix_(EVEN, EVEN)]


def even_product(a: EvenMultivectors, b: EvenMultivectors) -> Float[Array, "*n 16 c"]:
    """Geometric product a b, channel by channel."""
    split = b.reshape(*b.shape[:-2], 2, 2, 2, 2, b.shape[-1])
    total = jnp.zeros_like(b)
    for place in _PLACES:
        axes = [split.ndim - 2 - bit for bit in range(4) if place >> bit & 1]
        signs = jnp.asarray(_signs()[place, place ^ _PLACES, None], b.dtype)
        moved = jnp.flip(split, axes).reshape(b.shape)
        total = total + a[..., place, None, :] * (jnp.broadcast_to(signs, b.shape) * moved)
    return total


@functools.cache
def even_product_table() -> np.ndarray:
    """Of the product of every two blades the part along every blade: read-only float64 (16, 16, 16)."""
    table = np.zeros((16, 16, 16))
    left, right = np.indices((16, 16))
    table[left, right, left ^ right] = _signs()
    table.setflags(write=False)
    return table


def rotor_actions(bivectors: Float[Array | np.ndarray, "*n 10"]) -> Float[Array, "*n 16 16"]:
    """Matrices of x -> R x ~R for the rotors R = exp(B/2) of bivectors B, in float32.

    Each is the exponential of the matrix of x -> (B x - x B)/2. So R is a versor with R ~R = 1 whatever B is, and no
    length is divided by: in a metric with a minus sign that of a versor may be 0.
    """
    table = even_product_table()
    commutators = (table - table.swapaxes(0, 1)).swapaxes(1, 2)  # of a blade with blades: (16, 16 after, 16 before)
    halves = jnp.asarray(commutators[BIVECTORS] / 2, jnp.float32)
    return _exponential(jnp.einsum("...b,bij->...ij", bivectors.astype(jnp.float32), halves))


def _exponential(matrices: Float[Array, "*n 16 16"]) -> Float[Array, "*n 16 16"]:
    """By scaling and squaring a short series; that of SciPy solves systems and always squares sixteen times."""
    one = jnp.broadcast_to(jnp.eye(16, dtype=matrices.dtype), matrices.shape)
    scaled, result = matrices / 2**SQUARINGS, one
    for k in range(TERMS, 0, -1):
        result = one + jnp.matmul(scaled, result, precision="highest") / k
    for _ in range(SQUARINGS):
        result = jnp.matmul(result, result, precision="highest")
    return result


def motor_squares(motors: Float[Array | np.ndarray, "*n 8"]) -> Float[Array, "*n 36"]:
    """Products of two of the 8 numbers of motors, in the order of MOTOR_PAIRS."""
    motors, (first, second) = jnp.asarray(motors), MOTOR_PAIRS
    return motors[..., first] * motors[..., second]


@functools.cache
def motor_action_table() -> np.ndarray:
    """What makes of `motor_squares` the matrix of x -> m x ~m: read-only float64 (36, 16, 16)."""
    parts = np.zeros((8, 16))  # E_n by blades
    for number, blade in enumerate(MOTOR_8):
        parts[number, blade & 15] = 1.0
        if blade & cga.EP:
            parts[number, (blade ^ cga.EP) & 15] = 1.0  # e- for e+: its bit goes, that of e- is not among the four
    grades = np.array(cga.BLADE_GRADES)[EVEN]
    reversed_parts = parts * (1 - 2 * (grades * (grades - 1) // 2 % 2))
    product = even_product_table()
    actions = np.einsum("mb,bki,nd,idj->mnjk", parts, product, reversed_parts, product, optimize=True)
    both = actions + actions.swapaxes(0, 1)
    both[np.diag_indices(8)] /= 2  # a square occurs once
    table = both[MOTOR_PAIRS]
    table.setflags(write=False)
    return table
