"""The door for animations: npz files of recorded frames, blendshapes or a rig, and glTF files.

* *recorded frames*: `verts` (t, v, 3), `faces` (f, 3). Frame 0 is the rest.
* *blendshapes*: `base` (v, 3), `delta` (k, v, 3), `faces`, `names` (k,), `parameters` (t, k). A frame is
  base + sum_k a_k delta_k, a its row of `parameters`; without them the frames are the base, then each shape by itself.
* *rig*: `rest` (v, 3), `weights` (v, b), `transforms` (t, b, 3, 4), `faces`, `names` (b,). A frame is
  sum_b w_b T_b [rest; 1].

`names` and `times` (t,), in seconds, may be missing; other arrays are noted and left out. Weights of bones are divided
by their sum at each vertex, with a note where that changes them. Recorded frames that the file holds uncompressed
(`numpy.savez`) are read from it one by one.
"""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import shown
from gash_jax.files.atomic import FileError, as_path
from gash_jax.files.npz import names_in_npz, open_npz
from gash_jax.formats.gltf_animation import read_gltf_animation
from gash_jax.formats.mesh_files import READERS
from gash_jax.formats.meshes import TO_Y_UP, read_mesh
from gash_jax.geometry.animation import Animation, Blend, Recorded, blend_rows, unit_weights
from gash_jax.geometry.mesh import Mesh, MeshError

GLTF = (".glb", ".gltf")
_FAR = 1e37  # below the largest float32: a frame within it is finite
FORMS = {
    "recorded frames": ("verts", "faces"),
    "blendshapes": ("base", "delta", "faces"),
    "rig": ("rest", "weights", "transforms", "faces"),
}
_EXTRA = {"recorded frames": (), "blendshapes": ("names", "parameters"), "rig": ("names",)}


def animation_form(path: str | os.PathLike[str]) -> str | None:
    """Which of the forms of animation a file's arrays have; None for other files."""
    path = as_path(path)
    if path.suffix.lower() != ".npz":
        return None
    names = names_in_npz(path)
    return next((form for form, wanted in FORMS.items() if set(wanted) <= set(names)), None)


def load_animation(path: str | os.PathLike[str], up: str = "y", clip: str | None = None) -> Animation:
    """The animation in an .npz, .glb or .gltf file (docs/animation.md); `up` is the axis that points up in it.

    Of a glTF file `clip` names the one to take, None the first; its frames are at the clip's own keys. Every frame is
    checked. Raises FileError and MeshError, one line that says what to do.

    >>> corners, frames = np.array([[0, 1, 2]]), np.stack([np.eye(3), 2 * np.eye(3)])
    >>> np.savez("grows.npz", verts=frames, faces=corners)
    >>> animation = gash_jax.load_animation("grows.npz")
    >>> len(animation), float(animation.frame(1).max())
    (2, 2.0)
    """
    path = as_path(path)
    if up not in TO_Y_UP:
        raise MeshError(f"unknown up axis {shown(up)}: choose one of {', '.join(TO_Y_UP)}")
    if not path.exists():
        raise FileError(f"no such file: {path}")
    suffix = path.suffix.lower()
    if suffix in GLTF:
        animation = read_gltf_animation(path, clip)
    elif suffix != ".npz":
        hint = ": this is a mesh, which does not move" if suffix in READERS else ""
        raise FileError(f"{path}: no kind of animation{hint}; give .npz, {' or '.join(GLTF)}")
    elif clip is not None:
        raise FileError(f"{path} has no clips to choose from: leave the clip out")
    else:
        animation = _read_npz(path)
    animation = _turned(animation, TO_Y_UP[up].astype(np.float64))
    _check_frames(path, animation)
    return animation


def _read_npz(path: Path) -> Animation:
    form = animation_form(path)
    if form is None:
        wanted = "; ".join(f"{name}: {', '.join(arrays)}" for name, arrays in FORMS.items())
        raise FileError(f"{path} is no animation: its arrays are {', '.join(names_in_npz(path))}, known are {wanted}")
    arrays = open_npz(path, "animation")
    known = (*FORMS[form], *_EXTRA[form], "times")
    unknown = sorted(set(arrays) - {*known, "metadata"})
    notes = (f"arrays that no animation has: {', '.join(unknown)}, left out",) if unknown else ()
    try:
        animation, seconds = _READ[form](arrays), None
        if "times" in arrays:
            seconds = _finite("times", _numbers(arrays, "times", (len(animation),))).astype(np.float64)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    return animation._replace(seconds=seconds, notes=notes + animation.notes)


def _numbers(arrays: dict[str, np.ndarray], name: str, shape: tuple[int | str, ...]) -> np.ndarray:
    """An array of the given shape; a letter stands for any length but 0. Raises MeshError."""
    array = arrays[name]
    fits = array.ndim == len(shape) and all(
        have == want or (isinstance(want, str) and have) for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits or array.dtype.kind not in "fiu":
        sides = ", ".join(map(str, shape))
        raise MeshError(f"{name!r} holds {array.dtype} {array.shape}: give real numbers of shape ({sides})")
    return array


def _recorded(arrays: dict[str, np.ndarray]) -> Animation:
    verts = _numbers(arrays, "verts", ("t", "v", 3))
    mesh = _rest(verts[0], arrays)
    return Animation(mesh, np.arange(len(verts), dtype=np.float64)[:, None], ("frame",), Recorded(verts))


def _blendshapes(arrays: dict[str, np.ndarray]) -> Animation:
    base = _numbers(arrays, "base", ("v", 3))
    delta = _numbers(arrays, "delta", ("k", len(base), 3))
    shapes = len(delta)
    if "parameters" in arrays:
        rows = _finite("parameters", _numbers(arrays, "parameters", ("t", shapes)))
    else:
        rows = np.eye(shapes + 1, shapes, k=-1)
    mesh = _rest(base, arrays)
    motion = Blend(base.astype(np.float32), _finite("delta", delta), np.zeros((len(base), 0)))
    return Animation(mesh, blend_rows(rows, np.zeros((len(rows), 0, 3, 4))), _names(arrays, shapes, "shape"), motion)


def _rig(arrays: dict[str, np.ndarray]) -> Animation:
    rest = _numbers(arrays, "rest", ("v", 3))
    given = _numbers(arrays, "weights", (len(rest), "b"))
    bones = given.shape[1]
    transforms = _finite("transforms", _numbers(arrays, "transforms", ("t", bones, 3, 4)))
    weights, notes = unit_weights(given)
    mesh = _rest(rest, arrays)
    motion = Blend(rest.astype(np.float32), np.zeros((0, len(rest), 3), np.float32), weights)
    rows = blend_rows(np.zeros((len(transforms), 0)), transforms)
    return Animation(mesh, rows, _names(arrays, bones, "bone"), motion, notes=notes)


_READ: dict[str, Callable[[dict[str, np.ndarray]], Animation]] = {
    "recorded frames": _recorded,
    "blendshapes": _blendshapes,
    "rig": _rig,
}


def _rest(vertices: np.ndarray, arrays: dict[str, np.ndarray]) -> Mesh:
    faces = arrays["faces"]
    if faces.ndim == 3:
        raise MeshError(f"'faces' has shape {faces.shape}, one list for each frame: all frames must share one (f, 3)")
    return read_mesh((vertices, faces))[0]


def _names(arrays: dict[str, np.ndarray], count: int, noun: str) -> tuple[str, ...]:
    if "names" not in arrays:
        return tuple(f"{noun} {number}" for number in range(count))
    names = arrays["names"]
    if names.shape != (count,) or names.dtype.kind != "U":
        raise MeshError(f"'names' holds {names.dtype} {names.shape}: give {count} names, one for each {noun}")
    return tuple(map(str, names))


def _finite(name: str, array: np.ndarray) -> np.ndarray:
    bad = ~np.isfinite(array).reshape(len(array), -1).all(axis=1)
    if bad.any():
        raise MeshError(f"{name!r} has values that are not finite in {bad.sum()} rows (first: {np.argmax(bad)})")
    return array


def _turned(animation: Animation, turn: Float[np.ndarray, "3 3"]) -> Animation:
    """The animation with its up axis turned to +y."""
    if np.array_equal(turn, np.eye(3)):
        return animation
    mesh = read_mesh((animation.mesh.vertices @ turn.T, animation.mesh.faces, animation.mesh.normals @ turn.T))[0]
    motion = animation.motion
    if isinstance(motion, Recorded):
        return animation._replace(mesh=mesh, motion=motion._replace(turn=turn))
    moved = animation.transforms.astype(np.float64)
    moved = np.concatenate([turn @ moved[..., :3] @ turn.T, (moved[..., 3] @ turn.T)[..., None]], axis=-1)
    return animation._replace(
        mesh=mesh,
        parameters=blend_rows(animation.shape_weights, moved),
        motion=motion._replace(
            rest=(motion.rest @ turn.T).astype(np.float32), deltas=(motion.deltas @ turn.T).astype(np.float32)
        ),
    )


def _check_frames(path: Path, animation: Animation) -> None:
    """Raise MeshError for a frame whose positions are not finite."""
    rows, motion = animation.parameters, animation.motion
    with np.errstate(all="ignore"):
        safe = motion.reach(rows) < _FAR if isinstance(motion, Blend) else np.zeros(len(rows), bool)
    for number in np.flatnonzero(~safe):
        with np.errstate(all="ignore"):
            bad = ~np.isfinite(motion(rows[number])).all(axis=1)
        if bad.any():
            raise MeshError(
                f"{path}: {bad.sum()} vertices of frame {number} are not finite (first: {np.argmax(bad)}): "
                "repair or leave out the frame"
            )
