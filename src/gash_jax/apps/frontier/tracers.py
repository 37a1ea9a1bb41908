"""Other programs' ray tracers under one interface: how each answers "is this ray free?" at its best.

`TRACERS[name]()` imports the library, which raises ImportError where it is not installed, and returns a function that
builds a scene from a mesh in trace space; the scene is called with float32 origins and directions. All of them bring
their own threads but trimesh.
"""

import importlib
import os
from collections.abc import Callable
from types import ModuleType
from typing import Any, no_type_check

import numpy as np

from gash_jax.files.cores import available_cores

Free = Callable[[np.ndarray, np.ndarray], np.ndarray]
Build = Callable[[np.ndarray, np.ndarray], Free]


def _library(name: str) -> Any:
    """A library that the package does not depend on."""
    os.environ.setdefault("EMBREE_NUM_THREADS", str(available_cores()))
    module: ModuleType = importlib.import_module(name)
    return module


def trimesh_tracer() -> Build:
    """trimesh.ray over the same Embree: a closest-hit query with copies in float64, one thread."""
    trimesh = _library("trimesh")

    def build(vertices: np.ndarray, faces: np.ndarray) -> Free:
        mesh = trimesh.Trimesh(vertices, faces, process=False, maintain_order=True)
        return lambda origins, directions: ~mesh.ray.intersects_any(origins, directions)

    return build


def open3d_tracer() -> Build:
    """Open3D's RaycastingScene.test_occlusions."""
    open3d = _library("open3d")

    def build(vertices: np.ndarray, faces: np.ndarray) -> Free:
        scene = open3d.t.geometry.RaycastingScene()
        scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))
        return lambda origins, directions: ~scene.test_occlusions(np.concatenate([origins, directions], 1)).numpy()

    return build


def mitsuba_tracer() -> Build:
    """Mitsuba 3, `ray_test` of its LLVM variant."""
    drjit, mitsuba = _library("drjit"), _library("mitsuba")
    mitsuba.set_variant("llvm_ad_rgb")

    def build(vertices: np.ndarray, faces: np.ndarray) -> Free:
        mesh = mitsuba.Mesh("mesh", len(vertices), len(faces))
        values = mitsuba.traverse(mesh)
        values["vertex_positions"] = vertices.astype(np.float32).ravel()
        values["faces"] = faces.astype(np.uint32).ravel()
        values.update()
        scene = mitsuba.load_dict({"type": "scene", "mesh": mesh})

        def free(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
            rays = mitsuba.Ray3f(mitsuba.Point3f(origins.T.copy()), mitsuba.Vector3f(directions.T.copy()))
            hit = scene.ray_test(rays)
            drjit.eval(hit)
            return ~np.asarray(hit)

        return free

    return build


def warp_tracer() -> Build:
    """NVIDIA Warp's mesh queries, on the GPU where there is one."""
    warp = _library("warp")
    warp.config.log_level = warp.LOG_ERROR  # else it says what it found and compiled
    warp.init()
    far = 1e10  # beyond anything in trace space, where a mesh has size 1

    @no_type_check  # Warp reads its source, which nothing may wrap
    def meets(mesh: warp.uint64, origins: Any, directions: Any, hit: Any):
        i = warp.tid()
        hit[i] = warp.mesh_query_ray(mesh, origins[i], directions[i], far).result

    vectors = warp.array(dtype=warp.vec3)
    meets.__annotations__ = {"mesh": warp.uint64, "origins": vectors, "directions": vectors}
    meets.__annotations__["hit"] = warp.array(dtype=warp.bool)
    kernel = warp.Kernel(meets)

    def build(vertices: np.ndarray, faces: np.ndarray) -> Free:
        points = warp.array(vertices.astype(np.float32), dtype=warp.vec3)
        mesh = warp.Mesh(points=points, indices=warp.array(faces.astype(np.int32).ravel(), dtype=warp.int32))

        def free(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
            hit = warp.zeros(len(origins), dtype=warp.bool)
            rays = (warp.array(array, dtype=warp.vec3) for array in (origins, directions))
            warp.launch(kernel, dim=len(origins), inputs=[mesh.id, *rays, hit])
            return ~hit.numpy()

        return free

    return build


TRACERS: dict[str, Callable[[], Build]] = {
    "trimesh": trimesh_tracer,
    "open3d": open3d_tracer,
    "mitsuba": mitsuba_tracer,
    "warp": warp_tracer,
}
