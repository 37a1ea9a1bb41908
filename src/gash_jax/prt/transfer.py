"""What a bake or a prediction is, and its file (README: "The files").

t_k(v) = (1/pi) * integral over the sphere of V(v, w) max(n_v . w, 0) Y_k(w) dw. Without shadows V = 1 and the
integral is a formula, `algebra.closed_forms.unshadowed_transfer`.
"""

import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from jax import Array
from jaxtyping import Float, Int

from gash_jax.algebra.arguments import ArrayLike, WholeNumber, as_array, is_real
from gash_jax.algebra.sh import bands_of
from gash_jax.files.atomic import FileError
from gash_jax.files.containers import Container, array_names
from gash_jax.files.npz import check_arrays, read_npz, write_npz
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.compression import NAMES, compress_visibility, expand_visibility

if TYPE_CHECKING:
    import trimesh

FORMAT, FORMAT_VERSION = "gash-transfer", 1
CONVENTIONS = (
    "world right-handed, +y up; real orthonormal SH, polar axis z, k = l*l + l + m, no Condon-Shortley sign; "
    "transfer (1/pi) integral V cos Y, albedo not included; vertex order of the input file"
)
ERRORS, GLOSSY = ("standard_error", "predicted_error"), ("visibility", "matrices", "visibility_error")


@dataclass(frozen=True, eq=False)
class Transfer(Container):
    """Coefficients per vertex of the input file, and the mesh they belong to: NumPy or JAX arrays in a pytree
    (`files.containers`).

    Where surfaces are coloured there are coefficients for red, green and blue light, (v, k, 3). `standard_error` is
    that of sampled results; `predicted_error` is the RMS error that a network expects of itself. Glossy transfer is
    held as `visibility`, j = (2 bands - 1)² coefficients of V where n.w > 0, with its standard error
    `visibility_error`, or as `matrices`, in float32 or float16. Rows of a bake have no faces.

    >>> transfer = gash_jax.bake_transfer("bunny.ply", rays=64)
    >>> transfer.bands, transfer.metadata["method"], transfer.mesh.faces.shape
    (3, 'bake', (720, 3))
    >>> transfer.to_trimesh().vertex_attributes["coefficients"].shape
    (362, 9)
    """

    coefficients: Float[Any, "v k"] | Float[Any, "v k 3"]
    standard_error: Float[Any, "v k"] | Float[Any, "v k 3"] | None
    vertices: Float[Any, "v 3"]
    normals: Float[Any, "v 3"]
    faces: Int[Any, "f 3"]
    metadata: Mapping[str, Any]
    predicted_error: Float[Any, "v k"] | Float[Any, "v k 3"] | None = None
    visibility: Float[Any, "v j"] | None = None
    matrices: Float[Any, "v k k"] | None = None
    visibility_error: Float[Any, "v j"] | None = None
    bands: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", transfer_coefficients(self.coefficients))
        self._set(bands_of(self.coefficients.shape[1]))

    @property
    def mesh(self) -> Mesh:
        """The mesh that was baked."""
        return Mesh(self.vertices, self.normals, self.faces)

    def to_trimesh(self) -> "trimesh.Trimesh":
        """The mesh as a trimesh.Trimesh with the arrays "v ..." of the transfer as its vertex attributes, by name."""
        surface = self.mesh.to_trimesh()
        for name in ("coefficients", *ERRORS, *GLOSSY):
            if getattr(self, name) is not None:
                surface.vertex_attributes[name] = np.asarray(getattr(self, name))
        return surface


if TYPE_CHECKING:  # wherever coefficients go in: the container, or the plain array of NumPy or JAX
    TransferLike: TypeAlias = Transfer | ArrayLike | Array
else:  # what does not fit is refused below, in words
    TransferLike = Any


def transfer_coefficients(transfer: TransferLike) -> Float[Array | np.ndarray, "v k"] | Float[Any, "v k 3"]:
    """Coefficients of a transfer, as the array they are. Raises ValueError unless they are (v, bands^2) or with a last
    axis of 3 for red, green and blue, and real numbers."""
    if isinstance(transfer, Transfer):
        return transfer.coefficients
    found = as_array(transfer)
    if found.ndim not in (2, 3) or found.shape[2:] not in ((), (3,)) or not is_real(found):
        raise ValueError(
            f"transfer has shape {found.shape} {found.dtype}, not (vertices, bands^2[, 3]) of real numbers: "
            "give what a bake or a model returns"
        )
    bands_of(found.shape[1])
    return found.astype(np.float32) if found.dtype.kind in "iu" else found


@cache
def software_versions() -> dict[str, str]:
    """Versions that a reader needs to rebuild a result."""
    packages = ("gash-jax", "jax", "numpy", "embreex", "trimesh")
    return {"python": platform.python_version(), **{name: version(name) for name in packages}}


def make_metadata(bands: int, method: str, parameters: dict[str, Any], **entries: Any) -> dict[str, Any]:
    """The metadata every transfer file carries, plus what the method has to say."""
    return {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "bands": bands,
        "conventions": CONVENTIONS,
        "method": method,
        "parameters": parameters,
        **entries,
        "software": software_versions(),
    }


def save_transfer(path: str | Path, transfer: Transfer, components: WholeNumber | None = None) -> None:
    """Write a transfer file; plain NumPy reads it without pickle. Raises FileError where the arrays do not fit.

    Of metadata that a transformation has dropped, format and conventions are written all the same. `components` writes
    the visibility as so many numbers a vertex in place of (2 bands - 1)² (`prt.compression`), without
    `visibility_error` and with the error of that in the metadata; `load_transfer` expands it. Raises ValueError where
    there is none, or for a number that does not fit.

    >>> gash_jax.save_transfer("bunny.npz", gash_jax.bake_transfer("bunny.ply", rays=64))
    >>> sorted(np.load("bunny.npz").files)
    ['coefficients', 'faces', 'metadata', 'normals', 'standard_error', 'vertices']
    """
    if not isinstance(transfer, Transfer):
        raise FileError(f"a {type(transfer).__name__} is no Transfer: give a path, then what a bake or a model returns")
    arrays = {}
    for name in array_names(Transfer):
        value = getattr(transfer, name)
        if value is not None:
            half = name in GLOSSY and np.asarray(value).dtype == np.float16
            kind = np.int32 if name == "faces" else np.float16 if half else np.float32
            arrays[name] = np.asarray(value, kind, order="C")
    _check(path, arrays)
    metadata = {**make_metadata(transfer.bands, "unknown", {}), **transfer.metadata, "bands": transfer.bands}
    if components is not None:
        metadata["compression"] = _compress(arrays, components)
    write_npz(path, arrays, metadata)


def load_transfer(path: str | Path) -> Transfer:
    """Read a transfer file and check it whole: types, shapes that fit, finite values, faces of existing vertices.

    >>> gash_jax.save_transfer("bunny.npz", gash_jax.bake_transfer("bunny.ply", rays=64))
    >>> gash_jax.load_transfer("bunny.npz").coefficients.shape
    (362, 9)
    """
    arrays, metadata = read_npz(path, "transfer", ("coefficients", "vertices", "normals", "faces"))
    if metadata.get("format") != FORMAT:
        raise FileError(f"{path} is not a transfer file: bake or predict one")
    _check(path, arrays)
    if NAMES[0] in arrays:
        arrays["visibility"] = expand_visibility(arrays, arrays["normals"])
    arrays["faces"] = arrays["faces"].astype(np.int32, copy=False)
    return Transfer(**{name: arrays.get(name) for name in array_names(Transfer)}, metadata=metadata)  # type: ignore[arg-type]


def _compress(arrays: dict[str, np.ndarray], components: WholeNumber) -> dict[str, Any]:
    """Put components in the place of visibility; the error of that, for the metadata."""
    if "visibility" not in arrays:
        raise ValueError("only visibility is compressed, and the transfer has none: bake it with glossy=True")
    visibility = arrays.pop("visibility")
    arrays.pop("visibility_error", None)
    arrays |= compress_visibility(visibility, arrays["normals"], components)
    lost = expand_visibility(arrays, arrays["normals"]).astype(np.float64) - visibility
    size = np.linalg.norm(visibility.astype(np.float64))
    relative = float(np.linalg.norm(lost) / size) if size else None
    return {"components": len(arrays[NAMES[1]]), "relative_error": relative}


def _check(path: str | Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Raise FileError, one line that names the first array that does not fit."""
    rows = ("v", "k", 3) if arrays["coefficients"].ndim == 3 else ("v", "k")
    shapes = {"coefficients": rows, "vertices": ("v", 3), "normals": ("v", 3), "faces": ("f", 3)}
    shapes |= dict.fromkeys(ERRORS, rows)
    sizes = check_arrays(path, "transfer", arrays, shapes, optional=ERRORS, integers=("faces",))
    try:
        bands = bands_of(sizes["k"])
    except ValueError as error:
        raise FileError(f"{path} is not a transfer file: {error}; bake it again") from None
    glossy = dict.fromkeys(("visibility", "visibility_error"), (sizes["v"], (2 * bands - 1) ** 2))
    glossy |= {"matrices": (sizes["v"], sizes["k"], sizes["k"])}
    glossy |= {NAMES[0]: (sizes["v"], "n"), NAMES[1]: ("n", (2 * bands - 1) ** 2), NAMES[2]: ((2 * bands - 1) ** 2,)}
    whole = set(arrays).isdisjoint(NAMES)  # else all three or none
    check_arrays(path, "transfer", arrays, glossy, optional=(*GLOSSY, *NAMES) if whole else GLOSSY)
    faces = arrays["faces"]
    if np.any((faces < 0) | (faces >= sizes["v"])):
        raise FileError(f"{path} is not a whole transfer file: faces name vertices that do not exist; bake it again")
