"""The door for animations: what the forms of npz give, and what is refused in one line."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from gash_jax import load_animation
from gash_jax.files.npz import write_npz
from gash_jax.formats.animations import animation_form
from gash_jax.shapes.primitives import icosphere, plane
from tests.helpers.shared_data import shared_file

BALL = icosphere(1)
V = len(BALL.vertices)
RNG = np.random.default_rng(0)
VERTS = BALL.vertices + RNG.normal(scale=0.1, size=(4, V, 3)).astype(np.float32)
DELTA = RNG.normal(size=(3, V, 3)).astype(np.float32)
STILL = np.tile(np.eye(3, 4, dtype=np.float32), (5, 2, 1, 1))
RECORDED = {"verts": VERTS, "faces": BALL.faces}
SHAPES = {"base": BALL.vertices, "delta": DELTA, "faces": BALL.faces}
RIG = {"rest": BALL.vertices, "weights": np.full((V, 2), 0.5), "transforms": STILL, "faces": BALL.faces}


def written(tmp_path: Path, arrays: dict, **changes: object) -> Path:
    path = tmp_path / "animation.npz"
    kept = {name: array for name, array in (arrays | changes).items() if array is not None}
    np.savez(path, **kept)  # type: ignore[arg-type]
    return path


def test_recorded_frames(tmp_path: Path) -> None:
    path = written(tmp_path, RECORDED, times=np.arange(4) / 24)
    animation = load_animation(path)
    assert animation_form(path) == "recorded frames" and animation.names == ("frame",)
    np.testing.assert_array_equal(np.stack(list(animation.frames())), VERTS)
    np.testing.assert_array_equal(animation.mesh.vertices, VERTS[0])
    np.testing.assert_array_equal(animation.mesh.faces, BALL.faces)
    assert animation.seconds is not None
    np.testing.assert_allclose(animation.seconds, np.arange(4) / 24)
    assert animation.mesh.normals.any(axis=1).all()


def test_blendshapes_with_and_without_frames_of_their_own(tmp_path: Path) -> None:
    animation = load_animation(written(tmp_path, SHAPES, names=np.array(["smile", "frown", "blink"])))
    assert len(animation) == 4 and animation.names == ("smile", "frown", "blink")
    np.testing.assert_array_equal(animation.frame(0), BALL.vertices)
    np.testing.assert_allclose(animation.frame(2), BALL.vertices + DELTA[1], atol=1e-6)
    weights = RNG.random((6, 3))
    animation = load_animation(written(tmp_path, SHAPES, parameters=weights))
    assert animation.names == ("shape 0", "shape 1", "shape 2") and len(animation) == 6
    np.testing.assert_allclose(animation.shape_weights, weights, rtol=1e-6)
    np.testing.assert_allclose(animation.frame(4), BALL.vertices + np.tensordot(weights[4], DELTA, 1), atol=1e-5)


def test_a_rig(tmp_path: Path) -> None:
    moving = STILL.copy()
    moving[2, 1, :, 3] = [2, 0, 0]
    animation = load_animation(written(tmp_path, RIG, transforms=moving))
    assert len(animation) == 5 and animation.names == ("bone 0", "bone 1") and not animation.notes
    np.testing.assert_allclose(animation.frame(0), BALL.vertices, atol=1e-6)
    np.testing.assert_allclose(animation.frame(2), BALL.vertices + [1, 0, 0], atol=1e-6)
    np.testing.assert_array_equal(animation.transforms, moving)


def test_one_frame_is_fine_and_other_arrays_are_noted(tmp_path: Path) -> None:
    animation = load_animation(written(tmp_path, RECORDED, verts=VERTS[:1].astype(np.float64), uv=np.zeros((V, 2))))
    assert len(animation) == 1
    assert animation.notes == ("arrays that no animation has: uv, left out",)


def test_weights_off_1_are_noted(tmp_path: Path) -> None:
    animation = load_animation(written(tmp_path, RIG, weights=np.full((V, 2), 0.6)))
    assert "divided by their sum" in animation.notes[0]
    np.testing.assert_allclose(animation.frame(0), BALL.vertices, atol=1e-6)


@pytest.mark.parametrize("arrays", [RECORDED, SHAPES, RIG], ids=["recorded", "shapes", "rig"])
@pytest.mark.parametrize("up", ["x", "z"])
def test_another_axis_may_point_up(tmp_path: Path, arrays: dict, up: str) -> None:
    moving = STILL + RNG.normal(scale=0.2, size=STILL.shape) if "rest" in arrays else None
    path = written(tmp_path, arrays, **({"transforms": moving} if moving is not None else {}))
    plain, turned = load_animation(path), load_animation(path, up)
    matrix = {"x": np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]), "z": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])}[
        up
    ]
    np.testing.assert_allclose(turned.frame(2), plain.frame(2) @ matrix.T, atol=1e-5)
    np.testing.assert_allclose(turned.mesh.vertices, plain.mesh.vertices @ matrix.T, atol=1e-6)
    np.testing.assert_allclose(turned.mesh.normals, plain.mesh.normals @ matrix.T, atol=1e-5)


def test_a_long_recording_stays_in_its_file(tmp_path: Path) -> None:
    mesh = plane(1.0, 50)
    frames = np.tile(mesh.vertices, (200, 1, 1))
    np.savez(tmp_path / "long.npz", verts=frames, faces=mesh.faces)
    size = frames.nbytes
    del frames
    tracemalloc.start()
    animation = load_animation(tmp_path / "long.npz")
    last = animation.frame(199)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_array_equal(last, mesh.vertices)
    assert peak < size / 2


NAN = VERTS.copy()
NAN[2, 7, 1] = np.nan
REFUSED = {
    "nan in a frame": (RECORDED, {"verts": NAN}, "1 vertices of frame 2 are not finite (first: 7)"),
    "nan in the rest": (RECORDED, {"verts": NAN[2:]}, "1 of 42 vertices are not finite (first: 7)"),
    "no frames": (
        RECORDED,
        {"verts": VERTS[:0]},
        "'verts' holds float32 (0, 42, 3): give real numbers of shape (t, v, 3)",
    ),
    "no vertices": (RECORDED, {"verts": VERTS[:, :0]}, "give real numbers of shape (t, v, 3)"),
    "one frame without its axis": (RECORDED, {"verts": VERTS[0]}, "give real numbers of shape (t, v, 3)"),
    "text": (RECORDED, {"verts": np.full((2, V, 3), "x")}, "give real numbers of shape (t, v, 3)"),
    "topology that changes": (RECORDED, {"faces": np.stack([BALL.faces] * 4)}, "all frames must share one (f, 3)"),
    "faces of other vertices": (RECORDED, {"verts": VERTS[:, :20]}, "name a vertex that does not exist"),
    "times of another length": (
        RECORDED,
        {"times": np.arange(3)},
        "'times' holds int64 (3,): give real numbers of shape (4)",
    ),
    "shapes of other vertices": (
        SHAPES,
        {"delta": DELTA[:, :9]},
        "'delta' holds float32 (3, 9, 3): give real numbers of shape (k, 42, 3)",
    ),
    "no shapes": (SHAPES, {"delta": DELTA[:0]}, "of shape (k, 42, 3)"),
    "nan in a shape": (
        SHAPES,
        {"delta": DELTA * [[[np.nan]], [[1]], [[1]]]},
        "'delta' has values that are not finite in 1 rows (first: 0)",
    ),
    "too few names": (SHAPES, {"names": np.array(["a"])}, "give 3 names, one for each shape"),
    "weights of other shapes": (SHAPES, {"parameters": np.zeros((2, 5))}, "of shape (t, 3)"),
    "matrices of other bones": (RIG, {"transforms": STILL[:, :1]}, "of shape (t, 2, 3, 4)"),
    "matrices 4 x 4": (RIG, {"transforms": np.tile(np.eye(4), (5, 2, 1, 1))}, "of shape (t, 2, 3, 4)"),
    "no frames of a rig": (RIG, {"transforms": STILL[:0]}, "of shape (t, 2, 3, 4)"),
    "a vertex without bones": (RIG, {"weights": np.zeros((V, 2))}, "42 vertices have no usable weights of bones"),
    "an overflowing frame": (
        RIG,
        {"rest": 4 * BALL.vertices, "transforms": 3e38 * STILL},
        "vertices of frame 0 are not finite",
    ),
    "an array missing": (RIG, {"faces": None}, "is no animation: its arrays are rest, weights, transforms, known are"),
    "ragged frames": (
        RECORDED,
        {"verts": np.array([VERTS[0], VERTS[0][:5]], dtype=object)},
        "is not a readable npz file",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    arrays, changes, message = REFUSED[name]
    path = written(tmp_path, arrays, **changes)
    with pytest.raises(ValueError) as raised:
        load_animation(path)
    assert message in str(raised.value) and str(path) in str(raised.value) and "\n" not in str(raised.value)


def test_other_files_are_refused(tmp_path: Path) -> None:
    for name, message in (
        ("absent.npz", "no such file"),
        ("mesh.ply", "no kind of animation: this is a mesh, which does not move; give .npz, .glb or .gltf"),
        ("clip.mov", "no kind of animation; give"),
        ("cut.npz", "is not a readable npz file"),
    ):
        if name != "absent.npz":
            (tmp_path / name).write_bytes(b"PK\x03\x04 cut off")
        with pytest.raises(ValueError, match=message):
            load_animation(tmp_path / name)
    write_npz(tmp_path / "own.npz", {"coefficients": np.zeros((3, 9))}, {"format": "gash-transfer"})
    with pytest.raises(ValueError, match="is no animation: its arrays are coefficients, metadata"):
        load_animation(tmp_path / "own.npz")
    with pytest.raises(ValueError, match="has no clips to choose from"):
        load_animation(written(tmp_path, RECORDED), clip="walk")
    with pytest.raises(ValueError, match="unknown up axis 'w'"):
        load_animation(written(tmp_path, RECORDED), up="w")


def test_the_shared_face_has_its_shapes() -> None:
    path = shared_file("animated/ict_face_expressions.npz")
    animation = load_animation(path)
    with np.load(path) as arrays:
        np.testing.assert_allclose(animation.frame(5), arrays["base"] + arrays["delta"][4], atol=1e-4)
    assert "jawOpen" in animation.names and len(animation) == 58
