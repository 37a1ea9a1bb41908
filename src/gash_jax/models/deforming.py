"""Transfer of a mesh that deforms: positions in, coefficients out.

The faces stay, so the tree of surfels and the lists of the vertices are built once, from the pose of `mesh`; normals,
moments and the network follow the positions. The unit of length is that of the first pose. A frame far from it looks at
surfels that were chosen for another: build anew from a pose in between when it matters.

The normals of `mesh`, a file's own smooth or hard ones too, are carried along (`geometry.carried_normals`).
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from gash_jax.algebra.arguments import ArrayLike, as_array, is_real
from gash_jax.formats.meshes import MeshLike, as_mesh
from gash_jax.geometry.carried_normals import carried_normals
from gash_jax.graph.surfel_graph import SurfelGraph, check_together, normalised, part_arrays, plan_surfels, vertex_slots
from gash_jax.graph.surfels import surfel_records
from gash_jax.models.model import Model
from gash_jax.models.pose_normals import normals_of_pose
from gash_jax.models.surfel_inference import apply_surfels, predict_surfels
from gash_jax.nn.surfel_net import SurfelConfig

# positions -> coefficients and predicted error, both "v k"
DeformingFn = Callable[[ArrayLike | Array], tuple[Array, Array]]


def check_deforms(model: Model) -> None:
    """Raise ValueError unless a model has a graph that can follow a mesh that deforms."""
    if not isinstance(model, Model):
        raise ValueError(f"a {type(model).__name__} is no model: give what load_model returns")
    if not isinstance(model.config, SurfelConfig):
        raise ValueError(f"model {model.config.name} has no path for deforming meshes: use local")


def deforming_predictor(model: Model, mesh: MeshLike) -> DeformingFn:
    """A compiled function of the positions of all vertices, in the file's units; normals of `mesh` are carried along.

    Raises ValueError for a model other than `local`, and where it is called for positions of another shape.

    >>> mesh = gash_jax.load_mesh("bunny.ply")
    >>> predict = gash_jax.deforming_predictor(gash_jax.load_model("local"), mesh)
    >>> coefficients, predicted_error = predict(1.1 * mesh.vertices)
    >>> coefficients.shape
    (362, 9)
    """
    check_deforms(model)
    mesh = as_mesh(mesh)
    positions, center, unit = normalised(mesh)
    plan, _ = plan_surfels(mesh, positions, moves=True)
    slot = vertex_slots(plan)
    middle, carried = jnp.asarray(center, jnp.float32)[None], carried_normals(mesh, plan.faces)

    @jax.jit
    def posed(vertices: Array) -> tuple[Array, Array]:
        placed = (vertices - middle) / np.float32(unit)
        return placed, normals_of_pose(placed, plan.faces, carried)

    def traced(vertices: Array) -> tuple[Array, Array]:
        placed, normals = posed(vertices)
        records = surfel_records(plan.tree, placed, plan.faces, jnp)
        parts = part_arrays(plan, placed, normals, jnp)
        graph = SurfelGraph(records, parts, slot, center, np.asarray(unit, np.float32))
        return apply_surfels(model.module, model.params, graph)

    def predict(vertices: ArrayLike | Array) -> tuple[Array, Array]:
        pose = as_array(vertices)
        if pose.shape != mesh.vertices.shape or not is_real(pose):
            raise ValueError(
                f"positions have shape {pose.shape} {pose.dtype}: give those of all vertices of the mesh, "
                f"{mesh.vertices.shape}"
            )
        if isinstance(pose, Tracer):
            return traced(jnp.asarray(pose, jnp.float32))
        check_together(plan, np.asarray(pose, np.float32) / np.float32(unit))
        # copies, as for arrays that may not be written to all loops would be compiled once more
        placed, normals = (np.array(array) for array in posed(np.asarray(pose, np.float32)))
        records = surfel_records(plan.tree, placed, plan.faces)
        graph = SurfelGraph(records, part_arrays(plan, placed, normals), slot, center, np.asarray(unit, np.float32))
        return predict_surfels(model.module, model.params, graph)

    return predict
