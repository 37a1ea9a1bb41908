"""Meshes of trimesh, and mesh formats without a reader of their own here, read by it in its order of vertices.

Nothing is merged or reordered (`process=False, maintain_order=True`); the meshes of a scene follow each other, each in
its place. Normals are left to be computed. trimesh needs another package for most of these formats; it is named where
it is missing.
"""

import io
import sys
import warnings
from typing import Any

import numpy as np

from gash_jax.formats.raw_mesh import RawMesh
from gash_jax.geometry.mesh import MeshError

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
            mesh = trimesh.load_scene(io.BytesIO(data), **options).to_mesh()
            vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    except ImportError:
        package = OTHERS[suffix]
        raise MeshError(f"{suffix} files are read by trimesh, which needs {package}: pip install {package}") from None
    except Exception:  # whatever the parsers of these formats raise
        raise MeshError(f"trimesh cannot read this {suffix} file: it is damaged, cut off or holds no mesh") from None
    return RawMesh(vertices, faces, None, (f"{suffix} is read by trimesh: vertices in its order, normals computed",))


def is_trimesh(value: object) -> bool:
    """Whether a value is a mesh or a scene of trimesh; does not import it: without it there is none."""
    trimesh = sys.modules.get("trimesh")
    return trimesh is not None and isinstance(value, trimesh.Trimesh | trimesh.Scene)


def from_trimesh(source: Any) -> RawMesh:
    """Vertices and faces of a trimesh.Trimesh, or of all meshes in a trimesh.Scene, each in its place.

    Normals are those that the mesh was given or that trimesh has computed already, else they are left to be computed.
    """
    import trimesh  # imported already: a value of its own was given

    source = source.to_mesh() if isinstance(source, trimesh.Scene) else source
    # as trimesh's own exporters ask; `vertex_normals` itself would compute them
    normals = np.asarray(source.vertex_normals) if "vertex_normals" in source._cache else None
    return RawMesh(np.asarray(source.vertices), np.asarray(source.faces), normals, ())
