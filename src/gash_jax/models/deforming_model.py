"""A fitted model of one object that deforms, as one value: config and arrays in, a pose in, coefficients out, or of a
glossy surface the radiance that arrives at it under one light.

Files are npz as those of `model`: float32 arrays by name, large ones float16 or int8, and JSON metadata with the full
config. They also hold the rest and the faces, so that a pose can be checked and given its normals, and the light.
"""

import time
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gash_jax.algebra.arguments import ArrayLike, as_array, is_real
from gash_jax.files.atomic import FileError, as_path
from gash_jax.files.npz import check_arrays, names_in_npz, read_npz, write_npz
from gash_jax.files.settings import ConfigError, from_dict
from gash_jax.geometry.carried_normals import CarriedNormals, carried_normals, posed_mesh
from gash_jax.geometry.mesh import Mesh, MeshError, referenced
from gash_jax.models.deep_prt import NET
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.model import DEFORMING_FORMAT
from gash_jax.models.pose_normals import normals_of_pose
from gash_jax.models.pose_reader import POSE_SHAPES, poses_outside, reader_of
from gash_jax.nn.config import ModelConfig
from gash_jax.prt.transfer import Transfer, make_metadata

FORMAT, FORMAT_VERSION = DEFORMING_FORMAT, 1
# how large arrays are written, by the first part of their name; all others are float32
STORED = {"mean": np.float16, "basis": np.float16, "known": np.float16, "into": np.float16, "directions": np.int8}
FAR = 1e36  # of float32 coordinates: sums of a few hundred of them are finite
REST = ("rest/vertices", "rest/normals", "rest/faces")
LIGHT = "light"  # the coefficients (bands², 3) of the light, of a model of radiance


@cache
def _compiled(config: ModelConfig) -> Any:
    return jax.jit(partial(DEFORMING[config.name].predict, config))


def _normals_on_device(mesh: Mesh, carried: CarriedNormals) -> Callable[[Array], Array]:
    """Normals of a pose in a program of their own, of this mesh: in one program with the coefficients, frames took up
    to twice as long."""

    used = np.flatnonzero(referenced(mesh))

    def normals(positions: Array) -> Array:
        if not len(used):
            return jnp.zeros_like(positions) + carried.fixed
        placed = positions - positions[used[:1]]
        unit = jnp.maximum(jnp.max(jnp.abs(placed[used])), 1e-30)  # squares of areas would leave the range of float32
        return normals_of_pose(placed / unit, mesh.faces, carried)

    return jax.jit(normals)


class DeformingModel:
    """A model of one object: `model(positions)` gives (v, k) coefficients of a pose of it, `model.radiance(positions)`,
    where it has a `light`, the radiance (v, k, 3) that arrives under it.

    Positions are those of all vertices, in the units and the order of the mesh that it was fitted to.
    """

    def __init__(self, config: ModelConfig, arrays: dict[str, Any], mesh: Mesh, metadata: dict[str, Any]):
        self.config: Any = config
        self.mesh, self.metadata = mesh, metadata
        self.arrays = {
            name: np.asarray(array, np.int8 if _stored(name) is np.int8 else np.float32)
            for name, array in arrays.items()
        }
        self._carried = carried_normals(mesh, mesh.faces)
        self._normals = _normals_on_device(mesh, self._carried)
        self._held = {name: jnp.asarray(array) for name, array in self.arrays.items()}

    def pose(self, positions: ArrayLike | Array) -> Mesh:
        """A pose as a mesh, with normals carried along from the rest. Raises MeshError for another mesh."""
        return posed_mesh(self._checked(positions), self.mesh.faces, self._carried)

    def _checked(self, positions: ArrayLike | Array) -> Float[np.ndarray, "v 3"]:
        """Positions of all vertices, float32. Raises MeshError."""
        found = np.asarray(as_array(positions))
        if found.shape != self.mesh.vertices.shape or not is_real(found):
            raise MeshError(
                f"positions have shape {found.shape} {found.dtype}: this model is of one mesh, give positions of all "
                f"its vertices, {self.mesh.vertices.shape}"
            )
        with np.errstate(over="ignore"):  # what float32 cannot hold is refused here
            found = found.astype(np.float32)
        bad = ~(np.abs(found) < FAR).all(axis=1)
        if bad.any():
            raise MeshError(
                f"{bad.sum()} of {len(found)} positions are not finite or beyond {FAR:g} (first: {np.argmax(bad)}): "
                "repair or leave out the pose"
            )
        return found

    @property
    def parameters(self) -> int:
        """Numbers that were trained, of a network; of what is fitted all that it holds."""
        trained = [array.size for name, array in self.arrays.items() if name.startswith(NET)]
        return sum(trained) or sum(array.size for array in self.arrays.values())

    @property
    def light(self) -> Float[np.ndarray, "k 3"] | None:
        """Coefficients of the light that a model of radiance is of; None where the model says transfer."""
        return self.arrays.get(LIGHT)

    def outputs(self, mesh: Mesh) -> Float[Array, "v c"]:
        """All that the model says of a pose that has its normals: coefficients, or radiance, flat."""
        return _compiled(self.config)(self._held, jnp.asarray(mesh.vertices), jnp.asarray(mesh.normals))

    def coefficients(self, mesh: Mesh) -> Float[Array, "v k"]:
        """Coefficients of a pose that has its normals. Raises ValueError for a model of radiance."""
        self._check_transfer()
        return self.outputs(mesh)

    def radiance(self, positions: ArrayLike | Array) -> Float[Array, "v k 3"]:
        """What arrives at all vertices of a pose under `light`, in its bands; `light.gloss.reflected_radiance` shades.

        Raises ValueError for a model of transfer.
        """
        if self.light is None:
            raise ValueError("this model says transfer, which is for any light: take model(positions)")
        return self._said(positions).reshape(-1, *self.light.shape)

    def __call__(self, positions: ArrayLike | Array) -> Float[Array, "v k"]:
        """Coefficients of all vertices of a pose. Raises ValueError for a model of radiance."""
        self._check_transfer()
        return self._said(positions)

    def _check_transfer(self) -> None:
        if self.light is not None:
            raise ValueError("this model says radiance under a light, not transfer: take model.radiance(positions)")

    def _said(self, positions: ArrayLike | Array) -> Float[Array, "v c"]:
        """All that the model says of a pose, its normals made on the way."""
        checked = jnp.asarray(self._checked(positions))
        return _compiled(self.config)(self._held, checked, self._normals(checked))

    def predict(self, positions: ArrayLike | Array) -> Transfer:
        """The transfer of a pose."""
        started = time.perf_counter()
        mesh = self.pose(positions)
        found = np.asarray(jax.block_until_ready(self.coefficients(mesh)))
        parameters = {"model": self.config.to_dict(), "weights": self.metadata.get("name", "")}
        seconds = {"total": time.perf_counter() - started}
        metadata = make_metadata(self.config.bands, "predict", parameters, rays_total=0, seconds=seconds)
        return Transfer(found, None, *mesh, metadata)

    def outside(self, positions: ArrayLike | Array) -> bool:
        """Whether a pose lies outside the range of those that the model was fitted to. Raises MeshError."""
        return poses_outside(reader_of(self.arrays), self._checked(positions)) > 0


def as_stored(arrays: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Arrays in the precision of a model file."""
    return {name: np.asarray(array, _stored(name)) for name, array in arrays.items()}


def _stored(name: str) -> type:
    return STORED.get(name.split("/")[0], np.float32)


def save_deforming_model(
    path: str | Path, config: ModelConfig, arrays: dict[str, Any], mesh: Mesh, **metadata: Any
) -> None:
    """Write a model file; `metadata` entries go in beside the config."""
    rest = dict(zip(REST, (mesh.vertices, mesh.normals, mesh.faces.astype(np.float32)), strict=True))
    header = {**metadata, "format": FORMAT, "version": FORMAT_VERSION, "model": config.to_dict()}
    write_npz(path, {**as_stored(arrays), **rest}, header)


def deforming_model_file(name: str | Path) -> Path:
    """The file at a path, or that of the run in a folder. Raises FileError."""
    path = as_path(name)
    if path.is_dir():
        path = path / "model.npz"
    if not path.is_file():
        raise FileError(f"no model {str(name)!r}: give the folder of a run of gash train, or a weights file")
    return path


def is_deforming(path: Path) -> bool:
    """Whether a file is of a model of one object that deforms. Raises FileError where it is no npz file."""
    return REST[0] in names_in_npz(path)


def load_deforming_model(name: str | Path) -> DeformingModel:
    """Read a model file, or that of a run's folder. Raises FileError for anything else."""
    path = deforming_model_file(name)
    arrays, metadata = read_npz(path, "model", ())
    if metadata.get("format") != FORMAT:
        raise FileError(f"{path} is no model of an object that deforms: train one with gash train deform")
    values = metadata.get("model", {})
    if values.get("name") not in DEFORMING:
        raise FileError(f"{path} was written by another version of gash_jax: its kind is {values.get('name')!r}")
    try:
        config = from_dict(DEFORMING[values["name"]].config, values, "model.")
    except ConfigError as error:
        raise FileError(f"{path} was written by another version of gash_jax: {error}") from None
    outputs = config.bands**2 * (3 if LIGHT in arrays else 1)
    rest: dict[str, tuple[int | str, ...]] = {REST[0]: ("v", 3), REST[1]: ("v", 3), REST[2]: ("f", 3)}
    rest |= {**POSE_SHAPES, LIGHT: (config.bands**2, 3)}
    shapes = {**rest, **DEFORMING[config.name].shapes(config, outputs)}
    check_arrays(path, "model", arrays, shapes, (LIGHT,), [name for name in shapes if _stored(name) is np.int8])
    vertices, normals, faces = (arrays.pop(name) for name in REST)
    mesh = Mesh(vertices.astype(np.float32), normals.astype(np.float32), faces.astype(np.int32))
    return DeformingModel(config, arrays, mesh, metadata)
