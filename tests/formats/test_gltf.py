import base64
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from gash_jax.formats.gltf import read_gltf
from gash_jax.formats.meshes import read_mesh
from gash_jax.geometry.mesh import MeshError, vector_areas
from gash_jax.shapes.primitives import icosphere
from tests.geometry.mesh_files import Gltf, glb, tempting_mesh
from tests.helpers.shared_data import shared_file

HERE = Path()
BALL = icosphere(1)
TRIANGLE = np.eye(3, dtype=np.float32), [[0, 1, 2]]


def test_order_is_sacred() -> None:
    vertices, faces = tempting_mesh()
    raw = read_gltf(glb(vertices, faces), HERE)
    np.testing.assert_array_equal(raw.vertices, vertices)
    np.testing.assert_array_equal(raw.faces, faces)
    assert raw.normals is not None and not raw.normals.any()


def _scene(nodes: list[dict], roots: list[int], meshes: int = 2) -> bytes:
    """Mesh k is a ball moved by 10 k along z, with normals."""
    file = Gltf()
    shift = [np.array([0, 0, 10.0 * k]) for k in range(meshes)]
    primitives = [file.primitive(BALL.vertices + s, BALL.faces, BALL.normals) for s in shift]
    file.document |= {"meshes": [{"primitives": [p]} for p in primitives], "nodes": nodes}
    file.document |= {"scenes": [{"nodes": []}, {"nodes": roots}], "scene": 1}
    return file.glb()


def test_depth_first_order_and_places() -> None:
    """Node 2 > (node 0 > node 3), node 1; node 4 is in no scene."""
    turn = Rotation.from_euler("z", 90, degrees=True)
    nodes = [
        {"children": [3], "translation": [1, 0, 0]},
        {"mesh": 0, "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 7, 8, 9, 1]},  # column by column: x -> y
        {"children": [0, 1], "rotation": turn.as_quat().tolist(), "scale": [2, 2, 2]},
        {"mesh": 1, "translation": [0, 1, 0]},
        {"mesh": 0},
    ]
    raw = read_gltf(_scene(nodes, [2]), HERE)
    first = turn.apply(BALL.vertices + [1, 1, 10]) * 2
    second = turn.apply(turn.apply(BALL.vertices) + [7, 8, 9]) * 2
    np.testing.assert_allclose(raw.vertices, np.concatenate([first, second]), atol=1e-5)
    np.testing.assert_array_equal(raw.faces, np.concatenate([BALL.faces, BALL.faces + len(BALL.vertices)]))
    assert raw.normals is not None
    np.testing.assert_allclose(raw.normals[: len(BALL.vertices)], turn.apply(BALL.normals), atol=1e-6)


def test_every_use_of_a_mesh_counts_and_scenes_are_optional() -> None:
    data = _scene([{"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]}, {"children": [1]}], [0, 2])
    raw = read_gltf(data, HERE)
    np.testing.assert_allclose(raw.vertices, np.concatenate([BALL.vertices, BALL.vertices + [5, 0, 0]]), atol=1e-6)
    bare = read_gltf(data.replace(b'"scenes"', b'"screen"'), HERE)  # then all roots: nodes 0 and 2
    np.testing.assert_array_equal(bare.vertices, raw.vertices)


@pytest.mark.parametrize("scale", [[1, 2, 5], [-1, 1, 1], [-1, -2, -3], [1, -3, -2]])
def test_stretched_and_mirrored_nodes(scale: list[float]) -> None:
    """Faces stay outward, normals stay at right angles to the surface."""
    raw = read_gltf(_scene([{"mesh": 0, "scale": scale}], [0]), HERE)
    vectors = vector_areas(raw.vertices.astype(np.float64), raw.faces)
    assert np.all(np.einsum("fi,fi->f", vectors, raw.vertices[raw.faces].mean(axis=1)) > 0)
    exact = raw.vertices / np.square(scale)  # gradient of the ellipsoid
    assert raw.normals is not None
    np.testing.assert_allclose(raw.normals, exact / np.linalg.norm(exact, axis=1, keepdims=True), atol=1e-5)


@pytest.mark.parametrize("inverse_bind", [True, False])
def test_skinned_mesh_in_its_bind_pose(inverse_bind: bool) -> None:
    """A z-up figure under a root that turns it up; the second joint is bent, its node moved: neither shows."""
    file = Gltf()
    stand = Rotation.from_euler("x", -90, degrees=True)
    bind = np.eye(4)
    bind[:3, 3] = [0, 0, -3]  # the root joint sits at z = 3 of the stored mesh
    primitive = file.primitive(BALL.vertices, BALL.faces)
    skin: dict = {"joints": [2, 1]}
    if inverse_bind:
        skin["inverseBindMatrices"] = file.add(np.stack([np.eye(4) * 99, bind.T]).astype("<f4"), "MAT4")
    file.document |= {
        "meshes": [{"primitives": [primitive]}],
        "skins": [skin],
        "nodes": [
            {"rotation": stand.as_quat().tolist(), "children": [1]},
            {"translation": [0, 0, 3], "children": [2]},
            {"rotation": [0, 0, 1, 0]},
            {"mesh": 0, "skin": 0, "translation": [50, 50, 50]},
        ],
        "scenes": [{"nodes": [0, 3]}],
    }
    expected = BALL.vertices if inverse_bind else BALL.vertices + [0, 0, 3]
    np.testing.assert_allclose(read_gltf(file.glb(), HERE).vertices, stand.apply(expected), atol=1e-6)


def test_real_skinned_figure() -> None:
    """The same points as in the rest pose worked out apart, where vertices at one position are merged."""
    mesh, _ = read_mesh(shared_file("animated/CesiumMan.glb"))
    with np.load(shared_file("animated/cesium_man_walk.npz")) as arrays:
        rest = arrays["verts"][0]
    assert len(mesh.vertices) == 3273 and len(mesh.faces) == 4672
    assert KDTree(rest).query(mesh.vertices)[0].max() < 1e-6
    assert KDTree(mesh.vertices).query(rest)[0].max() < 1e-6


@pytest.mark.parametrize(
    ("mode", "expected"), [(5, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]), (6, [[0, 1, 2], [0, 2, 3], [0, 3, 4]])]
)
def test_strips_and_fans(mode: int, expected: list) -> None:
    file = Gltf()
    primitive = file.primitive(np.arange(15).reshape(5, 3), [0, 1, 2, 3, 4], mode=mode)
    lines = file.primitive(np.ones((2, 3)), [0, 1], mode=1)
    file.document |= {"meshes": [{"primitives": [lines, primitive]}], "nodes": [{"mesh": 0}]}
    raw = read_gltf(file.glb(), HERE)
    np.testing.assert_array_equal(raw.faces, expected)
    assert raw.notes == ("1 primitive of points or lines: left out",) and len(raw.vertices) == 5
    del primitive["indices"]
    np.testing.assert_array_equal(read_gltf(file.glb(), HERE).faces, expected)


def test_strides_sparse_and_normalised_integers() -> None:
    file = Gltf()
    interleaved = np.arange(24, dtype="<f4").reshape(4, 6)
    position = file.add(interleaved, "VEC3")
    file.document["bufferViews"][-1]["byteStride"] = 24
    at, values = file.add(np.array([2], "<u1"), "SCALAR"), file.add(np.array([[7, 7, 7]], "<f4"), "VEC3")
    views = [file.document["accessors"].pop()["bufferView"] for _ in (values, at)][::-1]
    file.document["accessors"][position]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": views[0], "componentType": 5121},
        "values": {"bufferView": views[1]},
    }
    normal = file.add(
        np.array([[32767, 0, 0], [0, -32767, 0], [0, 0, -32768], [0, 0, 0]], "<i2"), "VEC3", normalized=True
    )
    primitive = {
        "attributes": {"POSITION": position, "NORMAL": normal},
        "indices": file.add(np.array([0, 1, 2], "<u4"), "SCALAR"),
    }
    file.document |= {"meshes": [{"primitives": [primitive]}], "nodes": [{"mesh": 0}]}
    raw = read_gltf(file.glb(), HERE)
    np.testing.assert_array_equal(raw.vertices, [[0, 1, 2], [6, 7, 8], [7, 7, 7], [18, 19, 20]])
    np.testing.assert_array_equal(raw.normals, [[1, 0, 0], [0, -1, 0], [0, 0, -1], [0, 0, 0]])


@pytest.mark.parametrize("embedded", [True, False])
def test_text_form(embedded: bool, tmp_path: Path) -> None:
    file = Gltf()
    file.document |= {"meshes": [{"primitives": [file.primitive(*TRIANGLE)]}], "nodes": [{"mesh": 0}]}
    uri = "data:application/octet-stream;base64," + base64.b64encode(file.binary).decode() if embedded else "a%20b.bin"
    file.document["buffers"] = [{"byteLength": len(file.binary), "uri": uri}]
    text = json.dumps(file.document).encode()
    if not embedded:
        with pytest.raises(MeshError, match="missing: put it beside"):
            read_gltf(text, tmp_path)
        (tmp_path / "a b.bin").write_bytes(file.binary)
    np.testing.assert_array_equal(read_gltf(text, tmp_path).vertices, TRIANGLE[0])


def _document(**changes) -> bytes:
    file = Gltf()
    file.document |= {"meshes": [{"primitives": [file.primitive(*TRIANGLE)]}], "nodes": [{"mesh": 0}]}
    file.document["scenes"] = [{"nodes": [0]}]
    file.document |= changes
    return file.glb()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (_document()[:-1], "cut off"),
        (_document()[:15], "cut off"),
        (b"glTF\x01\0\0\0" + _document()[8:], "another version"),
        (_document(extensionsRequired=["KHR_draco_mesh_compression"]), "compressed with KHR_draco"),
        (_document(nodes=[{"mesh": 0, "children": [0]}]), "two parents"),
        (_document(nodes=[{"mesh": 0, "skin": 0}, {}], skins=[{"joints": [1]}]), "skeleton"),
        (_document().replace(b'"count": 3, "type": "VEC3"', b'"count": 9, "type": "VEC3"'), "outside its buffers"),
        (_document().replace(b'"byteLength": 44}]', b'"byteLength": 99}]'), "shorter"),
    ],
)
def test_bad_files(data: bytes, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_gltf(data, HERE)
