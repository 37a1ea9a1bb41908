"""Transfer from what a vertex sees of a tree of surfels, as a residual to the closed form.

Every vertex looks at the `neighbours` surfels of its block (`graph.sight`) and at the corners of its own faces
(nodes["near"]). A surfel of area A at offset o = d u covers the solid angle w = a / (a + d²), with a the smaller of A
and its projected area; what stands above the tangent plane counts by its cosine c = max(n . u, 0). With f the features
of a pair in the frame F of the vertex, h = ReLU(W f + b), and g the same of the near corners:

    z = [sum_j w c h, sum_j w clip(n . u + r, 0, 1) h, mean g, max g, sum_j w c, max_j w c]
    r(v) = gate MLP(z),    gate = s / (s + GATE),   s = sum_j w c + mean_near max(n . u, 0)
    t(v) = A_l/pi Y(n) + D(F) r(v)

Sums over surfels weighted by solid angle do not change when a surfel is replaced by its parts, so the tree may be cut
anywhere. On a convex body nothing stands above any tangent plane: s = 0, and the prediction is the closed form.

F has the normal as third column; its twist is fixed by the tangential part of sum_j w c u, the direction in which
most is hidden (by all surfels where that vanishes, by the near corners where there are none; arbitrary where all
vanish, as at the pole of a body of revolution, where of the exact transfer too only the terms of order 0 survive).
Nothing absolute enters, so the prediction turns with the mesh.

Beside the coefficients the network predicts, per band, the mean square error of itself and that of the closed form,
from z, without changing it. Where it expects to be worse than the closed form it falls back in that proportion.
"""

import jax
import jax.numpy as jnp
import jraph
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.algebra.numerics import safe_normalize
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.nn.closed_form import closed_form, zero_without_normal
from gash_jax.nn.inputs import edge_arrays, node_arrays

GATE = 0.01
BLOCK = 16
# squared lengths are at least this (radius of the surface = 1): what coincides has no direction
FLOOR = 1e-12
TINY = 1e-20
# its inverse square, in gradients, is a float32
SMALLEST_AREA = 1e-18
# of the logarithm of a mean square error: outside, its likelihood overflows
LOG_RANGE = (-14.0, 5.0)
# a surfel whose middle is the vertex reaches infinitely far for its distance
FARTHEST = 4.0

Pair = Float[Array, "b w n"]


def _dot(a: list[Array], b: list[Array]) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _quadratic(form: list[Array], u: list[Array]) -> Array:
    """u' S u of S = (xx, yy, zz, xy, xz, yz)."""
    x, y, z = u
    return (
        form[0] * x * x + form[1] * y * y + form[2] * z * z + 2 * (form[3] * x * y + form[4] * x * z + form[5] * y * z)
    )


class SurfelNet(nn.Module):
    """Coefficients from a graph of blocks: see the module docstring and `graph.surfel_graph`.

    `channels` of the pairs; the near corners have 3/4 of them, the MLP of `layers` residual layers three times as many.
    """

    channels: int = 32
    layers: int = 2
    bands: int = 3
    neighbours: int = 64

    @nn.compact
    def with_error(self, graph: jraph.GraphsTuple, deterministic: bool = True) -> Float[Array, "v m"]:
        """Coefficients before any fallback (bands²), the closed form's (bands²), log MSE of the two (bands each).

        In world directions, in the order of the graph's blocks; nothing is random, so `deterministic` changes nothing.
        """
        nodes = node_arrays(graph)
        surfels = edge_arrays(graph)["surfel"].reshape(-1, self.neighbours, edge_arrays(graph)["surfel"].shape[-1])
        blocks = len(surfels)
        position, normal, near = (nodes[name].reshape(blocks, BLOCK, -1) for name in ("position", "normal", "near"))
        z, frame, seen = self._look(surfels, position, normal, near.reshape(blocks, BLOCK, -1, 6))
        flat = lambda a: a.reshape(blocks * BLOCK, *a.shape[2:])  # noqa: E731
        z, frame, seen = flat(z), flat(frame), flat(seen)
        width = 3 * self.channels
        x = nn.relu(nn.Dense(width, name="mix")(z))
        for i in range(self.layers):
            x = x + nn.relu(nn.Dense(width, name=f"hidden_{i}")(x))
        gate = (seen / (seen + GATE))[:, None]
        residual = gate * nn.Dense(self.bands**2, kernel_init=nn.initializers.zeros_init(), name="head")(x)
        y = nn.relu(nn.Dense(self.channels, name="doubt")(jax.lax.stop_gradient(x)))
        errors = jnp.clip(nn.Dense(2 * self.bands, name="error")(y), *LOG_RANGE) + 2 * jnp.log(
            jax.lax.stop_gradient(gate) + GATE
        )
        world = rotate_coefficients(residual, frame)
        normals = flat(normal)
        exact = closed_form(normals, self.bands)
        return jnp.concatenate([exact + zero_without_normal(world, normals), exact, errors], axis=-1)

    def __call__(self, graph: jraph.GraphsTuple, deterministic: bool = True) -> Float[Array, "v m"]:
        """Coefficients after the fallback, then their expected error per band, (v, bands² + bands)."""
        output = self.with_error(graph)
        return fall_back(output, node_arrays(graph)["normal"], self.bands)

    def _look(
        self, surfels: Float[Array, "b n d"], position: Array, normal: Array, near: Float[Array, "b w m 6"]
    ) -> tuple[Array, Array, Array]:
        """Pooled features, frames, and how much stands above the tangent plane."""
        column = lambda i: surfels[:, None, :, i]  # noqa: E731
        own = [normal[:, :, None, i] for i in range(3)]
        offset = [column(i) - position[:, :, None, i] for i in range(3)]
        square = _dot(offset, offset) + FLOOR
        inverse = jax.lax.rsqrt(square)
        u = [o * inverse for o in offset]
        vector, area, size = [column(i) for i in (3, 4, 5)], column(6), column(7)
        projected = (
            4 * np.float32(np.pi) * jnp.sqrt(jnp.maximum(_quadratic([column(i) for i in range(8, 14)], u), 0) + 1e-24)
        )
        covered = jnp.minimum(projected, area)
        angle = covered / (covered + square)
        height = _dot(u, own)
        above = angle * jnp.maximum(height, 0)
        reach = jnp.sqrt(jnp.maximum(_quadratic([column(i) for i in range(14, 20)], own), 0) + TINY) * inverse
        reach = jnp.minimum(reach, FARTHEST)
        corner = [near[..., i] for i in range(3)]
        away = jax.lax.rsqrt(_dot(corner, corner) + FLOOR)
        v = [c * away for c in corner]
        frame = _frames(normal, u, above, angle, v)
        axes = [[frame[:, :, None, i, j] for i in range(3)] for j in range(3)]
        x, y = _dot(u, axes[0]), _dot(u, axes[1])
        flux = jnp.clip(-_dot(u, vector) / jnp.maximum(covered, SMALLEST_AREA), -2, 2)
        facing = [_dot(vector, axis) / jnp.maximum(area, SMALLEST_AREA) for axis in axes]
        distance = jnp.log(square * inverse + 1e-3) * 0.3
        size = size / (size + square * inverse)
        features = [x, y, height, x * y, y * height, 1.5 * height * height - 0.5, x * height, 0.5 * (x * x - y * y)]
        features += [jnp.sqrt(jnp.maximum(angle, TINY)), flux, reach, size, facing[2], facing[0], facing[1], distance]
        h = nn.relu(nn.Dense(self.channels, name="surfel")(jnp.stack(features, axis=-1)))
        weights = jnp.stack([above, angle * jnp.clip(height + reach, 0, 1)], axis=2)
        pooled = jnp.einsum("bwin,bwnc->bwic", weights, h).reshape(*height.shape[:2], -1)
        g = nn.relu(nn.Dense(3 * self.channels // 4, name="near")(_near_features(near, v, away, axes)))
        rise = jnp.mean(jnp.maximum(_dot(v, own), 0), axis=-1)
        edge = jnp.log(jnp.mean(1 / away, axis=-1, keepdims=True) + 1e-3) * 0.3
        total = jnp.sum(above, axis=-1)
        extra = [total[..., None], jnp.max(above, axis=-1, keepdims=True), edge]
        z = jnp.concatenate([pooled, jnp.mean(g, axis=2), jnp.max(g, axis=2), *extra], axis=-1)
        return z, frame, total + rise


def _frames(normal: Array, u: list[Array], above: Pair, angle: Pair, near: list[Array]) -> Float[Array, "b w 3 3"]:
    """Frames whose first axis looks where most is hidden."""
    weight = above + 1e-3 * angle
    hidden = jnp.stack(
        [jnp.sum(weight * a, axis=-1) + 1e-4 * jnp.mean(b, axis=-1) for a, b in zip(u, near, strict=True)], -1
    )
    tangent = hidden - jnp.sum(hidden * normal, axis=-1, keepdims=True) * normal
    known = jnp.sum(tangent * tangent, axis=-1, keepdims=True) > 1e-16
    other = orthonormal_frame(normal)[..., 0]
    first = safe_normalize(jnp.where(known, tangent, other))
    return jnp.stack([first, jnp.cross(normal, first), normal], axis=-1)


def _near_features(near: Array, v: list[Array], away: Array, axes: list[list[Array]]) -> Float[Array, "b w m 14"]:
    """What is said of the corners of a vertex's own faces: direction, normal, distance in units of their mean."""
    x, y, z = (_dot(v, axis) for axis in axes)
    normal = [near[..., i] for i in (3, 4, 5)]
    turned = [_dot(normal, axis) for axis in axes]
    length = 1 / away
    relative = length / (jnp.mean(length, axis=-1, keepdims=True) + 1e-9)
    features = [x, y, z, x * y, y * z, x * z, 0.5 * (x * x - y * y), z * z, *turned, _dot(normal, v), relative]
    return jnp.stack([*features, jnp.log(length + 1e-3) * 0.3], axis=-1)


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
