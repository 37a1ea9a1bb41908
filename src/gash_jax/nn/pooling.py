"""Sum and maximum over a last axis of some dozens, as a CPU likes them: what is pooled over surfels."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def _halved(x: Array, together: Callable[[Array, Array], Array]) -> Array:
    """The last axis brought to one by halves: whole vectors, where XLA would reduce number by number on a CPU."""
    while (count := x.shape[-1]) > 1:
        half = count // 2
        rest = x[..., 2 * half :]
        x = together(x[..., :half], x[..., half : 2 * half])
        x = jnp.concatenate([x, rest], axis=-1) if count % 2 else x
    return x[..., 0]


@jax.custom_jvp
def total_of(x: Float[Array, "... n"]) -> Float[Array, "..."]:
    """Sum over the last axis."""
    return _halved(x, jnp.add)


@total_of.defjvp
def _total_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    return total_of(primals[0]), jnp.sum(tangents[0], axis=-1)


def weighted_total(weight: Float[Array, "v n"], x: Float[Array, "c v n"]) -> Float[Array, "c v"]:
    """Sum over the last axis of several arrays, weighted alike: as products of matrices and vectors."""
    return jnp.einsum("cvn,vn->cv", x, weight, precision="highest")


@jax.custom_jvp
def most_of(x: Float[Array, "... n"]) -> Float[Array, "..."]:
    """Maximum over the last axis; ties share its gradient."""
    return _halved(x, jnp.maximum)


@most_of.defjvp
def _most_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    return most_of(primals[0]), jax.jvp(partial(jnp.max, axis=-1), primals, tangents)[1]
