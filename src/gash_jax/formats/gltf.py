"""glTF 2.0 files (.glb, .gltf): all triangles of the scene, node by node in depth-first order.

Each primitive of each node gives its vertices in order, moved by the node's place in the scene (a mirroring node
turns its faces around, as glTF says). A node with instances (EXT_mesh_gpu_instancing) gives its mesh once for each, in
order, each placed within the node. Morph targets count with the weights that the node, else the mesh, gives them (glTF
2.0, 3.7.2.2). Of a skinned mesh the bind pose is taken: the positions as stored, placed by what the skin's root joint
does to them at rest, G B with G the joint's place and B its inverse bind matrix. The place of the node itself does not
count then, as glTF says. COLOR_0 is linear RGB, and white where only some primitives have it (glTF 2.0, 3.9.2).
TEXCOORD_0 counts v downwards, as is meant here; where only some primitives have it, the others have none.
Materials and animations are ignored.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.formats.gltf_document import INSTANCING, Document, open_document, refuse_compressed
from gash_jax.geometry.mesh import MeshError, RawMesh, normalized

MOST_VERTICES = 1 << 26
_TRIANGLES, _STRIP, _FAN = SURFACES = 4, 5, 6  # modes of primitives; others are points and lines


class Piece(NamedTuple):
    """The triangles of a primitive, in its own numbers."""

    points: Float[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]  # 0 where it has none
    triangles: Int[np.ndarray, "f 3"]
    colors: Float[np.ndarray, "v 3"]  # 1 where it has none
    uv: Float[np.ndarray, "v 2"]  # not a number where it has none
    colored: bool
    morphed: bool


def read_gltf(data: bytes, folder: Path) -> RawMesh:
    """The scene of a .glb or .gltf file; `folder` is where buffers of a .gltf are looked for. Raises MeshError."""
    document = open_document(data, folder)
    places = scene_places(document)
    none = np.zeros((0, 3))
    scene: list[tuple[np.ndarray, ...]] = [(none, none.astype(np.int64), none, none, none[:, :2])]
    skipped, morphed, colored = 0, False, False
    count = 0
    for index, place in places.items():
        node = document.json["nodes"][index]
        if "mesh" not in node:
            continue
        mesh = document.json["meshes"][node["mesh"]]
        weights = [float(weight) for weight in node.get("weights", mesh.get("weights", ()))]
        found = [read_piece(document, primitive, weights) for primitive in mesh["primitives"]]
        pieces = [piece for piece in found if piece is not None]
        skipped += len(found) - len(pieces)
        morphed |= any(piece.morphed for piece in pieces)
        colored |= any(piece.colored for piece in pieces)
        if pieces:
            scene.append(_placed(pieces, mesh_places(document, node, place, places), count))
            count += len(scene[-1][0])
    notes = document.notes
    if skipped:
        notes += (f"{skipped} {'primitive' if skipped == 1 else 'primitives'} of points or lines: left out",)
    if morphed:
        notes += ("morph targets with default weights: applied, the shape is not the base shape",)
    vertices, faces, normals, colors, uv = (np.concatenate(arrays) for arrays in zip(*scene, strict=True))
    corners = None if np.isnan(uv).all() else uv[faces]
    return RawMesh(vertices, faces, normals, notes, colors if colored else None, corners)


def _placed(pieces: list[Piece], places: Float[np.ndarray, "n 4 4"], count: int) -> tuple[np.ndarray, ...]:
    """Vertices, faces, normals, colours and texture coordinates of all pieces once for each place.

    Vertices are numbered from `count`.
    """
    own = sum(len(piece.points) for piece in pieces)
    if own * len(places) + count > MOST_VERTICES:
        raise MeshError(f"the glTF scene has more than {MOST_VERTICES} vertices, instances included: export fewer")
    turns = places[:, :3, :3]
    moved = [p.points @ turns.transpose(0, 2, 1) + places[:, None, :3, 3] for p in pieces]
    inverse = np.linalg.pinv(turns)
    tilts = [normalized((p.normals @ inverse).reshape(-1, 3)).reshape(len(places), *p.points.shape) for p in pieces]
    offsets = np.cumsum([0] + [len(piece.points) for piece in pieces[:-1]])
    triangles = np.concatenate([p.triangles + offset for p, offset in zip(pieces, offsets, strict=True)])
    mirrored = (np.linalg.det(turns) < 0)[:, None, None]
    faces = np.where(mirrored, triangles[:, ::-1], triangles) + (count + own * np.arange(len(places)))[:, None, None]
    arrays = (np.concatenate(moved, axis=1), faces, np.concatenate(tilts, axis=1))
    vertices, faces, normals = (array.reshape(-1, 3) for array in arrays)
    same = (np.concatenate([p.colors for p in pieces]), np.concatenate([p.uv for p in pieces]))
    return vertices, faces, normals, *(np.tile(array, (len(places), 1)) for array in same)


def mesh_places(
    document: Document, node: dict[str, Any], place: Float[np.ndarray, "4 4"], places: dict[int, np.ndarray]
) -> Float[np.ndarray, "n 4 4"]:
    """Where the mesh of a node stands: at `place`, at its instances in it, or where its skin puts it."""
    attributes = node.get("extensions", {}).get(INSTANCING, {}).get("attributes", {})
    if "skin" in node:
        if attributes:
            raise MeshError("a skinned mesh with instances has no bind pose in the glTF scene: export it without")
        return skin_place(document, node["skin"], places)[None]
    if not attributes:
        return place[None]
    values = {name: document.values(index).astype(np.float64) for name, index in attributes.items()}
    counts = {len(array) for array in values.values()}
    if len(counts) != 1:
        raise MeshError("the instances of a glTF node have attributes of different lengths: the file is damaged")
    matrices = np.tile(np.eye(4), (counts.pop(), 1, 1))
    if "ROTATION" in values and len(matrices):
        from scipy.spatial.transform import Rotation  # slow to import, as below

        matrices[:, :3, :3] = Rotation.from_quat(values["ROTATION"]).as_matrix()
    if "SCALE" in values:
        matrices[:, :3, :3] *= values["SCALE"][:, None]
    if "TRANSLATION" in values:
        matrices[:, :3, 3] = values["TRANSLATION"]
    return place @ matrices


def read_piece(document: Document, primitive: dict[str, Any], weights: list[float]) -> Piece | None:
    """A primitive with its morph targets applied; None for points and lines."""
    attributes = primitive["attributes"]
    if not document.has_data(attributes["POSITION"]):
        refuse_compressed(primitive)
    points = document.values(attributes["POSITION"]).astype(np.float64)
    triangles = _triangles(document, primitive, len(points))
    if triangles is None:
        return None
    if np.any((triangles < 0) | (triangles >= len(points))):
        raise MeshError("an index of a glTF primitive names a vertex that does not exist: the file is damaged")
    normals = np.zeros_like(points)
    if "NORMAL" in attributes:
        normals = document.values(attributes["NORMAL"]).astype(np.float64)
    active = [(w, target) for w, target in zip(weights, primitive.get("targets", ()), strict=False) if w]
    for weight, target in active:
        if "POSITION" in target:
            points = points + weight * document.values(target["POSITION"])
        if "NORMAL" in target and "NORMAL" in attributes:
            normals = normals + weight * document.values(target["NORMAL"])
    colored = "COLOR_0" in attributes and document.has_data(attributes["COLOR_0"])
    colors = document.values(attributes["COLOR_0"])[:, :3].astype(np.float64) if colored else np.ones_like(points)
    uv = np.full((len(points), 2), np.nan)
    if "TEXCOORD_0" in attributes and document.has_data(attributes["TEXCOORD_0"]):
        found = document.values(attributes["TEXCOORD_0"])
        uv = found.astype(np.float64) if found.shape == uv.shape else uv
    if points.shape != normals.shape or points.shape != colors.shape or points.shape[1] != 3:
        raise MeshError("positions, normals, colours and targets of a glTF primitive do not fit: the file is damaged")
    return Piece(points, normals, triangles, colors, uv, colored, bool(active))


def scene_places(document: Document) -> dict[int, Float[np.ndarray, "4 4"]]:
    """Matrix of each node of the scene, in depth-first order."""
    nodes = document.json.get("nodes", [])
    if document.json.get("scenes"):
        roots = document.json["scenes"][document.json.get("scene", 0)].get("nodes", [])
    else:
        roots = sorted(set(range(len(nodes))) - {child for node in nodes for child in node.get("children", ())})
    places: dict[int, np.ndarray] = {}
    stack = [(root, np.eye(4)) for root in reversed(roots)]
    while stack:
        index, above = stack.pop()
        if index in places:
            raise MeshError("a node of the glTF scene has two parents: the file is damaged, export it again")
        places[index] = above @ local_matrix(nodes[index])
        stack += [(child, places[index]) for child in reversed(nodes[index].get("children", ()))]
    return places


def local_matrix(node: dict[str, Any]) -> Float[np.ndarray, "4 4"]:
    """Place of a node in the one above it."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    from scipy.spatial.transform import Rotation  # slow to import, and only this format needs it

    rotation = Rotation.from_quat(node.get("rotation", [0.0, 0.0, 0.0, 1.0])).as_matrix()
    matrix[:3, :3] = rotation * np.array(node.get("scale", [1.0, 1.0, 1.0]))
    matrix[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return matrix


def skin_place(document: Document, index: int, places: dict[int, np.ndarray]) -> Float[np.ndarray, "4 4"]:
    """What the root joint of a skin does to the stored positions when the skeleton is at rest."""
    skin = document.json["skins"][index]
    joints = [joint for joint in skin["joints"] if joint in places]
    if not joints:
        raise MeshError("the skeleton of a mesh is not in the glTF scene: export it with its armature")
    root = min(joints, key=list(places).index)  # depth-first order: no joint comes before the one above it
    if "inverseBindMatrices" not in skin:
        return places[root]
    inverse = document.values(skin["inverseBindMatrices"])
    return places[root] @ inverse[skin["joints"].index(root)].reshape(4, 4).T.astype(np.float64)


def _triangles(document: Document, primitive: dict[str, Any], count: int) -> Int[np.ndarray, "f 3"] | None:
    """Triangles of a primitive in its own vertex numbers; None for points and lines."""
    mode = primitive.get("mode", _TRIANGLES)
    if mode not in SURFACES:
        return None
    if "indices" in primitive:
        indices = document.values(primitive["indices"])[:, 0].astype(np.int64)
    else:
        indices = np.arange(count)
    if mode == _TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    middle, last = indices[1:-1], indices[2:]
    if mode == _FAN:
        return np.stack([np.full(len(last), indices[0]), middle, last], axis=1)
    odd = np.arange(len(last)) % 2 == 1
    return np.stack([indices[:-2], np.where(odd, last, middle), np.where(odd, middle, last)], axis=1)
