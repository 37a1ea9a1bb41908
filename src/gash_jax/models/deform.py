"""`deform`: the transfer of one object that deforms, patch by patch, in frames that follow its skin.

*Frames.* Coefficients are held in the frame of their vertex: its normal along z, along x the edge that was longest
across the normal in the rest. There the transfer without shadows is the same in every pose, and so is all of it where
a part of the body moves rigidly; what is left to learn is what changes around the vertex. The prediction is turned into
the world by `algebra.sh_rotation`.

*Patches.* The vertices are divided into patches, each with a regression (`kernel_regression`) of all its coefficients
on what it reads of a pose (`surroundings`): how what is near it, or the parts of the body that throw shadow on it, are
placed as seen from it. So a pose that is moved as a whole has the same shadows, moved along.

*Size.* A patch knows the more training poses the larger the model may be. Of its predictions the leading directions are
kept, more of them where more changes (`patch_levels`).
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from gash_jax.algebra.closed_forms import unshadowed_transfer, zero_without_normal
from gash_jax.algebra.numerics import safe_normalize
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.settings import setting
from gash_jax.geometry.carried_normals import carried_normals, vertex_frames
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.models.kernel_regression import fit_low_rank, products_of
from gash_jax.models.patch_levels import ENDS, LEVEL_SHAPES, MEGABYTE, Patches, level_arrays, say_levels
from gash_jax.models.pose_reader import fit_reader, reader_arrays
from gash_jax.models.surroundings import SURROUNDINGS, WAYS, pose_kernel
from gash_jax.models.surroundings_fit import Reading, divide_surface, find_candidates, read_patch
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.nn.config import ModelConfig
from gash_jax.prt.sequence import posed_meshes

POSES, FEWEST = 60, 32  # that patches know: so many a megabyte, and at the least


@dataclass(frozen=True)
class DeformConfig(ModelConfig):
    """The regression of patches."""

    patches: int = setting(64, "patches that the surface is divided into", least=1)
    megabytes: float = setting(8.0, "size of the model file; its directions are chosen for it", least=0)


DEFORM_SHAPES: dict[str, tuple[int | str, ...]] = {
    "patch": ("v",),
    "row": ("v",),
    "neighbour": ("v",),
    "mean": ("v", "k"),
    **SURROUNDINGS,
    **LEVEL_SHAPES,
}


def local_frames(
    positions: Float[Any, "v 3"], normals: Float[Any, "v 3"], neighbour: Int[Any, "v"]
) -> Float[Array, "v 3 3"]:
    """Frames that follow the skin as matrices with columns x, y, z; x is 0 where the edge has vanished."""
    rows = vertex_frames(positions, normals, neighbour, safe_normalize)
    return jnp.stack([rows[:, 1], rows[:, 2], rows[:, 0]], axis=-1)


_frames = jax.jit(local_frames)


def local_coefficients(poses: TrainingPoses, neighbour: Int[np.ndarray, "v"]) -> Float[np.ndarray, "t v k"]:
    """Coefficients of all frames in the frames of their vertices, float16."""
    turned, meshes = [], posed_meshes(poses.animation)
    for shard in poses.shards:
        for coefficients in shard:
            mesh = next(meshes)
            frames = np.asarray(_frames(mesh.vertices, mesh.normals, neighbour))
            local = rotate_coefficients(coefficients.astype(np.float32), frames.transpose(0, 2, 1))
            turned.append(np.asarray(local, np.float16))
    return np.stack(turned)


class Fitted(NamedTuple):
    """Everything that was found, before a size is chosen."""

    patch: Int[np.ndarray, "v"]
    readings: list[Reading]
    local: Float[np.ndarray, "t v k"]  # what is to be said, float16
    places: dict[str, np.ndarray]  # where the patches are
    arrays: dict[str, np.ndarray]  # of the vertices and the pose

    def outputs(self, number: int) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "t o"]]:
        """The vertices of a patch, and all that is to be said of them."""
        own = np.flatnonzero(self.patch == number)
        return own, self.local[:, own].astype(np.float32).reshape(len(self.local), -1)


def fit_patches(config: DeformConfig, poses: TrainingPoses) -> Fitted:
    """What all patches read, and what they are to say."""
    mesh, (reader, _) = poses.animation.mesh, fit_reader(poses.animation)
    points, neighbour = mesh.vertices.astype(np.float64), carried_normals(mesh, mesh.faces).neighbour
    patch, middles = divide_surface(points, config.patches)
    unit = max(2 * NormalisedMesh(mesh).half_diagonal, 1e-30)
    candidates = find_candidates(poses.animation, middles, unit)
    arrays = {"neighbour": neighbour, "unit": np.array([unit]), **reader_arrays(reader)}
    places = {"anchors": candidates.anchors, "axes": candidates.axes}
    fitted = Fitted(patch, [], local_coefficients(poses, neighbour), places, arrays)
    for number in range(len(middles)):
        outputs = fitted.outputs(number)[1]
        fitted.readings.append(read_patch(candidates, number, products_of(outputs), max(outputs.shape[1], 1)))
    return fitted


def cut_to_size(fitted: Fitted, mesh: Mesh, megabytes: float) -> dict[str, Any]:
    """The arrays of a model whose file takes about so many megabytes, or what it takes at the least."""
    count, (times, vertices, size), rank = len(fitted.readings), fitted.local.shape, ENDS[-1]
    poses = min(times, max(FEWEST, round(POSES * megabytes)))
    mean, basis = np.zeros((vertices, size), np.float32), np.zeros((vertices, size, rank), np.float16)
    weights, energy = np.zeros((count, poses, rank), np.float32), np.zeros((count, rank))
    known = np.zeros((count, WAYS, poses))
    for number, reading in enumerate(fitted.readings):
        own, outputs = fitted.outputs(number)
        known[number], machine = reading.knowing(poses)
        found = fit_low_rank(machine, outputs, products_of(outputs), rank)
        mean[own], weights[number], energy[number] = found.mean.reshape(-1, size), found.dual, found.energy
        basis[own] = found.basis.reshape(rank, -1, size).transpose(1, 2, 0)
    read = {name: np.stack([reading.arrays[name] for reading in fitted.readings]) for name in fitted.readings[0].arrays}
    halves = mean.size + known.size + read["into"].size
    whole = (*fitted.arrays.values(), *fitted.places.values(), *read.values(), *mesh)
    numbers = sum(array.size for array in whole) - read["into"].size + 2 * vertices  # `patch` and `row`
    read |= {**fitted.places, "known": known}
    patches = Patches(fitted.patch, mean, basis, weights, energy)
    tables = level_arrays(patches, MEGABYTE * megabytes - 2 * halves - 4 * numbers)
    order = tables.pop("order")
    return {**fitted.arrays, **tables, **{name: array[order] for name, array in read.items()}}


def fit_deform(config: DeformConfig, poses: TrainingPoses) -> dict[str, Any]:
    """The arrays of the model."""
    return cut_to_size(fit_patches(config, poses), poses.animation.mesh, config.megabytes)


def predict_deform(
    arrays: dict[str, Any], positions: Float[Array, "v 3"], normals: Float[Array, "v 3"]
) -> Float[Array, "v k"]:
    """Coefficients of a pose; the closed form where the frame of a vertex has vanished, 0 without a normal."""
    local = say_levels(arrays, pose_kernel(arrays, positions))
    frames = local_frames(positions, normals, arrays["neighbour"].astype(jnp.int32))
    whole = jnp.any(frames[..., 0] != 0, axis=-1, keepdims=True)
    turned, bands = rotate_coefficients(local, frames), math.isqrt(local.shape[1])
    found = jax.lax.cond(  # nearly always all are whole, and the formula costs as much as the kernel
        jnp.all(whole), lambda: turned, lambda: jnp.where(whole, turned, unshadowed_transfer(normals, bands))
    )
    return zero_without_normal(found, normals)
