"""Writing .glb files (glTF 2.0, 4.4): a mesh of its own, or attributes added to a file that keeps all it has.

Vertices are those that `gltf` reads, in its order: the triangles of the scene, node by node in depth-first order. A
mesh that several nodes show is copied, as its vertices differ in the world. Values start at multiples of four bytes, as
3.6.2.4 demands; the binary chunk is the first buffer, and what it held stays where it was.
"""

import copy
import json
import struct
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Num

from gash_jax.formats.gltf import SURFACES, scene_places
from gash_jax.formats.gltf_document import INSTANCING, named_files, open_document, refuse_compressed, split_document
from gash_jax.geometry.mesh import Mesh, MeshError

_CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
_VERTICES, _INDICES = 34962, 34963
_MOST_SHORT = 65535  # 2^16 - 1 is no index: it restarts strips


class Attribute(NamedTuple):
    """Values of a vertex attribute in the type that is stored; integers are normalised."""

    name: str
    values: Num[np.ndarray, "v c"]


class Place(NamedTuple):
    """Where some vertices of a scene stand in its document: node, primitive of the node's mesh, how many."""

    node: int
    primitive: int
    size: int


class Glb:
    """A .glb file in the making: the document, and the binary chunk, which grows."""

    def __init__(self, document: dict[str, Any], binary: bytes = b"") -> None:
        self.document = document
        self.binary = bytearray(binary)

    def add(self, values: Num[np.ndarray, "n c"], target: int = _VERTICES, bounds: bool = False) -> int:
        """The number of a new accessor of these values."""
        kind = values.dtype.str[1:]
        width = values.dtype.itemsize * values.shape[1]
        stride = width if target == _INDICES else -(-width // 4) * 4
        rows = np.zeros((len(values), stride), np.uint8)
        rows[:, :width] = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), width)
        self.binary += bytes(-len(self.binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": rows.size, "target": target}
        self.binary += rows.tobytes()
        entry = {"bufferView": self._append("bufferViews", view | ({"byteStride": stride} if stride > width else {}))}
        entry |= {"componentType": _CODES[kind], "count": len(values)}
        entry |= {"type": "SCALAR" if target == _INDICES else f"VEC{values.shape[1]}"}
        if bounds:
            entry |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        return self._append(
            "accessors", entry | ({"normalized": True} if kind[0] in "iu" and target == _VERTICES else {})
        )

    def content(self) -> bytes:
        """The file."""
        binary = bytes(self.binary) + bytes(-len(self.binary) % 4)
        buffers = self.document.setdefault("buffers", [{}])
        buffers[0] = {**buffers[0], "byteLength": len(self.binary)}
        text = json.dumps(self.document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def _append(self, name: str, entry: dict[str, Any]) -> int:
        self.document.setdefault(name, []).append(entry)
        return len(self.document[name]) - 1


def mesh_glb(mesh: Mesh) -> tuple[Glb, list[Place]]:
    """A file of one mesh. A vertex without a normal gets +y, as glTF has none that are 0.

    Raises MeshError where it has no faces.
    """
    if not len(mesh.faces):
        raise MeshError("the transfer has no faces, so it makes no .glb: write .npz, .json or .txt instead")
    glb = Glb({"asset": {"version": "2.0", "generator": f"gash_jax {version('gash-jax')}"}})
    normals = np.where(np.any(mesh.normals, axis=1)[:, None], mesh.normals, np.array([0, 1, 0], np.float32))
    attributes = {
        "POSITION": glb.add(mesh.vertices.astype("<f4"), bounds=True),
        "NORMAL": glb.add(normals.astype("<f4")),
    }
    indices = mesh.faces.reshape(-1, 1).astype("<u2" if len(mesh.vertices) <= _MOST_SHORT else "<u4")
    primitive = {"attributes": attributes, "indices": glb.add(indices, _INDICES)}
    glb.document |= {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
    }
    return glb, [Place(0, 0, len(mesh.vertices))]


def open_glb(path: Path) -> tuple[Glb, list[Place]]:
    """A file to add to, and where its vertices stand. Raises MeshError, one line."""
    if not path.is_file():
        raise MeshError(f"no such file: {path}")
    data = path.read_bytes()
    if data[:4] != b"glTF":
        raise MeshError(f"{path} is no .glb file: export the scene as one .glb")
    beside = named_files(data, path.parent)
    if beside:
        raise MeshError(f"{path} keeps {beside[0].name} in another file: export it with everything inside")
    try:
        document = open_document(data, path.parent)
        places = _places(document.json, scene_places(document))
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError):
        raise MeshError(f"{path}: not a readable GLB file, damaged or cut off") from None
    binary = split_document(data)[1] or b""
    size = document.json["buffers"][0]["byteLength"] if document.json.get("buffers") else 0
    return Glb(copy.deepcopy(document.json), binary[:size]), places


def _places(document: dict[str, Any], nodes: dict[int, np.ndarray]) -> list[Place]:
    found = []
    for index in nodes:
        node = document["nodes"][index]
        for number, primitive in enumerate(document["meshes"][node["mesh"]]["primitives"] if "mesh" in node else ()):
            if INSTANCING in node.get("extensions", {}):
                raise MeshError("a node has instances, which share their attributes: make them meshes of their own")
            if primitive.get("mode", SURFACES[0]) in SURFACES:
                refuse_compressed(primitive)
                count = document["accessors"][primitive["attributes"]["POSITION"]]["count"]
                found.append(Place(index, number, count))
    return found


def attach(glb: Glb, places: list[Place], attributes: list[Attribute], extras: dict[str, Any]) -> None:
    """Give the vertices of a scene, all of them in order, more attributes; `extras` go to their meshes."""
    document = glb.document
    owners: dict[int, int] = {}
    start = 0
    for place in places:
        node = document["nodes"][place.node]
        if owners.setdefault(node["mesh"], place.node) != place.node:
            document["meshes"].append(copy.deepcopy(document["meshes"][node["mesh"]]))
            node["mesh"] = len(document["meshes"]) - 1
            owners[node["mesh"]] = place.node
        mesh = document["meshes"][node["mesh"]]
        mesh["extras"] = {**(mesh["extras"] if isinstance(mesh.get("extras"), dict) else {}), **extras}
        rows = slice(start, start + place.size)
        for attribute in attributes:
            mesh["primitives"][place.primitive]["attributes"][attribute.name] = glb.add(attribute.values[rows])
        start += place.size


def texture_sets(glb: Glb, places: list[Place]) -> int:
    """How many sets of texture coordinates the vertices have, at least one: where some lack a set they get zeros."""
    document = glb.document
    meshes = [document["meshes"][document["nodes"][place.node]["mesh"]] for place in places]
    found = [mesh["primitives"][place.primitive]["attributes"] for mesh, place in zip(meshes, places, strict=True)]
    most = max([1, *(sum(name.startswith("TEXCOORD_") for name in attributes) for attributes in found)])
    for attributes, place in zip(found, places, strict=True):
        for name in (f"TEXCOORD_{number}" for number in range(most)):
            if name not in attributes:
                attributes[name] = glb.add(np.zeros((place.size, 2), "<f4"))
    return most
