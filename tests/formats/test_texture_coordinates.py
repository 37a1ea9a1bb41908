"""Texture coordinates come to the corners that they belong to, (u, v) with v downwards, and disturb nothing else."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from trimesh.visual import TextureVisuals

from gash_jax.formats.meshes import load_mesh, texture_coordinates
from gash_jax.formats.obj import read_obj
from gash_jax.formats.ply import read_ply
from tests.helpers.textured import SQUARE, SQUARE_OBJ, SQUARE_UV

THREE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def test_obj_by_hand(tmp_path: Path) -> None:
    (tmp_path / "square.obj").write_text(SQUARE_OBJ)
    found = texture_coordinates(tmp_path / "square.obj")
    assert found is not None
    np.testing.assert_array_equal(found, SQUARE_UV)
    np.testing.assert_array_equal(load_mesh(tmp_path / "square.obj").vertices, SQUARE.vertices)
    assert texture_coordinates(SQUARE) is None


def test_obj_corners_differ_at_one_vertex_and_polygons_are_cut_alike() -> None:
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.2 0.5 0\n" + "".join(f"vt 0.{i} 0.25\n" for i in range(1, 7))
    raw = read_obj((text + "f 1/1 2/2 3/3 4/4 5/5\nf 1/-1 2/1 3/1\nf -5//1 2 3/1\n").encode())
    assert raw.uv is not None and raw.uv.shape == (len(raw.faces), 3, 2)
    at_vertex = {0: 0.1, 1: 0.2, 2: 0.3, 3: 0.4, 4: 0.5}
    np.testing.assert_allclose(raw.uv[:3, :, 0], [[at_vertex[corner] for corner in face] for face in raw.faces[:3]])
    assert raw.uv[3, 0, 0] == 0.6 and raw.uv[3, 0, 1] == 0.75
    assert np.isnan(raw.uv[4, :2]).all() and np.isfinite(raw.uv[4, 2]).all()


@pytest.mark.parametrize("lines", ["vt 0 0\nvt x 1\nvt 0 1\n", "vt 0 0\nvt\nvt 0 1\n", "vt 0 0\n"])
def test_damaged_obj_coordinates_do_not_refuse_the_mesh(lines: str) -> None:
    raw = read_obj((THREE + lines + "f 1/1 2/2 3/3\n").encode())
    assert raw.faces.tolist() == [[0, 1, 2]] and raw.uv is not None and np.isnan(raw.uv).any()


def test_obj_with_one_number_has_v_0() -> None:
    raw = read_obj((THREE + "vt 0.5\nvt 0.25 0.5 0\nf 1/1 2/2 3/2\n").encode())
    assert raw.uv is not None
    np.testing.assert_array_equal(raw.uv[0], [[0.5, 1], [0.25, 0.5], [0.25, 0.5]])
    assert read_obj((THREE + "f 1 2 3\n").encode()).uv is None


@pytest.mark.parametrize("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v")])
def test_ply_of_vertices(names: tuple[str, str]) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "".join(f"property float {name}\n" for name in names) + "element face 1\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    raw = read_ply((head + "0 0 0 0.5 0.25\n1 0 0 1 0\n0 1 0 0 1\n3 0 2 1\n").encode())
    assert raw.uv is not None
    np.testing.assert_array_equal(raw.uv, [[[0.5, 0.75], [0, 0], [1, 1]]])


def test_ply_of_corners() -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 1\n"
    head += "property list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
    raw = read_ply((head + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3 8 0 0 1 0 1 1 0 1\n").encode())
    assert raw.uv is not None
    np.testing.assert_array_equal(raw.uv, SQUARE_UV)


def test_gltf_as_trimesh_writes_it_and_trimesh_itself(tmp_path: Path) -> None:
    from_below = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    visual = TextureVisuals(uv=from_below)
    mesh = trimesh.Trimesh(SQUARE.vertices, SQUARE.faces, visual=visual, process=False)
    mesh.export(tmp_path / "square.glb")
    for source in (mesh, tmp_path / "square.glb"):
        found = texture_coordinates(source)
        assert found is not None
        np.testing.assert_allclose(found, SQUARE_UV, atol=1e-6)
    plain = trimesh.Trimesh(SQUARE.vertices, SQUARE.faces, process=False)
    plain.export(tmp_path / "plain.glb")
    assert texture_coordinates(plain) is None and texture_coordinates(tmp_path / "plain.glb") is None


def test_gltf_with_coordinates_of_a_wrong_kind_is_still_read(tmp_path: Path) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 0}}]}],
        "buffers": [{"byteLength": 36, "uri": "points.bin"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    }
    (tmp_path / "points.bin").write_bytes(points.tobytes())
    (tmp_path / "wrong.gltf").write_text(json.dumps(document))
    assert texture_coordinates(tmp_path / "wrong.gltf") is None
    assert load_mesh(tmp_path / "wrong.gltf").faces.tolist() == [[0, 1, 2]]
