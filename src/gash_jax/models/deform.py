"""`deform`: the transfer of one object that deforms, patch by patch, in frames that follow its skin.

*Frames.* Coefficients are held in the frame of their vertex: its normal along z, along x the edge that was longest
across the normal in the rest. There the transfer without shadows is the same in every pose, and so is all of it where
a part of the body moves rigidly; what is left to learn is what changes around the vertex. The prediction is turned into
the world by `algebra.sh_rotation`.

*Patches.* The vertices are divided into patches, each with a regression (`kernel_regression`) of all its coefficients
on the pose. What moves near a patch shadows it most: the numbers of the pose count by the RMS displacement that they
cause around the middle of the patch, where a vertex of the sample at distance d has the weight 1 / (d² + d0²)^(p/2), in
units of the diagonal of the box. With f the pose so weighted, of mean square length 1 over the training poses, the
kernel is Matern's of order 3/2, (1 + s) exp(-s) with s = sqrt(3) |f - f'| / REACH (Rasmussen & Williams 2006, 4.17).

*Size.* Of each patch's predictions `rank` directions are kept: r numbers for each coefficient of a vertex.
"""

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from gash_jax.algebra.closed_forms import unshadowed_transfer, zero_without_normal
from gash_jax.algebra.numerics import safe_normalize
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.settings import setting
from gash_jax.geometry.carried_normals import carried_normals, vertex_frames
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.models.kernel_regression import fit_low_rank
from gash_jax.models.pose_reader import fit_reader, read_pose, reader_arrays, reader_of, spread_vertices
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.nn.config import ModelConfig
from gash_jax.prt.sequence import posed_meshes

NEAR, POWER = 0.03, 4.0  # d0 and p
REACH = 4.0  # of the kernel, in lengths of a weighted pose


@dataclass(frozen=True)
class DeformConfig(ModelConfig):
    """The regression of patches."""

    patches: int = setting(64, "patches that the surface is divided into", least=1)
    rank: int = setting(16, "numbers of a patch's pose that reach its coefficients", least=1)
    ridge: float = setting(0.0, "ridge, relative to the kernel; 0: by leaving one pose out in each patch", least=0)


DEFORM_SHAPES: dict[str, tuple[int | str, ...]] = {
    "patch": ("v",),
    "neighbour": ("v",),
    "relevance": ("q", "p"),
    "poses": ("t", "p"),
    "mean": ("v", "k"),
    "basis": ("v", "k", "r"),
    "weights": ("q", "t", "r"),
}


def divide_surface(
    points: Float[np.ndarray, "v 3"], count: int, rounds: int = 8
) -> tuple[Int[np.ndarray, "v"], Float[np.ndarray, "q 3"]]:
    """The patch of every vertex, and the middles of the patches: k-means from vertices far apart."""
    from scipy.spatial import KDTree  # slow to import, and a prediction does without

    middles = points[spread_vertices(points, count)]
    for _ in range(rounds):
        patch = KDTree(middles).query(points)[1]
        size = np.bincount(patch, minlength=len(middles))
        sums = np.stack([np.bincount(patch, axis, len(middles)) for axis in points.T], axis=1)
        middles = np.where(size[:, None] > 0, sums / np.maximum(size, 1)[:, None], middles)
    return np.asarray(KDTree(middles).query(points)[1]), middles


def relevance(
    middles: Float[np.ndarray, "q 3"], sample: Float[np.ndarray, "s 3"], moved: Float[np.ndarray, "p s"], unit: float
) -> Float[np.ndarray, "q p"]:
    """How much each number of the pose moves what is around each patch (module docstring)."""
    apart = np.linalg.norm(middles[:, None] - sample, axis=2) / unit
    weight = (apart**2 + NEAR**2) ** (-POWER / 2)
    return np.sqrt((weight / weight.sum(axis=1, keepdims=True)) @ (moved**2).T)


def pose_kernel(
    first: Float[Array | np.ndarray, "... a p"], second: Float[Array | np.ndarray, "... t p"]
) -> Float[Array | np.ndarray, "... a t"]:
    """The kernel of weighted poses (module docstring)."""
    xp = first.__array_namespace__()
    products = first @ xp.swapaxes(second, -1, -2)
    ends = xp.sum(first * first, axis=-1)[..., :, None] + xp.sum(second * second, axis=-1)[..., None, :]
    far = xp.sqrt(3 * xp.maximum(ends - 2 * products, 1e-12)) / REACH  # the root of 0 has no gradient
    return (1 + far) * xp.exp(-far)


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


def fit_deform(config: DeformConfig, poses: TrainingPoses) -> dict[str, Any]:
    """The arrays of the model."""
    mesh, (reader, rows, moved) = poses.animation.mesh, fit_reader(poses.animation)
    points, neighbour = mesh.vertices.astype(np.float64), carried_normals(mesh, mesh.faces).neighbour
    patch, middles = divide_surface(points, config.patches)
    unit = 2 * NormalisedMesh(mesh).half_diagonal
    near = relevance(middles, points[reader.sample.astype(int)], moved, unit)
    near /= np.maximum(np.sqrt((near**2) @ (rows**2).mean(axis=0)), 1e-30)[:, None]
    local = local_coefficients(poses, neighbour)
    size, rank = local.shape[2], config.rank
    mean, basis = np.zeros((len(points), size), np.float32), np.zeros((len(points), size, rank), np.float32)
    weights = np.zeros((len(middles), len(rows), rank), np.float32)
    for number in range(len(middles)):
        own = np.flatnonzero(patch == number)
        if len(own):
            seen = near[number] * rows
            outputs = local[:, own].astype(np.float32).reshape(len(rows), -1)
            found = fit_low_rank(np.asarray(pose_kernel(seen, seen)), outputs, rank, config.ridge)
            mean[own], weights[number] = found.mean.reshape(-1, size), found.dual
            basis[own] = found.basis.reshape(rank, -1, size).transpose(1, 2, 0)
    arrays = {"patch": patch, "neighbour": neighbour, "relevance": near, "poses": rows}
    arrays |= {"mean": mean, "basis": basis, "weights": weights}
    arrays |= reader_arrays(reader)
    return {name: np.asarray(array, np.float32) for name, array in arrays.items()}


def predict_deform(
    arrays: dict[str, Any], positions: Float[Array, "v 3"], normals: Float[Array, "v 3"]
) -> Float[Array, "v k"]:
    """Coefficients of a pose; the closed form where the frame of a vertex has vanished, 0 without a normal."""
    pose, near = read_pose(reader_of(arrays), positions), arrays["relevance"]
    seen = pose_kernel((near * pose[None])[:, None], near[:, None] * arrays["poses"][None])
    scores = jnp.einsum("qt,qtr->qr", seen[:, 0], arrays["weights"])
    of_vertex = scores[arrays["patch"].astype(jnp.int32)]
    local = arrays["mean"] + jnp.einsum("vkr,vr->vk", arrays["basis"], of_vertex)
    frames = local_frames(positions, normals, arrays["neighbour"].astype(jnp.int32))
    whole = jnp.any(frames[..., 0] != 0, axis=-1, keepdims=True)
    bare = unshadowed_transfer(normals, math.isqrt(local.shape[1]))
    return zero_without_normal(jnp.where(whole, rotate_coefficients(local, frames), bare), normals)
