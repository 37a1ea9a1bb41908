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

from typing import Any, NamedTuple

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
    """What is known of vertices, or with axes "m v" of the ends of their edges: residual, variance of its noise by
    band, rays, free share of them. Vertices are the last axis, along which the compiler vectorises."""

    residual: Float[Array, "k *v"]
    noise: Float[Array, "b *v"]
    rays: Float[Array, "*v"]
    share: Float[Array, "*v"]


class Around(NamedTuple):
    """The edges of vertices (`edge_features`), and which entries are one."""

    edges: Float[Array, "e m v"]
    found: Bool[Array, "m v"]


def reference_noise(rays: Float[Array, "*v"], share: Float[Array, "*v"], bands: int) -> Float[Array, "b *v"]:
    """Rough variance of one coefficient of an estimate by `rays` lattice points of which `share` are free."""
    return jnp.broadcast_to(rough_variance(rays, share)[None], (bands, *rays.shape))


def rough_variance(rays: Any, share: Any) -> Any:
    """The law of `reference_noise`, of NumPy's arrays or JAX's."""
    return 0.06 * (share * (1 - share) + 0.05 / (rays + 2)) / rays**1.5


def edge_features(
    places: Float[Array, "3 v"],
    normals: Float[Array, "3 v"],
    near_places: Float[Array, "3 m v"],
    near_normals: Float[Array, "3 m v"],
    found: Bool[Array, "m v"],
) -> Float[Array, "5 m v"]:
    """Cosines between the two normals, and of each with the edge; the edge's length over the mean at the vertex, and
    that mean as a logarithm. Places are in units of the mesh."""
    offsets = near_places - places[:, None]
    length = jnp.sqrt(jnp.sum(offsets * offsets, axis=0) + 1e-16)
    count = jnp.maximum(jnp.sum(found, axis=0), 1)
    mean = jnp.sum(jnp.where(found, length, 0), axis=0) / count + 1e-8
    unit = offsets / length[None]
    own = normals[:, None]
    cosines = [jnp.sum(a * b, axis=0) for a, b in ((own, near_normals), (unit, own), (unit, near_normals))]
    scale = jnp.broadcast_to(0.3 * jnp.log(mean)[None] + 1, found.shape)
    return jnp.stack([*cosines, length / mean[None], scale])


def by_band(values: Float[Array, "k *v"], bands: int) -> Float[Array, "b *v"]:
    """Mean over the coefficients of each of the first `bands` bands."""
    return jnp.stack([values[order * order : (order + 1) ** 2].mean(axis=0) for order in range(bands)])


def bands_used(k: int, bands: int) -> np.ndarray:
    """For each of k coefficients the band whose weight it gets: its own, the last one beyond those that there are."""
    return np.minimum(band_index(bands_of(k)), bands - 1)


def bands_apart(k: int, bands: int) -> list[tuple[int, slice]]:
    """The coefficients of each band with the band whose weight they get (`bands_used`)."""
    return [(min(band, bands - 1), slice(band * band, (band + 1) ** 2)) for band in range(bands_of(k))]


def _dense(
    module: nn.Module, name: str, values: Float[Array, "f *v"], width: int, scale: float
) -> Float[Array, "h *v"]:
    kernel = module.param(name, nn.initializers.normal(scale), (values.shape[0], width))
    return jnp.einsum("fh,f...->h...", kernel, values)


def _bias(module: nn.Module, name: str, width: int, axes: int) -> Array:
    return module.param(name, nn.initializers.zeros, (width,)).reshape(width, *(1,) * axes)


class Pass(nn.Module):
    """One look at the neighbours: averaged residuals and their noise."""

    hidden: int
    bands: int

    @nn.compact
    def __call__(self, own: Seen, near: Seen, around: Around) -> tuple[Seen, Float[Array, "c v"]]:
        """Vertices "v" and the ends of their edges "m v" -> the vertices anew, and how far neighbours lie apart."""
        found, count = around.found[None], jnp.maximum(jnp.sum(around.found, axis=0), 1)
        apart = by_band((near.residual - own.residual[:, None]) ** 2, COMPARED)
        noise, near_noise = own.noise[:COMPARED, None], near.noise[:COMPARED]
        mean_apart = jnp.sum(jnp.where(found, apart, 0), axis=1) / count[None]
        partly, near_partly = (seen.share * (1 - seen.share) for seen in (own, near))
        of_vertex = jnp.concatenate(
            [
                jnp.log(mean_apart / noise[:, 0] + 0.1),
                0.5 * jnp.log(own.rays)[None] - 1.5,
                0.5 * jnp.log(partly + 0.01)[None] + 1,
            ]
        )
        of_edge = jnp.concatenate(
            [
                around.edges,
                jnp.log(apart / (noise + near_noise) + 0.1),
                jnp.log(near_noise[:1] / noise[:1]),
                0.3 * jnp.log(near_noise[:1]) + 2.5,
                5 * jnp.sqrt(apart[:1] + 1e-6),
                0.3 * jnp.log(near_partly + 1e-3)[None] + 1,
            ]
        )
        # a layer over both, without writing the vertex's part once for each edge
        hidden = _dense(self, "of_edge", of_edge, self.hidden, 0.28)
        hidden += (_dense(self, "of_vertex", of_vertex, self.hidden, 0.45) + _bias(self, "bias", self.hidden, 1))[
            :, None
        ]
        logits = _dense(self, "out", nn.relu(hidden), self.bands, 0.1) + _bias(self, "out_bias", self.bands, 2)
        used = min(self.bands, bands_of(own.residual.shape[0]))
        weight = jnp.where(found, jnp.exp(jnp.clip(logits[:used], SMALLEST_LOGIT, LARGEST_LOGIT)), 0)
        rest = 1 / (1 + jnp.sum(weight, axis=1))
        weight = weight * rest[:, None]
        # band by band: a gather of the weights for each coefficient takes longer than all sums
        parts = [
            own.residual[part] * rest[None, band] + jnp.sum(weight[None, band] * near.residual[part], axis=1)
            for band, part in bands_apart(own.residual.shape[0], used)
        ]
        residual = jnp.concatenate(parts)
        left = rest**2 * own.noise[:used] + jnp.sum(weight**2 * near.noise[:used], axis=1)
        spread = by_band((near.residual - residual[:, None]) ** 2, COMPARED)
        spread = jnp.sum(weight[:COMPARED] * spread, axis=1)
        moved = by_band((own.residual - residual) ** 2, COMPARED)
        return Seen(residual, left, own.rays, own.share), spread + rest[:COMPARED] * moved


class ExpectedError(nn.Module):
    """What error is left after the passes, of one coefficient of each band, as a mean square."""

    hidden: int
    bands: int

    @nn.compact
    def __call__(self, seen: Seen, spread: Float[Array, "c v"]) -> Float[Array, "b v"]:
        """Vertices after the last pass and how far their neighbours lay apart -> variance by band."""
        used = len(seen.noise)
        features = jnp.concatenate(
            [
                0.3 * jnp.log(seen.noise[:COMPARED]) + 2.5,
                jnp.log(spread / seen.noise[:COMPARED] + 0.1),
                0.3 * jnp.log(spread + LEAST) + 2.5,
                0.5 * jnp.log(seen.rays)[None] - 1.5,
                0.5 * jnp.log(seen.share * (1 - seen.share) + 0.01)[None] + 1,
            ]
        )
        hidden = nn.relu(_dense(self, "first", features, self.hidden, 0.3) + _bias(self, "bias", self.hidden, 1))
        found = _dense(self, "out", hidden, self.bands, 0.1) + _bias(self, "out_bias", self.bands, 1)
        return seen.noise * jnp.exp(found[:used]) + LEAST


class Reconstruction(nn.Module):
    """Two passes and the expected error, of as many bands as there are."""

    hidden: int = 10
    bands: int = 6

    def setup(self) -> None:
        """The passes, and what comes after them."""
        self.first, self.second = (Pass(self.hidden, self.bands) for _ in range(2))
        self.error = ExpectedError(self.hidden, self.bands)

    def look(self, own: Seen, near: Seen, around: Around) -> Seen:
        """The first pass."""
        return self.first(own, near, around)[0]

    def look_again(self, own: Seen, near: Seen, around: Around) -> tuple[Float[Array, "k v"], Float[Array, "b v"]]:
        """The second pass, of what the first has made -> residuals, and their mean square error by band."""
        seen, spread = self.second(own, near, around)
        # what the passes do is judged by their error alone, not by how well that can be foretold
        return seen.residual, self.error(*jax.lax.stop_gradient((seen, spread)))

    def __call__(
        self, seen: Seen, table: Int[Array, "m v"], around: Around
    ) -> tuple[Float[Array, "k v"], Float[Array, "b v"]]:
        """All vertices of a mesh with the table of their edges: both passes."""
        once = self.look(seen, jax.tree.map(lambda values: values[..., table], seen), around)
        return self.look_again(once, jax.tree.map(lambda values: values[..., table], once), around)
