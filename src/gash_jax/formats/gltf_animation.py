"""Animations in glTF 2.0 files: skins, morph targets and moving nodes, posed by a clip.

The mesh is that of the mesh reader, vertex by vertex: the scene at rest, skins in their bind pose. Every joint of a
skin is a bone, and so is every node that has an unskinned mesh; its matrix takes the vertices of the rest to where the
clip puts them. Morph targets are shapes whose weights count from those that the rest has.

Frames are at the keys of the clip. Without a clip a file with morph targets gives its rest and then each target by
itself; any other is refused, as nothing moves in it.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.formats.gltf import mesh_places, read_piece, scene_places
from gash_jax.formats.gltf_clips import Tracks, clip_name, clip_times, clip_tracks, find_clip, moving_places
from gash_jax.formats.gltf_document import Document, open_document
from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry.animation import Animation, Blend, blend_rows, unit_weights
from gash_jax.geometry.mesh import MeshError

_UNREADABLE = "its skins, morph targets or clips cannot be read: damaged or cut off, export it again"


class _Part(NamedTuple):
    """The vertices that one node brings into the scene, instances included."""

    node: int
    deltas: Float[np.ndarray, "k v 3"]  # in the scene
    weights: Float[np.ndarray, "v b"]  # of its own bones
    bones: list[int]  # nodes
    inverse: Float[np.ndarray, "b 4 4"]  # from the rest to what each bone's place moves
    shapes: list[str]
    default: Float[np.ndarray, "k"]


def read_gltf_animation(path: Path, clip: str | None, times: Float[np.ndarray, "t"] | None = None) -> Animation:
    """The animation of a .glb or .gltf file; `times` in seconds, None at the keys of the clip. Raises MeshError."""
    mesh = load_mesh(path)
    try:
        document = open_document(path.read_bytes(), path.parent)
        found = find_clip(document, clip)
        parts = _parts(document)
        if found is None and not any(part.shapes for part in parts):
            raise MeshError("nothing moves in it: it has no clip and no morph targets, read it as a mesh")
        if times is None:
            times = clip_times(document, found) if found else np.zeros(1 + sum(len(part.shapes) for part in parts))
        tracks = clip_tracks(document, found, times) if found else {}
        motion, notes = _motion(mesh.vertices, parts)
        rows = blend_rows(
            _shape_weights(parts, tracks, len(times), found is None), _transforms(document, parts, tracks, len(times))
        )
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError, MemoryError, RecursionError):
        raise MeshError(f"{path}: {_UNREADABLE}") from None
    names = [name for part in parts for name in part.shapes]
    names += [_node_name(document, bone) for part in parts for bone in part.bones]
    return Animation(mesh, rows, tuple(names), motion, times if found else None, notes)


def moves(path: Path) -> bool:
    """Whether a .glb or .gltf file has a clip or morph targets. Raises MeshError where it cannot be read."""
    try:
        found = open_document(path.read_bytes(), path.parent).json
        entries = [entry for mesh in found.get("meshes", ()) for entry in mesh["primitives"]]
        return bool(found.get("animations")) or any(entry.get("targets") for entry in entries)
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        raise MeshError(f"{path}: {_UNREADABLE}") from None


def clip_names(path: Path) -> list[str]:
    """Names of the clips of a .glb or .gltf file that can be read."""
    clips = open_document(path.read_bytes(), path.parent).json.get("animations", [])
    return [clip_name(clip, number) for number, clip in enumerate(clips)]


def _node_name(document: Document, number: int) -> str:
    return str(document.json["nodes"][number].get("name", f"node {number}"))


def _parts(document: Document) -> list[_Part]:
    """What the nodes of the scene bring, in the order of the mesh reader."""
    parts, places = [], scene_places(document)
    for number, place in places.items():
        node = document.json["nodes"][number]
        if "mesh" not in node:
            continue
        mesh = document.json["meshes"][node["mesh"]]
        default = np.array(node.get("weights", mesh.get("weights", ())), dtype=np.float64)
        pieces = [(read_piece(document, entry, []), entry) for entry in mesh["primitives"]]
        kept = [(piece, entry) for piece, entry in pieces if piece is not None]
        if not kept:
            continue
        at = mesh_places(document, node, place, places)
        sizes = [len(piece.points) for piece, _ in kept]
        count = max(len(entry.get("targets", ())) for _, entry in kept)
        deltas = np.concatenate(
            [_targets(document, entry, size, count) for (_, entry), size in zip(kept, sizes, strict=True)], 1
        )
        deltas = np.concatenate([deltas @ matrix[:3, :3].T for matrix in at], axis=1)
        if "skin" in node:
            skin = document.json["skins"][node["skin"]]
            bones = list(skin["joints"])
            weights = np.concatenate([_skin_weights(document, entry, len(bones)) for _, entry in kept])
            bind = np.tile(np.eye(4), (len(bones), 1, 1))
            if "inverseBindMatrices" in skin:
                bind = document.values(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
            inverse = bind.astype(np.float64) @ _inverted(at[0])
        else:
            bones, weights = [number], np.ones((sum(sizes) * len(at), 1))
            inverse = _inverted(place)[None]
        names = mesh.get("extras", {}).get("targetNames", [])
        shapes = [str(names[k]) if k < len(names) else f"target {k}" for k in range(count)]
        default = np.append(default, np.zeros(count))[:count]
        parts.append(_Part(number, deltas, weights, bones, inverse, shapes, default))
    return parts


def _inverted(place: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    if abs(np.linalg.det(place)) < 1e-30:
        raise MeshError("a mesh of the glTF scene is squeezed flat at rest, so its motion is lost: export it unscaled")
    return np.linalg.inv(place)


def _targets(document: Document, primitive: dict[str, Any], size: int, count: int) -> Float[np.ndarray, "k v 3"]:
    """Displacements by the morph targets of a primitive; 0 for those that it lacks."""
    deltas = np.zeros((count, size, 3))
    for number, target in enumerate(primitive.get("targets", ())):
        if "POSITION" in target:
            deltas[number] = document.values(target["POSITION"])
    return deltas


def _skin_weights(document: Document, primitive: dict[str, Any], bones: int) -> Float[np.ndarray, "v b"]:
    """Weight of every bone at each vertex of a primitive."""
    attributes = primitive["attributes"]
    sets = sum(name.startswith("JOINTS_") for name in attributes)
    if not sets:
        raise MeshError("a skinned mesh says no bones of its vertices (JOINTS_0): export it again")
    joints = np.concatenate([document.values(attributes[f"JOINTS_{k}"]) for k in range(sets)], axis=1).astype(np.int64)
    shares = np.concatenate([document.values(attributes[f"WEIGHTS_{k}"]) for k in range(sets)], axis=1)
    if joints.max(initial=0) >= bones or joints.shape != shares.shape:
        raise MeshError("a skinned mesh names a bone that its skin does not have: the file is damaged, export it again")
    weights = np.zeros((len(joints), bones))
    np.add.at(weights, (np.arange(len(joints))[:, None], joints), shares)
    return weights


def _motion(rest: Float[np.ndarray, "v 3"], parts: list[_Part]) -> tuple[Blend, tuple[str, ...]]:
    """All parts as one: each with shapes and bones of its own."""
    ends = np.cumsum(
        [[0, 0, 0], *([part.weights.shape[0], len(part.shapes), len(part.bones)] for part in parts)], axis=0
    )
    vertices, shapes, bones = ends[-1]
    if vertices != len(rest):
        raise MeshError("the vertices of its skins are not those of its meshes: the file is damaged, export it again")
    deltas, weights = np.zeros((shapes, vertices, 3), np.float32), np.zeros((vertices, bones))
    for part, (v, k, b), (v_end, k_end, b_end) in zip(parts, ends[:-1], ends[1:], strict=True):
        deltas[k:k_end, v:v_end], weights[v:v_end, b:b_end] = part.deltas, part.weights
    weights, notes = unit_weights(weights)
    return Blend(rest, deltas, weights), notes


def _shape_weights(parts: list[_Part], tracks: Tracks, count: int, alone: bool) -> Float[np.ndarray, "t k"]:
    """Weights of all shapes at all times, from those of the rest on; `alone`: none, then each by itself."""
    shapes = sum(len(part.shapes) for part in parts)
    if alone:
        return np.eye(count, shapes, k=-1)
    columns = [np.zeros((count, 0))]
    for part in parts:
        moving = tracks.get((part.node, "weights"))
        at = np.broadcast_to(part.default, (count, len(part.default))) if moving is None else moving
        columns.append(at - part.default)
    return np.concatenate(columns, axis=1)


def _transforms(document: Document, parts: list[_Part], tracks: Tracks, count: int) -> Float[np.ndarray, "t b 3 4"]:
    """Matrices of all bones at all times, from the rest."""
    places = moving_places(document, tracks, count)
    found = [np.stack([places[bone] for bone in part.bones], axis=1) @ part.inverse for part in parts]
    return np.concatenate(found, axis=1)[:, :, :3]
