"""What it costs to keep the weights of a network in float16: half the bytes, an error that is measured.

Only the file is smaller: weights are turned back into float32 when they are read, and everything is computed in that.
"""

from typing import Any

import jax
import numpy as np

from gash_jax.files.atomic import FileError
from gash_jax.measure.metrics import relrmse
from gash_jax.models.model import Model
from gash_jax.shapes.procedural import make_shape

# of a seed that no shipped corpus has, one of each of so many kinds
SEED, SHAPES, VERTICES = 9016, 6, (400, 800)


def rounded(model: Model) -> Model:
    """The model with its weights rounded to float16. Raises FileError where one is beyond float16."""
    with np.errstate(over="ignore"):
        params = jax.tree.map(lambda leaf: np.asarray(leaf, np.float16).astype(np.float32), model.params)
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(params)):
        raise FileError(f"a weight of model {model.config.name} is beyond float16 (65504): leave out --half")
    return Model(model.config, params, model.metadata)


def rounding_error(model: Model, other: Model) -> dict[str, Any]:
    """relrmse of the predictions of `other` to those of `model` on generated meshes: the median and the worst."""
    errors, counts = [], []
    for index in range(SHAPES):
        mesh = make_shape(SEED, index, VERTICES)[1]
        graph = model.graph(mesh)
        found = relrmse(np.asarray(other(graph)), np.asarray(model(graph)))
        errors.append(0.0 if found is None else found)  # without energy there is nothing to be off by
        counts.append(len(mesh.vertices))
    measured = {"relrmse_median": float(np.median(errors)), "relrmse_worst": float(np.max(errors))}
    return {**measured, "meshes": SHAPES, "vertices": [min(counts), max(counts)], "seed": SEED}
