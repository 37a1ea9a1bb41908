"""Meshes of trimesh, and mesh formats without a reader of their own here, read by it in its order of vertices.

Nothing is merged or reordered (`process=False, maintain_order=True`); the meshes of a scene follow each other, each in
its place. trimesh needs another package for most of these formats; it is named where it is missing.
"""

import io
import sys
import warnings
from typing import Any

import numpy as np
from jaxtyping import Float

from gash_jax.formats.colors import linear_rgb
from gash_jax.geometry.mesh import MeshError, RawMesh

# suffix and the package that trimesh needs for it
OTHERS = {
    **{".3mf": "lxml", ".3dxml": "lxml", ".xaml": "lxml", ".dae": "pycollada", ".zae": "pycollada"},
    **{".step": "cascadio", ".stp": "cascadio"},
}


def read_other(data: bytes, suffix: str) -> RawMesh:
    """All triangles in a file of one of the formats in `OTHERS`. Raises MeshError, also where a package is missing."""
    import trimesh  # here, as nothing else needs it: importing it takes as long as reading a mesh

    options = {"file_type": suffix[1:], "process": False, "maintain_order": True}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            raw = from_trimesh(trimesh.load_scene(io.BytesIO(data), **options))
    except ImportError:
        package = OTHERS[suffix]
        raise MeshError(f"{suffix} files are read by trimesh, which needs {package}: pip install {package}") from None
    except Exception:  # whatever the parsers of these formats raise
        raise MeshError(f"trimesh cannot read this {suffix} file: it is damaged, cut off or holds no mesh") from None
    normals = "computed" if raw.normals is None else "as it found them"
    return raw._replace(notes=(f"{suffix} is read by trimesh: vertices in its order, normals {normals}",))


def is_trimesh(value: object) -> bool:
    """Whether a value is a mesh or a scene of trimesh; does not import it: without it there is none."""
    trimesh = sys.modules.get("trimesh")
    return trimesh is not None and isinstance(value, trimesh.Trimesh | trimesh.Scene)


def from_trimesh(source: Any) -> RawMesh:
    """Vertices and faces of a trimesh.Trimesh, or of all meshes in a trimesh.Scene in its order, each in its place.

    Normals are those that the meshes were given or that trimesh has computed already; unless all have some, they are
    left to be computed. Of a single mesh the colours of the vertices are read as well, which trimesh holds in sRGB, and
    their texture coordinates, which it counts from below.
    """
    import trimesh  # imported already: a value of its own was given

    if isinstance(source, trimesh.Trimesh):
        arrays = np.asarray(source.vertices), np.asarray(source.faces), _own_normals(source)
        return RawMesh(*arrays, colors=_own_colors(source), uv=_own_uv(source))
    placed = [
        (source.geometry[name], np.asarray(place)) for place, name in map(source.graph.get, source.graph.nodes_geometry)
    ]
    meshes = [(mesh, place) for mesh, place in placed if isinstance(mesh, trimesh.Trimesh)]
    vertices, faces, normals, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], [np.zeros((0, 3))], 0
    for mesh, place in meshes:
        linear, own = place[:3, :3], _own_normals(mesh)
        mirrored = np.linalg.det(linear) < 0  # turns faces inside out
        vertices.append(mesh.vertices @ linear.T + place[:3, 3])
        faces.append((mesh.faces[:, ::-1] if mirrored else mesh.faces) + count)
        normals.append(np.zeros((0, 3)) if own is None else own @ np.linalg.pinv(linear))
        count += len(mesh.vertices)
    known = len(np.concatenate(normals)) == count
    return RawMesh(np.concatenate(vertices), np.concatenate(faces), np.concatenate(normals) if known else None)


def _own_normals(mesh: Any) -> Float[np.ndarray, "v 3"] | None:
    # as trimesh's own exporters ask; `vertex_normals` itself would compute them
    return np.asarray(mesh.vertex_normals) if "vertex_normals" in mesh._cache else None


def _own_colors(mesh: Any) -> Float[np.ndarray, "v 3"] | None:
    if mesh.visual.kind != "vertex":
        return None
    return linear_rgb(np.asarray(mesh.visual.vertex_colors)[:, :3] / 255)


def _own_uv(mesh: Any) -> Float[np.ndarray, "f 3 2"] | None:
    uv = getattr(mesh.visual, "uv", None)
    if uv is None or np.shape(uv) != (len(mesh.vertices), 2):
        return None
    return (np.asarray(uv, np.float64) * [1, -1] + [0, 1])[mesh.faces]
