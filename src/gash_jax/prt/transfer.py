"""What a bake or a prediction is, and the transfer file (DESIGN: "Transfer file").

t_k(v) = (1/pi) * integral over the sphere of V(v, w) max(n_v . w, 0) Y_k(w) dw. Without shadows V = 1 and the
integral is a formula, `algebra.closed_forms.unshadowed_transfer`.
"""

import platform
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.algebra.sh import MAX_BANDS
from gash_jax.files.atomic import FileError
from gash_jax.files.npz import check_arrays, read_npz, write_npz
from gash_jax.geometry.mesh import Mesh

FORMAT, FORMAT_VERSION = "gash-transfer", 1
CONVENTIONS = (
    "world right-handed, +y up; real orthonormal SH, polar axis z, k = l*l + l + m, no Condon-Shortley sign; "
    "transfer (1/pi) integral V cos Y, albedo not included; vertex order of the input file"
)


class Transfer(NamedTuple):
    """Coefficients per vertex of the input file, and the mesh they belong to (all NumPy).

    `standard_error` is that of sampled results; `predicted_error` is the RMS error that a network expects of itself.
    """

    coefficients: Float[np.ndarray, "v k"]
    standard_error: Float[np.ndarray, "v k"] | None
    vertices: Float[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    metadata: dict[str, Any]
    predicted_error: Float[np.ndarray, "v k"] | None = None

    @property
    def bands(self) -> int:
        """SH bands B; there are B² coefficients."""
        return round(self.coefficients.shape[1] ** 0.5)

    @property
    def mesh(self) -> Mesh:
        """The mesh that was baked."""
        return Mesh(self.vertices, self.normals, self.faces)


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


def save_transfer(path: str | Path, transfer: Transfer) -> None:
    """Write a transfer file; plain NumPy reads it without pickle."""
    arrays = {name: value for name, value in transfer._asdict().items() if name != "metadata" and value is not None}
    write_npz(path, arrays, transfer.metadata)


def load_transfer(path: str | Path) -> Transfer:
    """Read a transfer file and check it whole: types, shapes that fit, finite values, faces of existing vertices."""
    arrays, metadata = read_npz(path, "transfer", ("coefficients", "vertices", "normals", "faces"))
    if metadata.get("format") != FORMAT:
        raise FileError(f"{path} is not a transfer file: bake or predict one")
    rows, errors = ("v", "k"), ("standard_error", "predicted_error")
    shapes = {"coefficients": rows, "vertices": ("v", 3), "normals": ("v", 3), "faces": ("f", 3)}
    shapes |= dict.fromkeys(errors, rows)
    sizes = check_arrays(path, "transfer", arrays, shapes, optional=errors, integers=("faces",))
    if sizes["k"] not in {bands * bands for bands in range(1, MAX_BANDS + 1)}:
        raise FileError(
            f"{path} is not a transfer file: {sizes['k']} coefficients are no square of bands, bake it again"
        )
    faces = arrays["faces"]
    if np.any((faces < 0) | (faces >= sizes["v"])):
        raise FileError(f"{path} is not a whole transfer file: faces name vertices that do not exist; bake it again")
    estimates = (arrays["coefficients"], arrays.get("standard_error"))
    mesh = (arrays["vertices"], arrays["normals"], faces.astype(np.int32, copy=False))
    return Transfer(*estimates, *mesh, metadata, arrays.get("predicted_error"))
