"""Coefficients as vertex attributes of a .glb file: their names, and what is stored.

A coefficient is stored * scale + offset, with a scale and an offset for each column in the `extras` of the mesh, under
"gash", which also names the convention (`light.engines`; "gash" is ours). Columns are the coefficients k = 0, 1, ...
(of coloured transfer first those of red, then green, then blue), and zeros up to a multiple of an attribute's width:

    sh  `_SH0` to `_SH3`, four columns each (glTF 2.0, 3.7.2.1: names of one's own start with an underscore); coloured
        `_SHR0`, `_SHG0`, `_SHB0` and on. Floats, or signed integers, normalised: -1 to 1 stands for -scale to scale.
    uv  `TEXCOORD_n`, two columns each, after the file's own sets: the one way into Unity. Floats, or unsigned integers.
"""

from math import isqrt
from typing import Any

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.sh import bands_of
from gash_jax.formats.gltf_writing import Attribute

MOST_BANDS = 4  # 16 floats: what engines take as attributes of one's own
MOST_TEXTURE_SETS = 8  # of Unity
STORES = {"float": ("<f4", "<f4"), "short": ("<i2", "<u2"), "byte": ("<i1", "<u1")}  # as sh, as uv


def vertex_attributes(
    coefficients: Float[np.ndarray, "v k *c"], style: str, store: str, first_set: int
) -> tuple[list[Attribute], dict[str, Any], float]:
    """The attributes, their extras, and the largest error of a coefficient that storing made.

    `style` is "sh" or "uv", `store` a key of `STORES`, `first_set` the first free set of texture coordinates. Raises
    ValueError, one line, where they do not fit.
    """
    coloured = coefficients.ndim == 3
    count = coefficients.shape[1]
    bands = bands_of(count)
    if bands > MOST_BANDS:
        raise ValueError(
            f"{bands} bands, and a .glb holds {MOST_BANDS}: keep the first {MOST_BANDS} (--bands {MOST_BANDS})"
        )
    channels = np.moveaxis(coefficients, 2, 0) if coloured else coefficients[None]
    width = 4 if style == "sh" else 2
    each = -(-count // width)
    if style == "uv" and first_set + each * len(channels) > MOST_TEXTURE_SETS:
        fitting = isqrt(width * ((MOST_TEXTURE_SETS - first_set) // len(channels)))
        fewer = f"keep fewer bands (--bands {fitting}), or " * (fitting > 0)
        raise ValueError(
            f"{count * len(channels)} numbers need {each * len(channels)} sets of texture coordinates after the first "
            f"{first_set}, and there are {MOST_TEXTURE_SETS}: {fewer}use --attributes sh"
        )
    padded = np.zeros((len(channels), coefficients.shape[0], each * width))
    padded[:, :, :count] = channels
    values, scale, offset = stored(np.concatenate(list(padded), axis=1), store, signed=style == "sh")
    names = _names("RGB" if coloured else "", each, style, first_set)
    found = [Attribute(name, values[:, width * i : width * (i + 1)]) for i, name in enumerate(names)]
    error = float(np.abs(read_back(values, scale, offset) - np.concatenate(list(padded), axis=1)).max(initial=0.0))
    extras = {
        **{"attributes": names, "coefficients": count, "bands": bands, "channels": len(channels), "stored": store},
        **{"scale": scale.tolist(), "offset": offset.tolist()},
    }
    return found, extras, error


def _names(colours: str, each: int, style: str, first_set: int) -> list[str]:
    if style == "uv":
        return [f"TEXCOORD_{first_set + i}" for i in range(each * max(1, len(colours)))]
    return [f"_SH{colour}{i}" for colour in colours or ("",) for i in range(each)]


def stored(
    columns: Float[np.ndarray, "v n"], store: str, signed: bool
) -> tuple[np.ndarray, Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Columns in the type that is stored, with the scale and the offset of each."""
    kind = np.dtype(STORES[store][0 if signed else 1])
    if kind.kind == "f":
        return columns.astype(kind), np.ones(columns.shape[1]), np.zeros(columns.shape[1])
    most = np.iinfo(kind).max
    low = np.zeros(columns.shape[1]) if signed else columns.min(axis=0)
    scale = np.abs(columns).max(axis=0) if signed else np.ptp(columns, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    return np.rint((columns - low) / scale * most).astype(kind), scale, low


def read_back(
    values: np.ndarray, scale: Float[np.ndarray, " n"], offset: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "v n"]:
    """The columns that a reader finds."""
    if values.dtype.kind != "f":
        values = np.maximum(values / np.iinfo(values.dtype).max, -1.0)
    return values * scale + offset
