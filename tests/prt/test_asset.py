"""Transfers as .glb files: whole scenes, vertices that are split, seams."""

from pathlib import Path

import numpy as np
import pytest

from gash_jax.formats.animations import load_animation
from gash_jax.formats.gltf import read_gltf
from gash_jax.formats.gltf_document import open_document
from gash_jax.geometry.mesh import Mesh, MeshError, RawMesh
from gash_jax.prt.asset import weld_map, write_asset
from gash_jax.prt.transfer import Transfer
from gash_jax.shapes.primitives import icosphere
from tests.formats.test_gltf_writing import accessors, scene
from tests.geometry.mesh_files import Gltf
from tests.helpers.node import validator_errors
from tests.helpers.shared_data import shared_file

BALL = icosphere(1)
RNG = np.random.default_rng(7)


def transfer(mesh: Mesh, bands: int = 4) -> Transfer:
    return Transfer(RNG.normal(size=(len(mesh.vertices), bands**2)).astype(np.float32), None, *mesh, {})


def mesh_of(raw: RawMesh) -> Mesh:
    assert raw.normals is not None
    return Mesh(raw.vertices.astype(np.float32), raw.normals.astype(np.float32), raw.faces.astype(np.int32))


def coefficients(path: Path, count: int) -> np.ndarray:
    blocks = [np.concatenate(accessors(path.read_bytes(), f"_SH{i}")) for i in range(-(-count // 4))]
    return np.concatenate(blocks, axis=1)[:, :count]


def split_glb(mesh: Mesh) -> bytes:
    """Every face with its own three vertices and its flat normal."""
    corners = mesh.vertices[mesh.faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = np.repeat(flat / np.linalg.norm(flat, axis=1, keepdims=True), 3, axis=0)
    file = Gltf()
    primitive = file.primitive(corners.reshape(-1, 3), np.arange(3 * len(corners)), flat)
    box = {"min": corners.min(axis=(0, 1)).tolist(), "max": corners.max(axis=(0, 1)).tolist()}
    file.document["accessors"][primitive["attributes"]["POSITION"]] |= box
    file.document |= {"meshes": [{"primitives": [primitive]}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}
    return file.glb()


@pytest.mark.parametrize("bands", [1, 2, 3, 4])
def test_a_transfer_makes_its_own_file(bands: int, tmp_path: Path) -> None:
    given = transfer(BALL, bands)
    asset = write_asset(tmp_path / "a.glb", given, None, "sh", "float", None)
    assert asset.vertices == len(BALL.vertices) and asset.error < 1e-6
    np.testing.assert_array_equal(coefficients(tmp_path / "a.glb", bands**2), given.coefficients)
    np.testing.assert_array_equal(read_gltf((tmp_path / "a.glb").read_bytes(), tmp_path).vertices, BALL.vertices)


def test_a_scene_that_was_baked_gets_each_vertex_its_own(tmp_path: Path) -> None:
    """Two primitives of a mesh that two nodes show: four blocks of vertices, each in its own place."""
    (tmp_path / "scene.glb").write_bytes(scene().glb())
    given = transfer(mesh_of(read_gltf((tmp_path / "scene.glb").read_bytes(), tmp_path)))
    write_asset(tmp_path / "out.glb", given, tmp_path / "scene.glb", "sh", "float", None)
    np.testing.assert_array_equal(coefficients(tmp_path / "out.glb", 16), given.coefficients)
    assert validator_errors(tmp_path / "out.glb") == []


def test_split_vertices_get_the_row_of_their_file_vertex(tmp_path: Path) -> None:
    (tmp_path / "split.glb").write_bytes(split_glb(BALL))
    given = transfer(BALL)
    asset = write_asset(tmp_path / "out.glb", given, tmp_path / "split.glb", "sh", "float", tmp_path / "map.npz")
    assert asset.vertices == 3 * len(BALL.faces)
    np.testing.assert_allclose(
        coefficients(tmp_path / "out.glb", 16), given.coefficients[BALL.faces.ravel()], atol=1e-6
    )
    saved = np.load(tmp_path / "map.npz")
    np.testing.assert_array_equal(saved["file_vertex"], BALL.faces.ravel())
    np.testing.assert_array_equal(saved["file_vertex"][saved["engine_vertex"]], np.arange(len(BALL.vertices)))


def test_seams_get_equal_coefficients(tmp_path: Path) -> None:
    """The ball twice over in one file, with noise between the copies: their mean at both."""
    twice = Mesh(np.concatenate(2 * [BALL.vertices]), np.concatenate(2 * [BALL.normals]), BALL.faces)
    given = transfer(twice, 3)
    write_asset(tmp_path / "out.glb", given, None, "sh", "float", tmp_path / "map.npz")
    found = coefficients(tmp_path / "out.glb", 9)
    first, second = np.split(found, 2)
    np.testing.assert_array_equal(first, second)
    np.testing.assert_allclose(first, sum(np.split(given.coefficients, 2)) / 2, atol=1e-6)


def test_the_map_by_hand() -> None:
    arrays = weld_map(np.array([2, 0, 2]), 4)
    assert arrays["file_vertex"].tolist() == [2, 0, 2] and arrays["engine_vertex"].tolist() == [1, -1, 0, -1]


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (icosphere(2), r"the transfer has 162 vertices and .*split\.glb 240: bake .* or give --weld map\.npz"),
        (
            Mesh(np.zeros((240, 3), np.float32), np.zeros((240, 3), np.float32), BALL.faces),
            "are not where those of the transfer are",
        ),
    ],
)
def test_another_mesh_is_refused_and_nothing_written(mesh: Mesh, message: str, tmp_path: Path) -> None:
    (tmp_path / "split.glb").write_bytes(split_glb(BALL))
    with pytest.raises(MeshError, match=message):
        write_asset(tmp_path / "out.glb", transfer(mesh), tmp_path / "split.glb", "sh", "float", None)
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.parametrize("store", ["short", "byte"])
def test_skins_and_clips_are_kept(store: str, tmp_path: Path) -> None:
    source = shared_file("animated/CesiumMan.glb")
    before = open_document(source.read_bytes(), source.parent).json
    given = transfer(mesh_of(read_gltf(source.read_bytes(), source.parent)))
    asset = write_asset(tmp_path / "man.glb", given, source, "sh", store, None)
    after = open_document((tmp_path / "man.glb").read_bytes(), tmp_path).json
    for name in ("skins", "animations", "materials", "textures", "images", "samplers", "nodes", "scenes"):
        assert after[name] == before[name]
    one, two = load_animation(source), load_animation(tmp_path / "man.glb")
    np.testing.assert_array_equal(one.transforms, two.transforms)
    assert asset.error < {"short": 2e-4, "byte": 4e-2}[store]
    assert validator_errors(tmp_path / "man.glb") == []
