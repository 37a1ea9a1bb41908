"""Environment maps as spherical harmonics.

L_k = integral over the sphere of L(w) Y_k(w) dw, linear RGB radiance, never windowed. A pixel of a map looks where its
layout says (`layouts`), covers its solid angle and counts as light from its centre, so a single lit pixel gives Y_k(d)
times its flux; a constant map of radiance 1 gives L_00 = 2 sqrt(pi) and a rest that vanishes as 1 / H^2.

Along a row of a latlong map a component of degree l is a trigonometric polynomial of degree l: its sum over all pixels
is one over 2 B - 1 azimuths, to which the row is brought by the Dirichlet kernel. That is exact, and makes the
projection of a large map as fast as reading it.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Shaped

from gash_jax.algebra.arguments import WholeNumber
from gash_jax.algebra.sh import sh_components, validate_bands
from gash_jax.formats.picture import LightError, Progress
from gash_jax.light.layouts import layout_of, pixel_rays, pixel_solid_angles

_BLOCK_PIXELS = 1 << 16  # of a map projected at once: memory stays below 60 MiB at any size and band count


def project_map(
    image: Shaped[np.ndarray, "..."], bands: WholeNumber, layout: str | None = None, progress: Progress | None = None
) -> Float[np.ndarray, "k 3"]:
    """Radiance coefficients of an environment map as `project_light`, summed in float64, returned as float32.

    `progress(done, total)` counts rows.
    """
    bands = validate_bands(bands)
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape or image.dtype.kind not in "fiu":
        raise LightError(f"an environment map has shape (height, width, 3), this image {image.shape} {image.dtype}")
    if not np.isfinite(image).all():
        raise LightError("the environment map holds values that are not finite: repair these pixels first")
    layout, _ = layout_of(image, layout)
    total = np.zeros((bands * bands, 3))
    for directions, flux, done in _blocks(image, layout, bands):
        x, y, z = np.moveaxis(directions, -1, 0)
        for k, component in enumerate(sh_components(x, y, z, bands)):
            total[k] += np.einsum("hs,hsc->c", component, flux)
        if progress:
            progress(done, len(image))
    if np.abs(total).max() > np.finfo(np.float32).max:
        raise LightError("the environment map is too bright for float32 coefficients: scale it down")
    return total.astype(np.float32)


def _blocks(
    image: Shaped[np.ndarray, "_ _ 3"], layout: str, bands: int
) -> Iterator[tuple[np.ndarray, np.ndarray, int]]:
    """Directions and the flux from each, float64, of some rows of a map at a time; and how many rows are done.

    A row of a latlong map is brought to as many azimuths as its harmonics have.
    """
    height, width = image.shape[:2]
    azimuths = 2 * bands - 1
    few = layout == "latlong" and azimuths < width
    middles = [(np.arange(count) + 0.5) / count for count in (azimuths, width)]
    apart = 2.0 * np.pi * np.subtract.outer(*middles)[..., None] * np.arange(1, bands)
    kernel = (1.0 + 2.0 * np.cos(apart).sum(axis=-1)) / azimuths
    step = max(1, _BLOCK_PIXELS // width)
    for start in range(0, height, step):
        rows = slice(start, min(start + step, height))
        block = image[rows].astype(np.float64)
        directions, solid_angles = pixel_rays(layout, height, azimuths if few else width, rows)
        if few:
            solid_angles = pixel_solid_angles(height, width)[rows, None]
            block = kernel @ block
        yield directions, block * solid_angles[..., None], rows.stop
