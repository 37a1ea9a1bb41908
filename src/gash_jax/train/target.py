"""What models of one object say of a frame: its coefficients, or of a glossy surface the radiance that arrives under a
light, M L of `light.gloss`, made from the visibility of the baked frames one after the other.

Radiance is flat, (v, 3 k): of each coefficient red, green and blue. As the coefficients it is kept in float16. M takes
away what is hidden and adds nothing, so no radiance is longer than its light: that of the light is checked.
"""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gash_jax.files.settings import ConfigError
from gash_jax.light.environment import load_light
from gash_jax.light.gloss import seen_radiance
from gash_jax.train.truth import Truth

DIMMEST, BRIGHTEST = 1e-3, 1e4  # lengths of a light whose radiance float16 holds to its 11 bits, with room for noise

_radiance = jax.jit(seen_radiance)


def target_light(name: str, bands: int) -> Float[np.ndarray, "k 3"] | None:
    """The light of a config, float32; None where it names none.

    Raises ConfigError for one that is too dim or too bright for float16, LightError or FileError as `load_light`.
    """
    if not name:
        return None
    light = np.asarray(load_light(name, bands).coefficients, np.float32)
    length = float(np.linalg.norm(light, axis=0).max())
    if not DIMMEST <= length <= BRIGHTEST:
        raise ConfigError(
            f"data.light={name} has coefficients of length {length:.3g}, and float16 holds {DIMMEST:g} to "
            f"{BRIGHTEST:g}: scale them, and write them with gash_jax.save_light"
        )
    return light


def target_frames(truth: Truth, light: Float[np.ndarray, "k 3"] | None) -> Iterator[Float[np.ndarray, "v c"]]:
    """Frame by frame: coefficients in float16, or under a light radiance in float32, of a glossy bake."""
    for shard in truth.shards("coefficients" if light is None else "visibility"):
        for frame in shard:
            yield frame if light is None else flat_radiance(frame, light)


def target_shards(truth: Truth, light: Float[np.ndarray, "k 3"] | None) -> list[Float[np.ndarray, "t v c"]]:
    """The same in float16, as many frames together as are in a file; radiance stands in memory."""
    if light is None:
        return truth.shards()
    return [
        np.stack([flat_radiance(frame, light).astype(np.float16) for frame in shard])
        for shard in truth.shards("visibility")
    ]


def flat_radiance(visibility: Float[np.ndarray, "v j"], light: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "v c"]:
    """M L of what is baked of every vertex, flat; float32."""
    found = _radiance(jnp.asarray(visibility, jnp.float32), jnp.asarray(light))
    return np.asarray(found).reshape(len(visibility), -1)
