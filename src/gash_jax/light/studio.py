"""A generated studio: soft sky, a warm key light, a cool rim light, a dim floor.

The key comes from the upper left in front (viewer at +z), the rim from the right behind, both discs with soft edges.
Radiances are chosen so that a white surface facing the key leaves about 1, one in its shadow about a quarter of it.
"""

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.light.layouts import pixel_directions

SKY_HORIZON, SKY_ZENITH, FLOOR = (0.26, 0.28, 0.31), (0.16, 0.2, 0.28), (0.05, 0.045, 0.04)
# direction, half-angle in degrees, radiance
KEY = ((-0.55, 0.7, 0.55), 20.0, (7.4, 6.3, 4.9))
RIM = ((0.75, 0.3, -0.6), 16.0, (3.0, 4.0, 5.6))


def studio_light(height: WholeNumber = 128) -> Float[np.ndarray, "h w 3"]:
    """Equirectangular map (height, 2 height, 3), linear radiance, float32; `height` from 4 to 8192, or ValueError.

    >>> gash_jax.project_light(gash_jax.studio_light(64)).coefficients.shape
    (9, 3)
    """
    height = whole_number(height, "height", 4, 8192)
    directions = pixel_directions(height, 2 * height)
    up = directions[..., 1:2]
    sky = np.array(SKY_HORIZON) + np.clip(up, 0.0, 1.0) * np.subtract(SKY_ZENITH, SKY_HORIZON)
    image = np.array(FLOOR) + _ramp(up, -0.08, 0.08) * (sky - np.array(FLOOR))
    for toward, half_angle, radiance in (KEY, RIM):
        cosine = directions @ (np.array(toward) / np.linalg.norm(toward))
        edge = np.cos(np.radians([1.3 * half_angle, 0.7 * half_angle]))
        image = image + _ramp(cosine[..., None], edge[0], edge[1]) * np.array(radiance)
    return image.astype(np.float32)


def _ramp(values: Float[np.ndarray, "*shape"], low: float, high: float) -> Float[np.ndarray, "*shape"]:
    """0 below low, 1 above high, smooth between."""
    t = np.clip((values - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
