"""The network that ships as `local`: transfer from a list of surfels, as a residual to the unshadowed closed form.

Every vertex has a list of surfels of its own (`graph.surfel_lists`). Those v whose lists have one width n make a part
(`graph.surfel_graph`), of which the network reads

    position, normal (v, 3)    near (v, m * 6)    cover (v, 3)    surfel (v, n, 20)    weight (v, n)

where "near" are offset and normal of m corners of the vertex's own faces, and "cover" says exactly what the faces right
beside it cover (`graph.surfel_cover`).

*Pairs.* For every pair of a vertex with normal n and a surfel of area A at offset d u (u of unit length):

    a = min(A, projected area along u)      the part of the surfel that faces the vertex
    w = a / (a + d²)                        about the solid angle it covers, between 0 and 1
    c = max(n . u, 0)                       cosine to the normal; 0 below the tangent plane
    h = ReLU(W f + b)                       f: features of the pair in the frame F of the vertex

and g, the same for the near corners.

*Pooling.* With the weight q of the surfel in the list, and r its extent along n over d, where
clip(n . u + r, 0, 1) also counts surfels that only reach above the tangent plane:

    z    = [sum_j q w c h, sum_j q w clip(n . u + r, 0, 1) h, mean g, max g,
            sum_j q w c, max_j q w c, (mean edge length)^1/4, cover in the frame]
    s    = sum_j q w c + mean over corners of max(n . u, 0) + n . cover     how much stands above the tangent plane
    r(v) = s / (s + GATE) MLP(z)                                 residual in the frame of the vertex
    t(v) = A_l/pi Y(n) + D(F) r(v)                               prediction in the world

A surfel and its children together cover the same solid angle, so the sums are about the same whichever of them a list
holds; as weights are continuous, so is the prediction. On a convex body nothing stands above a tangent plane (by more
than rounding): s = 0, and the prediction is the closed form.

*Heads.* One MLP says the first BASE bands. Another one says, from the same z, the bands after them and what each bounce
of light off white surfaces adds; whoever does not ask for these does not wait for it.

*Frame.* The third column of F is the normal. The first is the tangential part of sum_j k u with
k = q w (c + 0.001 clip(n . u + r, 0, 1)), the direction in which most is hidden. Where that is shorter than FAINT and
EVEN times the sum of its weights together, hardly any direction is preferred and rounding would choose: there the
direction of the first near corner, turned by ASIDE about the normal, is added, the more the less there is. A vertex
without corners takes `orthonormal_frame`. Nothing absolute enters otherwise: the prediction turns with the mesh.

*Errors.* After its coefficients the network learns to predict, per band, the mean square error of itself, of what
bounces, and of the closed form, from the same z. Where it expects to be worse than the closed form, it is drawn towards
it (`fall_back`). Where nothing stands above the tangent plane the expected error is 0.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.algebra.closed_forms import unshadowed_transfer, zero_without_normal
from gash_jax.algebra.sh import MAX_BANDS
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.settings import setting
from gash_jax.nn.config import ModelConfig
from gash_jax.nn.pooling import most_of, total_of, weighted_total
from gash_jax.nn.surfel_pairs import Part, Parts, fourth_root, look

BASE = 3
GATE = 0.01
# of the logarithm of a mean square error: beyond, its likelihood overflows, or what is unlike the corpus runs away
LOG_RANGE = (-14.0, -3.0)


@dataclass(frozen=True)
class SurfelConfig(ModelConfig):
    """The network over a tree of surfels."""

    channels: int = setting(16, "width of what is said of a pair of vertex and surfel", least=2)
    layers: int = setting(2, "residual layers after pooling", least=1)
    known_bands: int = setting(1, "SH bands that are learnt, if more than `bands`", least=1, most=MAX_BANDS)
    known_bounces: int = setting(0, "bounces of light that are learnt", least=0, most=2)

    @property
    def learnt_bands(self) -> int:
        """Bands that the network learns: whoever loads it may ask for fewer."""
        return max(self.bands, self.known_bands)


class Said(NamedTuple):
    """All that the network says of v vertices, before any fallback; coefficients are in world directions."""

    own: Float[Array, "v k"]
    bounced: Float[Array, "v c"]  # k of every bounce
    formula: Float[Array, "v k"]
    log_own: Float[Array, "v b"]  # logarithms of mean square errors, by band
    log_formula: Float[Array, "v b"]
    log_bounced: Float[Array, "v d"]  # b of every bounce
    gate: Float[Array, "v 1"]  # 0 where nothing stands above the tangent plane, towards 1 where much does


def split_said(output: Float[Array, "v m"], bands: int, bounces: int) -> Said:
    """What stands side by side in `SurfelNet.everything`, which knows so much."""
    k = bands**2
    ends = np.cumsum([k, bounces * k, k, bands, bands, bounces * bands]).tolist()
    return Said(*jnp.split(output, ends, axis=1))


class SurfelNet(nn.Module):
    """Coefficients from vertices and their surfels: see the module docstring.

    `channels` of the pairs; the near corners have 3/4 of them, the MLPs of residual layers four times as many. It knows
    `known_bands` and `known_bounces`, and says `bands` and `bounces`.
    """

    channels: int = 16
    layers: int = 2
    known_bands: int = 3
    known_bounces: int = 0
    bands: int = 3
    bounces: int = 0

    def setup(self) -> None:
        """The layers by their names in the model file."""
        width, base = 4 * self.channels, min(BASE, self.known_bands)
        self.surfel, self.near = _Pairs(self.channels), _Pairs(3 * self.channels // 4)
        zeros = nn.initializers.zeros_init()
        self.mix, self.hidden = nn.Dense(width), [nn.Dense(width) for _ in range(self.layers)]
        self.head = nn.Dense(base**2, kernel_init=zeros)
        self.error_hidden, self.error_head = nn.Dense(self.channels), nn.Dense(2 * base)
        higher = self.known_bands - base
        if higher or self.known_bounces:
            self.further_mix, self.further_hidden = nn.Dense(width), nn.Dense(width)
            count = self.known_bands**2 - base**2 + self.known_bounces * self.known_bands**2
            self.further_head = nn.Dense(count, kernel_init=zeros)
            self.further_error_hidden = nn.Dense(self.channels)
            self.further_error_head = nn.Dense(2 * higher + self.known_bounces * self.known_bands)

    def everything(self, parts: Parts, deterministic: bool = True) -> Float[Array, "v m"]:
        """All of `Said` side by side, of all bands and bounces that are known: what training looks at."""
        said = self._said(*self.encode_all(parts), _normals_of(parts), self.known_bands, self.known_bounces)
        return jnp.concatenate(said, axis=1)

    def __call__(self, parts: Parts, deterministic: bool = True) -> Float[Array, "v m"]:
        """Coefficients after the fallback, then of each bounce; the expected errors per band of these, in this order.

        In world directions, of the vertices of all parts in turn; nothing is random, so `deterministic` changes
        nothing.
        """
        if self.is_initializing():  # parameters of what is not asked for, too
            self.everything(parts)
        return self.decode(*self.encode_all(parts), _normals_of(parts))

    def encode_all(self, parts: Parts) -> tuple[Float[Array, "v c"], Float[Array, "v 3 3"], Float[Array, "v"]]:
        """What `encode` finds in all parts."""
        filled = [part for part in parts if len(part["normal"])] or parts[:1]
        return jax.tree.map(lambda *arrays: jnp.concatenate(arrays), *(self.encode(part) for part in filled))

    def decode(
        self, pooled: Float[Array, "v c"], frames: Float[Array, "v 3 3"], seen: Float[Array, "v"], normals: Array
    ) -> Float[Array, "v m"]:
        """What the network says, from what `encode` found."""
        return fall_back(self._said(pooled, frames, seen, normals, self.bands, self.bounces), normals, self.bands)

    def _said(self, pooled: Array, frames: Array, seen: Array, normals: Array, bands: int, bounces: int) -> Said:
        gate = (seen / (seen + GATE))[:, None]
        k, base = bands**2, min(BASE, self.known_bands)
        x = nn.relu(self.mix(pooled))
        for hidden in self.hidden:
            x = x + nn.relu(hidden(x))
        local, logs = self.head(x), _log_errors(self.error_head(nn.tanh(self.error_hidden(x))))
        log_own, log_formula = logs[:, :base], logs[:, base:]
        log_bounced, bounced = logs[:, :0], []
        if bands > base or bounces:
            y = nn.relu(self.further_mix(pooled))
            y = y + nn.relu(self.further_hidden(y))
            further, logs = self.further_head(y), self.further_error_head(nn.tanh(self.further_error_hidden(y)))
            logs, known, higher = _log_errors(logs), self.known_bands**2, self.known_bands - base
            local = jnp.concatenate([local, further[:, : known - base**2]], axis=1)
            each = [further[:, known * (i + 1) - base**2 :][:, :k] for i in range(bounces)]
            bounced = [rotate_coefficients(gate * term, frames) for term in each]
            log_own = jnp.concatenate([log_own, logs[:, :higher]], axis=1)
            log_formula = jnp.concatenate([log_formula, logs[:, higher : 2 * higher]], axis=1)
            starts = [2 * higher + i * self.known_bands for i in range(bounces)]
            log_bounced = jnp.concatenate([log_bounced, *(logs[:, start : start + bands] for start in starts)], axis=1)
        formula = unshadowed_transfer(normals, bands)
        own = formula + zero_without_normal(rotate_coefficients(gate * local[:, :k], frames), normals)
        rest = [zero_without_normal(term, normals) for term in bounced]
        together = jnp.concatenate([own[:, :0], *rest], axis=1)
        return Said(own, together, formula, log_own[:, :bands], log_formula[:, :bands], log_bounced, gate)

    def encode(self, part: Part) -> tuple[Float[Array, "v c"], Float[Array, "v 3 3"], Float[Array, "v"]]:
        """What is pooled for every vertex, its frame, and how much stands above its tangent plane."""
        seen = look(part)
        h, g = self.surfel(seen.features), self.near(seen.near)
        pooled = [weighted_total(weight, h) for weight in (seen.above, seen.partly)]
        pooled += [jnp.sum(g, axis=1) / g.shape[1], jnp.max(g, axis=1)]
        total = total_of(seen.above)
        pooled += [jnp.stack([total, most_of(seen.above), fourth_root(seen.edge), *seen.cover])]
        return jnp.concatenate(pooled).T, seen.frames, total + seen.rise + seen.cover[2]


def _normals_of(parts: Parts) -> Float[Array, "v 3"]:
    return jnp.concatenate([jnp.asarray(part["normal"]) for part in parts])


def _log_errors(x: Array) -> Array:
    low, high = LOG_RANGE
    return low + (high - low) * nn.sigmoid(x)


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
        return nn.relu((product + bias[:, None]).reshape(self.channels, *shape))


def by_band(values: Float[Array, "v b"], bands: int) -> Float[Array, "v k"]:
    """One value a band, repeated for each of its coefficients."""
    return jnp.repeat(values, 2 * np.arange(bands) + 1, axis=-1, total_repeat_length=bands**2)


def fall_back(said: Said, normals: Float[Array, "v 3"], bands: int) -> Float[Array, "v n"]:
    """Coefficients, drawn to the closed form where that is better, and of bounces; the errors of both, by band."""
    trust = jnp.exp(jnp.minimum(said.log_formula - said.log_own, 0.0))
    coefficients = said.formula + by_band(trust, bands) * (said.own - said.formula)
    error = jnp.sqrt(trust**2 * jnp.exp(said.log_own) + (1 - trust) ** 2 * jnp.exp(said.log_formula))
    errors = said.gate * jnp.concatenate([error, jnp.exp(said.log_bounced / 2)], axis=1)
    return jnp.concatenate([coefficients, said.bounced, zero_without_normal(errors, normals)], axis=1)


def build_surfel_net(config: SurfelConfig) -> SurfelNet:
    """The network of a config."""
    return SurfelNet(config.channels, config.layers, config.learnt_bands, config.known_bounces, bands=config.bands)
