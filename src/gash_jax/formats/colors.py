"""Colours of vertices: linear RGB from sRGB (IEC 61966-2-1)."""

import numpy as np
from jaxtyping import Float


def linear_rgb(srgb: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Linear RGB of sRGB colours, both from 0 to 1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, (np.maximum(srgb, 0.0) / 1.055 + 0.055 / 1.055) ** 2.4)
