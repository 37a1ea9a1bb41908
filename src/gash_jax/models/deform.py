"""`deform`: the transfer of one object that deforms, patch by patch, in frames that follow its skin.

*Frames.* Coefficients are held in the frame of their vertex: its normal along z, along x the edge that was longest
across the normal in the rest. There the transfer without shadows is the same in every pose, and so is all of it where
a part of the body moves rigidly; what is left to learn is what changes around the vertex. The prediction is turned into
the world by `algebra.sh_rotation`.

*Patches.* The vertices are divided into patches, each with a regression (`kernel_regression`) of all its coefficients
on the pose. Two poses are alike to a patch if what is around it has the same shape in both: the displacements there,
without those of a rigid motion, by which no shadow changes. Of `AROUND` vertices spread over the rest one at distance d
from the middle of the patch has the weight 1 / (d² + d0²)^(p/2), in units of the diagonal of the box; displacements are
taken as linear in the numbers of the pose, and so are the leading `WAYS` directions f of the weighted ones, scaled to a
mean square length of 1 over the training poses. The kernel is Matern's of order 3/2, (1 + s) exp(-s) with s = sqrt(3)
|f - f'| / REACH (Rasmussen & Williams 2006, 4.17).

*Size.* Of each patch's predictions the leading directions are kept, more of them where more changes (`patch_levels`).
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
from gash_jax.geometry.animation import Animation
from gash_jax.geometry.carried_normals import carried_normals, vertex_frames
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.models.kernel_regression import fit_low_rank
from gash_jax.models.patch_levels import ENDS, LEVEL_SHAPES, MEGABYTE, Patches, level_arrays, say_levels
from gash_jax.models.pose_reader import (
    fit_reader,
    read_pose,
    reader_arrays,
    reader_of,
    spread_in_faces,
    spread_vertices,
)
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.nn.config import ModelConfig
from gash_jax.prt.sequence import posed_meshes

AROUND = 800  # vertices whose displacements say how alike two poses are: with fewer lips and eyelids have too few
NEAR, POWER = 0.03, 6.0  # d0 and p
WAYS = 24  # in which what is around a patch changes its shape
REACH = 4.0  # of the kernel, in lengths of f


@dataclass(frozen=True)
class DeformConfig(ModelConfig):
    """The regression of patches."""

    patches: int = setting(64, "patches that the surface is divided into", least=1)
    megabytes: float = setting(8.0, "size of the model file; its directions are chosen for it", least=0)
    ridge: float = setting(0.0, "ridge, relative to the kernel; 0: by leaving one pose out in each patch", least=0)


DEFORM_SHAPES: dict[str, tuple[int | str, ...]] = {
    "patch": ("v",),
    "row": ("v",),
    "neighbour": ("v",),
    "relevance": ("q", "p", "w"),
    "poses": ("t", "p"),
    "lengths": ("q", "t"),
    "mean": ("v", "k"),
    **LEVEL_SHAPES,
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


def displacements(
    animation: Animation, poses: Float[np.ndarray, "t p"], chosen: Int[np.ndarray, "s"]
) -> Float[np.ndarray, "p s 3"]:
    """How far each number of the pose moves the chosen vertices: least squares over the frames of an animation."""
    seen = np.stack([frame[chosen] for frame in animation.frames()]).astype(np.float64).reshape(len(poses), -1)
    found = np.linalg.pinv(poses - poses.mean(axis=0)) @ (seen - seen.mean(axis=0))
    return found.reshape(poses.shape[1], -1, 3)


def without_rigid(
    moved: Float[np.ndarray, "p s 3"], points: Float[np.ndarray, "s 3"], weight: Float[np.ndarray, "s"]
) -> Float[np.ndarray, "p d"]:
    """Displacements times the roots of the weights, d = 3 s, less the small rigid motion that is closest to each."""
    root, apart = np.sqrt(weight)[:, None], points - np.average(points, axis=0, weights=weight)
    ways = [np.broadcast_to(axis, apart.shape) for axis in np.eye(3)] + [np.cross(axis, apart) for axis in np.eye(3)]
    rigid = np.stack([(root * way).ravel() for way in ways], axis=1)
    found = (root * moved).reshape(len(moved), -1)
    return found - found @ np.linalg.pinv(rigid).T @ rigid.T


def relevance(
    middle: Float[np.ndarray, "3"],
    around: Float[np.ndarray, "s 3"],
    moved: Float[np.ndarray, "p s 3"],
    poses: Float[np.ndarray, "t p"],
    unit: float,
) -> Float[np.ndarray, "p w"]:
    """From the numbers of a pose to the shape of what is around a patch: pose -> f (module docstring)."""
    apart = np.linalg.norm(around - middle, axis=1) / unit
    weight = (apart**2 + NEAR**2) ** (-POWER / 2)
    shapes = without_rigid(moved, around, weight / weight.sum())
    triangle = np.linalg.qr(poses - poses.mean(axis=0), mode="r")  # with fewer rows, of the same singular values
    _, sizes, ways = np.linalg.svd(triangle @ shapes, full_matrices=False)
    length = max(float(np.linalg.norm(sizes)) / np.sqrt(len(poses)), 1e-30)
    found = shapes @ ways[:WAYS].T / length
    return np.pad(found, ((0, 0), (0, WAYS - found.shape[1])))


def matern(squares: Float[Any, "..."]) -> Float[Any, "..."]:
    """The kernel of squared distances of f (module docstring)."""
    xp = squares.__array_namespace__()
    far = xp.sqrt(3 * xp.maximum(squares, 1e-12)) / REACH  # the root of 0 has no gradient
    return (1 + far) * xp.exp(-far)


def pose_kernel(arrays: dict[str, Any], pose: Float[Array, "p"]) -> Float[Array, "q t"]:
    """The kernel of a pose and those of the training, of each patch.

    |f - f'|² = |f|² - 2 f.f' + |f'|², the last in `lengths`: to make f' would take longer than all the rest.
    """
    near = arrays["relevance"]
    seen = pose @ near  # (q, w)
    products = jnp.einsum("qpw,qw->qp", near, seen) @ arrays["poses"].T
    return matern(jnp.sum(seen * seen, axis=1)[:, None] - 2 * products + arrays["lengths"])


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

    patches: Patches
    relevance: Float[np.ndarray, "q p w"]
    arrays: dict[str, np.ndarray]  # of any size


def fit_patches(config: DeformConfig, poses: TrainingPoses) -> Fitted:
    """The regressions of all patches."""
    from scipy.spatial.distance import pdist, squareform  # slow to import, and a prediction does without

    mesh, (reader, rows) = poses.animation.mesh, fit_reader(poses.animation)
    points, neighbour = mesh.vertices.astype(np.float64), carried_normals(mesh, mesh.faces).neighbour
    patch, middles = divide_surface(points, config.patches)
    unit = 2 * NormalisedMesh(mesh).half_diagonal
    around = spread_in_faces(mesh, AROUND)
    moved = displacements(poses.animation, rows, around)
    near = np.stack([relevance(middle, points[around], moved, rows, unit) for middle in middles])
    local = local_coefficients(poses, neighbour)
    (count, size), rank = local.shape[1:], ENDS[-1]
    mean, basis = np.zeros((count, size), np.float32), np.zeros((count, size, rank), np.float16)
    weights, energy = np.zeros((len(middles), len(rows), rank), np.float32), np.zeros((len(middles), rank))
    for number in range(len(middles)):
        own = np.flatnonzero(patch == number)
        if len(own):
            seen = rows @ near[number]
            outputs = local[:, own].astype(np.float32).reshape(len(rows), -1)
            found = fit_low_rank(matern(squareform(pdist(seen, "sqeuclidean"))), outputs, rank, config.ridge)
            mean[own], weights[number], energy[number] = found.mean.reshape(-1, size), found.dual, found.energy
            basis[own] = found.basis.reshape(rank, -1, size).transpose(1, 2, 0)
    arrays = {"neighbour": neighbour, "poses": rows, **reader_arrays(reader)}
    return Fitted(Patches(patch, mean, basis, weights, energy), near, arrays)


def cut_to_size(fitted: Fitted, mesh: Mesh, megabytes: float) -> dict[str, Any]:
    """The arrays of a model whose file takes about so many megabytes, or what it takes at the least."""
    patches, halves = fitted.patches, fitted.patches.mean.nbytes // 2
    numbers = sum(array.size for array in (*fitted.arrays.values(), fitted.relevance, *mesh)) + 2 * len(patches.patch)
    numbers += len(fitted.relevance) * len(fitted.arrays["poses"])  # lengths
    tables = level_arrays(patches, MEGABYTE * megabytes - halves - 4 * numbers)
    relevance = fitted.relevance[tables.pop("order")]
    lengths = (np.einsum("tp,qpw->qtw", fitted.arrays["poses"], relevance) ** 2).sum(axis=2)
    arrays = {**fitted.arrays, **tables, "relevance": relevance, "lengths": lengths}
    return {name: np.asarray(array, np.float32) for name, array in arrays.items()}


def fit_deform(config: DeformConfig, poses: TrainingPoses) -> dict[str, Any]:
    """The arrays of the model."""
    return cut_to_size(fit_patches(config, poses), poses.animation.mesh, config.megabytes)


def predict_deform(
    arrays: dict[str, Any], positions: Float[Array, "v 3"], normals: Float[Array, "v 3"]
) -> Float[Array, "v k"]:
    """Coefficients of a pose; the closed form where the frame of a vertex has vanished, 0 without a normal."""
    local = say_levels(arrays, pose_kernel(arrays, read_pose(reader_of(arrays), positions)))
    frames = local_frames(positions, normals, arrays["neighbour"].astype(jnp.int32))
    whole = jnp.any(frames[..., 0] != 0, axis=-1, keepdims=True)
    turned, bands = rotate_coefficients(local, frames), math.isqrt(local.shape[1])
    found = jax.lax.cond(  # nearly always all are whole, and the formula costs as much as the kernel
        jnp.all(whole), lambda: turned, lambda: jnp.where(whole, turned, unshadowed_transfer(normals, bands))
    )
    return zero_without_normal(found, normals)
