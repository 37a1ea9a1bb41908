"""The conformal geometric algebra R(4,1): blades and products.

Generators e1, e2, e3, e+, e- square to +1, +1, +1, +1, -1. A multivector is an array of 32 coefficients on its
last axis. A blade's index is the bitmask of its generators (bit 0 e1, bit 1 e2, bit 2 e3, bit 3 e+, bit 4 e-),
its generators stand in ascending order, and

    e_i e_j = sign[i, j] e_(i xor j)

with sign[i, j] = (-1)^(swaps that sort the generators) times the squares of the generators that meet.

Null vectors: e_inf = e- + e+ (infinity) and e_o = (e- - e+)/2 (origin), so that e_inf^2 = e_o^2 = 0 and
e_o . e_inf = -1.

All products broadcast their leading shapes; the outer and inner products keep, of the product of a grade-r with a
grade-s part, the grades r + s and |r - s| (scalars included).
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from gash_jax.algebra.arguments import check_last_axis

METRIC = (1, 1, 1, 1, -1)

SCALAR, E1, E2, E3, EP, EM = 0, 1, 2, 4, 8, 16
E12, E13, E23, E123 = E1 | E2, E1 | E3, E2 | E3, E1 | E2 | E3
E1P, E2P, E3P, E123P = E1 | EP, E2 | EP, E3 | EP, E123 | EP
E1M, E2M, E3M, E123M = E1 | EM, E2 | EM, E3 | EM, E123 | EM

_BLADES = range(32)
BLADE_NAMES = tuple(
    "e" + "".join(symbol for bit, symbol in enumerate("123+-") if blade >> bit & 1) if blade else "1"
    for blade in _BLADES
)
BLADE_GRADES = tuple(blade.bit_count() for blade in _BLADES)

# Multivectors per tile and per block. A tile has one row per blade; rows of 2^k bytes would share few cache sets.
_TILE, _BLOCK = 500, 2000

Multivector = Float[Array | np.ndarray, "... 32"]


def _sign(left: int, right: int) -> float:
    """Sign of the product of two basis blades."""
    swaps = sum((left >> shift & right).bit_count() for shift in range(1, 5))
    squares = [METRIC[bit] for bit in range(5) if left & right & 1 << bit]
    return float((-1) ** swaps * np.prod(squares, initial=1))


@functools.cache
def cayley_signs() -> np.ndarray:
    """Signs of the geometric product as a read-only float64 (32, 32) array: e_i e_j = signs[i, j] e_(i xor j)."""
    signs = np.array([[_sign(left, right) for right in _BLADES] for left in _BLADES], dtype=np.float64)
    signs.setflags(write=False)
    return signs


@functools.cache
def _product_signs(kind: str) -> np.ndarray:
    """Cayley signs with the terms that the outer or the inner product drops set to zero."""
    left, right = np.indices((32, 32))
    kept = {
        "geometric": np.full((32, 32), True),
        "outer": (left & right) == 0,
        "inner": ((left & right) == left) | ((left & right) == right),
    }
    return np.where(kept[kind], cayley_signs(), 0.0)


def _rows_product(a: Float[Array, "32 m"], b: Float[Array, "32 m"], kind: str) -> Float[Array, "32 m"]:
    """Blades first: the sum over the left blades i of a_i times the signed permutation of b that e_i causes."""
    signs = _product_signs(kind)
    total = jnp.zeros(b.shape, b.dtype)
    for left in _BLADES:
        right = np.arange(32) ^ left
        rows = b.at[right].get(mode="promise_in_bounds", unique_indices=True)
        total = total + a[left, None] * (jnp.asarray(signs[left, right, None], b.dtype) * rows)
    return total


def _block_product(a: Float[Array, "n 32"], b: Float[Array, "n 32"], kind: str) -> Float[Array, "n 32"]:
    """Product of one block, in tiles. The inner loop makes XLA store the transposed tiles instead of fusing the
    transposition into each of the 32 permutations."""
    tiles = [x.reshape(-1, _TILE, 32).swapaxes(1, 2) for x in (a, b)]
    return lax.map(lambda tile: _rows_product(tile[0], tile[1], kind), tiles).swapaxes(1, 2).reshape(a.shape)


def _blocked_product(a: Float[Array, "n 32"], b: Float[Array, "n 32"], kind: str) -> Float[Array, "n 32"]:
    """Product in blocks that stay in a core's cache. Differentiation keeps the factors alone and forms the permutations
    again: they take 32 times as much memory."""
    padding = ((0, -len(a) % _BLOCK), (0, 0))
    blocks = [jnp.pad(x, padding).reshape(-1, _BLOCK, 32) for x in (a, b)]
    product = jax.checkpoint(lambda block: _block_product(block[0], block[1], kind), prevent_cse=False)
    return lax.map(product, blocks).reshape(-1, 32)[: len(a)]


@functools.partial(jax.jit, static_argnames="kind")
def _product(a: Multivector, b: Multivector, kind: str) -> Float[Array, "... 32"]:
    a, b = jnp.asarray(a), jnp.asarray(b)
    for factor in (a, b):
        check_last_axis("multivectors", factor, 32)
    shape = (*np.broadcast_shapes(a.shape[:-1], b.shape[:-1]), 32)
    dtype = jnp.result_type(a, b)
    a, b = (jnp.broadcast_to(x, shape).reshape(-1, 32).astype(dtype) for x in (a, b))

    def at_once(a: Array, b: Array) -> Array:
        return _rows_product(a.T, b.T, kind).T

    if len(a) < _BLOCK:
        return at_once(a, b).reshape(shape)
    # The blocks follow one another: good for a cache, bad for an accelerator.
    blocked = functools.partial(_blocked_product, kind=kind)
    return lax.platform_dependent(a, b, cpu=blocked, default=at_once).reshape(shape)


def geometric_product(a: Multivector, b: Multivector) -> Float[Array, "... 32"]:
    """Geometric product a b.

    >>> e1, e2 = np.eye(32, dtype=np.float32)[[1, 2]]
    >>> int(np.argmax(gash_jax.geometric_product(e1, e2)))  # e12, whose bitmask is 3
    3
    """
    return _product(a, b, "geometric")


def outer_product(a: Multivector, b: Multivector) -> Float[Array, "... 32"]:
    """Outer product a ^ b: the part of grade r + s of the product of grades r and s."""
    return _product(a, b, "outer")


def inner_product(a: Multivector, b: Multivector) -> Float[Array, "... 32"]:
    """Inner product a . b: the part of grade |r - s| of the product of grades r and s."""
    return _product(a, b, "inner")


def _scaled_blades(a: Multivector, factors: np.ndarray) -> Float[Array, "... 32"]:
    """Multiply each blade's coefficient by a constant."""
    a = jnp.asarray(a)
    return a * jnp.broadcast_to(jnp.asarray(factors, a.dtype), a.shape)


def reverse(a: Multivector) -> Float[Array, "... 32"]:
    """Reverse ~a: the generators of every blade in opposite order, sign (-1)^(r(r-1)/2) on grade r."""
    grades = np.array(BLADE_GRADES)
    return _scaled_blades(a, 1.0 - 2.0 * (grades * (grades - 1) // 2 % 2))


def grade_projection(a: Multivector, grade: int) -> Float[Array, "... 32"]:
    """Part of a of one grade, 0 to 5."""
    if not 0 <= grade <= 5:
        raise ValueError(f"grade {grade} does not exist in R(4,1): use 0 to 5")
    return _scaled_blades(a, np.array(BLADE_GRADES) == grade)


def sandwich(m: Multivector, x: Multivector) -> Float[Array, "... 32"]:
    """Sandwich product m x ~m."""
    return geometric_product(geometric_product(m, x), reverse(m))


def e_inf() -> Float[np.ndarray, "32"]:
    """Null vector of the point at infinity, e- + e+."""
    return _vector(plus=1.0, minus=1.0)


def e_o() -> Float[np.ndarray, "32"]:
    """Null vector of the origin, (e- - e+)/2."""
    return _vector(plus=-0.5, minus=0.5)


def _vector(plus: float, minus: float) -> Float[np.ndarray, "32"]:
    vector = np.zeros(32, np.float32)
    vector[EP], vector[EM] = plus, minus
    return vector
