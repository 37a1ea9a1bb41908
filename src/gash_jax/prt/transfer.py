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

from gash_jax.files.atomic import FileError
from gash_jax.files.npz import read_npz, write_npz
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
    """Read a transfer file and check that its arrays fit together."""
    arrays, metadata = read_npz(path, "transfer", ("coefficients", "vertices", "normals", "faces"))
    coefficients, vertices = arrays["coefficients"], arrays["vertices"]
    if coefficients.ndim != 2 or len(coefficients) != len(vertices) or metadata.get("format") != FORMAT:
        raise FileError(f"{path} is not a transfer file: coefficients {coefficients.shape}, vertices {vertices.shape}")
    if not np.isfinite(coefficients).all():
        raise FileError(f"{path} holds coefficients that are not finite: bake it again")
    sampled, predicted = arrays.get("standard_error"), arrays.get("predicted_error")
    return Transfer(coefficients, sampled, vertices, arrays["normals"], arrays["faces"], metadata, predicted)
