"""Models of one object that deforms with random arrays, to hold runtimes and ONNX files against the package."""

from typing import Any

import numpy as np

from gash_jax.files.settings import from_dict
from gash_jax.geometry.mesh import Mesh
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.deforming_model import DeformingModel, as_stored
from gash_jax.models.pose_reader import POSE_SHAPES

FIRST = 30  # rows of the first patch
PATCHES = (2, 1, 1, 1, 1, 0, 0)  # of each level


def random_model(name: str, mesh: Mesh) -> DeformingModel:
    """A `momo-prt` or a `deform` of 3 bands; the first patch of the latter compares all it reads, the second adds."""
    rng, config = np.random.default_rng(0), from_dict(DEFORMING[name].config, {"name": name, "bands": 3})
    count = len(mesh.vertices)
    sizes = {"v": count, "k": 9, "r": 3, "p": 2, "s": 4, "d": 12, "q": 2, "m": 5, "a": 4}
    sizes |= {f"patches {level}": patches for level, patches in enumerate(PATCHES)}
    sizes |= {f"rows {level}": (0, FIRST, count)[patches] for level, patches in enumerate(PATCHES)}
    shapes = {**POSE_SHAPES, **DEFORMING[name].shapes(config, 9)}
    arrays: dict[str, Any] = {
        key: rng.normal(0, 0.3, [sizes[side] if isinstance(side, str) else side for side in shape])
        for key, shape in shapes.items()
    }
    arrays |= {"pose/sample": rng.integers(0, count, 4), "pose/low": -np.ones(2), "pose/high": np.ones(2)}
    if name == "deform":
        arrays |= {"patch": np.arange(count) >= FIRST, "row": rng.permutation(count), "together": [1, 0]}
        arrays["unit"] = np.array([1.5])
        for key in ("neighbour", "anchors", "points"):
            arrays[key] = rng.integers(0, count, arrays[key].shape)
        arrays |= {key: np.rint(300 * array) for key, array in arrays.items() if key.startswith("directions")}
        arrays |= {key: array / 100 for key, array in arrays.items() if key.startswith("weights")}
        arrays["into"] = 0.1 * arrays["into"]  # or no pose would be like another
        arrays["amounts"] = np.abs(arrays["amounts"]) + [[0.7], [0]]
    return DeformingModel(config, as_stored(arrays), mesh, {})
