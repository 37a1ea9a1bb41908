"""Triangles as PIFu's loader makes them, against a loader written like theirs, and what they are for."""

from pathlib import Path

import numpy as np
import pytest

from gash_jax.files.atomic import FileError
from gash_jax.formats.meshes import load_mesh
from gash_jax.light.pifu_faces import pifu_faces, triangles_of

MIXED = """# a quad, a triangle, a pentagon, a quad with textures and normals
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 2 1
vt 0 0\nvn 0 0 1
f 1 2 3 4
f 3 2 5
f 1 2 3 4 5
f 4/1/1 3/1/1 2/1/1 1/1/1
"""


def their_faces(text: str) -> np.ndarray:
    """lib/renderer/mesh.py, load_obj_mesh: four corners or more are the first four, (1, 2, 3) and (3, 4, 1)."""
    faces = []
    for line in text.splitlines():
        values = line.split()
        if values and values[0] == "f":
            corners = [int(value.split("/")[0]) - 1 for value in values[1:]]
            faces.append(corners[:3])
            if len(values) > 4:
                faces.append([corners[2], corners[3], corners[0]])
    return np.array(faces)


def test_faces_are_those_of_their_loader(tmp_path: Path) -> None:
    (tmp_path / "mixed.obj").write_text(MIXED)
    faces = pifu_faces(tmp_path / "mixed.obj", 5)
    np.testing.assert_array_equal(faces, their_faces(MIXED))
    assert faces[:3].tolist() == [[0, 1, 2], [2, 3, 0], [2, 1, 4]]
    ours = load_mesh(tmp_path / "mixed.obj").faces
    assert len(ours) != len(faces) or np.any(ours != faces), "our own cut would give the same"


def test_triangles_alone_are_kept() -> None:
    corners = np.arange(9)
    np.testing.assert_array_equal(triangles_of(corners, np.array([3, 3, 3])), corners.reshape(3, 3))
    assert triangles_of(np.arange(3), np.array([2, 1])).shape == (0, 3)


def test_another_mesh_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mixed.obj").write_text(MIXED)
    with pytest.raises(FileError, match="is not the mesh of 4 vertices that was baked"):
        pifu_faces(tmp_path / "mixed.obj", 4)
    with pytest.raises(FileError, match=r"read \.obj files"):
        pifu_faces(tmp_path / "mixed.ply", 5)
    with pytest.raises(FileError, match="no such file"):
        pifu_faces(tmp_path / "absent.obj", 5)
