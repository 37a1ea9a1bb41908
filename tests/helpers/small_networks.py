"""Small networks of every family with random weights, and two meshes to hold runtimes against the package on."""

from pathlib import Path
from typing import Any

import numpy as np

from gash_jax.geometry.mesh import Mesh, angle_weighted_normals
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.models.model import save_model
from gash_jax.nn.config import ModelConfig
from gash_jax.nn.output import FRAMES
from gash_jax.shapes.procedural import make_shape
from tests.helpers.bumpy import bumpy_mesh, random_variables

SMALL: dict[str, Any] = {"channels": 8, "layers": 2, "heads": 2}
NETS = {
    "mlp": model_config("mlp", channels=16, layers=2),
    "gnn": model_config("gnn", neighbours=5, **SMALL),
    "teacher": model_config("teacher", neighbours=5, **SMALL),
    "two-stage": model_config("two-stage", neighbours=5, visibility_channels=8, visibility_layers=2, **SMALL),
    "two-stage rings, 4 bands": model_config(
        "two-stage", 4, neighbours=16, graph="rings", visibility_channels=8, visibility_layers=1, **SMALL
    ),
    "rings": model_config("rings", neighbours=16, **SMALL),
    "rings, 5 bands": model_config("rings", 5, neighbours=32, **SMALL),
    "versor": model_config("versor", channels=4, layers=1, neighbours=16),
    "local": model_config("local", channels=8, layers=1),
    "local, 5 bands": model_config("local", 5, channels=8),
}

# what all networks over motors end in, on the one that compiles fastest, and once each on the others
ENDS = [("mlp", frame, residual) for frame in FRAMES for residual in (False, True)]
ENDS += [(name, frame, True) for name in ("gnn", "teacher", "two-stage") for frame in ("world", "vertex")]


def _odd_mesh() -> Mesh:
    """Coincident and isolated vertices, a zero normal, normals at and near -e_y."""
    mesh = bumpy_mesh(90, seed=3)
    vertices = np.concatenate([mesh.vertices, [mesh.vertices[4], [9.0, 0.0, 0.0]]]).astype(np.float32)
    faces = np.concatenate([mesh.faces, [[0, 1, 90]]]).astype(np.int32)
    normals = angle_weighted_normals(vertices, faces).astype(np.float32)
    normals[7], normals[91] = 0, 0
    normals[8], normals[9] = [0, -1, 0], [1e-4, -1, 0]
    normals[10] = [0, 0, -1]
    return Mesh(vertices, normals, faces)


def _generated_mesh() -> Mesh:
    """Moved a little, so that no two neighbours are equally far: which of those a tree finds is its own affair."""
    mesh = make_shape(2, 5, (300, 400))[1]
    noise = np.random.default_rng(0).normal(scale=1e-3, size=mesh.vertices.shape)
    return mesh._replace(vertices=(mesh.vertices + noise).astype(np.float32))


MESHES = {"odd": _odd_mesh(), "generated": _generated_mesh()}


def written(config: ModelConfig, path: Path) -> Path:
    """The model file of a config with random weights."""
    graph = model_graph(config, bumpy_mesh(30))
    save_model(path, config, random_variables(build_model(config), graph)["params"], name="test")
    return path
