"""A linear stage 2: coefficients from traced visibilities by one matrix. The row that any network must beat.

    .venv/bin/python -m experiments.neural_gash.linear --output FILE.json

The matrix is fitted by least squares, exactly, on the shapes that the variants are trained on, in every frame of
`nn.output`, with and without residual; the second only where it makes a difference: in the frame of the vertex the
transfer without shadows is the same at every vertex, so the constant of the fit holds it already. `main` fits on a few
shapes and measures shapes that the fit has not seen.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from benchmarks.options import options, saved
from experiments.neural_gash.variants import SUBSET
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.motors import motor, rotor_from_normal, rotor_to_matrix
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure import metrics
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import REFERENCE_RAYS, make_reference
from gash_jax.models.examples import Item
from gash_jax.models.families import label_visibility, model_config, traced_visibility
from gash_jax.nn.output import world_coefficients
from gash_jax.train.config import DataConfig, load_config
from gash_jax.train.corpus import build_corpus, split_indices

ENDS = (("mixed", False), ("mixed", True), ("world", False), ("world", True), ("vertex", False))
FEW, UNSEEN = 7, 6
TINY = DataConfig(shapes=3, validation_shapes=2, rays=32, min_vertices=150, max_vertices=300)


class LinearMap(NamedTuple):
    """Coefficients in the frame, over the closed form where `residual`: [visibilities, 1] @ weights."""

    weights: Float[np.ndarray, "n k"]
    frame: str
    residual: bool

    @property
    def name(self) -> str:
        """What its row is called."""
        return self.name_of(self.frame, self.residual)

    @staticmethod
    def name_of(frame: str, residual: bool) -> str:
        """What the row of a frame is called, with or without residual."""
        return f"linear in 25 rays, frame {frame}{', residual' if residual else ''}"


def _teacher(frame: str) -> Any:
    return model_config("teacher", frame=frame)


def _with_constant(visibility: np.ndarray) -> np.ndarray:
    return np.concatenate([visibility, np.ones((len(visibility), 1))], axis=1)


def fit(items: Sequence[Item], frame: str, residual: bool) -> LinearMap:
    """The map with the least square error over all vertices of the shapes that have a normal."""
    inputs, targets = [], []
    for item in items:
        usable = np.any(item.mesh.normals != 0, axis=1)
        normals, target = item.mesh.normals[usable], item.coefficients[usable]
        if residual:
            target = target - np.asarray(unshadowed_transfer(normals, round(target.shape[1] ** 0.5)))
        if frame == "vertex":
            target = rotate_coefficients(target, rotor_to_matrix(rotor_from_normal(normals)).swapaxes(-1, -2))
        inputs.append(_with_constant(label_visibility(_teacher(frame), item)[usable]))
        targets.append(np.asarray(target, np.float64))
    weights = np.linalg.lstsq(np.concatenate(inputs), np.concatenate(targets), rcond=None)[0]
    return LinearMap(weights, frame, residual)


def predict(linear: LinearMap, mesh: Mesh) -> Float[np.ndarray, "v k"]:
    """Coefficients in the world: 25 rays a vertex and a matrix."""
    said = _with_constant(traced_visibility(_teacher(linear.frame), mesh)) @ linear.weights
    nodes = {"motor": motor(jnp.zeros_like(mesh.vertices), mesh.normals), "normal": jnp.asarray(mesh.normals)}
    found = world_coefficients(jnp.asarray(said, jnp.float32), nodes, linear.frame, linear.residual)
    return np.asarray(found)


def fit_all(items: Sequence[Item]) -> list[LinearMap]:
    """One map for every frame, with and without residual."""
    return [fit(items, *end) for end in ENDS]


def corpus(quick: bool) -> tuple[list[Item], list[Item]]:
    """The shapes that the variants are trained on, and those that they are validated on."""
    data = TINY if quick else load_config("mlp", SUBSET).data
    return tuple(build_corpus(data, 3, indices) for indices in split_indices(data)[:2])  # type: ignore[return-value]


def main(output: Path | None, quick: bool) -> dict[str, Any]:
    items, unseen = corpus(quick)
    rays, rows = 256 if quick else REFERENCE_RAYS, []
    references = [make_reference(item.mesh, rays=rays).coefficients for item in unseen[:UNSEEN]]
    for count in (min(FEW, len(items)), len(items)):
        for linear in fit_all(items[:count]):
            skills = [
                metrics.skill(predict(linear, item.mesh), reference, item.mesh.normals)
                for item, reference in zip(unseen, references, strict=False)
            ]
            rows.append({"frame": linear.frame, "residual": linear.residual, "shapes": count, "skills": skills})
            print(rows[-1], flush=True)
    meshes = [{"kind": item.kind, "vertices": len(item.mesh.vertices)} for item in unseen[:UNSEEN]]
    return saved(output, {**provenance(seed=0, arguments={"rays": rays}), "meshes": meshes, "rows": rows})


if __name__ == "__main__":
    main(**options(__doc__, "output", "quick"))
