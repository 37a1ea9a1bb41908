"""Environment light from outside: maps, light files and names of lights become a `Light`, which can be turned."""

from pathlib import Path
from typing import overload

import jax.numpy as jnp
import numpy as np
from jax import Array

from gash_jax.algebra.arguments import ArrayLike, WholeNumber, as_array
from gash_jax.algebra.rotations import rotation_matrix, with_rotation
from gash_jax.algebra.sh import validate_bands
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.atomic import as_path
from gash_jax.files.npz import read_npz, write_npz
from gash_jax.formats.maps import SUFFIXES, read_map
from gash_jax.formats.picture import LightError, Progress
from gash_jax.light.container import FORMAT, Light, LightLike, light_coefficients, light_metadata
from gash_jax.light.layouts import layout_of
from gash_jax.light.named import NAMES, named_light
from gash_jax.light.projection import project_map


def project_light(image: ArrayLike | Array, bands: WholeNumber = 3, layout: str | None = None) -> Light:
    """The light of an environment map (h, w, 3) of linear RGB radiance.

    `layout` is one of "latlong", "angular", "cross", "equal-area"; without it a map twice as wide as high is latlong,
    and another one is recognised or refused. Raises LightError for another shape or values that are not finite,
    ValueError for bands outside 1 to 10.

    >>> light = gash_jax.project_light(np.ones((32, 64, 3)), bands=2)
    >>> light.coefficients.shape, round(float(light.coefficients[0, 0]), 3)
    ((4, 3), 3.545)
    """
    image, bands = np.asarray(as_array(image)), validate_bands(bands)
    coefficients = project_map(image, bands, layout)
    layout, note = layout_of(image, layout)
    entries = {"map": list(image.shape[:2]), "layout": layout, "notes": list(note)}
    return Light(coefficients, light_metadata(bands, **entries))


def load_light(
    path: str | Path, bands: WholeNumber = 3, layout: str | None = None, progress: Progress | None = None
) -> Light:
    """Light with `bands` bands from an environment map (.hdr, .pic, .exr), a light file (.npz), or a name.

    Names are "constant", "directional", "sphere", "sun-sky" and "studio", with the arguments of the functions that make
    them, as in "sun-sky:elevation=30,turbidity=2.5" or "directional:direction=0,1,1" (`light.named`); a file of that
    name comes first.

    `layout` says how the map is laid out (`LAYOUTS`); without it a map twice as wide as high is latlong, another one is
    recognised where that is certain. `progress(done, total)` counts rows, read and projected. What reading decided is
    in `metadata["notes"]`. A light file with more bands is cut; with fewer it is refused, as the missing ones are not
    in it. Raises LightError for a map, a name or its options, and FileError for an npz that cannot be used.

    >>> gash_jax.load_light("studio.hdr", bands=4).coefficients.shape
    (16, 3)
    >>> gash_jax.load_light("sun-sky:elevation=30").metadata["source"]
    'sun-sky:elevation=30'
    """
    bands, path = validate_bands(bands), as_path(path)
    if path.suffix.lower() == ".npz":
        if layout is not None:
            raise LightError(f"{path} is a light file, which has no layout: leave the layout out")
        return _load_light_file(path, bands)
    if not path.is_file() and (light := named_light(str(path), bands)):
        if layout is not None:
            raise LightError(f"{path} is no map and has no layout: leave the layout out")
        return light
    if not path.exists() and path.suffix.lower() not in SUFFIXES:
        raise LightError(f"no such file: {path}; lights by name are {', '.join(NAMES)}")
    # reading and projecting take about as long
    picture = read_map(path, progress and (lambda done, total: progress(done, 2 * total)))
    image = picture.radiance
    try:
        layout, note = layout_of(image, layout or picture.layout)
        later = progress and (lambda done, total: progress(total + done, 2 * total))
        coefficients = project_map(image, bands, layout, later)
    except LightError as error:
        raise LightError(f"{path}: {error}") from None
    notes = [*picture.notes, *note]
    entries = {"source": path.name, "map": list(image.shape[:2]), "layout": layout, "notes": notes}
    return Light(coefficients, light_metadata(bands, **entries))


def save_light(path: str | Path, light: LightLike) -> None:
    """Write a light file; plain NumPy reads it without pickle. Raises LightError unless its values are finite.

    >>> gash_jax.save_light("studio.npz", gash_jax.load_light("studio.hdr"))
    >>> gash_jax.load_light("studio.npz").bands
    3
    """
    light = light if isinstance(light, Light) else Light(light)
    coefficients = np.asarray(light.coefficients, np.float32)
    if not np.isfinite(coefficients).all():
        raise LightError(f"{path} was not written: the light holds values that are not finite, project the map again")
    metadata = {**light_metadata(light.bands), **light.metadata, "bands": light.bands}
    write_npz(path, {"coefficients": coefficients}, metadata)


@overload
def rotate_light(light: Light, rotation: ArrayLike | Array) -> Light: ...
@overload
def rotate_light(light: ArrayLike | Array, rotation: ArrayLike | Array) -> Array: ...
def rotate_light(light: LightLike, rotation: ArrayLike | Array) -> Light | Array:
    """The environment turned by a rotation R: what came from w comes from R w.

    `rotation` is a rotation matrix (3, 3), a unit quaternion (w, x, y, z), a rotor (32,) or a motor (32,), whose rotor
    part counts. A `Light` for a `Light`, with the matrix in `metadata["rotation"]`; an array for an array. Works under
    jit, vmap and grad. Raises ValueError for what is no proper rotation.

    >>> half_turn = np.diag([-1.0, 1.0, -1.0])
    >>> light = gash_jax.load_light("studio.hdr")
    >>> turned = gash_jax.rotate_light(light, half_turn)
    >>> bool(np.allclose(turned.coefficients[3], -light.coefficients[3], atol=1e-6))
    True
    """
    matrix = rotation_matrix(rotation)
    turned = rotate_coefficients(light_coefficients(light).T, jnp.asarray(matrix, jnp.float32)).T
    if not isinstance(light, Light):
        return turned
    return light._replace(coefficients=turned, metadata=with_rotation(light.metadata, matrix))


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
