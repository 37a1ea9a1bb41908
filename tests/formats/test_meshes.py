import struct
import time
from pathlib import Path

import numpy as np
import pytest

from gash_jax.formats.meshes import READERS, TO_Y_UP, load_mesh, read_mesh, save_mesh
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh, MeshError
from gash_jax.shapes.primitives import bumpy_sphere, icosphere
from tests.geometry.mesh_files import glb, obj, off, ply_ascii, ply_binary, stl_ascii, stl_binary, tempting_mesh

VERTICES, FACES = tempting_mesh()
FILES = {
    "ascii.ply": ply_ascii(VERTICES, FACES),
    "little.ply": ply_binary(VERTICES, FACES, "<"),
    "big.PLY": ply_binary(VERTICES, FACES, ">"),
    "a.obj": obj(VERTICES, FACES),
    "a.off": off(VERTICES, FACES),
    "a.glb": glb(VERTICES, FACES),
    "ascii.stl": stl_ascii(VERTICES[FACES]),
    "binary.stl": stl_binary(VERTICES[FACES]),
}


@pytest.mark.parametrize("name", FILES)
def test_vertices_and_faces_are_those_of_the_file(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(FILES[name])
    mesh = load_mesh(tmp_path / name)
    is_stl = name.endswith("stl")
    np.testing.assert_array_equal(mesh.vertices, VERTICES[FACES].reshape(-1, 3) if is_stl else VERTICES)
    np.testing.assert_array_equal(mesh.faces, np.arange(15).reshape(-1, 3) if is_stl else FACES)
    save_mesh(tmp_path / "again.ply", mesh)
    for found, expected in zip(load_mesh(str(tmp_path / "again.ply")), mesh, strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-7)


@pytest.mark.parametrize(("up", "axis"), [("x", [1, 0, 0]), ("y", [0, 1, 0]), ("z", [0, 0, 1])])
def test_up_becomes_y_by_a_rotation(up: str, axis: list[int], tmp_path: Path) -> None:
    np.testing.assert_array_equal(TO_Y_UP[up] @ axis, [0, 1, 0])
    assert round(np.linalg.det(TO_Y_UP[up])) == 1
    mesh = bumpy_sphere(3)
    save_mesh(tmp_path / "a.ply", mesh)
    turned = load_mesh(tmp_path / "a.ply", up=up)
    np.testing.assert_allclose(turned.vertices, mesh.vertices @ TO_Y_UP[up].T, atol=1e-7)
    np.testing.assert_allclose(turned.normals, mesh.normals @ TO_Y_UP[up].T, atol=1e-6)
    np.testing.assert_array_equal(turned.faces, mesh.faces)


def test_hand_worked_axes() -> None:
    np.testing.assert_array_equal(TO_Y_UP["z"] @ [1, 2, 3], [1, 3, -2])
    np.testing.assert_array_equal(TO_Y_UP["x"] @ [1, 2, 3], [-2, 1, 3])


def test_reading_and_health_report_together(tmp_path: Path) -> None:
    ball = icosphere(1)
    text = obj(ball.vertices, [*ball.faces[:, ::-1].tolist(), [0, 1]])
    (tmp_path / "a.obj").write_bytes(text)
    mesh, report = read_mesh(tmp_path / "a.obj")
    assert report.lines()[0] == "1 polygon of fewer than three corners: left out"
    assert "flipped" in report.lines()[1] and len(report.lines()) == 2
    np.testing.assert_allclose(mesh.normals, ball.normals, atol=0.02)
    assert np.einsum("vi,vi->v", mesh.normals, ball.normals).min() > 0.99


def test_normals_of_an_obj_file_reach_the_mesh(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 0 -1\nvn 0 3 4\nf 1//1 2//1 3//1\n"
    (tmp_path / "a.obj").write_text(text)
    mesh, report = read_mesh(tmp_path / "a.obj")
    np.testing.assert_allclose(mesh.normals, [[0, 0.6, 0.8]] * 3, atol=1e-7)
    assert report.normals == "file"
    np.testing.assert_allclose(load_mesh(tmp_path / "a.obj", up="z").normals, [[0, 0.8, -0.6]] * 3, atol=1e-7)


TRIANGLE = np.eye(3), [[0, 1, 2]]
BAD = {
    "text.ply": (b"this is not a mesh\n", "not a PLY file"),
    "text.stl": (b"this is not a mesh\n", "neither"),
    "text.off": (b"this is not a mesh\n", "not an ASCII OFF file"),
    "text.obj": (b"this is not a mesh\n", "no vertices"),
    "text.glb": (b"this is not a mesh\n", "not a readable GLB file"),
    "text.gltf": (b"[1, 2]", "not a readable GLTF file"),
    "zero.ply": (b"", "the file is empty"),
    "empty.ply": (ply_ascii(np.zeros((0, 3)), []), "no vertices"),
    "points.ply": (ply_ascii(np.eye(3), []), "no faces"),
    "points.obj": (obj(np.eye(3), []), "no faces"),
    "points.off": (off(np.eye(3), []), "no faces"),
    "empty.stl": (stl_binary([]), "no vertices"),
    "nothing.gltf": (b"{}", "no vertices"),
    "nan.ply": (ply_ascii([[np.nan, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), "not finite"),
    "nan.obj": (obj([[np.inf, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), "not finite"),
    "range.ply": (ply_binary(np.eye(3), [[0, 1, 3]]), "does not exist"),
    "range.obj": (obj(np.eye(3), [[0, 1, 3]]), "does not exist"),
    "zero.obj": (obj(np.eye(3), [[0, 1, -1]]), "does not exist"),
    "negative.off": (off(np.eye(3), [[0, 1, -1]]), "does not exist"),
    "range.glb": (glb(np.eye(3), [[0, 1, 3]]), "does not exist"),
    "point.ply": (ply_ascii(np.ones((3, 3)), [[0, 1, 2]]), "no size"),
    "cut.ply": (ply_binary(*TRIANGLE)[:-9], "cut off"),
    "cut.stl": (stl_binary([np.eye(3)])[:-1], "cut off"),
    "cut.glb": (glb(*TRIANGLE)[:-1], "cut off"),
    "json.glb": (glb(*TRIANGLE).replace(b'"nodes"', b'"nodes ', 1), "not a readable GLB file"),
    "key.glb": (glb(*TRIANGLE).replace(b'"POSITION"', b'"POSITIOM"'), "not a readable GLB file"),
    "index.glb": (glb(*TRIANGLE).replace(b'"mesh": 0', b'"mesh": 9'), "not a readable GLB file"),
    "a.xyz": (b"1 2 3", r"unknown mesh format '.xyz', known are .ply .obj"),
    "a": (b"1 2 3", "unknown mesh format ''"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_give_one_line_that_names_them(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    content, message = BAD[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(MeshError, match=message) as caught:
        load_mesh(tmp_path / name)
    assert "\n" not in str(caught.value) and str(tmp_path / name) in str(caught.value)
    assert caught.value.__context__ is None or caught.value.__suppress_context__
    assert capfd.readouterr() == ("", "")


def test_what_is_no_file(tmp_path: Path) -> None:
    for missing in ("none.ply", "none/none.glb"):
        with pytest.raises(MeshError, match="no such file"):
            load_mesh(tmp_path / missing)
    with pytest.raises(MeshError, match="is a folder"):
        load_mesh(tmp_path)
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(MeshError, match="is a folder"):
        load_mesh(tmp_path / "folder.ply")
    with pytest.raises(MeshError, match="up axis 'w': choose one of x, y, z"):
        load_mesh(tmp_path / "none.ply", up="w")
    with pytest.raises(MeshError, match=r"written as \.ply"):
        save_mesh(tmp_path / "a.obj", bumpy_sphere(2))
    assert not (tmp_path / "a.obj").exists()


@pytest.mark.parametrize("name", FILES)
def test_damaged_bytes_never_end_in_another_error(name: str, tmp_path: Path) -> None:
    """A few bytes overwritten or missing: a mesh or a MeshError; no other error, and no warning."""
    rng = np.random.default_rng(sum(FILES[name]))
    path, failed = tmp_path / name, 0
    for _ in range(60):
        data = bytearray(FILES[name])
        for place in rng.integers(0, len(data), size=rng.integers(1, 6)):
            data[place] = rng.integers(0, 256)
        path.write_bytes(data[: rng.integers(1, len(data))] if rng.random() < 0.3 else data)
        try:
            assert isinstance(load_mesh(path), Mesh)
        except MeshError as error:
            assert "\n" not in str(error)
            failed += 1
    assert failed > 0


def test_a_huge_number_of_corners_is_no_huge_array(tmp_path: Path) -> None:
    data = ply_binary(*TRIANGLE)
    size = data.index(struct.pack("<hB", -3, 3)) + 2
    (tmp_path / "a.ply").write_bytes(data[:size] + b"\xff" + data[size + 1 :])
    with pytest.raises(MeshError, match="cut off"):
        load_mesh(tmp_path / "a.ply")


def test_every_known_extension_is_tested() -> None:
    names = [*FILES, *BAD]
    assert {Path(name).suffix.lower() for name in names} - {".xyz", ""} == set(READERS)


def test_large_text_files_are_read_in_arrays(tmp_path: Path) -> None:
    """120 thousand lines of text in little more time than the checks of the mesh take."""
    mesh = bumpy_sphere(64)
    (tmp_path / "a.obj").write_bytes(obj(mesh.vertices, mesh.faces))
    start = time.process_time()
    again = load_mesh(tmp_path / "a.obj")
    reading = time.process_time() - start
    np.testing.assert_array_equal(again.vertices, mesh.vertices)
    np.testing.assert_array_equal(again.faces, mesh.faces)
    start = time.process_time()
    prepare_mesh(mesh.vertices, mesh.faces)
    assert reading < 4 * (time.process_time() - start)
