"""Ray tracers under one interface, for the benchmarks: how each answers "is this ray free?" at its best.

A peer is built from a mesh in trace space and called with float32 origins and directions. embreex is ours, called
through `prt.visibility` from as many threads as there are cores; the others bring their own threads. A peer that is
not installed is left out (`pip install -e '.[peers]'` brings Open3D and Mitsuba; trimesh is always there).
"""

import importlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from gash_jax.files.cores import available_cores
from gash_jax.prt.visibility import visibility

Free = Callable[[np.ndarray, np.ndarray], np.ndarray]
CHUNK = 1 << 17


def embreex_peer(vertices: np.ndarray, faces: np.ndarray) -> Free:
    """Our own tracer on all cores."""
    visible = visibility(vertices, faces)

    def free(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        starts = range(0, len(origins), CHUNK)
        with ThreadPoolExecutor(available_cores()) as pool:
            parts = pool.map(lambda s: visible(origins[s : s + CHUNK], directions[s : s + CHUNK]), starts)
        return np.concatenate(list(parts))

    return free


def trimesh_peer(vertices: np.ndarray, faces: np.ndarray) -> Free:
    """trimesh.ray over the same Embree: a closest-hit query with copies in float64, one thread."""
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces, process=False, maintain_order=True)
    return lambda origins, directions: ~mesh.ray.intersects_any(origins, directions)


def open3d_peer(vertices: np.ndarray, faces: np.ndarray) -> Free:
    """Open3D's RaycastingScene.test_occlusions."""
    import open3d  # pyright: ignore[reportMissingImports]

    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))
    return lambda origins, directions: ~scene.test_occlusions(np.concatenate([origins, directions], 1)).numpy()


def mitsuba_peer(vertices: np.ndarray, faces: np.ndarray) -> Free:
    """Mitsuba 3, `ray_test` of its LLVM variant."""
    import drjit  # pyright: ignore[reportMissingImports]
    import mitsuba  # pyright: ignore[reportMissingImports]

    mitsuba.set_variant("llvm_ad_rgb")
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


PEERS: dict[str, tuple[str, Callable[[np.ndarray, np.ndarray], Free]]] = {
    "embreex": ("embreex", embreex_peer),
    "trimesh.ray": ("trimesh", trimesh_peer),
    "Open3D": ("open3d", open3d_peer),
    "Mitsuba 3": ("mitsuba", mitsuba_peer),
}


def installed_peers() -> dict[str, Callable[[np.ndarray, np.ndarray], Free]]:
    """Peers whose library can be imported here; the reason for each other one is printed."""
    os.environ.setdefault("EMBREE_NUM_THREADS", str(available_cores()))
    found = {}
    for name, (module, build) in PEERS.items():
        try:
            importlib.import_module(module)
        except (ImportError, OSError) as reason:
            print(f"{name}: left out ({reason})")
            continue
        found[name] = build
    return found
