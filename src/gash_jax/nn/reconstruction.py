"""A small network that averages few-ray estimates over the edges of a mesh, as far as neighbours see the same.

Kernel prediction (after Bako et al. 2017, who do it for pixels), band by band. What is averaged is the *residual*, the
estimate minus the transfer without shadows, in world axes. A pass gives the neighbour j of a vertex i the weight

    w_ij = exp(f(features of i, j)) / (1 + sum_j exp(f)),     the vertex itself what is left,

f a network of one hidden layer. Features say how much the two residuals differ, as a multiple of what noise alone
would make of them, and how the surface bends in between. All follow from the surface and the rays, none from axes or
units, so the result turns with the mesh. The variance that noise has left is carried from pass to pass.

Noise is measured in `reference_noise`: a rough law of what an estimate of N rays with a free share p is off by, which
the network corrects. It falls faster than the differences between neighbours do, which do not depend on rays: with more
rays weights go to the vertex itself, and the result to the bake.

Last the network says what error it expects to be left: `variance`, the mean square of one coefficient of each band.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Bool, Float, Int

from gash_jax.algebra.sh import band_index, bands_of

COMPARED = 3  # bands in which residuals are compared
LARGEST_LOGIT, SMALLEST_LOGIT = 8.0, -12.0
LEAST = 1e-9  # variance, below what float32 sums can tell


class Seen(NamedTuple):
    """What is known of vertices (any leading axes): residual, variance of its noise by band, rays, their free share."""

    residual: Float[Array, "*v k"]
    noise: Float[Array, "*v b"]
    rays: Float[Array, "*v"]
    share: Float[Array, "*v"]


class Around(NamedTuple):
    """A vertex and its edges: lengths and directions as `edge_features` has them, and which entries are an edge."""

    edges: Float[Array, "v m e"]
    found: Bool[Array, "v m"]


def reference_noise(
    rays: Float[Array, "*v"], share: Float[Array, "*v"], bands: int, scale: float = 0.06
) -> Float[Array, "*v b"]:
    """Rough variance of one coefficient of an estimate by `rays` lattice points of which `share` are free."""
    partly = share * (1 - share) + 0.05 / (rays + 2)
    return jnp.repeat((scale * partly * rays**-1.5)[..., None], bands, axis=-1)


def edge_features(
    places: Float[Array, "v 3"],
    normals: Float[Array, "v 3"],
    near_places: Float[Array, "v m 3"],
    near_normals: Float[Array, "v m 3"],
    found: Bool[Array, "v m"],
) -> Float[Array, "v m 5"]:
    """Cosines between the two normals, and of each with the edge; the edge's length over the mean at the vertex, and
    that mean as a logarithm. Places are in units of the mesh."""
    offsets = near_places - places[:, None]
    square = jnp.sum(offsets * offsets, axis=-1)
    length = jnp.sqrt(square + 1e-16)
    count = jnp.maximum(jnp.sum(found, axis=-1), 1)
    mean = jnp.sum(jnp.where(found, length, 0), axis=-1) / count + 1e-8
    unit = offsets / length[..., None]
    own = normals[:, None]
    cosines = [jnp.sum(a * b, axis=-1) for a, b in ((own, near_normals), (unit, own), (unit, near_normals))]
    scale = jnp.broadcast_to(0.3 * jnp.log(mean)[:, None] + 1, found.shape)
    return jnp.stack([*cosines, length / mean[:, None], scale], -1)


def by_band(values: Float[Array, "*v k"], bands: int) -> Float[Array, "*v b"]:
    """Mean over the coefficients of each of the first `bands` bands."""
    parts = [values[..., order * order : (order + 1) ** 2].mean(axis=-1) for order in range(bands)]
    return jnp.stack(parts, axis=-1)


class Pass(nn.Module):
    """One look at the neighbours: averaged residuals and their noise."""

    hidden: int
    bands: int

    @nn.compact
    def __call__(self, own: Seen, near: Seen, around: Around) -> tuple[Seen, Float[Array, "v b"]]:
        """Vertices "v" and the ends of their edges "v m" -> the vertices anew, and how far neighbours lie apart."""
        found, count = around.found[..., None], jnp.maximum(jnp.sum(around.found, axis=-1), 1)[:, None]
        apart = by_band((near.residual - own.residual[:, None]) ** 2, COMPARED)
        noise, near_noise = own.noise[:, None, :COMPARED], near.noise[..., :COMPARED]
        mean_apart = jnp.sum(jnp.where(found, apart, 0), axis=1) / count
        partly, near_partly = (seen.share * (1 - seen.share) for seen in (own, near))
        of_vertex = jnp.concatenate(
            [
                jnp.log(mean_apart / noise[:, 0] + 0.1),
                0.5 * jnp.log(own.rays)[:, None] - 1.5,
                0.5 * jnp.log(partly + 0.01)[:, None] + 1,
            ],
            -1,
        )
        of_edge = jnp.concatenate(
            [
                around.edges,
                jnp.log(apart / (noise + near_noise) + 0.1),
                jnp.log(near_noise[..., :1] / noise[..., :1]),
                0.3 * jnp.log(near_noise[..., :1]) + 2.5,
                5 * jnp.sqrt(apart[..., :1] + 1e-6),
                0.3 * jnp.log(near_partly + 1e-3)[..., None] + 1,
            ],
            -1,
        )
        # a layer over both, without writing the vertex's part once for each edge
        hidden = nn.relu(nn.Dense(self.hidden)(of_edge) + nn.Dense(self.hidden, use_bias=False)(of_vertex)[:, None])
        logits = nn.Dense(self.bands, kernel_init=nn.initializers.normal(0.1))(hidden)
        weight = jnp.where(found, jnp.exp(jnp.clip(logits, SMALLEST_LOGIT, LARGEST_LOGIT)), 0)
        rest = 1 / (1 + jnp.sum(weight, axis=1))
        weight = weight * rest[:, None]
        band = np.minimum(band_index(bands_of(own.residual.shape[-1])), self.bands - 1)
        residual = own.residual * rest[:, band] + jnp.sum(weight[..., band] * near.residual, axis=1)
        noise = rest**2 * own.noise + jnp.sum(weight**2 * near.noise, axis=1)
        spread = jnp.sum(weight[..., :COMPARED] * by_band((near.residual - residual[:, None]) ** 2, COMPARED), axis=1)
        own_move = by_band((own.residual - residual) ** 2, COMPARED)
        return Seen(residual, noise, own.rays, own.share), spread + rest[:, :COMPARED] * own_move


class ExpectedError(nn.Module):
    """What error is left after the passes, of one coefficient of each band, as a mean square."""

    hidden: int

    @nn.compact
    def __call__(self, seen: Seen, spread: Float[Array, "v b"]) -> Float[Array, "v c"]:
        """Vertices after the last pass and how far their neighbours lay apart -> variance by band."""
        features = jnp.concatenate(
            [
                0.3 * jnp.log(seen.noise) + 2.5,
                jnp.log(spread / seen.noise[..., :COMPARED] + 0.1),
                0.3 * jnp.log(spread + LEAST) + 2.5,
                0.5 * jnp.log(seen.rays)[..., None] - 1.5,
                0.5 * jnp.log(seen.share * (1 - seen.share) + 0.01)[..., None] + 1,
            ],
            -1,
        )
        hidden = nn.relu(nn.Dense(self.hidden)(features))
        return seen.noise * jnp.exp(nn.Dense(seen.noise.shape[-1])(hidden)) + LEAST


class Reconstruction(nn.Module):
    """All passes and the expected error."""

    hidden: int = 10
    bands: int = 6
    count: int = 2

    def setup(self) -> None:
        """The passes, by number, and what comes after them."""
        self.passes = [Pass(self.hidden, self.bands) for _ in range(self.count)]
        self.error = ExpectedError(self.hidden)

    def look(self, index: int, own: Seen, near: Seen, around: Around) -> tuple[Seen, Float[Array, "v b"]]:
        """One of the passes (`Pass.__call__`)."""
        return self.passes[index](own, near, around)

    def expected_error(self, seen: Seen, spread: Float[Array, "v b"]) -> Float[Array, "v c"]:
        """`ExpectedError` after the last pass."""
        return self.error(seen, spread)

    def __call__(
        self, seen: Seen, table: Int[Array, "v m"], around: Around
    ) -> tuple[Float[Array, "v k"], Float[Array, "v c"]]:
        """All vertices of a mesh with the table of their edges -> residuals, and their mean square error by band."""
        spread = seen.noise[..., :COMPARED]
        for index in range(self.count):
            near = jax.tree.map(lambda values: values[table], seen)
            seen, spread = self.look(index, seen, near, around)
        # what the passes do is judged by their error alone, not by how well that can be foretold
        held, spread = jax.lax.stop_gradient((seen, spread))
        return seen.residual, self.expected_error(held, spread)
