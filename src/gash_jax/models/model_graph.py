"""The graph that a model reads: what `graph` builds, and for the teacher the visibility that it is told."""

import jraph
import numpy as np
from jaxtyping import Bool, Float

from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.mesh_graph import build_graph
from gash_jax.graph.surfel_graph import surfel_graph
from gash_jax.models.config import ModelConfig
from gash_jax.prt.hemisphere import hemisphere_visibility


def model_graph(
    config: ModelConfig,
    mesh: Mesh,
    seed: int = 0,
    visibility: Float[np.ndarray, "v n"] | Bool[np.ndarray, "v n"] | None = None,
) -> jraph.GraphsTuple:
    """Graph of a mesh; `seed` draws the neighbours of a `rings` graph.

    The teacher (GNN paper, 4.1.1) also reads nodes["visibility"]: the one given, else traced here with one ray for
    each of its directions.
    """
    if config.graph == "surfels":
        return surfel_graph(mesh, config.neighbours)
    graph = build_graph(mesh, config.graph, config.neighbours, seed, config.encoding)
    if config.name != "teacher":
        return graph
    if visibility is None:
        visibility = hemisphere_visibility(mesh, config.visibility_directions)
    return graph._replace(nodes={**dict(graph.nodes), "visibility": np.asarray(visibility, np.float32)})  # type: ignore[call-overload]
