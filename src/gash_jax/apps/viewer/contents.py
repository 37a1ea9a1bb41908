"""What a page holds: small npz files, one for each result and each light, as the page's own script reads them.

A *result* is what a transfer file holds, less what the page does not draw; the first one brings the mesh. Coefficients
stay in float32 (frames of an animation and textures in float16), error bars and glossy transfer are in float16. A
*light* is
`coefficients` (k, 3), and of a latlong map also `map` (h, w, 3) in float16, at most `WIDEST` pixels wide, to be seen
behind the mesh.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from gash_jax.algebra.sh import MAX_BANDS
from gash_jax.formats.maps import read_map
from gash_jax.formats.picture import Progress
from gash_jax.light.environment import LightLike, light_coefficients, load_light, project_map
from gash_jax.light.layouts import layout_of
from gash_jax.light.studio import studio_light
from gash_jax.measure.reference import REFERENCE_RAYS
from gash_jax.prt.texture import TransferTexture
from gash_jax.prt.transfer import ERRORS, GLOSSY, Transfer

WIDEST = 512  # pixels of a map that is seen
_BRIGHTEST = 65504.0  # of float16


@dataclass(frozen=True)
class PageFile:
    """A file of the page: "transfer" or "light", the name that the page shows, and its arrays."""

    kind: str
    name: str
    arrays: dict[str, np.ndarray]
    metadata: dict[str, Any] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Bytes of the arrays."""
        return sum(array.nbytes for array in self.arrays.values())


def still_file(transfer: Transfer, name: str, *, mesh: bool) -> PageFile:
    """The page's file of a transfer, with its mesh or without."""
    arrays = {"coefficients": np.asarray(transfer.coefficients, np.float32)}
    for key in (*ERRORS, *GLOSSY):
        if getattr(transfer, key) is not None:
            arrays[key] = as_half(np.asarray(getattr(transfer, key)))
    return _with_mesh(PageFile("transfer", name, arrays), transfer) if mesh else PageFile("transfer", name, arrays)


def texture_file(texture: TransferTexture, name: str, *, mesh: bool) -> PageFile:
    """The page's file of a transfer texture, with its mesh or without."""
    arrays = {"texture": as_half(texture.texture)}
    if texture.standard_error is not None:
        arrays["standard_error"] = as_half(texture.standard_error)
    if not mesh:
        return PageFile("transfer", name, arrays)
    size = len(texture.coverage)
    file = PageFile("transfer", name, {**arrays, "uv": texture.uv.astype(np.float32)})
    return _with_mesh(file, texture, f", {size} x {size} texels")


def _with_mesh(file: PageFile, shown: Transfer | TransferTexture, more: str = "") -> PageFile:
    places = {key: np.asarray(getattr(shown, key), np.float32) for key in ("vertices", "normals")}
    arrays = {**file.arrays, **places, "faces": np.asarray(shown.faces, np.int32)}
    counted = f"{len(shown.vertices)} vertices, {len(shown.faces)} faces{more}"
    return PageFile(file.kind, file.name, arrays, {"notes": [counted]})


def result_name(metadata: Mapping[str, Any]) -> str:
    """What a transfer is, in the words of the page, from its metadata."""
    method, parameters = metadata.get("method"), metadata.get("parameters") or {}
    if method == "predict":
        return f"prediction, network {parameters.get('model', {}).get('name', '')}".strip()
    if method not in ("bake", "bake texture"):
        return str(method or "transfer")
    rays, bounces = parameters.get("rays"), parameters.get("bounces")
    each = "texel" if "texture" in metadata else "vertex"
    name = "bake" if not rays else f"{'reference' if rays >= REFERENCE_RAYS else 'bake'}, {rays} rays a {each}"
    return f"{name}, {bounces} bounce{'s' * (bounces > 1)}" if bounces else name


def distinct(names: Sequence[str], files: Sequence[str]) -> list[str]:
    """Names by which results can be told apart: with the name of the file where two would be the same."""
    return [
        f"{name} ({file})" if list(names).count(name) > 1 else name for name, file in zip(names, files, strict=True)
    ]


def map_file(path: Path, bands: int, layout: str | None = None, progress: Progress | None = None) -> PageFile:
    """The page's file of an environment map or a light by name in 10 bands, of a light file in as many as are needed.

    Raises LightError and FileError, one line, as `load_light` does.
    """
    if path.suffix.lower() == ".npz":
        return light_file(load_light(path, bands, layout), path.name)
    if not path.exists():  # a light by name, or the error that says what there is
        return light_file(load_light(path, MAX_BANDS, layout), str(path))
    picture = read_map(path, progress)
    found, note = layout_of(picture.radiance, layout or picture.layout)
    coefficients = project_map(picture.radiance, MAX_BANDS, found)
    seen = picture.radiance if found == "latlong" else None
    return light_file(coefficients, path.name, seen, [*picture.notes, *note])


def light_file(
    light: LightLike, name: str, seen: Float[np.ndarray, "h w 3"] | None = None, notes: Sequence[str] = ()
) -> PageFile:
    """The page's file of a light, with the latlong map that it comes from where there is one."""
    arrays = {"coefficients": np.asarray(light_coefficients(light), np.float32)}
    if seen is not None:
        arrays["map"] = as_half(shrunk(seen))
    return PageFile("light", name, arrays, {"notes": [f"{name}: {note}" for note in notes]})


def own_lights() -> list[PageFile]:
    """The lights of a page that was given none: a generated studio, and the same radiance from everywhere."""
    studio = studio_light(256)
    everywhere = np.zeros((MAX_BANDS**2, 3), np.float32)
    everywhere[0] = 2 * np.sqrt(np.pi)  # radiance 1
    return [
        light_file(project_map(studio, MAX_BANDS), "a generated studio", studio),
        light_file(everywhere, "the same from everywhere"),
    ]


def shrunk(image: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "_ _ 3"]:
    """The map at most `WIDEST` pixels wide, each the mean of those that it stands for."""
    height, width = image.shape[:2]
    sides = min(height, -(-height * WIDEST // width)), min(width, WIDEST)
    rows, columns = (np.arange(side) * full // side for side, full in zip(sides, (height, width), strict=True))
    counts = np.outer(np.diff(rows, append=height), np.diff(columns, append=width))
    sums = np.add.reduceat(np.add.reduceat(image.astype(np.float64), rows, axis=0), columns, axis=1)
    return (sums / counts[..., None]).astype(np.float32)


def as_half(array: Shaped[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """The array in float16, what is beyond it cut to its largest number."""
    return np.clip(array, -_BRIGHTEST, _BRIGHTEST).astype(np.float16)
