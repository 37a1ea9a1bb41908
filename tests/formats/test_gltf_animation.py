"""Skins, morph targets and moving nodes of glTF files, on files built here and on a real character."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from gash_jax import load_animation, load_mesh
from gash_jax.formats.gltf_animation import clip_names, moves, read_gltf_animation
from gash_jax.geometry.mesh import MeshError
from gash_jax.shapes.primitives import icosphere
from tests.geometry.mesh_files import Gltf
from tests.helpers.shared_data import shared_file

BALL = icosphere(1)
V = len(BALL.vertices)
TURN = Rotation.from_euler("z", 90, degrees=True)


class Clip:
    """Channels of one clip, added to a file."""

    def __init__(self, file: Gltf, name: str) -> None:
        self.file, self.entry = file, {"name": name, "samplers": [], "channels": []}
        file.document.setdefault("animations", []).append(self.entry)

    def move(self, node: int, path: str, keys: list[float], values: object, mode: str = "LINEAR") -> None:
        array = np.asarray(values, "<f4")
        kind = {"rotation": "VEC4", "weights": "SCALAR"}.get(path, "VEC3")
        times = self.file.add(np.asarray(keys, "<f4"), "SCALAR")
        output = self.file.add(array.reshape(-1) if kind == "SCALAR" else array, kind)
        self.entry["samplers"].append({"input": times, "output": output, "interpolation": mode})
        self.entry["channels"].append(
            {"sampler": len(self.entry["samplers"]) - 1, "target": {"node": node, "path": path}}
        )


def _save(tmp_path: Path, file: Gltf, nodes: list[dict], roots: list[int]) -> Path:
    file.document |= {"nodes": nodes, "scenes": [{"nodes": roots}], "scene": 0}
    path = tmp_path / "scene.glb"
    path.write_bytes(file.glb())
    return path


def _arm(file: Gltf, weights: np.ndarray, **more: object) -> dict:
    """A ball bound to two joints."""
    primitive = file.primitive(BALL.vertices, BALL.faces, BALL.normals, **more)
    joints = np.tile(np.array([[0, 1, 0, 0]], "<u1"), (V, 1))
    shares = np.concatenate([weights, np.zeros((V, 2))], axis=1).astype("<f4")
    primitive["attributes"] |= {"JOINTS_0": file.add(joints, "VEC4"), "WEIGHTS_0": file.add(shares, "VEC4")}
    return primitive


SHARES = np.stack([(BALL.vertices[:, 0] < 0), (BALL.vertices[:, 0] >= 0)], axis=1).astype(float)


RAISED = np.array([0, 2, 0])


def _skinned(tmp_path: Path, shares: np.ndarray = SHARES) -> Path:
    """Nodes: 0 the skinned ball, 1 the upper joint, 2 the lower one, which bends about the middle of the ball.

    At rest the whole skeleton stands RAISED over where it was bound.
    """
    file = Gltf()
    file.document["meshes"] = [{"primitives": [_arm(file, shares)]}]
    bind = np.stack([np.eye(4), np.eye(4)])
    bind[0, :3, 3] = [1, 0, 0]
    file.document["skins"] = [
        {
            "joints": [1, 2],
            "inverseBindMatrices": file.add(bind.transpose(0, 2, 1).reshape(2, 16).astype("<f4"), "MAT4"),
        }
    ]
    clip = Clip(file, "bend")
    clip.move(2, "rotation", [0.0, 1.0], [[0, 0, 0, 1], TURN.as_quat()])
    Clip(file, "walk").move(1, "translation", [0.0, 0.5], [[-1, 0, 0], [-1, 0, 4]])
    nodes = [
        {"mesh": 0, "skin": 0, "translation": [50, 0, 0]},  # which does not count
        {"name": "upper", "translation": [-1, 2, 0], "children": [2]},
        {"translation": [1, 0, 0]},
    ]
    return _save(tmp_path, file, nodes, [0, 1])


def test_a_joint_that_bends_by_hand(tmp_path: Path) -> None:
    path = _skinned(tmp_path)
    animation = load_animation(path)
    assert animation.names == ("upper", "node 2") and len(animation) == 2
    np.testing.assert_array_equal(animation.mesh.vertices, load_mesh(path).vertices)
    np.testing.assert_allclose(animation.frame(0), BALL.vertices + RAISED, atol=1e-6)
    bent = np.where(SHARES[:, :1] == 1, BALL.vertices, TURN.apply(BALL.vertices))
    np.testing.assert_allclose(animation.frame(1), bent + RAISED, atol=1e-6)
    half = read_gltf_animation(path, "bend", np.array([0.5])).frame(0)
    eighth = Rotation.from_euler("z", 45, degrees=True).apply(BALL.vertices)
    np.testing.assert_allclose(half, np.where(SHARES[:, :1] == 1, BALL.vertices, eighth) + RAISED, atol=1e-6)


def test_clips_are_chosen_by_name(tmp_path: Path) -> None:
    path = _skinned(tmp_path)
    assert clip_names(path) == ["bend", "walk"] and moves(path)
    walk = load_animation(path, clip="walk")
    np.testing.assert_allclose(walk.frame(1), BALL.vertices + [0, 0, 4], atol=1e-6)
    assert walk.seconds is not None and walk.seconds.tolist() == [0.0, 0.5]
    with pytest.raises(MeshError, match="no clip is called 'run': the file has bend, walk"):
        load_animation(path, clip="run")


def test_weights_of_a_skin_are_made_to_sum_to_1(tmp_path: Path) -> None:
    animation = load_animation(_skinned(tmp_path, 2 * SHARES))
    assert "divided by their sum" in animation.notes[0]
    np.testing.assert_allclose(animation.frame(0), BALL.vertices + RAISED, atol=1e-6)
    with pytest.raises(MeshError, match="no usable weights of bones"):
        load_animation(_skinned(tmp_path, 0 * SHARES))


def _morphed(tmp_path: Path, animated: bool, defaults: list[float]) -> Path:
    """A ball under a node that is turned and twice as large, with two targets."""
    file = Gltf()
    targets = [
        {"POSITION": file.add(np.tile(np.array([way], "<f4"), (V, 1)), "VEC3")} for way in ([1, 0, 0], [0, 1, 0])
    ]
    mesh = {"primitives": [file.primitive(BALL.vertices, BALL.faces, targets=targets)], "weights": defaults}
    file.document["meshes"] = [mesh | {"extras": {"targetNames": ["right", "up"]}}]
    if animated:
        Clip(file, "nod").move(0, "weights", [0.0, 1.0], [[0, 0], [1, 0.5]])
    node = {"mesh": 0, "rotation": TURN.as_quat().tolist(), "scale": [2, 2, 2], "name": "head"}
    return _save(tmp_path, file, [node], [0])


def test_morph_targets_move_in_the_scene(tmp_path: Path) -> None:
    animation = load_animation(_morphed(tmp_path, True, [0, 0]))
    assert animation.names == ("right", "up", "head")
    rest = 2 * TURN.apply(BALL.vertices)
    np.testing.assert_allclose(animation.frame(0), rest, atol=1e-5)
    np.testing.assert_allclose(animation.frame(1), rest + 2 * TURN.apply([1, 0.5, 0]), atol=1e-5)


def test_weights_count_from_those_of_the_rest(tmp_path: Path) -> None:
    path = _morphed(tmp_path, True, [0.25, 1])
    animation = load_animation(path)
    np.testing.assert_allclose(animation.mesh.vertices, load_mesh(path).vertices)
    np.testing.assert_allclose(animation.shape_weights, [[-0.25, -1], [0.75, -0.5]], atol=1e-6)
    np.testing.assert_allclose(animation.frame(0), 2 * TURN.apply(BALL.vertices), atol=1e-5)


def test_without_a_clip_every_target_by_itself(tmp_path: Path) -> None:
    path = _morphed(tmp_path, False, [0, 0])
    animation = load_animation(path)
    assert len(animation) == 3 and animation.seconds is None and moves(path) and clip_names(path) == []
    np.testing.assert_allclose(animation.frame(2) - animation.frame(0), [2 * TURN.apply([0, 1, 0])] * V, atol=1e-5)


def test_nodes_move_their_meshes_and_what_hangs_from_them(tmp_path: Path) -> None:
    file = Gltf()
    file.document["meshes"] = [{"primitives": [file.primitive(BALL.vertices, BALL.faces)]}]
    clip = Clip(file, "spin")
    clip.move(1, "rotation", [0.0, 1.0], [[0, 0, 0, 1], TURN.as_quat()])
    clip.move(1, "scale", [0.0, 2.0], [[1, 1, 1], [3, 3, 3]], "STEP")
    nodes = [{"mesh": 0, "translation": [5, 0, 0]}, {"children": [0], "translation": [0, 1, 0]}, {"mesh": 0}]
    animation = load_animation(_save(tmp_path, file, nodes, [1, 2]))
    assert animation.seconds is not None and animation.seconds.tolist() == [0, 1, 2]
    np.testing.assert_allclose(animation.frame(1)[:V], TURN.apply(BALL.vertices + [5, 0, 0]) + [0, 1, 0], atol=1e-5)
    np.testing.assert_allclose(animation.frame(2)[:V], 3 * TURN.apply(BALL.vertices + [5, 0, 0]) + [0, 1, 0], atol=1e-5)
    np.testing.assert_allclose(animation.frame(2)[V:], BALL.vertices, atol=1e-6)


def test_what_does_not_move_or_is_damaged_is_refused(tmp_path: Path) -> None:
    file = Gltf()
    file.document["meshes"] = [{"primitives": [file.primitive(BALL.vertices, BALL.faces)]}]
    still = _save(tmp_path, file, [{"mesh": 0}], [0])
    assert not moves(still)
    with pytest.raises(MeshError, match="nothing moves in it: it has no clip and no morph targets"):
        load_animation(still)
    Clip(file, "back").move(0, "translation", [1.0, 0.5], [[0, 0, 0], [1, 0, 0]])
    with pytest.raises(MeshError, match="keys of a glTF clip do not rise in time"):
        load_animation(_save(tmp_path, file, [{"mesh": 0}], [0]))
    file.document["animations"][0]["channels"][0]["sampler"] = 7
    with pytest.raises(MeshError, match="its skins, morph targets or clips cannot be read"):
        load_animation(_save(tmp_path, file, [{"mesh": 0}], [0]))


def test_a_clip_that_holds_no_numbers_is_refused_by_its_frame(tmp_path: Path) -> None:
    file = Gltf()
    file.document["meshes"] = [{"primitives": [file.primitive(BALL.vertices, BALL.faces)]}]
    Clip(file, "lost").move(0, "translation", [0.0, 1.0], [[0, 0, 0], [np.nan, 0, 0]])
    with pytest.raises(MeshError, match="42 vertices of frame 0 are not finite"):
        load_animation(_save(tmp_path, file, [{"mesh": 0}], [0]))


def test_a_mesh_squeezed_flat_at_rest_is_refused(tmp_path: Path) -> None:
    file = Gltf()
    file.document["meshes"] = [{"primitives": [file.primitive(BALL.vertices, BALL.faces)]}]
    Clip(file, "grow").move(0, "scale", [0.0, 1.0], [[1, 0, 1], [1, 1, 1]])
    with pytest.raises(MeshError, match="squeezed flat at rest"):
        load_animation(_save(tmp_path, file, [{"mesh": 0, "scale": [1, 0, 1]}], [0]))


def test_a_real_character_walks_as_another_program_has_it() -> None:
    path = shared_file("animated/CesiumMan.glb")
    with np.load(shared_file("animated/cesium_man_walk.npz")) as arrays:
        verts, times = arrays["verts"], arrays["times"].astype(np.float64)
    animation = read_gltf_animation(path, None, times[1:])  # frame 0 is the rest, whose time is -1
    same = KDTree(verts[0]).query(animation.mesh.vertices)[1]
    np.testing.assert_allclose(animation.mesh.vertices, verts[0][same], atol=1e-6)
    # where the other program merged vertices that differ in the rest by rounding, both belong to one place
    for number, points in enumerate(animation.frames(), 1):
        np.testing.assert_allclose(points, verts[number][same], atol=2e-6)
