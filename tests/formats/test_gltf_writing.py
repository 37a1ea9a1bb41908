"""Writing .glb files: read back by our reader, by trimesh, by Khronos' validator and by three.js."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from gash_jax.formats.gltf import read_gltf
from gash_jax.formats.gltf_document import open_document
from gash_jax.formats.gltf_writing import Attribute, attach, mesh_glb, open_glb, texture_sets
from gash_jax.geometry.mesh import Mesh, MeshError
from gash_jax.shapes.primitives import icosphere
from tests.geometry.mesh_files import Gltf, tempting_mesh
from tests.helpers.node import run_node, validator_errors

BALL = icosphere(1)
COUNT = len(BALL.vertices)
RNG = np.random.default_rng(6)


def attributes(count: int, kind: str = "<i2") -> list[Attribute]:
    values = RNG.integers(-100, 100, size=(2, count, 4)) if kind[1] == "i" else RNG.normal(size=(2, count, 4))
    return [Attribute(f"_SH{i}", block.astype(kind)) for i, block in enumerate(values)]


def scene() -> Gltf:
    """Two primitives of one mesh, one with textures, that two nodes show; a material; points; a third node apart."""
    file = Gltf()
    first = file.primitive(BALL.vertices, BALL.faces, BALL.normals, material=0)
    first["attributes"]["TEXCOORD_0"] = file.add(RNG.uniform(size=(COUNT, 2)).astype("<f4"), "VEC2")
    points = {**file.primitive(BALL.vertices, [[0, 1, 2]]), "mode": 0}
    second = file.primitive(BALL.vertices + 3, BALL.faces, BALL.normals)
    for primitive in (first, points, second):
        low = file.document["accessors"][primitive["attributes"]["POSITION"]]
        positions = BALL.vertices + 3 if primitive is second else BALL.vertices
        low |= {"min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}
    file.document |= {
        "meshes": [{"primitives": [first, points, second], "extras": {"kept": 1}}],
        "materials": [{"name": "red", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}],
        "nodes": [{"mesh": 0}, {"mesh": 0, "translation": [9, 0, 0]}, {"name": "empty"}],
        "scenes": [{"nodes": [0, 1, 2]}],
        "scene": 0,
    }
    return file


def accessors(content: bytes, name: str) -> list[np.ndarray]:
    """Values of an attribute, primitive by primitive of the scene's nodes."""
    document = open_document(content, Path())
    meshes = [document.json["meshes"][node["mesh"]] for node in document.json["nodes"] if "mesh" in node]
    found = [primitive["attributes"].get(name) for mesh in meshes for primitive in mesh["primitives"]]
    return [document.values(index) for index in found if index is not None]


def test_a_mesh_of_its_own_comes_back(tmp_path: Path) -> None:
    vertices, faces = tempting_mesh()
    normals = np.zeros_like(vertices)
    normals[1:] = [0, 0, 1]
    glb, places = mesh_glb(Mesh(vertices, normals, faces.astype(np.int32)))
    given = attributes(len(vertices))
    attach(glb, places, given, {"gash": {"scale": [1.0]}})
    (tmp_path / "a.glb").write_bytes(glb.content())
    raw = read_gltf(glb.content(), tmp_path)
    np.testing.assert_array_equal(raw.vertices, vertices)
    np.testing.assert_array_equal(raw.faces, faces)
    assert raw.normals is not None and raw.normals[0].tolist() == [0, 1, 0]
    np.testing.assert_allclose(accessors(glb.content(), "_SH1")[0], given[1].values / 32767)
    assert validator_errors(tmp_path / "a.glb") == []


def test_trimesh_reads_vertices_and_attributes() -> None:
    glb, places = mesh_glb(BALL)
    given = attributes(COUNT, "<f4")
    attach(glb, places, given, {})
    loaded: Any = trimesh.load(io.BytesIO(glb.content()), file_type="glb", process=False, maintain_order=True)
    (found,) = loaded.geometry.values()
    np.testing.assert_array_equal(found.vertices.astype(np.float32), BALL.vertices)
    np.testing.assert_array_equal(found.vertex_attributes["_SH0"], given[0].values)


@pytest.mark.parametrize("count", [65535, 65536])
def test_indices_have_as_many_bits_as_they_need(count: int) -> None:
    points = RNG.normal(size=(count, 3)).astype(np.float32)
    faces = np.array([[0, 1, count - 1]], np.int32)
    content = mesh_glb(Mesh(points, np.ones_like(points), faces))[0].content()
    document = open_document(content, Path()).json
    kinds = [document["accessors"][p["indices"]]["componentType"] for m in document["meshes"] for p in m["primitives"]]
    assert kinds == [5123 if count == 65535 else 5125]
    np.testing.assert_array_equal(read_gltf(content, Path()).faces, faces)


@pytest.mark.parametrize("kind", ["<f4", "<i2", "<i1"])
def test_a_scene_keeps_what_it_has(kind: str, tmp_path: Path) -> None:
    before = scene().glb()
    (tmp_path / "scene.glb").write_bytes(before)
    glb, places = open_glb(tmp_path / "scene.glb")
    assert [(place.node, place.primitive, place.size) for place in places] == [
        *((0, 0, COUNT), (0, 2, COUNT)),
        *((1, 0, COUNT), (1, 2, COUNT)),
    ]
    given = attributes(4 * COUNT, kind)
    attach(glb, places, given, {"gash": {"scale": [2.0]}})
    after = glb.content()
    (tmp_path / "after.glb").write_bytes(after)
    old, new = (open_document(content, tmp_path).json for content in (before, after))
    assert new["materials"] == old["materials"] and new["scenes"] == old["scenes"]
    assert [mesh["extras"] for mesh in new["meshes"]] == 2 * [{"kept": 1, "gash": {"scale": [2.0]}}]
    one, two = read_gltf(before, tmp_path), read_gltf(after, tmp_path)
    np.testing.assert_array_equal(one.vertices, two.vertices)
    np.testing.assert_array_equal(one.faces, two.faces)
    for attribute in given:
        most = 1 if kind == "<f4" else np.iinfo(kind).max
        found = np.concatenate(accessors(after, attribute.name))
        np.testing.assert_allclose(found, attribute.values / most, rtol=1e-6)
    np.testing.assert_array_equal(accessors(after, "TEXCOORD_0")[0], accessors(before, "TEXCOORD_0")[0])
    assert validator_errors(tmp_path / "after.glb") == []


def test_sets_of_texture_coordinates_are_continuous(tmp_path: Path) -> None:
    (tmp_path / "scene.glb").write_bytes(scene().glb())
    glb, places = open_glb(tmp_path / "scene.glb")
    assert texture_sets(glb, places) == 1
    pairs = [Attribute("TEXCOORD_1", RNG.integers(0, 255, size=(4 * COUNT, 2)).astype("<u1"))]
    attach(glb, places, pairs, {})
    (tmp_path / "after.glb").write_bytes(glb.content())
    sets = accessors(glb.content(), "TEXCOORD_0")
    assert len(sets) == 4 and not sets[1].any() and sets[0].any()
    np.testing.assert_allclose(np.concatenate(accessors(glb.content(), "TEXCOORD_1")), pairs[0].values / 255)
    assert validator_errors(tmp_path / "after.glb") == []


def test_three_reads_attributes_and_extras(tmp_path: Path) -> None:
    """GLTFLoader of three.js; names are lower case there."""
    glb, places = mesh_glb(BALL)
    given = attributes(COUNT)
    attach(glb, places, given, {"gash": {"scale": [0.5, 2.0]}})
    (tmp_path / "ball.glb").write_bytes(glb.content())
    script = """
    globalThis.self = globalThis;
    const { GLTFLoader } = await import(require.resolve('three/examples/jsm/loaders/GLTFLoader.js'));
    const data = fs.readFileSync(process.argv[2]);
    const bytes = data.buffer.slice(data.byteOffset, data.byteOffset + data.length);
    const gltf = await new GLTFLoader().parseAsync(bytes, '');
    let found;
    gltf.scene.traverse((node) => { if (node.isMesh) found = node; });
    const attribute = found.geometry.attributes._sh1;
    const row = (i) => [0, 1, 2, 3].map((c) => attribute.getComponent(i, c));
    const values = Array.from({ length: attribute.count }, (_, i) => row(i));
    console.log(JSON.stringify({ extras: found.userData, normalized: attribute.normalized, values }));
    """
    found = run_node(script, tmp_path / "ball.glb")
    assert found["normalized"] and found["extras"]["gash"] == {"scale": [0.5, 2.0]}
    np.testing.assert_allclose(found["values"], given[1].values / 32767, atol=1e-7)


def test_the_validator_finds_what_is_wrong(tmp_path: Path) -> None:
    glb, places = mesh_glb(BALL)
    attach(glb, places, [Attribute("SH0", np.zeros((COUNT, 4), "<f4"))], {})  # no underscore
    glb.document["accessors"][0].pop("min")
    (tmp_path / "bad.glb").write_bytes(glb.content())
    assert len(validator_errors(tmp_path / "bad.glb")) >= 2


def _broken(change) -> bytes:
    file = scene()
    change(file.document)
    return file.glb()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["nodes"][1].update(extensions={"EXT_mesh_gpu_instancing": {"attributes": {}}}), "has instances"),
        (lambda d: d.update(images=[{"uri": "red.png"}]), "keeps red.png in another file"),
        (lambda d: d["nodes"][0].update(mesh=7), "not a readable GLB file"),
        (
            lambda d: d["meshes"][0]["primitives"][0].update(extensions={"KHR_draco_mesh_compression": {}}),
            "compressed with KHR_draco_mesh_compression",
        ),
    ],
)
def test_scenes_that_cannot_be_added_to_are_refused(change, message: str, tmp_path: Path) -> None:
    (tmp_path / "scene.glb").write_bytes(_broken(change))
    with pytest.raises(MeshError, match=message):
        open_glb(tmp_path / "scene.glb")


def test_what_is_no_glb_or_has_no_faces_is_refused(tmp_path: Path) -> None:
    (tmp_path / "scene.glb").write_text(json.dumps(scene().document))
    with pytest.raises(MeshError, match=r"is no \.glb file"):
        open_glb(tmp_path / "scene.glb")
    with pytest.raises(MeshError, match=r"has no faces, so it makes no \.glb"):
        mesh_glb(Mesh(BALL.vertices, BALL.normals, np.zeros((0, 3), np.int32)))
