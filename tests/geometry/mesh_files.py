"""Writers of every mesh format, as plain as can be, for the tests of the readers; and a mesh that tempts them."""

import json
import struct

import numpy as np
import trimesh

from gash_jax.geometry.mesh import Mesh


def tempting_mesh() -> tuple[np.ndarray, np.ndarray]:
    """Vertices that a loader would like to merge, drop or reorder: equal positions, isolated ones, unused first."""
    vertices = [[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 5, 5], [0, 0, 1]]
    faces = [[1, 2, 3], [6, 4, 5], [1, 8, 2], [3, 8, 1], [1, 2, 2]]
    return np.array(vertices, dtype=np.float32), np.array(faces)


CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float32)
CUBE_QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
CUBE_FACES = np.array([[q[0], q[i], q[i + 1]] for q in CUBE_QUADS for i in (1, 2)])  # as fans


def exported(mesh: Mesh, kind: str, **more) -> bytes:
    """The file another library writes."""
    text = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(file_type=kind, **more)
    return text if isinstance(text, bytes) else str(text).encode()


def ply_ascii(vertices, faces, normals=None) -> bytes:
    names = ["x", "y", "z"] + (["nx", "ny", "nz"] if normals is not None else [])
    rows = vertices if normals is None else np.concatenate([vertices, normals], axis=1)
    lines = ["ply", "format ascii 1.0", "comment made up", f"element vertex {len(vertices)}"]
    lines += [f"property float {name}" for name in names]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(repr, map(float, row))) for row in rows]
    lines += [" ".join(map(str, [len(face), *face])) for face in faces]
    return ("\n".join(lines) + "\n").encode()


def ply_binary(vertices, faces, order: str = "<", normals=None) -> bytes:
    """Doubles for positions, a colour between, a flag before and a weight after the list of corners."""
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    header = ["ply", f"format {name} 1.0", f"element vertex {len(vertices)}", "property uchar red"]
    header += [f"property double {axis}" for axis in "xyz"]
    header += [f"property float n{axis}" for axis in "xyz"] if normals is not None else []
    header += [f"element face {len(faces)}", "property short flag", "property list uchar uint vertex_index"]
    header += ["property float weight", "element edge 1", "property int vertex1", "end_header", ""]
    body = b""
    for i, vertex in enumerate(vertices):
        body += struct.pack(f"{order}B3d", 7, *vertex)
        body += struct.pack(f"{order}3f", *normals[i]) if normals is not None else b""
    for face in faces:
        body += struct.pack(f"{order}hB{len(face)}If", -3, len(face), *face, 0.5)
    return "\n".join(header).encode() + body + struct.pack(f"{order}i", 1)


def obj(vertices, faces) -> bytes:
    lines = ["# made up", "mtllib none.mtl", "o thing"]
    lines += ["v " + " ".join(map(repr, map(float, vertex))) for vertex in vertices]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    return ("\n".join(lines) + "\n").encode()


def off(vertices, faces) -> bytes:
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0"]
    lines += [" ".join(map(repr, map(float, vertex))) for vertex in vertices]
    lines += [" ".join(map(str, [len(face), *face])) for face in faces]
    return ("\n".join(lines) + "\n").encode()


def stl_binary(corners) -> bytes:
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *np.ravel(corner), 0) for corner in corners)
    return b"made up".ljust(80) + struct.pack("<I", len(corners)) + rows


def stl_ascii(corners) -> bytes:
    lines = ["solid made up"]
    for corner in corners:
        lines += ["facet normal 0 0 0", " outer loop"]
        lines += ["  vertex " + " ".join(map(repr, map(float, point))) for point in corner]
        lines += [" endloop", "endfacet"]
    return ("\n".join([*lines, "endsolid made up"]) + "\n").encode()


class Gltf:
    """A glTF document built array by array."""

    def __init__(self) -> None:
        self.binary = b""
        self.document: dict = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": []}

    def add(self, array: np.ndarray, kind: str, **more) -> int:
        """The number of a new accessor for `array`."""
        code = {"f4": 5126, "u4": 5125, "u2": 5123, "u1": 5121, "i2": 5122}[array.dtype.str[1:]]
        self.document["bufferViews"].append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": array.nbytes})
        self.binary += array.tobytes() + b"\0" * (-array.nbytes % 4)
        view = len(self.document["bufferViews"]) - 1
        entry = {"bufferView": view, "componentType": code, "count": len(array), "type": kind, **more}
        self.document["accessors"].append(entry)
        return len(self.document["accessors"]) - 1

    def primitive(self, vertices, faces, normals=None, **more) -> dict:
        attributes = {"POSITION": self.add(np.asarray(vertices, "<f4"), "VEC3")}
        if normals is not None:
            attributes["NORMAL"] = self.add(np.asarray(normals, "<f4"), "VEC3")
        return {"attributes": attributes, "indices": self.add(np.ravel(faces).astype("<u2"), "SCALAR"), **more}

    def glb(self) -> bytes:
        document = {**self.document, "buffers": [{"byteLength": len(self.binary)}]}
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        total = 28 + len(text) + len(self.binary)
        head = struct.pack("<4sII", b"glTF", 2, total) + struct.pack("<I4s", len(text), b"JSON")
        return head + text + struct.pack("<I4s", len(self.binary), b"BIN\0") + self.binary


def glb(vertices, faces) -> bytes:
    file = Gltf()
    file.document["meshes"] = [{"primitives": [file.primitive(vertices, faces)]}]
    file.document |= {"nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0}
    return file.glb()
