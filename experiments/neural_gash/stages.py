"""What the second stage makes of visibilities: traced ones, those that the first stage predicts, and none at all."""

from typing import Any

import jax
import numpy as np

from gash_jax.geometry.mesh import Mesh
from gash_jax.measure import metrics
from gash_jax.measure.reference import Reference
from gash_jax.models.families import traced_visibility
from gash_jax.models.model import Model
from gash_jax.nn.two_stage import TeacherConfig, build_coefficient_net


def stage_two_skills(model: Model, mesh: Mesh, reference: Reference) -> dict[str, float | str]:
    """Skill of the net that predicts coefficients, by what it is told; empty for a network that is told nothing.

    "constant" tells every vertex the mean over the mesh of what the network would be told in use: the predictions of
    the first stage, or of a teacher the traced visibilities. What is lost to it the second stage had from visibilities.
    """
    config = model.config
    if not isinstance(config, TeacherConfig):
        return {}
    graph, usable = model.graph(mesh), np.any(mesh.normals != 0, axis=1)
    told: dict[str, np.ndarray] = {"traced": traced_visibility(config, mesh).astype(np.float32)}
    if model.predicts_visibility:
        told["predicted"] = np.asarray(jax.nn.sigmoid(model.visibility_logits(graph)))
    usual = told.get("predicted", told["traced"])
    told["constant"] = np.broadcast_to(usual[usable].mean(axis=0), usual.shape)
    params: Any = model.params["coefficient"] if model.predicts_visibility else model.params
    apply = jax.jit(build_coefficient_net(config).apply)
    skills = {}
    for name, visibility in told.items():
        seen = graph._replace(nodes={**graph.nodes, "visibility": visibility})
        found = np.asarray(apply({"params": params}, seen))
        skills[f"skill_{name}"] = metrics.skill(found, reference.coefficients, mesh.normals)
    return skills
