"""What is hard about lights: a sun of one pixel, no light at all, maps of a few pixels and of a hundred million."""

import numpy as np

from experiments.hard_cases.directions import SILENT, bright_pixel
from gash_jax.algebra.sh import hann_window
from gash_jax.light.environment import project_map
from gash_jax.light.shading import shade
from gash_jax.light.windows import WINDOWS, light_window
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import bumpy_sphere

UNIT = 2 * np.sqrt(np.pi)  # radiance 1 from everywhere


def sun_of_one_pixel(bands: int) -> tuple[float, str]:
    """Most negative radiance of shadowed vertices under the least window, as a part of the greatest."""
    transfer = bake_transfer(bumpy_sphere(12), bands, 256, replicates=1)
    radiance = np.asarray(shade(transfer, project_map(bright_pixel()[0], bands), window="radiance"))
    return max(0.0, -float(radiance.min()) / float(radiance.max())), SILENT


def black() -> tuple[float, str]:
    """Radiance without any light, under each window, and how far the least windows are from none."""
    transfer, light = bake_transfer(bumpy_sphere(6), rays=64), np.zeros((9, 3))
    windows = {kind: light_window(light, kind) for kind in WINDOWS}
    wrong = [np.abs(windows[kind] - (hann_window(3, 3) if kind == "hann" else 1)) for kind in WINDOWS[:1] + WINDOWS[2:]]
    radiance = [np.abs(np.asarray(shade(transfer, light, window=factors))) for factors in windows.values()]
    return float(max(np.max(found) for found in (*wrong, *radiance))), "gash light: the light is black"


def map_of(width: int) -> tuple[float, str]:
    """Coefficients of a map of radiance 1 against 2 sqrt(pi) and zeros."""
    found = np.asarray(project_map(np.broadcast_to(np.float32(1), (width // 2, width, 3)), 3), np.float64)
    found[0] -= UNIT
    return float(np.abs(found).max()), SILENT
