import base64
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from gash_jax.formats.gltf import read_gltf
from gash_jax.formats.meshes import read_mesh
from gash_jax.geometry.mesh import MeshError, vector_areas
from gash_jax.shapes.primitives import icosphere
from tests.geometry.mesh_files import CUBE, CUBE_FACES, Gltf, glb, tempting_mesh
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


def _volume(raw) -> float:
    vectors = vector_areas(raw.vertices.astype(np.float64), raw.faces)
    return float(np.einsum("fi,fi->", vectors, raw.vertices[raw.faces].mean(axis=1)) / 3)


def _cubes(attributes: dict[str, np.ndarray], mode: dict | None = None, **more) -> Gltf:
    """A cube and a triangle strip of two faces, both instanced within a node that is moved."""
    file = Gltf()
    kinds = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3", "_ID": "SCALAR"}
    placed = {k: file.add(v, kinds[k], **(mode or {} if k == "ROTATION" else {})) for k, v in attributes.items()}
    strip = file.primitive([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [0, 1, 2, 3], mode=5)
    primitives = [file.primitive(CUBE, CUBE_FACES, CUBE - 0.5), strip]
    file.document |= {
        "meshes": [{"primitives": primitives}],
        "nodes": [
            {"mesh": 0, "translation": [0, 10, 0], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": placed}}}
        ],
        "extensionsUsed": ["EXT_mesh_gpu_instancing"],
        **more,
    }
    return file


@pytest.mark.parametrize("packed", [False, True])
def test_instances_in_order_with_all_their_places(packed: bool) -> None:
    """Three instances of two primitives: turned, stretched, mirrored; required or not, rotations packed or not."""
    turn = Rotation.from_rotvec(np.pi / 2 * np.array([[0, 0, 0], [0, 1, 0], [0, 2, 0]]))
    quaternions = turn.as_quat()
    translation, scale = np.array([[0, 0, 0], [5, 0, 0], [0, 0, 7]]), np.array([[1, 1, 1], [1, 2, 3], [-1, 1, 1]])
    attributes = {"TRANSLATION": translation.astype("<f4"), "SCALE": scale.astype("<f4")}
    attributes["ROTATION"] = np.rint(32767 * quaternions).astype("<i2") if packed else quaternions.astype("<f4")
    more = {"extensionsRequired": ["EXT_mesh_gpu_instancing"]} if packed else {}
    raw = read_gltf(_cubes(attributes, {"normalized": True} if packed else {}, **more).glb(), HERE)
    own = np.concatenate([CUBE, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]])
    expected = np.concatenate([turn[i].apply(own * scale[i]) + translation[i] + [0, 10, 0] for i in range(3)])
    np.testing.assert_allclose(raw.vertices, expected, atol=1e-3 if packed else 1e-5)
    faces = np.concatenate([CUBE_FACES, np.array([[0, 1, 2], [1, 3, 2]]) + 8])
    np.testing.assert_array_equal(raw.faces[14:28], faces + 12)
    np.testing.assert_array_equal(raw.faces[28:], faces[:, ::-1] + 24)  # mirrored
    assert raw.normals is not None and raw.notes == ()
    tilted = turn[1].apply((CUBE - 0.5) / [1, 2, 3])
    np.testing.assert_allclose(raw.normals[12:20], tilted / np.linalg.norm(tilted, axis=1)[:, None], atol=1e-4)


def test_instances_by_translation_alone_and_by_none() -> None:
    """Volume 4 and face count of four cubes; attributes of other names only count the instances."""
    for name, values in (("TRANSLATION", np.arange(12, dtype="<f4").reshape(4, 3)), ("_ID", np.zeros((4, 1), "<f4"))):
        raw = read_gltf(_cubes({name: values}).glb(), HERE)
        assert _volume(raw._replace(faces=raw.faces.reshape(4, 14, 3)[:, :12].reshape(-1, 3))) == pytest.approx(4)
    raw = read_gltf(_cubes({"TRANSLATION": np.zeros((0, 3), "<f4")}).glb(), HERE)
    assert len(raw.faces) == 0


def test_instances_that_do_not_fit_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    uneven = {"TRANSLATION": np.zeros((2, 3), "<f4"), "SCALE": np.ones((3, 3), "<f4")}
    with pytest.raises(MeshError, match="different lengths"):
        read_gltf(_cubes(uneven).glb(), HERE)
    monkeypatch.setattr("gash_jax.formats.gltf.MOST_VERTICES", 23)
    with pytest.raises(MeshError, match="more than 23 vertices"):
        read_gltf(_cubes({"TRANSLATION": np.zeros((2, 3), "<f4")}).glb(), HERE)
    file = _cubes({"TRANSLATION": np.zeros((1, 3), "<f4")})
    file.document["nodes"][0]["skin"] = 0
    with pytest.raises(MeshError, match="skinned mesh with instances"):
        read_gltf(file.glb(), HERE)


def _morphing(node: dict, mesh: dict, normals: bool = True, sparse: bool = False) -> Gltf:
    """A cube with two targets: the top moved up by 1 and its normals turned to the side; everything moved along x."""
    file = Gltf()
    up = np.zeros((8, 3), "<f4")
    up[[2, 3, 6, 7], 1] = 1
    along = np.tile(np.array([[3, 0, 0]], "<f4"), (8, 1))
    primitive = file.primitive(CUBE, CUBE_FACES, np.tile([0, 1.0, 0], (8, 1)) if normals else None)
    targets = [{"POSITION": file.add(up, "VEC3")}, {"POSITION": file.add(along, "VEC3")}]
    if normals:
        targets[0]["NORMAL"] = file.add(np.tile(np.array([[0, -1, 1]], "<f4"), (8, 1)), "VEC3")
    if sparse:
        at, values = file.add(np.array([2, 3, 6, 7], "<u1"), "SCALAR"), file.add(up[[2, 3, 6, 7]], "VEC3")
        views = [file.document["accessors"].pop()["bufferView"] for _ in (values, at)][::-1]
        entry = file.document["accessors"][targets[0]["POSITION"]]
        del entry["bufferView"]
        places = {"bufferView": views[0], "componentType": 5121}
        entry["sparse"] = {"count": 4, "indices": places, "values": {"bufferView": views[1]}}
    file.document |= {
        "meshes": [{"primitives": [primitive | {"targets": targets}], **mesh}],
        "nodes": [{"mesh": 0, **node}],
    }
    return file


@pytest.mark.parametrize("sparse", [False, True])
def test_default_morph_weights_are_applied(sparse: bool) -> None:
    """Half the first target: height 1.5; those of the node come before those of the mesh."""
    note = "morph targets with default weights: applied, the shape is not the base shape"
    for node, mesh in (({}, {"weights": [0.5, 0]}), ({"weights": [0.5, 0]}, {"weights": [7, 7]})):
        raw = read_gltf(_morphing(node, mesh, sparse=sparse).glb(), HERE)
        assert _volume(raw) == pytest.approx(1.5) and np.ptp(raw.vertices[:, 1]) == 1.5
        assert raw.normals is not None and raw.notes == (note,)
        np.testing.assert_allclose(raw.normals, np.tile([0, 0.5**0.5, 0.5**0.5], (8, 1)), atol=1e-6)
    both = read_gltf(_morphing({"scale": [1, 2, 1]}, {"weights": [1, 2]}, normals=False, sparse=sparse).glb(), HERE)
    np.testing.assert_allclose(both.vertices, (CUBE * [1, 2, 1] + [6, 0, 0]) * [1, 2, 1], atol=1e-6)


@pytest.mark.parametrize("weights", [{}, {"weights": []}, {"weights": [0, 0.0]}])
def test_targets_without_weight_change_nothing(weights: dict) -> None:
    raw = read_gltf(_morphing({}, weights).glb(), HERE)
    np.testing.assert_array_equal(raw.vertices, CUBE)
    np.testing.assert_array_equal(raw.normals, np.tile([0, 1, 0], (8, 1)))
    assert raw.notes == ()


def test_quantised_positions_and_normals() -> None:
    """KHR_mesh_quantization: bytes and shorts, normalised or not, in rows of four bytes; required by the file."""
    file = Gltf()
    rows = np.zeros((8, 4), "<u1")
    rows[:, :3] = 255 * CUBE.astype(int)
    position = file.add(rows, "VEC3", normalized=True)
    file.document["bufferViews"][-1]["byteStride"] = 4
    normal = file.add(np.pad(np.rint(127 * (2 * CUBE - 1)).astype("i1"), ((0, 0), (0, 1))).view("<u1"), "VEC3")
    file.document["accessors"][normal] |= {"componentType": 5120, "normalized": True}
    file.document["bufferViews"][-1]["byteStride"] = 4
    plain = file.add(np.pad((9 * CUBE).astype("<i2"), ((0, 0), (0, 1))), "VEC3")
    file.document["bufferViews"][-1]["byteStride"] = 8
    indices = file.add(np.ravel(CUBE_FACES).astype("<u2"), "SCALAR")
    primitives = [{"attributes": {"POSITION": position, "NORMAL": normal}, "indices": indices}]
    primitives += [{"attributes": {"POSITION": plain}, "indices": indices}]
    file.document |= {"meshes": [{"primitives": primitives}], "nodes": [{"mesh": 0, "scale": [2, 2, 2]}]}
    file.document |= {"extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"]}
    raw = read_gltf(file.glb(), HERE)
    np.testing.assert_array_equal(raw.vertices, np.concatenate([2 * CUBE, 18 * CUBE]))
    assert raw.normals is not None and raw.notes == ()
    np.testing.assert_allclose(raw.normals[:8], (2 * CUBE - 1) / 3**0.5, atol=1e-6)


@pytest.mark.parametrize("spare", [b"\0", b"\0\0\0", b" \0"])
def test_documents_padded_with_zeros(spare: bytes) -> None:
    data = _document()
    size = int.from_bytes(data[12:16], "little")
    padded = data[20 : 20 + size].rstrip() + spare + b"\0" * 4
    head = data[:8] + (len(data) - size + len(padded)).to_bytes(4, "little") + len(padded).to_bytes(4, "little")
    raw = read_gltf(head + data[16:20] + padded + data[20 + size :], HERE)
    np.testing.assert_array_equal(raw.vertices, TRIANGLE[0])


def test_extensions_used_are_noted_if_they_may_change_what_is_seen() -> None:
    used = ["KHR_materials_unlit", "MSFT_lod", "KHR_texture_transform", "KHR_node_visibility", "KHR_lights_punctual"]
    raw = read_gltf(_document(extensionsUsed=used), HERE)
    assert [note.split()[3] for note in raw.notes] == ["MSFT_lod", "KHR_node_visibility"]
    assert all("is not read" in note for note in raw.notes)


@pytest.mark.parametrize(
    "name", ["KHR_materials_unlit", "KHR_texture_basisu", "EXT_texture_webp", "KHR_lights_punctual", "KHR_xmp_json_ld"]
)
def test_extensions_that_leave_the_shape_alone_may_be_required(name: str) -> None:
    raw = read_gltf(_document(extensionsUsed=[name], extensionsRequired=[name]), HERE)
    assert raw.notes == () and len(raw.faces) == 1


@pytest.mark.parametrize("name", ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_compressed_data_with_a_copy_in_the_open_are_read_without_it_refused(name: str) -> None:
    """Draco says so in the primitive, meshopt in the view, whose buffer is then left empty."""
    file = Gltf()
    primitive = file.primitive(*TRIANGLE)
    file.document |= {"meshes": [{"primitives": [primitive]}], "nodes": [{"mesh": 0}], "extensionsUsed": [name]}
    if "draco" in name:
        primitive["extensions"] = {name: {"bufferView": 0, "attributes": {"POSITION": 0}}}
    else:
        file.document["bufferViews"][0]["extensions"] = {name: {"buffer": 0, "byteOffset": 0}}
    raw = read_gltf(file.glb(), HERE)
    np.testing.assert_array_equal(raw.vertices, TRIANGLE[0])
    assert raw.notes == ()
    if "draco" in name:
        del file.document["accessors"][0]["bufferView"]
        data = file.glb()
    else:
        file.document["bufferViews"][0]["buffer"] = 1
        empty = b', {"byteLength": 36, "extensions": {"%s": {"fallback": true}}}' % name.encode()
        data = _with_json(file.glb(), lambda text: text[:-2] + empty + text[-2:])
    with pytest.raises(MeshError, match=f"compressed with {name}: export it without"):
        read_gltf(data, HERE)


def _with_json(data: bytes, change) -> bytes:
    """The file with another text in it."""
    size = int.from_bytes(data[12:16], "little")
    text = change(data[20 : 20 + size].rstrip())
    text += b" " * (-len(text) % 4)
    total = len(data) - size + len(text)
    return data[:8] + struct.pack("<II", total, len(text)) + data[16:20] + text + data[20 + size :]


def test_older_versions_and_wide_text_are_refused_by_their_names() -> None:
    old = {"asset": {"version": "1.0"}, "nodes": {"a": {"meshes": ["b"]}}, "meshes": {"b": {}}}
    for document in (old, {"nodes": {"a": {}}}, old | {"asset": {}}):
        with pytest.raises(MeshError, match="a glTF 1.0 file"):
            read_gltf(json.dumps(document).encode(), HERE)
    with pytest.raises(MeshError, match="UTF-16"):
        read_gltf(json.dumps(old).encode("utf-16"), HERE)
    marked = b"\xef\xbb\xbf" + json.dumps({"asset": {"version": "2.1"}}).encode()
    assert len(read_gltf(marked, HERE).vertices) == 0


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (_document()[:-1], "cut off"),
        (_document()[:15], "cut off"),
        (b"glTF\x01\0\0\0" + _document()[8:], "a glTF 1.0 file, of another version than 2"),
        (b"glTF\x03\0\0\0" + _document()[8:], "another version"),
        (_document(extensionsRequired=["ACME_shape"]), "requires the glTF extension ACME_shape, which is not read"),
        (_document(extensionsRequired=["KHR_node_visibility"]), "requires the glTF extension KHR_node_visibility"),
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


def test_colours_are_linear_and_white_where_there_are_none() -> None:
    """COLOR_0 of four bytes and of three floats; of two primitives one without, twice in the scene."""
    file = Gltf()
    coloured, plain = file.primitive(*TRIANGLE), file.primitive(*TRIANGLE)
    packed = np.array([[255, 51, 0, 255], [0, 0, 0, 0], [255, 255, 255, 255]], np.uint8)
    coloured["attributes"]["COLOR_0"] = file.add(packed, "VEC4", normalized=True)
    file.document |= {"meshes": [{"primitives": [coloured, plain]}], "nodes": [{"mesh": 0}, {"mesh": 0}]}
    colors = read_gltf(file.glb(), HERE).colors
    expected = [[1, 0.2, 0], [0, 0, 0], [1, 1, 1], *np.ones((3, 3))]
    np.testing.assert_allclose(colors, expected * 2)  # type: ignore[arg-type]
    coloured["attributes"]["COLOR_0"] = file.add(np.full((3, 3), 0.25, "<f4"), "VEC3")
    np.testing.assert_allclose(read_gltf(file.glb(), HERE).colors[:3], 0.25)  # type: ignore[index]
    del coloured["attributes"]["COLOR_0"]
    assert read_gltf(file.glb(), HERE).colors is None
    coloured["attributes"]["COLOR_0"] = file.add(np.full((2, 3), 0.25, "<f4"), "VEC3")
    with pytest.raises(MeshError, match="do not fit"):
        read_gltf(file.glb(), HERE)
