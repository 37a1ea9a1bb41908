"""What a glTF 2.0 file holds before any geometry: its JSON document, its buffers, the values of its accessors.

A file says which extensions it needs to be understood (`extensionsRequired`: one that is not read here is refused, as
glTF 2.0, 3.12 demands) and which it uses. Of the latter those are noted that are neither read nor known to leave the
shape alone. Compressed geometry is refused, unless the file holds it uncompressed as well.
"""

import base64
import json
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np

from gash_jax.formats.number_text import refuse_wide_text
from gash_jax.geometry.mesh import MeshError

INSTANCING = "EXT_mesh_gpu_instancing"
MOST_VALUES = 1 << 28  # rows of an accessor without data
_READ = {INSTANCING, "KHR_mesh_quantization"}
_COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
# materials, textures, lights, metadata: they leave the shape and what is seen of it alone
_HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "MSFT_packing_", "ADOBE_materials_")
_HARMLESS += ("KHR_lights_", "EXT_lights_", "KHR_techniques_webgl", "KHR_xmp", "KHR_animation_pointer")
_HARMLESS += ("EXT_mesh_features", "EXT_instance_features", "EXT_structural_metadata", "EXT_mesh_manifold")
_HARMLESS += ("CESIUM_primitive_outline", "FB_geometry_metadata", "KHR_audio")

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_OUTSIDE = "the glTF file points outside its buffers: it is damaged, export it again"


class Document(NamedTuple):
    """The JSON of a file, its buffers (None: left empty beside compressed data), and notes on its extensions."""

    json: dict[str, Any]
    buffers: list[bytes | None]
    notes: tuple[str, ...]

    def values(self, index: int) -> np.ndarray:
        """Values of an accessor, one row each; normalised integers as floats, sparse replacements made."""
        entry = self.json["accessors"][index]
        kind, width, count = np.dtype(_COMPONENTS[entry["componentType"]]), _WIDTHS[entry["type"]], entry["count"]
        if not 0 <= count <= MOST_VALUES:
            raise MeshError(f"the glTF file announces {count} values at once: it is damaged, export it again")
        if "bufferView" in entry:
            values = self._view(entry, count, kind, width)
        else:
            values = np.zeros((count, width), dtype=kind)
        if "sparse" in entry:
            values, sparse = values.copy(), entry["sparse"]
            places = np.dtype(_COMPONENTS[sparse["indices"]["componentType"]])
            at = self._view(sparse["indices"], sparse["count"], places, 1)[:, 0]
            values[at] = self._view(sparse["values"], sparse["count"], kind, width)
        if entry.get("normalized"):
            return np.maximum(values.astype(np.float64) / np.iinfo(kind).max, -1.0)
        return values

    def has_data(self, index: int) -> bool:
        """Whether the file holds the values of an accessor outside compressed data."""
        return not {"bufferView", "sparse"}.isdisjoint(self.json["accessors"][index])

    def _view(self, entry: dict[str, Any], count: int, kind: np.dtype, width: int) -> np.ndarray:
        view = self.json["bufferViews"][entry["bufferView"]]
        offset = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        stride = view.get("byteStride", kind.itemsize * width)
        buffer = self.buffers[view["buffer"]]
        if buffer is None:
            refuse_compressed(view)
            raise MeshError(_OUTSIDE)
        if count and (offset < 0 or stride < 0 or offset + (count - 1) * stride + kind.itemsize * width > len(buffer)):
            raise MeshError(_OUTSIDE)
        return np.ndarray((count, width), kind, buffer, offset, (stride, kind.itemsize))


def open_document(data: bytes, folder: Path) -> Document:
    """The document in the bytes of a .glb or .gltf file; buffers of a .gltf are looked for in `folder`.

    Raises MeshError.
    """
    document, binary = split_document(data)
    _check_version(document)
    notes = _check_extensions(document)
    entries = document.get("buffers", ())
    return Document(
        document, [_buffer(entry, binary if k == 0 else None, folder) for k, entry in enumerate(entries)], notes
    )


def named_files(data: bytes, folder: Path) -> list[Path]:
    """Files that a glTF document names, its buffers and pictures; none where it cannot be read."""
    try:
        document, _ = split_document(data)
        entries = [entry for kind in ("buffers", "images") for entry in document.get(kind, ())]
        addresses = [entry["uri"] for entry in entries if "uri" in entry]
        return [folder / unquote(uri) for uri in addresses if not uri.startswith("data:")]
    except (MeshError, ValueError, TypeError, AttributeError, RecursionError):
        return []


def refuse_compressed(entry: dict[str, Any]) -> None:
    """MeshError if a primitive or a view has compressed data, named."""
    for name in _COMPRESSED:
        if name in entry.get("extensions", {}):
            raise MeshError(f"the file is compressed with {name}: export it without compression")


def split_document(data: bytes) -> tuple[dict[str, Any], bytes | None]:
    """The JSON document and the binary chunk that follows it in a .glb."""
    if data[:4] != b"glTF":
        refuse_wide_text(data)
        return json.loads(data.decode("utf-8-sig")), None
    if data[4:8] == b"\x01\x00\x00\x00":
        raise MeshError("a glTF 1.0 file, of another version than 2: export it as glTF 2.0")
    if len(data) < 20 or len(data) < int.from_bytes(data[8:12], "little"):
        raise MeshError("the file ends before its data do: it is cut off, copy or export it again")
    if data[4:8] != b"\x02\x00\x00\x00":
        raise MeshError("a glTF file of another version than 2: export it as glTF 2.0")
    size = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + size].rstrip(b"\0")), data[28 + size :]


def _check_version(document: dict[str, Any]) -> None:
    version = str(document.get("asset", {}).get("version", "1.0" if isinstance(document.get("nodes"), dict) else "2.0"))
    if version.split(".")[0] != "2":
        raise MeshError(f"a glTF {version[:20]} file, of another version than 2: export it as glTF 2.0")


def _check_extensions(document: dict[str, Any]) -> tuple[str, ...]:
    """Refuse what is required and not read; a note on what is used, not read and not known to be harmless."""
    required, used = (document.get(f"extensions{kind}", ()) for kind in ("Required", "Used"))
    refuse_compressed({"extensions": required})
    unread = [name for name in (*required, *used) if name not in _READ and not name.startswith(_HARMLESS)]
    for name in unread:
        if name in required:
            raise MeshError(f"the file requires the glTF extension {name}, which is not read: export it without")
    noted = [name for name in dict.fromkeys(unread) if name not in _COMPRESSED]
    return tuple(f"the glTF extension {name} is not read: other programs may show another shape" for name in noted)


def _buffer(entry: dict[str, Any], binary: bytes | None, folder: Path) -> bytes | None:
    """Content of a buffer: `binary` if it has no address of its own."""
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
    if content is not None and len(content) < entry["byteLength"]:
        raise MeshError("a buffer is shorter than the glTF file says: it is cut off, copy or export it again")
    return content
