"""The network that ships as `local`: transfer from a list of surfels, as a residual to the unshadowed closed form.

Vertices come in blocks b of w, which share a list of n surfels (`graph.surfel_graph`); the network reads

    position, normal (b, w, 3)    near (b, w, m * 6)    surfel (b, n, 20)

where "near" are offset and normal of m corners of the vertex's own faces.

*Pairs.* For every pair of a vertex with normal n and a surfel of area A at offset d u (u of unit length):

    a = min(A, projected area along u)      the part of the surfel that faces the vertex
    w = a / (a + d²)                        about the solid angle it covers, between 0 and 1
    c = max(n . u, 0)                       cosine to the normal; 0 below the tangent plane
    h = ReLU(W f + b)                       f: features of the pair in the frame F of the vertex

and g, the same for the near corners.

*Pooling.* With r the surfel's extent along n over d, clip(n . u + r, 0, 1) also counts surfels that only reach above
the tangent plane:

    z    = [sum_j w c h, sum_j w clip(n . u + r, 0, 1) h, mean g, max g, sum_j w c, max_j w c, (mean edge length)^1/4]
    s    = sum_j w c + mean over corners of max(n . u, 0)       how much stands above the tangent plane
    r(v) = s / (s + GATE) MLP(z)                                 residual in the frame of the vertex
    t(v) = A_l/pi Y(n) + D(F) r(v)                               prediction in the world

A surfel and its children together cover the same solid angle, so the sums are about the same whichever of them a list
holds. On a convex body nothing stands above a tangent plane (by more than rounding): s = 0, and the prediction is the
closed form.

*Frame.* The third column of F is the normal. The first is the tangential part of sum_j w c u, the direction in which
most is hidden; where that vanishes all surfels decide, then the near corners, then `orthonormal_frame`. The last case
is that of a pole of a body of revolution, where only the terms of order m = 0 of the exact transfer differ from 0, and
the twist does not matter. Nothing absolute enters: the prediction turns with the mesh.

*Errors.* After its coefficients the network learns to predict, per band, the mean square error of itself and that of
the closed form, from the same z. Where it expects to be worse than the closed form, it is drawn towards it
(`fall_back`).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.algebra.closed_forms import unshadowed_transfer, zero_without_normal
from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.algebra.numerics import safe_normalize
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.settings import setting
from gash_jax.nn.config import ModelConfig
from gash_jax.nn.pooling import most_of, total_of

GATE = 0.01
# squared lengths are at least this (radius of the surface = 1): what coincides has no direction
FLOOR = 1e-12
TINY = 1e-20
# of lengths: what is no higher than this above a tangent plane is in it
ROUNDING = 1e-6
# its inverse square, in gradients, is a float32
SMALLEST_AREA = 1e-18
# of the logarithm of a mean square error: beyond, its likelihood overflows, or what is unlike the corpus runs away
LOG_RANGE = (-14.0, -3.0)
# a surfel whose middle is the vertex reaches infinitely far for its distance
FARTHEST = 4.0
# a surfel seen edge-on still covers this part of its area: below, float32 does not tell how much it covers
EDGE_ON = 0.01

# pairs of vertex w of block b and surfel n: surfels are what is contiguous, so that loops are over whole vectors
Pair = Float[Array, "b w n"]
# corners of a vertex's own faces, vertices contiguous
Corner = Float[Array, "m v"]
Vector = list[Array]
# what the network reads, by name (module docstring)
Blocks = Mapping[str, Array | np.ndarray]


@dataclass(frozen=True)
class SurfelConfig(ModelConfig):
    """The network over a tree of surfels."""

    channels: int = setting(16, "width of what is said of a pair of vertex and surfel", least=2)
    layers: int = setting(2, "residual layers after pooling", least=1)
    neighbours: int = setting(48, "surfels that a block of vertices shares", least=1)


def _dot(a: Vector, b: Vector) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _quadratic(form: Vector, u: Vector) -> Array:
    """u' S u of S = (xx, yy, zz, xy, xz, yz)."""
    x, y, z = u
    return (
        form[0] * x * x + form[1] * y * y + form[2] * z * z + 2 * (form[3] * x * y + form[4] * x * z + form[5] * y * z)
    )


class SurfelNet(nn.Module):
    """Coefficients from blocks of vertices and their surfels: see the module docstring.

    `channels` of the pairs; the near corners have 3/4 of them, the MLP of `layers` residual layers four times as many.
    """

    channels: int = 16
    layers: int = 2
    bands: int = 3

    def setup(self) -> None:
        """The layers by their names in the model file."""
        width = 4 * self.channels
        self.surfel, self.near = _Pairs(self.channels), _Pairs(3 * self.channels // 4)
        self.mix, self.hidden = nn.Dense(width), [nn.Dense(width) for _ in range(self.layers)]
        self.head = nn.Dense(self.bands**2, kernel_init=nn.initializers.zeros_init())
        self.error_hidden, self.error_head = nn.Dense(self.channels), nn.Dense(2 * self.bands)

    def with_error(self, blocks: Blocks, deterministic: bool = True) -> Float[Array, "v m"]:
        """Coefficients before any fallback (bands²), the closed form's (bands²), log MSE of the two (bands each).

        In world directions, v = b * w vertices in the order of the blocks; nothing is random, so `deterministic`
        changes nothing.
        """
        return self.decode(*self.encode(blocks), jnp.asarray(blocks["normal"]).reshape(-1, 3))

    def __call__(self, blocks: Blocks, deterministic: bool = True) -> Float[Array, "v m"]:
        """Coefficients after the fallback, then their expected error per band, (v, bands² + bands)."""
        return fall_back(self.with_error(blocks), jnp.asarray(blocks["normal"]).reshape(-1, 3), self.bands)

    def encode(self, blocks: Blocks) -> tuple[Float[Array, "v c"], Float[Array, "v 3 3"], Float[Array, "v"]]:
        """State and frame of every vertex, and how much stands above its tangent plane."""
        # one array a component
        surfel = jnp.asarray(blocks["surfel"]).transpose(2, 0, 1)[:, :, None]
        position, normal = (jnp.asarray(blocks[name]).transpose(2, 0, 1) for name in ("position", "normal"))
        own = list(normal[..., None])
        offset = [surfel[i] - position[i][..., None] for i in range(3)]
        square = _dot(offset, offset) + FLOOR
        distance = jnp.sqrt(square)
        inverse = 1 / distance
        u = [o * inverse for o in offset]
        vector, area, size = list(surfel[3:6]), surfel[6], surfel[7]
        floor = jnp.square(area * np.float32(EDGE_ON / (4 * np.pi))) + SMALLEST_AREA**2
        projected = 4 * np.float32(np.pi) * jnp.sqrt(jnp.maximum(_quadratic(list(surfel[8:14]), u), 0) + floor)
        covered = jnp.minimum(projected, area)
        angle = covered / (covered + square)
        height = _dot(u, own)
        above = angle * jnp.maximum(height - ROUNDING * inverse, 0)
        reach = jnp.sqrt(jnp.maximum(_quadratic(list(surfel[14:20]), own), 0) + TINY) * inverse
        reach = jnp.minimum(reach, FARTHEST)
        partly = angle * jnp.clip(height + reach, 0, 1)
        corners = jnp.asarray(blocks["near"]).reshape(normal[0].size, -1, 6).transpose(2, 1, 0)
        away = jnp.sqrt(_dot(list(corners[:3]), list(corners[:3])) + FLOOR)
        v = [c / away for c in corners[:3]]
        frame = _frames(list(normal), u, above, angle, v)
        axes = [[component[..., None] for component in axis] for axis in frame]
        x, y = _dot(u, axes[0]), _dot(u, axes[1])
        flux = jnp.clip(-_dot(u, vector) / jnp.maximum(covered, SMALLEST_AREA), -2, 2)
        unit = 1 / jnp.maximum(area, SMALLEST_AREA)
        facing = [_dot(vector, axis) * unit for axis in axes]
        features = [x, y, height, x * y, y * height, 1.5 * height * height - 0.5, x * height, 0.5 * (x * x - y * y)]
        features += [jnp.sqrt(jnp.maximum(angle, TINY)), flux, reach, size / (size + distance)]
        h = self.surfel([*features, facing[2], facing[0], facing[1], _root(distance)])
        pooled = [total_of(weight[None] * h).reshape(len(h), -1) for weight in (above, partly)]
        g = self.near(_near_features(list(corners[3:]), v, away, [[a.reshape(1, -1) for a in axis] for axis in frame]))
        count = len(away)
        pooled += [jnp.sum(g, axis=1) / count, jnp.max(g, axis=1)]
        total = total_of(above).reshape(-1)
        pooled += [jnp.stack([total, most_of(above).reshape(-1), _root(jnp.sum(away, axis=0) / count)])]
        rise = jnp.maximum(_dot(v, [n.reshape(1, -1) for n in normal]) - ROUNDING / away, 0)
        frames = jnp.stack([jnp.stack(axis, axis=-1) for axis in frame], axis=-1)
        x = nn.relu(self.mix(jnp.concatenate(pooled).T))
        return x, frames.reshape(-1, 3, 3), total + jnp.sum(rise, axis=0) / count

    def decode(
        self, x: Float[Array, "v c"], frames: Float[Array, "v 3 3"], seen: Float[Array, "v"], normals: Array
    ) -> Float[Array, "v m"]:
        """What `with_error` says, from what `encode` found."""
        for hidden in self.hidden:
            x = x + nn.relu(hidden(x))
        gate = (seen / (seen + GATE))[:, None]
        residual = gate * self.head(x)
        low, high = LOG_RANGE
        errors = low + (high - low) * nn.sigmoid(self.error_head(nn.tanh(self.error_hidden(x))))
        world = rotate_coefficients(residual, frames)
        exact = unshadowed_transfer(normals, self.bands)
        return jnp.concatenate([exact + zero_without_normal(world, normals), exact, errors], axis=-1)


def _root(distance: Array) -> Array:
    """The fourth root: as good as a logarithm over the distances of a mesh, and finite at 0."""
    return jnp.sqrt(jnp.sqrt(jnp.maximum(distance, TINY)))


class _Pairs(nn.Module):
    """ReLU(W f + b) of every pair, from one array a feature to one a channel; stored as a Dense layer."""

    channels: int

    @nn.compact
    def __call__(self, features: list[Array]) -> Float[Array, "c ..."]:
        kernel = self.param("kernel", nn.initializers.lecun_normal(), (len(features), self.channels))
        bias = self.param("bias", nn.initializers.zeros_init(), (self.channels,))
        shape = features[0].shape
        flat = jnp.stack(features).reshape(len(features), -1)
        product = jax.lax.dot_general(kernel, flat, (((0,), (0,)), ((), ())))
        return nn.relu((product + bias[:, None]).reshape(-1, *shape))


def _frames(normal: Vector, u: Vector, above: Pair, angle: Pair, near: Vector) -> list[list[Float[Array, "b w"]]]:
    """Axes of frames whose first looks where most is hidden, components of each."""
    weight = above + 1e-3 * angle
    shape = normal[0].shape
    around = [1e-4 / len(b) * jnp.sum(b, axis=0).reshape(shape) for b in near]
    hidden = [total_of(weight * a) + b for a, b in zip(u, around, strict=True)]
    upward = _dot(hidden, normal)
    tangent = [h - upward * n for h, n in zip(hidden, normal, strict=True)]
    known = _dot(tangent, tangent) > 1e-16
    other = jnp.moveaxis(orthonormal_frame(jnp.stack(normal, axis=-1))[..., 0], -1, 0)
    chosen = jnp.stack([jnp.where(known, t, o) for t, o in zip(tangent, other, strict=True)], axis=-1)
    first = list(jnp.moveaxis(safe_normalize(chosen), -1, 0))
    second = [normal[i - 2] * first[i - 1] - normal[i - 1] * first[i - 2] for i in range(3)]
    return [first, second, normal]


def _near_features(normal: Vector, v: Vector, away: Corner, axes: list[Vector]) -> list[Corner]:
    """What is said of the corners of a vertex's own faces: direction, normal, distance in units of their mean."""
    x, y, z = (_dot(v, axis) for axis in axes)
    turned = [_dot(normal, axis) for axis in axes]
    relative = away / (jnp.sum(away, axis=0) / len(away) + 1e-9)[None]
    features = [x, y, z, x * y, y * z, x * z, 0.5 * (x * x - y * y), z * z, *turned, _dot(normal, v), relative]
    return [*features, _root(away)]


def by_band(values: Float[Array, "v b"], bands: int) -> Float[Array, "v k"]:
    """One value a band, repeated for each of its coefficients."""
    return jnp.repeat(values, 2 * np.arange(bands) + 1, axis=-1, total_repeat_length=bands**2)


def fall_back(output: Float[Array, "v m"], normals: Float[Array, "v 3"], bands: int) -> Float[Array, "v n"]:
    """From what `with_error` says: coefficients, drawn to the closed form where that is better, and errors."""
    k = bands**2
    raw, exact, own, formula = jnp.split(output, [k, 2 * k, 2 * k + bands], axis=-1)
    trust = jnp.exp(jnp.minimum(formula - own, 0.0))
    coefficients = exact + by_band(trust, bands) * (raw - exact)
    error = jnp.sqrt(trust**2 * jnp.exp(own) + (1 - trust) ** 2 * jnp.exp(formula))
    return jnp.concatenate([coefficients, zero_without_normal(error, normals)], axis=-1)


def build_surfel_net(config: SurfelConfig) -> SurfelNet:
    """The network of a config."""
    return SurfelNet(config.channels, config.layers, config.bands)
