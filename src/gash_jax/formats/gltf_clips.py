"""Clips of a glTF 2.0 file: what a clip makes of the nodes' places and of the weights of morph targets, over time.

A channel moves one property of one node along its keys: LINEAR (rotations by the short arc, at even speed), STEP, or
CUBICSPLINE (Hermite with the tangents of the file, times the step between two keys; glTF 2.0, appendix C). Before the
first and after the last key the value stays.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from gash_jax.formats.gltf import local_matrix
from gash_jax.formats.gltf_document import Document
from gash_jax.geometry.mesh import MeshError

Tracks = dict[tuple[int, str], np.ndarray]  # (node, path) -> values at all times
_TURNING = "rotation"
_DEFAULTS = {"translation": [0.0, 0.0, 0.0], _TURNING: [0.0, 0.0, 0.0, 1.0], "scale": [1.0, 1.0, 1.0]}


def find_clip(document: Document, name: str | None) -> dict[str, Any] | None:
    """The clip of a name, or the first, or None where the file has none. Raises MeshError for an unknown name."""
    clips = document.json.get("animations", [])
    if name is None:
        return clips[0] if clips else None
    names = [clip_name(clip, number) for number, clip in enumerate(clips)]
    if name not in names:
        raise MeshError(f"no clip is called {name!r}: the file has {', '.join(names) or 'none'}")
    return clips[names.index(name)]


def clip_name(clip: dict[str, Any], number: int) -> str:
    """Name of a clip; one without is called by its number."""
    return str(clip.get("name", f"clip {number}"))


def clip_times(document: Document, clip: dict[str, Any]) -> Float[np.ndarray, "t"]:
    """The times of all keys of a clip, in seconds."""
    inputs = {sampler["input"] for sampler in clip["samplers"]}
    return np.unique(np.concatenate([document.values(index)[:, 0].astype(np.float64) for index in inputs]))


def clip_tracks(document: Document, clip: dict[str, Any], times: Float[np.ndarray, "t"]) -> Tracks:
    """Values of what the clip moves, at the given times."""
    tracks: Tracks = {}
    for channel in clip["channels"]:
        target, sampler = channel["target"], clip["samplers"][channel["sampler"]]
        if "node" not in target or target["path"] not in (*_DEFAULTS, "weights"):
            continue  # what an extension moves
        keys = document.values(sampler["input"])[:, 0].astype(np.float64)
        values = document.values(sampler["output"]).astype(np.float64)
        if len(keys) == 0 or np.any(np.diff(keys) <= 0):
            raise MeshError("the keys of a glTF clip do not rise in time: the file is damaged, export it again")
        mode, path = sampler.get("interpolation", "LINEAR"), target["path"]
        parts = 3 if mode == "CUBICSPLINE" else 1
        values = values.reshape(len(keys), parts, -1)
        tracks[target["node"], path] = interpolated(times, keys, values, mode, path == _TURNING)
    return tracks


def interpolated(
    times: Float[np.ndarray, "t"],
    keys: Float[np.ndarray, "n"],
    values: Float[np.ndarray, "n p c"],
    mode: str,
    turning: bool,
) -> Float[np.ndarray, "t c"]:
    """Values at some times of a track with p = 3 (tangent in, value, tangent out) or 1 (value) for each key."""
    if mode not in ("LINEAR", "STEP", "CUBICSPLINE"):
        raise MeshError(f"a glTF clip has the unknown interpolation {mode!r}: the file is damaged, export it again")
    at = values[:, -1 if values.shape[1] == 1 else 1]
    if len(keys) == 1:
        return np.repeat(at, len(times), axis=0)
    last = np.clip(np.searchsorted(keys, times, "right") - 1, 0, len(keys) - 2)
    step = (keys[last + 1] - keys[last])[:, None]
    u = np.clip((times - keys[last])[:, None] / step, 0, 1)
    before, after = at[last], at[last + 1]
    if mode == "STEP":
        return np.where(u < 1, before, after)
    if mode == "CUBICSPLINE":
        out, into = values[last, 2] * step, values[last + 1, 0] * step
        cubic, square = u**3, u**2
        found = (2 * cubic - 3 * square + 1) * before + (cubic - 2 * square + u) * out
        found = found + (3 * square - 2 * cubic) * after + (cubic - square) * into
        return found / np.linalg.norm(found, axis=1, keepdims=True) if turning else found
    return _slerp(before, after, u) if turning else before + u * (after - before)


def _slerp(
    before: Float[np.ndarray, "t 4"], after: Float[np.ndarray, "t 4"], u: Float[np.ndarray, "t 1"]
) -> Float[np.ndarray, "t 4"]:
    cosine = (before * after).sum(axis=1, keepdims=True)
    after = np.where(cosine < 0, -after, after)
    angle = np.arccos(np.clip(np.abs(cosine), 0, 1))
    near = np.sin(angle) < 1e-6  # then the chord is the arc
    sine = np.where(near, 1, np.sin(angle))
    left = np.where(near, 1 - u, np.sin((1 - u) * angle) / sine)
    right = np.where(near, u, np.sin(u * angle) / sine)
    found = left * before + right * after
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def moving_places(document: Document, tracks: Tracks, count: int) -> list[Float[np.ndarray, "t 4 4"]]:
    """Place of every node in the scene at each of `count` times."""
    nodes = document.json.get("nodes", [])
    above = {child: number for number, node in enumerate(nodes) for child in node.get("children", ())}
    places: dict[int, np.ndarray] = {}
    for start in range(len(nodes)):
        chain = [start]
        while chain[-1] in above and chain[-1] not in places:
            chain.append(above[chain[-1]])
            if len(chain) > len(nodes):
                raise MeshError("the nodes of the glTF scene stand in a circle: the file is damaged, export it again")
        for number in reversed(chain):
            if number not in places:
                own = _moving_local(nodes[number], number, tracks, count)
                places[number] = places[above[number]] @ own if number in above else own
    return [places[number] for number in range(len(nodes))]


def _moving_local(node: dict[str, Any], number: int, tracks: Tracks, count: int) -> Float[np.ndarray, "t 4 4"]:
    moved = {path: tracks[number, path] for path in _DEFAULTS if (number, path) in tracks}
    if not moved:
        return np.broadcast_to(local_matrix(node), (count, 4, 4))
    from scipy.spatial.transform import Rotation  # slow to import

    given = {
        path: np.broadcast_to(node.get(path, default), (count, len(default))) for path, default in _DEFAULTS.items()
    }
    given |= moved
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(given[_TURNING]).as_matrix() * given["scale"][:, None]
    matrices[:, :3, 3] = given["translation"]
    return matrices
