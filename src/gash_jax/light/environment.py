"""Environment light as spherical harmonics: projection of maps, light files, rotation.

L_k = integral over the sphere of L(w) Y_k(w) dw, linear RGB radiance, never windowed. A pixel of a map looks where its
layout says (`layouts`), covers its solid angle and counts as light from its centre, so a single lit pixel gives Y_k(d)
times its flux; a constant map of radiance 1 gives L_00 = 2 sqrt(pi) and a rest that vanishes as 1 / H^2.

Along a row of a latlong map a component of degree l is a trigonometric polynomial of degree l: its sum over all pixels
is one over 2 B - 1 azimuths, to which the row is brought by the Dirichlet kernel. That is exact, and makes the
projection of a large map as fast as reading it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, overload

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Shaped

from gash_jax.algebra.arguments import ArrayLike, WholeNumber, as_array
from gash_jax.algebra.rotations import rotation_matrix, with_rotation
from gash_jax.algebra.sh import bands_of, radiance_coefficients, sh_components, validate_bands
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.atomic import as_path
from gash_jax.files.containers import Container
from gash_jax.files.npz import read_npz, write_npz
from gash_jax.formats.maps import read_map
from gash_jax.formats.picture import LightError, Progress
from gash_jax.light.layouts import layout_of, pixel_rays, pixel_solid_angles

FORMAT, FORMAT_VERSION = "gash-light", 1
CONVENTIONS = (
    "real orthonormal SH, polar axis z, k = l*l + l + m, no Condon-Shortley sign; world +y up; "
    "linear RGB radiance, not windowed"
)
_BLOCK_PIXELS = 1 << 16  # of a map projected at once: memory stays below 60 MiB at any size and band count


@dataclass(frozen=True, eq=False)
class Light(Container):
    """Radiance of an environment as SH coefficients (k, 3), and where it comes from; a pytree (`files.containers`).

    >>> light = gash_jax.load_light("studio.hdr")
    >>> light.coefficients.shape, light.bands, light.metadata["layout"]
    ((9, 3), 3, 'latlong')
    """

    coefficients: Any  # Float "k 3", checked in words
    metadata: Mapping[str, Any] = field(default_factory=dict)
    bands: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", light_coefficients(self.coefficients))
        self._set(bands_of(len(self.coefficients)))


if TYPE_CHECKING:  # wherever a light goes in: the container, or its coefficients (k, 3) as an array of NumPy or JAX
    LightLike: TypeAlias = Light | ArrayLike | Array
else:  # what does not fit is refused in words
    LightLike = Any


def light_coefficients(light: LightLike) -> Float[Array | np.ndarray, "k 3"]:
    """Coefficients of a light, as the array they are. Raises ValueError unless they are (bands^2, 3) real numbers."""
    if isinstance(light, Light):
        return light.coefficients
    return radiance_coefficients(light)


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


def load_light(
    path: str | Path, bands: WholeNumber = 3, layout: str | None = None, progress: Progress | None = None
) -> Light:
    """Light with `bands` bands from an environment map (.hdr, .pic, .exr) or a light file (.npz).

    `layout` says how the map is laid out (`LAYOUTS`); without it a map twice as wide as high is latlong, another one is
    recognised where that is certain. `progress(done, total)` counts rows, read and projected. What reading decided is
    in `metadata["notes"]`. A light file with more bands is cut; with fewer it is refused, as the missing ones are not
    in it. Raises LightError for a map and FileError for an npz that cannot be used.

    >>> gash_jax.load_light("studio.hdr", bands=4).coefficients.shape
    (16, 3)
    """
    bands, path = validate_bands(bands), as_path(path)
    if path.suffix.lower() == ".npz":
        if layout is not None:
            raise LightError(f"{path} is a light file, which has no layout: leave the layout out")
        return _load_light_file(path, bands)
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


def light_metadata(bands: int, **entries: Any) -> dict[str, Any]:
    """The metadata every light file carries, plus where the light comes from."""
    return {"format": FORMAT, "version": FORMAT_VERSION, "bands": bands, "conventions": CONVENTIONS, **entries}


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
