"""A transfer as a .glb file: its own mesh, or a scene that keeps its materials, textures, skins and clips.

The scene is the one that was baked, or one whose vertices are split: with a map (`weld`) coefficients go from file
vertices to engine vertices by place and normal (`geometry.vertex_matching`), and vertices at one place with one normal
get their mean first, so that no seam shows. Coefficients are those of the world at rest, whatever nodes and skins do
later.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from gash_jax.files.atomic import FileError, whole_file
from gash_jax.files.npz import write_npz
from gash_jax.formats.gltf import read_gltf
from gash_jax.formats.gltf_writing import Glb, Place, attach, mesh_glb, open_glb, texture_sets
from gash_jax.geometry.mesh import MeshError, lengths
from gash_jax.geometry.vertex_matching import TOLERANCE, mean_over, same_vertices, vertices_of
from gash_jax.prt.transfer import Transfer
from gash_jax.prt.vertex_attributes import vertex_attributes

OURS = "gash"  # the name of our own convention


class Asset(NamedTuple):
    """What was written: vertices of the .glb, names of its attributes, largest rounding of a coefficient."""

    vertices: int
    attributes: list[str]
    error: float


def write_asset(
    path: Path,
    transfer: Transfer,
    source: Path | None,
    style: str,
    store: str,
    weld: Path | None,
    convention: str = OURS,
) -> Asset:
    """Write the transfer into a .glb: `style` "sh" or "uv", `store` "float", "short" or "byte".

    `source` is a .glb whose scene is kept, `weld` a file for the map between its vertices and those of the transfer;
    `convention` is the name of that in which the coefficients are, for whoever reads the file.
    Raises ValueError, one line, where something does not fit; nothing is written then.
    """
    glb, places = open_glb(source) if source else mesh_glb(transfer.mesh)
    rows = _rows(transfer, source, weld is not None)
    coefficients = np.asarray(transfer.coefficients)
    if weld:
        labels = same_vertices(np.asarray(transfer.vertices), np.asarray(transfer.normals))
        flat = coefficients.reshape(len(coefficients), -1)
        coefficients = mean_over(labels, flat).reshape(coefficients.shape)
    first_set = texture_sets(glb, places) if style == "uv" else 0
    attributes, extras, error = vertex_attributes(coefficients[rows], style, store, first_set)
    extras["convention"] = convention
    _write(path, glb, places, attributes, {"gash": extras})
    if weld:
        write_npz(weld, weld_map(rows, len(coefficients)), {"format": "gash-weld"})
    return Asset(len(rows), [attribute.name for attribute in attributes], error)


def weld_map(rows: Int[np.ndarray, "e"], count: int) -> dict[str, Int[np.ndarray, "_"]]:
    """`file_vertex` of each engine vertex, and the first `engine_vertex` of each file vertex, -1 where it has none."""
    first = np.full(count, -1, np.int32)
    first[rows[::-1]] = np.arange(len(rows), dtype=np.int32)[::-1]
    return {"file_vertex": rows.astype(np.int32), "engine_vertex": first}


def _rows(transfer: Transfer, source: Path | None, by_place: bool) -> Int[np.ndarray, "e"]:
    """The vertex of the transfer for each vertex of the .glb."""
    file = np.asarray(transfer.vertices), np.asarray(transfer.normals)
    if source is None:
        return np.arange(len(file[0]))
    raw = read_gltf(source.read_bytes(), source.parent)
    engine = raw.vertices, np.zeros_like(raw.vertices) if raw.normals is None else raw.normals
    if by_place:
        return vertices_of(engine, file)
    if len(engine[0]) != len(file[0]):
        raise MeshError(
            f"the transfer has {len(file[0])} vertices and {source} {len(engine[0])}: bake {source} itself, "
            "or give --weld map.npz to carry the coefficients over by place and normal"
        )
    span = float(np.linalg.norm(np.ptp(file[0].astype(np.float64), axis=0)))
    if np.any(lengths(engine[0] - file[0].astype(np.float64)) > 10 * TOLERANCE * span):
        raise MeshError(f"the vertices of {source} are not where those of the transfer are: bake {source} itself")
    return np.arange(len(file[0]))


def _write(path: Path, glb: Glb, places: list[Place], attributes: list[Any], extras: dict[str, Any]) -> None:
    attach(glb, places, attributes, extras)
    content = glb.content()
    if len(content) >= 1 << 32:
        raise FileError(f"{path} would have {len(content)} bytes, and a .glb holds 2^32: use --store short or byte")
    with whole_file(path) as temporary:
        temporary.write_bytes(content)
