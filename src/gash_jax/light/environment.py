"""Environment light as spherical harmonics: projection of maps, light files, rotation.

L_k = integral over the sphere of L(w) Y_k(w) dw, linear RGB radiance, never windowed. A pixel (row i, column j) of an
H x W map looks along d = (sin t sin p, cos t, -sin t cos p), t = (i + 1/2) pi / H, p = ((j + 1/2) / W - 1/2) 2 pi:
row 0 is up, the image centre is -z. It covers the exact solid angle (cos t_i - cos t_(i+1)) 2 pi / W between its
edges and counts as light from its centre, so a single lit pixel gives Y_k(d) times its flux; a constant map of
radiance 1 gives L_00 = 2 sqrt(pi) and a rest that vanishes as 1 / H^2.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float, Shaped

from gash_jax.algebra.sh import sh_components, validate_bands
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.npz import read_npz, write_npz
from gash_jax.formats.hdr import FORMATS, LightError, read_hdr

FORMAT, FORMAT_VERSION = "gash-light", 1
CONVENTIONS = (
    "real orthonormal SH, polar axis z, k = l*l + l + m, no Condon-Shortley sign; world +y up; "
    "linear RGB radiance, not windowed"
)
_BLOCK_PIXELS = 1 << 16  # of a map projected at once: memory stays below 60 MiB at any size and band count


class Light(NamedTuple):
    """SH radiance of an environment (NumPy) and where it comes from."""

    coefficients: Float[np.ndarray, "k 3"]
    metadata: dict[str, Any]

    @property
    def bands(self) -> int:
        """SH bands B; there are B² coefficients."""
        return round(len(self.coefficients) ** 0.5)


def pixel_directions(height: int, width: int, rows: slice = slice(None)) -> Float[np.ndarray, "h w 3"]:
    """Unit directions of the pixel centres of an equirectangular map, float64; of some rows if given."""
    t = ((np.arange(height) + 0.5) / height * np.pi)[rows, None]
    p = (((np.arange(width) + 0.5) / width - 0.5) * 2.0 * np.pi)[None]
    return np.stack(np.broadcast_arrays(np.sin(t) * np.sin(p), np.cos(t), -np.sin(t) * np.cos(p)), axis=-1)


def pixel_solid_angles(height: int, width: int) -> Float[np.ndarray, "h"]:
    """Exact solid angle of one pixel of each row, float64; all pixels together cover 4 pi."""
    edges = np.cos(np.arange(height + 1) / height * np.pi)
    return (edges[:-1] - edges[1:]) * 2.0 * np.pi / width


def project_light(image: Shaped[np.ndarray, "..."], bands: int) -> Float[np.ndarray, "k 3"]:
    """Radiance coefficients of an equirectangular map (h, w, 3), summed in float64, returned as float32.

    Raises LightError for another shape or values that are not finite, ValueError for bands outside 1 to 10.
    """
    validate_bands(bands)
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape or image.dtype.kind not in "fiu":
        raise LightError(f"an environment map has shape (height, width, 3), this image {image.shape} {image.dtype}")
    if not np.isfinite(image).all():
        raise LightError("the environment map holds values that are not finite: repair these pixels first")
    height, width = image.shape[:2]
    solid_angles = pixel_solid_angles(height, width)
    total = np.zeros((bands * bands, 3))
    step = max(1, _BLOCK_PIXELS // width)
    for start in range(0, height, step):
        rows = slice(start, start + step)
        flux = image[rows].astype(np.float64) * solid_angles[rows, None, None]
        x, y, z = np.moveaxis(pixel_directions(height, width, rows), -1, 0)
        for k, component in enumerate(sh_components(x, y, z, bands)):
            total[k] += np.einsum("hw,hwc->c", component, flux)
    if np.abs(total).max() > np.finfo(np.float32).max:
        raise LightError("the environment map is too bright for float32 coefficients: scale it down")
    return total.astype(np.float32)


def load_light(path: str | Path, bands: int = 3) -> Light:
    """Light with `bands` bands from an environment map (.hdr, .pic, .exr) or a light file (.npz).

    A light file with more bands is cut; with fewer it is refused, as the missing ones are not in it. Raises LightError
    for a map and FileError for an npz that cannot be used.
    """
    validate_bands(bands)
    path = Path(path)
    if path.suffix.lower() == ".npz":
        return _load_light_file(path, bands)
    suffix = path.suffix.lower()
    if suffix not in (".hdr", ".pic", ".exr") and path.is_file():
        raise LightError(f"{path} has no known light format: readable are {FORMATS}, convert it to .hdr")
    if suffix == ".exr":
        from gash_jax.formats.exr import read_exr  # a library of its own, which no other map needs

        image = read_exr(path)
    else:
        image = read_hdr(path)
    entries = {"source": path.name, "map": list(image.shape[:2])}
    return Light(project_light(image, bands), light_metadata(bands, **entries))


def save_light(path: str | Path, light: Light) -> None:
    """Write a light file; plain NumPy reads it without pickle."""
    write_npz(path, {"coefficients": np.asarray(light.coefficients, np.float32)}, light.metadata)


def light_metadata(bands: int, **entries: Any) -> dict[str, Any]:
    """The metadata every light file carries, plus where the light comes from."""
    return {"format": FORMAT, "version": FORMAT_VERSION, "bands": bands, "conventions": CONVENTIONS, **entries}


def rotate_light(
    coefficients: Float[Array | np.ndarray, "k 3"], rotation: Float[Array | np.ndarray, "3 3"]
) -> Float[Array, "k 3"]:
    """Coefficients of the environment turned by the rotation: what came from w comes from R w."""
    return rotate_coefficients(coefficients.T, rotation).T


def _load_light_file(path: Path, bands: int) -> Light:
    arrays, metadata = read_npz(path, "light", ("coefficients",))
    coefficients = arrays["coefficients"]
    found = round(len(coefficients) ** 0.5) if coefficients.ndim == 2 else 0
    if metadata.get("format") != FORMAT or coefficients.shape != (found * found, 3) or found == 0:
        raise LightError(f"{path} is not a light file: coefficients have shape {coefficients.shape}, not (bands^2, 3)")
    if coefficients.dtype.kind != "f" or not np.isfinite(coefficients).all():
        raise LightError(f"{path} holds coefficients that are not finite numbers: project the map again")
    if found < bands:
        raise LightError(f"{path} holds {found} bands, {bands} are needed: project its map again with --bands {bands}")
    kept = coefficients[: bands * bands].astype(np.float32)
    return Light(kept, {**metadata, "bands": bands})
