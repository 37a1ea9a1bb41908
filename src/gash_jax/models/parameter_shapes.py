"""Names and shapes of the parameters of a network, and the structure of what it reads, from its config alone.

The parameters follow from tracing the network's initialisation on the smallest of meshes, which takes longer than
reading a model file. So they are kept in the user's cache, under the hash of the config and of the networks' source.
"""

import hashlib
import json
from functools import cache
from importlib.metadata import version
from typing import Any

import jax
import numpy as np
from flax.traverse_util import flatten_dict

from gash_jax.files.atomic import FileError, write_json
from gash_jax.files.caches import cache_folder, source_hash
from gash_jax.geometry.mesh import Mesh
from gash_jax.models.examples import Example
from gash_jax.models.families import build_model, family_of, model_graph
from gash_jax.nn.config import ModelConfig

# whose source the shapes depend on
NETWORK_ROOMS = ("nn", "graph", "models")
_CORNERS = np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32)
_FACES = [[0, 1, 2], [0, 5, 1], [0, 2, 4], [0, 4, 5], [3, 2, 1], [3, 1, 5], [3, 4, 2], [3, 5, 4]]
_OCTAHEDRON = Mesh(_CORNERS, _CORNERS, np.array(_FACES, np.int32))
_BATCH = 64  # vertices: more than it has, and a block of those networks that take blocks


def parameter_shapes(config: ModelConfig) -> dict[str, tuple[int, ...]]:
    """Shape of every parameter by its path in the tree, such as "coefficient/conv_0/source/kernel"."""
    parts = (json.dumps(config.to_dict(), sort_keys=True), source_hash(NETWORK_ROOMS), version("flax"))
    name = f"{hashlib.sha256(repr(parts).encode()).hexdigest()[:24]}.json"
    try:
        path = cache_folder() / "shapes" / name
    except RuntimeError:  # a user without a home
        return traced_shapes(config)
    try:
        return {key: tuple(shape) for key, shape in json.loads(path.read_text(encoding="utf-8")).items()}
    except (OSError, ValueError, AttributeError, TypeError):  # not there yet, or damaged: it is only a cache
        shapes = traced_shapes(config)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, shapes)
    except (OSError, FileError):  # a cache that cannot be written costs time, nothing else
        pass
    return shapes


def _smallest(config: ModelConfig) -> Example:
    """The octahedron as a network reads it, with labels of zeros."""
    count, directions = len(_CORNERS), getattr(config, "visibility_directions", 1)
    visibility = np.zeros((count, directions), np.float32)
    graph = model_graph(config, _OCTAHEDRON, 0, visibility)
    return Example(graph, np.zeros((count, config.bands**2), np.float32), visibility)


@cache
def graph_structure(config: ModelConfig) -> Any:
    """The tree of arrays that a network reads of a mesh, as `jax.tree.structure` gives it."""
    with jax.ensure_compile_time_eval():  # whoever asks may be tracing
        return jax.tree.structure(_smallest(config).graph)


def traced_shapes(config: ModelConfig) -> dict[str, tuple[int, ...]]:
    """The same without the cache; nothing is computed."""
    example = _smallest(config)
    inputs = jax.tree.map(lambda leaf: leaf[0], family_of(config).batches([example]).draw(_BATCH, 0, 0).inputs)
    variables = jax.eval_shape(build_model(config).init, jax.eval_shape(lambda: jax.random.key(0)), inputs)
    leaves: dict[str, Any] = flatten_dict(variables["params"], sep="/")  # type: ignore[assignment]
    return {name: leaf.shape for name, leaf in leaves.items()}
