"""Transfer in a texture: a baked texture, and its file.

The texture has B² coefficients, or B² for each of three colours, at every texel: the transfer that a `Transfer` holds
at vertices. A renderer looks them up by the texture coordinates of the point that it shades, bilinearly
(`geometry.bilinear`), and takes the dot product with the light as ever; or shades all texels first
(`light.shading.shade_texture`) and looks up radiance, which is the same, as both are linear.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8

from gash_jax.algebra.sh import bands_of
from gash_jax.files.atomic import FileError
from gash_jax.files.npz import check_arrays, read_npz, write_npz
from gash_jax.geometry.mesh import Mesh

FORMAT, FORMAT_VERSION = "gash-transfer-texture", 1
MOST_TEXELS = 4096  # along a side
FILLED, RIM, ON_FACE = 0, 1, 2  # what `coverage` says of a texel


class TransferTexture(NamedTuple):
    """Transfer at the n x n texels of a texture, row 0 at the top (v = 0), and the mesh that it belongs to.

    `coverage` is 2 where the centre of a texel lies on a face, 1 where the texel was baked at the nearest point of a
    face because bilinear lookups at the rim of a chart reach it, 0 where it repeats the nearest baked texel.
    `standard_error` is that of the bake, before seams were made equal.

    >>> square = ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> uv = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]])
    >>> texture = gash_jax.bake_texture(square, rays=16, size=8, uv=uv)
    >>> texture.bands, texture.texture.shape, texture.mesh.faces.shape
    (3, (8, 8, 9), (2, 3))
    """

    texture: Float[np.ndarray, "n n k"] | Float[np.ndarray, "n n k 3"]  # float16
    standard_error: Float[np.ndarray, "n n k"] | Float[np.ndarray, "n n k 3"] | None  # float16
    coverage: UInt8[np.ndarray, "n n"]
    uv: Float[np.ndarray, "f 3 2"]  # of each corner of each face, float32, u to the right, v downwards, 0 to 1
    vertices: Float[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    metadata: Mapping[str, Any]

    @property
    def mesh(self) -> Mesh:
        """The mesh that was baked."""
        return Mesh(self.vertices, self.normals, self.faces)

    @property
    def bands(self) -> int:
        """Bands B of the B² coefficients."""
        return bands_of(self.texture.shape[2])


def save_texture(path: str | Path, texture: TransferTexture) -> None:
    """Write a texture file, read by plain NumPy without pickle. Raises FileError where the arrays do not fit.

    >>> square = ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> uv = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]])
    >>> gash_jax.save_texture("square.npz", gash_jax.bake_texture(square, rays=16, size=8, uv=uv))
    >>> sorted(np.load("square.npz").files)
    ['coverage', 'faces', 'metadata', 'normals', 'standard_error', 'texture', 'uv', 'vertices']
    """
    if not isinstance(texture, TransferTexture):
        raise FileError(f"a {type(texture).__name__} is no TransferTexture: give what bake_texture returns")
    arrays = {name: np.asarray(value) for name, value in texture._asdict().items() if name != "metadata"}
    arrays = {name: value for name, value in arrays.items() if value.dtype != object}  # None: no standard error
    _check(path, arrays)
    write_npz(path, arrays, {**texture.metadata, "format": FORMAT, "version": FORMAT_VERSION})


def load_texture(path: str | Path) -> TransferTexture:
    """Read a texture file and check it whole. Raises FileError, one line.

    >>> square = ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> uv = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]])
    >>> gash_jax.save_texture("square.npz", gash_jax.bake_texture(square, rays=16, size=8, uv=uv))
    >>> gash_jax.load_texture("square.npz").texture.shape
    (8, 8, 9)
    """
    arrays, metadata = read_npz(path, "texture", ("texture", "coverage", "uv", "vertices", "normals", "faces"))
    if metadata.get("format") != FORMAT:
        raise FileError(f"{path} is not a texture file: bake one with --texture")
    _check(path, arrays)
    arrays["faces"] = arrays["faces"].astype(np.int32, copy=False)
    found = {name: arrays.get(name) for name in TransferTexture._fields if name != "metadata"}
    return TransferTexture(**found, metadata=metadata)  # type: ignore[arg-type]


def _check(path: str | Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Raise FileError, one line that names the first array that does not fit."""
    size = len(arrays["coverage"]) if arrays["coverage"].ndim else 0
    texels = (size, size, "k", 3) if arrays["texture"].ndim == 4 else (size, size, "k")
    shapes = {"texture": texels, "standard_error": texels, "coverage": (size, size), "uv": ("f", 3, 2)}
    shapes |= {"vertices": ("v", 3), "normals": ("v", 3), "faces": ("f", 3)}
    sizes = check_arrays(path, "texture", arrays, shapes, ("standard_error",), ("faces", "coverage"))
    try:
        bands_of(sizes["k"])
    except ValueError as error:
        raise FileError(f"{path} is not a texture file: {error}; bake it again") from None
    faces, uv, coverage = arrays["faces"], arrays["uv"], arrays["coverage"]
    if not size or not len(faces) or np.any((faces < 0) | (faces >= sizes["v"])):
        raise FileError(f"{path} is not a whole texture file: no texels, or faces of no vertices; bake it again")
    if np.any((uv < 0) | (uv > 1)) or np.any(coverage > ON_FACE):
        raise FileError(f"{path} is not a texture file: uv beyond 0 to 1, or coverage beyond 2; bake it again")
