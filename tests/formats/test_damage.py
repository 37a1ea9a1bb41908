"""Files of every format, with all that their readers know, cut and overwritten: a mesh or one line, in no time."""

import base64
import json
import time
from pathlib import Path

import numpy as np
import pytest

from gash_jax.formats.meshes import READERS, read_mesh
from gash_jax.geometry.mesh import Mesh, MeshError
from tests.geometry.mesh_files import (
    CUBE,
    CUBE_FACES,
    CUBE_QUADS,
    Gltf,
    obj,
    off,
    ply_ascii,
    ply_binary,
    stl_ascii,
    stl_binary,
)

POLYGONS = [*CUBE_QUADS, [0, 1, 3, 2, 6, 4], [0, 2, 6, 4, 5], [0, 1]]


def _scene() -> Gltf:
    """A cube with a sparse morph target, thrice by instances, beside a strip and lines."""
    file = Gltf()
    cube = file.primitive(CUBE, CUBE_FACES, CUBE - 0.5)
    at, values = file.add(np.array([2, 3], "<u1"), "SCALAR"), file.add(np.ones((2, 3), "<f4"), "VEC3")
    views = [file.document["accessors"].pop()["bufferView"] for _ in (values, at)][::-1]
    sparse = {
        "count": 2,
        "indices": {"bufferView": views[0], "componentType": 5121},
        "values": {"bufferView": views[1]},
    }
    file.document["accessors"].append({"componentType": 5126, "count": 8, "type": "VEC3", "sparse": sparse})
    cube["targets"] = [{"POSITION": len(file.document["accessors"]) - 1}]
    strip = file.primitive(CUBE[:4], [0, 1, 2, 3], mode=5)
    lines = file.primitive(CUBE[:2], [0, 1], mode=1)
    placed = {"TRANSLATION": file.add(np.arange(9, dtype="<f4").reshape(3, 3), "VEC3")}
    placed["ROTATION"] = file.add(np.tile(np.array([[0, 0, 0, 1]], "<f4"), (3, 1)), "VEC4")
    node = {"mesh": 0, "scale": [1, 2, 3], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": placed}}}
    file.document |= {
        "meshes": [{"primitives": [cube], "weights": [0.5]}, {"primitives": [strip, lines]}],
        "nodes": [{"children": [1, 2], "matrix": np.eye(4).ravel().tolist()}, node, {"mesh": 1}],
        "scenes": [{"nodes": [0]}],
        "extensionsUsed": ["EXT_mesh_gpu_instancing"],
    }
    return file


def _text(file: Gltf) -> bytes:
    uri = "data:application/octet-stream;base64," + base64.b64encode(file.binary).decode()
    return json.dumps({**file.document, "buffers": [{"byteLength": len(file.binary), "uri": uri}]}).encode()


FILES = {
    "ascii.ply": ply_ascii(CUBE, POLYGONS, CUBE - 0.5),
    "little.ply": ply_binary(CUBE, POLYGONS, "<", CUBE - 0.5),
    "big.ply": ply_binary(CUBE, POLYGONS, ">"),
    "a.obj": b"vn 0 0 1\nvt 0 0\n" + obj(CUBE, POLYGONS).replace(b"f 1 2 4 3", b"f 1/1/1 2//1 4/ 3/1"),
    "a.off": off(CUBE, POLYGONS),
    "ascii.stl": stl_ascii(CUBE[CUBE_FACES]),
    "binary.stl": stl_binary(CUBE[CUBE_FACES]) + b"more",
    "scene.glb": _scene().glb(),
    "scene.gltf": _text(_scene()),
}


@pytest.mark.parametrize("name", FILES)
def test_whole_files_are_read(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(FILES[name])
    assert isinstance(read_mesh(tmp_path / name)[0], Mesh)


@pytest.mark.parametrize("name", FILES)
def test_damage_is_one_line_or_harmless(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    rng, data = np.random.default_rng(sum(FILES[name])), FILES[name]
    refused, slowest = 0, 0.0
    for trial in range(200):
        damaged = bytearray(data)
        for place in rng.integers(0, len(data), size=rng.integers(1, 6)):
            damaged[place] = rng.integers(256) if trial % 2 else damaged[place] ^ (1 << int(rng.integers(8)))
        (tmp_path / name).write_bytes(damaged[: rng.integers(len(data))] if trial % 5 == 0 else damaged)
        start = time.process_time()
        try:
            mesh, report = read_mesh(tmp_path / name)
            assert mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)
            assert all("\n" not in line for line in report.lines())
        except MeshError as error:
            assert "\n" not in str(error) and name in str(error)
            refused += 1
        slowest = max(slowest, time.process_time() - start)
    assert refused > 20 and slowest < 2.0
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", FILES)
def test_files_cut_anywhere(name: str, tmp_path: Path) -> None:
    """Every fiftieth place or so: a mesh (of what a text file says so far) or one line."""
    for length in range(1, len(FILES[name]), max(len(FILES[name]) // 50, 1)):
        (tmp_path / name).write_bytes(FILES[name][:length])
        try:
            read_mesh(tmp_path / name)
            assert name.endswith(("obj", "ply", "off", "stl"))
        except MeshError as error:
            assert "\n" not in str(error)


def test_numbers_that_ask_for_all_memory(tmp_path: Path) -> None:
    """Counts of thousands of millions are refused before anything is made for them."""
    huge = {
        "a.ply": ply_ascii(CUBE, CUBE_QUADS).replace(b"vertex 8", b"vertex 8000000000"),
        "b.ply": ply_binary(CUBE, CUBE_QUADS).replace(b"face 6", b"face 6000000000"),
        "a.off": off(CUBE, CUBE_QUADS).replace(b"8 6 0", b"8000000000 6000000000 0"),
        "b.off": off(CUBE, CUBE_QUADS).replace(b"4 0 1 3 2", b"4000000000 0 1 3 2"),
        "a.stl": stl_binary(CUBE[CUBE_FACES])[:80] + b"\xff\xff\xff\xff" + stl_binary(CUBE[CUBE_FACES])[84:],
        "a.gltf": _text(_scene()).replace(
            b'"count": 8, "type": "VEC3", "sparse"', b'"count": 8000000000, "type": "VEC3", "sparse"'
        ),
        "a.obj": obj(CUBE, CUBE_QUADS).replace(b"f 1 2", b"f 99999999999999999999 2"),
    }
    for name, data in huge.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(MeshError):
            read_mesh(tmp_path / name)


def test_every_format_is_damaged() -> None:
    assert {Path(name).suffix for name in FILES} == set(READERS)
