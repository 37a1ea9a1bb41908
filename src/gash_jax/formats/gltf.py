"""glTF 2.0 files (.glb, .gltf): all triangles of the scene, node by node in depth-first order.

Each primitive of each node gives its vertices in order, moved by the node's place in the scene (a mirroring node
turns its faces around, as glTF says). Of a skinned mesh the bind pose is taken: the positions as stored, placed by
what the skin's root joint does to them at rest, G B with G the joint's place and B its inverse bind matrix. The
place of the node itself does not count then, as glTF says. Morph targets, materials and animations are ignored.
"""

import base64
import json
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float, Int

from gash_jax.formats.raw_mesh import RawMesh
from gash_jax.geometry.mesh import MeshError, normalized

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_COMPRESSED = {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def read_gltf(data: bytes, folder: Path) -> RawMesh:
    """The scene of a .glb or .gltf file; `folder` is where buffers of a .gltf are looked for. Raises MeshError."""
    document, binary = _split(data)
    compressed = _COMPRESSED & set(document.get("extensionsRequired", ()))
    if compressed:
        raise MeshError(f"the file is compressed with {sorted(compressed)[0]}: export it without compression")
    buffers = [_buffer(entry, binary, folder) for entry in document.get("buffers", ())]
    places = _places(document)
    vertices, normals, faces, skipped = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    count = 0
    for index, place in places.items():
        node = document["nodes"][index]
        if "mesh" not in node:
            continue
        place = _skin_place(document, buffers, node["skin"], places) if "skin" in node else place
        turn = np.linalg.det(place[:3, :3]) < 0
        for primitive in document["meshes"][node["mesh"]]["primitives"]:
            triangles = _triangles(document, buffers, primitive)
            if triangles is None:
                skipped += 1
                continue
            points, tilts = _attributes(document, buffers, primitive, place)
            vertices.append(points)
            normals.append(tilts)
            faces.append((triangles[:, ::-1] if turn else triangles) + count)
            count += len(points)
    note = f"{skipped} {'primitive' if skipped == 1 else 'primitives'} of points or lines: left out"
    return RawMesh(np.concatenate(vertices), np.concatenate(faces), np.concatenate(normals), (note,) if skipped else ())


def _split(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The JSON document and the binary chunk that follows it in a .glb."""
    if data[:4] != b"glTF":
        return json.loads(data.decode("utf-8-sig")), b""
    if len(data) < 20 or len(data) < int.from_bytes(data[8:12], "little"):
        raise MeshError("the file ends before its data do: it is cut off, copy or export it again")
    if data[4:8] != b"\x02\x00\x00\x00":
        raise MeshError("a glTF file of another version than 2: export it as glTF 2.0")
    size = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def _buffer(entry: dict[str, Any], binary: bytes, folder: Path) -> bytes:
    uri = entry.get("uri")
    if uri is None:
        content = binary
    elif uri.startswith("data:"):
        content = base64.b64decode(uri.partition(",")[2])
    else:
        path = folder / unquote(uri)
        if not path.is_file():
            raise MeshError(f"the buffer {uri} of the glTF file is missing: put it beside the file")
        content = path.read_bytes()
    if len(content) < entry["byteLength"]:
        raise MeshError("a buffer is shorter than the glTF file says: it is cut off, copy or export it again")
    return content


def _accessor(document: dict[str, Any], buffers: list[bytes], index: int) -> np.ndarray:
    """Values of an accessor, one row each; normalised integers as floats, sparse replacements made."""
    entry = document["accessors"][index]
    kind, width = np.dtype(_COMPONENTS[entry["componentType"]]), _WIDTHS[entry["type"]]
    values = np.zeros((entry["count"], width), dtype=kind)
    if "bufferView" in entry:
        values = _view(document, buffers, entry, entry["count"], kind, width)
    if "sparse" in entry:
        sparse = entry["sparse"]
        at = _view(
            document,
            buffers,
            sparse["indices"],
            sparse["count"],
            np.dtype(_COMPONENTS[sparse["indices"]["componentType"]]),
            1,
        )
        values = values.copy()
        values[at[:, 0]] = _view(document, buffers, sparse["values"], sparse["count"], kind, width)
    if entry.get("normalized"):
        return np.maximum(values.astype(np.float64) / np.iinfo(kind).max, -1.0)
    return values


def _view(
    document: dict[str, Any], buffers: list[bytes], entry: dict[str, Any], count: int, kind: np.dtype, width: int
) -> np.ndarray:
    view = document["bufferViews"][entry["bufferView"]]
    offset = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
    stride = view.get("byteStride", kind.itemsize * width)
    buffer = buffers[view["buffer"]]
    if count and (offset < 0 or stride < 0 or offset + (count - 1) * stride + kind.itemsize * width > len(buffer)):
        raise MeshError("the glTF file points outside its buffers: it is damaged, export it again")
    return np.ndarray((count, width), kind, buffer, offset, (stride, kind.itemsize))


def _places(document: dict[str, Any]) -> dict[int, Float[np.ndarray, "4 4"]]:
    """Matrix of each node of the scene, in depth-first order."""
    nodes = document.get("nodes", [])
    if document.get("scenes"):
        roots = document["scenes"][document.get("scene", 0)].get("nodes", [])
    else:
        roots = sorted(set(range(len(nodes))) - {child for node in nodes for child in node.get("children", ())})
    places: dict[int, np.ndarray] = {}
    stack = [(root, np.eye(4)) for root in reversed(roots)]
    while stack:
        index, above = stack.pop()
        if index in places:
            raise MeshError("a node of the glTF scene has two parents: the file is damaged, export it again")
        places[index] = above @ _local(nodes[index])
        stack += [(child, places[index]) for child in reversed(nodes[index].get("children", ()))]
    return places


def _local(node: dict[str, Any]) -> Float[np.ndarray, "4 4"]:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    from scipy.spatial.transform import Rotation  # slow to import, and only this format needs it

    rotation = Rotation.from_quat(node.get("rotation", [0.0, 0.0, 0.0, 1.0])).as_matrix()
    matrix[:3, :3] = rotation * np.array(node.get("scale", [1.0, 1.0, 1.0]))
    matrix[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return matrix


def _skin_place(
    document: dict[str, Any], buffers: list[bytes], index: int, places: dict[int, np.ndarray]
) -> Float[np.ndarray, "4 4"]:
    """What the root joint of a skin does to the stored positions when the skeleton is at rest."""
    skin = document["skins"][index]
    joints = [joint for joint in skin["joints"] if joint in places]
    if not joints:
        raise MeshError("the skeleton of a mesh is not in the glTF scene: export it with its armature")
    root = min(joints, key=list(places).index)  # depth-first order: no joint comes before the one above it
    if "inverseBindMatrices" not in skin:
        return places[root]
    inverse = _accessor(document, buffers, skin["inverseBindMatrices"])
    return places[root] @ inverse[skin["joints"].index(root)].reshape(4, 4).T.astype(np.float64)


def _triangles(
    document: dict[str, Any], buffers: list[bytes], primitive: dict[str, Any]
) -> Int[np.ndarray, "f 3"] | None:
    """Triangles of a primitive in its own vertex numbers; None for points and lines."""
    mode = primitive.get("mode", _TRIANGLES)
    if mode not in (_TRIANGLES, _STRIP, _FAN):
        return None
    if "indices" in primitive:
        indices = _accessor(document, buffers, primitive["indices"])[:, 0].astype(np.int64)
    else:
        indices = np.arange(document["accessors"][primitive["attributes"]["POSITION"]]["count"])
    if mode == _TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    middle, last = indices[1:-1], indices[2:]
    if mode == _FAN:
        return np.stack([np.full(len(last), indices[0]), middle, last], axis=1)
    odd = np.arange(len(last)) % 2 == 1
    return np.stack([indices[:-2], np.where(odd, last, middle), np.where(odd, middle, last)], axis=1)


def _attributes(
    document: dict[str, Any], buffers: list[bytes], primitive: dict[str, Any], place: Float[np.ndarray, "4 4"]
) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 3"]]:
    """Positions and normals of a primitive in the scene; normals 0 where it has none."""
    points = _accessor(document, buffers, primitive["attributes"]["POSITION"]).astype(np.float64)
    moved = points @ place[:3, :3].T + place[:3, 3]
    if "NORMAL" not in primitive["attributes"]:
        return moved, np.zeros_like(moved)
    normals = _accessor(document, buffers, primitive["attributes"]["NORMAL"]).astype(np.float64)
    return moved, normalized(normals @ np.linalg.pinv(place[:3, :3]))
