"""The linear model that deforming objects are usually given (Schneider et al. 2017, "MoMo-PRT"): coefficients in the
world are linear in the numbers of the pose.

It is least squares with a ridge over all vertices at once, kept in `rank` directions: t = mean + B^T W (pose - middle).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Array, Float

from gash_jax.files.settings import setting
from gash_jax.models.kernel_regression import fit_low_rank, products_of, ridge_machine
from gash_jax.models.pose_reader import fit_reader, read_pose, reader_arrays, reader_of
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.nn.config import ModelConfig


@dataclass(frozen=True)
class MomoConfig(ModelConfig):
    """The linear model."""

    rank: int = setting(64, "directions in the space of all coefficients that are kept", least=1)
    ridge: float = setting(0.0, "ridge, relative to the variance of the poses; 0: by leaving one pose out", least=0)


def momo_shapes(outputs: int) -> dict[str, tuple[int | str, ...]]:
    """Shapes of the arrays of a model that says so many numbers of a vertex."""
    return {"middle": ("p",), "mean": ("v", outputs), "weights": ("p", "r"), "basis": ("r", "v", outputs)}


def fit_momo(config: MomoConfig, poses: TrainingPoses) -> dict[str, Any]:
    """The arrays of the model."""
    reader, rows = fit_reader(poses.animation)
    outputs = np.concatenate([np.asarray(shard, np.float32) for shard in poses.shards])
    middle = rows.mean(axis=0)
    apart = rows - middle
    rank = min(config.rank, rows.shape[1])
    flat = outputs.reshape(len(outputs), -1)
    gram = products_of(flat)
    found = fit_low_rank(ridge_machine(apart @ apart.T, gram, config.ridge), flat, gram, rank)
    return {
        **reader_arrays(reader),
        "middle": middle.astype(np.float32),
        "mean": found.mean.reshape(outputs.shape[1:]),
        "weights": (apart.T @ found.dual).astype(np.float32),
        "basis": found.basis.reshape(-1, *outputs.shape[1:]),
    }


def predict_momo(
    arrays: dict[str, Any], positions: Float[Array, "v 3"], normals: Float[Array, "v 3"]
) -> Float[Array, "v c"]:
    """Coefficients of a pose, or radiance; its normals are not needed."""
    scores = (read_pose(reader_of(arrays), positions) - arrays["middle"]) @ arrays["weights"]
    basis = arrays["basis"]
    return arrays["mean"] + (scores @ basis.reshape(len(basis), -1)).reshape(basis.shape[1:])
