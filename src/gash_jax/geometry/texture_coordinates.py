"""Texture coordinates that a texture can be baked for: one place of the unit square for each corner of each face.

(u, v) counts u to the right and v downwards, (0, 0) is the upper left corner of the image. All of it may lie in another
square between whole numbers, as one tile of a UDIM set does, and is moved. What spreads over several is refused: tiles
of a UDIM set want textures of their own, and coordinates that repeat a texture put several faces on one texel.
"""

import numpy as np
from jaxtyping import Float, Shaped

from gash_jax.geometry.mesh import MeshError
from gash_jax.geometry.stretch import signed_areas

ATLAS = "have an atlas made, uv='atlas' or --uv atlas"
FLAT = 1e-12  # area of a face in the texture, of the whole, from which on it has none
_SLACK = 1e-4  # of the side of the texture, by which exporters overstep it


def checked_coordinates(uv: Shaped[np.ndarray, "..."], face_count: int) -> Float[np.ndarray, "f 3 2"]:
    """Texture coordinates of all corners as float32 from 0 to 1. Raises MeshError, one line."""
    if uv.shape != (face_count, 3, 2) or uv.dtype.kind not in "fiu":
        raise MeshError(
            f"texture coordinates have shape {uv.shape} {uv.dtype}, not ({face_count}, 3, 2): "
            "give (u, v) for each corner of each face"
        )
    places = uv.astype(np.float64)
    bad = ~np.isfinite(places).all(axis=(1, 2))
    if bad.any():
        raise MeshError(
            f"{bad.sum()} of {face_count} faces have no texture coordinates (first: face {np.argmax(bad)}): "
            f"unwrap them in the program that made the mesh, or {ATLAS}"
        )
    low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    tile = np.floor(low + _SLACK)
    if np.any(high > tile + 1 + _SLACK):
        spread = " and ".join(f"{axis} from {a:.4g} to {b:.4g}" for axis, a, b in zip("uv", low, high, strict=True))
        raise MeshError(
            f"texture coordinates run over several tiles, {spread} (UDIM, or a texture that repeats): "
            f"bring them into one square, or {ATLAS}"
        )
    found = np.clip(places - tile, 0, 1).astype(np.float32)
    if np.all(np.abs(corner_areas(found)) <= FLAT):
        raise MeshError(f"no face has an area in texture coordinates: unwrap the mesh, or {ATLAS}")
    return found


def corner_areas(uv: Float[np.ndarray, "f 3 2"]) -> Float[np.ndarray, "f"]:
    """Area of each face in the texture, of which the whole is 1; below 0 where it is mirrored or turned over."""
    places = uv.reshape(-1, 2).astype(np.float64)
    return signed_areas(places, np.arange(len(places)).reshape(-1, 3))
