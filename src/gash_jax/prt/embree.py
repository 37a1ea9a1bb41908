"""Rays by Embree: the only file that imports embreex.

embreex traces single rays and releases the GIL while it does, so callers run it from several Python threads.
`OCCLUDED` is the any-hit query: it returns 0 for a hit and -1 for a free ray. The scene is committed inside the
first `run`, holding the GIL, so a first ray is traced here, before any thread is started. Embree starts every ray
at parameter 0: the lift off the surface is the caller's (`rays.trace_geometry`).
"""

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float, Int

from gash_jax.prt.rays import ClosestHitFn, Hits, VisibilityFn


def _scene(vertices: np.ndarray, faces: np.ndarray) -> EmbreeScene:
    scene = EmbreeScene(robust=True)
    # embreex reads its arrays element by element, faces[i][j], making a NumPy object of each row and number: Python
    # objects, made all at once, are read in two thirds of the time (of the largest fixed cost of a bake of few rays)
    rows = np.fromiter(zip(*faces.T.tolist(), strict=True), object, len(faces))
    TriangleMesh(scene, vertices.astype(np.float32).astype(object), rows)
    first = np.zeros((1, 3), np.float32)
    scene.run(first, np.ones((1, 3), np.float32), query="OCCLUDED")
    return scene


def embree_visibility(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> VisibilityFn:
    """Build a scene once and return its any-hit query; safe to call from several threads."""
    scene = _scene(vertices, faces)

    def visible(origins: Float[np.ndarray, "r 3"], directions: Float[np.ndarray, "r 3"]) -> Bool[np.ndarray, "r"]:
        return scene.run(origins, directions, query="OCCLUDED") != 0

    return visible


def embree_closest_hit(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> ClosestHitFn:
    """Build a scene once and return its closest-hit query; safe to call from several threads."""
    scene = _scene(vertices, faces)

    def closest(origins: Float[np.ndarray, "r 3"], directions: Float[np.ndarray, "r 3"]) -> Hits:
        found = scene.run(origins, directions, query="INTERSECT", output=True)
        return Hits(found["primID"].astype(np.int32), found["u"], found["v"], found["tfar"])

    return closest
