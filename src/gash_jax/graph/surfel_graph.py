"""Mesh -> vertices and the surfels that each of them looks at: what `nn.surfel_net` reads.

Vertices whose lists have the same width w (`surfel_lists`) make one part of the graph:

    position, normal (n, 3)
    near    (n, NEAR * 6)  offset and normal of up to NEAR corners of the vertex's own faces, repeated in turn where
            there are fewer
    cover   (n, 3)         how much the faces right beside the vertex cover (`surfel_cover`)
    table   (n, w)         rows of the records of `surfels`
    weight  (n, w)         how much each counts, 0 where the list has ended

The network reads `surfel` (n, w, 20), the records themselves, in place of the table (`with_surfels`): a few vertices at
a time, as all of them together would take 5 kB a vertex.

Positions are (vertex - center) / scale with the box centre and, as scale, the radius of the surface, which turns with
the mesh. All arrays are NumPy, float32 or int32.

Vertices at one place with one normal (`repeated_vertices`) are one vertex here: parts hold the first of them, faces
join those of all, and all have its slot.

What depends on the faces alone (tree, lists) is a `SurfelPlan`; the rest follows from positions and normals, with
NumPy or under jit, so a mesh that deforms keeps its plan.
"""

from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.geometry.mesh import Mesh, MeshError
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.geometry.topology import first_of_duplicates
from gash_jax.graph.repeated_vertices import first_of_repeated
from gash_jax.graph.surfel_cover import ClosePairs, surfel_cover, without_own
from gash_jax.graph.surfel_lists import SurfelList, list_surfels
from gash_jax.graph.surfels import SurfelTree, build_tree, surface_axes, surfel_records

NEAR = 8
# how far copies of a vertex may part in a pose, in units of the mesh
APART = 1e-3


Part = dict[str, Any]


class SurfelGraph(NamedTuple):
    """Parts by width (module docstring); vertex i of the mesh is number slot[i] of those of all parts in turn."""

    records: Float[np.ndarray, "s d"]
    parts: tuple[Part, ...]
    slot: Int[np.ndarray, "v"]
    center: Float[np.ndarray, "3"]
    scale: Float[np.ndarray, ""]


class SurfelPlan(NamedTuple):
    """Everything about the graph that positions do not change.

    `faces`: each once, wound as the normals say, between the vertices that are `first` of those at their place.
    """

    faces: Int[np.ndarray, "f 3"]
    first: Int[np.ndarray, "v"]
    tree: SurfelTree
    corners: Int[np.ndarray, "v m"]
    lists: tuple[SurfelList, ...]
    close: ClosePairs


def outward_faces(
    mesh: Mesh | NormalisedMesh, first: Int[np.ndarray, "v"]
) -> tuple[Int[np.ndarray, "f 3"], Float[np.ndarray, "f"]]:
    """The faces between the `first` of each place, each set of corners once, turned as their normals say; and areas."""
    shape = NormalisedMesh.of(mesh)
    normals = shape.mesh.normals
    faces = first[shape.mesh.faces].astype(np.int32)
    kept = first_of_duplicates(faces, len(normals)) == np.arange(len(faces))
    faces, vectors = faces[kept], shape.vector_areas[kept]
    a, b, c = (np.take(normals, faces[:, i], axis=0) for i in range(3))
    against = np.einsum("fi,fi->f", vectors.astype(np.float32), a + b + c) < 0
    return np.where(against[:, None], faces[:, ::-1], faces), shape.areas[kept]


def corner_table(faces: Int[np.ndarray, "f 3"], n_vertices: int, count: int = NEAR) -> Int[np.ndarray, "v m"]:
    """For every vertex the next corners of its first `count` faces, in turn; the vertex itself where it has none."""
    corner, following = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    # NumPy sorts plain numbers faster than it finds their order: the index is in the lower half
    order = np.sort((corner.astype(np.int64) << 32) | np.arange(len(corner))) & 0xFFFFFFFF
    found = np.bincount(corner, minlength=n_vertices)
    place = (np.cumsum(found) - found)[:, None] + np.arange(count) % np.maximum(found, 1)[:, None]
    table = np.append(following[order], 0)[np.minimum(place, len(order))].astype(np.int32)
    table[found == 0] = np.flatnonzero(found == 0)[:, None]
    return table


def normalised(mesh: Mesh | NormalisedMesh) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "3"], float]:
    """Positions about the box centre in units of the surface's radius, centre, unit; loose vertices within the box."""
    shape = NormalisedMesh.of(mesh)
    unit = _unit(shape)
    return shape.positions(unit).astype(np.float32), shape.center, unit


def _unit(shape: NormalisedMesh) -> float:
    return shape.radius or shape.half_diagonal


def plan_surfels(
    mesh: Mesh | NormalisedMesh, positions: Float[np.ndarray, "v 3"], moves: bool = False
) -> tuple[SurfelPlan, Float[np.ndarray, "s d"]]:
    """The plan of a mesh, and the records of its surfels at these positions (those of `normalised`).

    If the mesh `moves`, lists hold what may yet rise above the horizon, too.
    """
    shape = NormalisedMesh.of(mesh)
    normals = shape.mesh.normals
    first = first_of_repeated(positions, normals)
    faces, area = outward_faces(shape, first)
    area = area / _unit(shape) ** 2
    tree = build_tree(positions, faces, area, surface_axes(positions, faces, area))
    records = surfel_records(tree, positions, faces)
    own = np.flatnonzero(first == np.arange(len(first))).astype(np.int32)
    found, close = list_surfels(tree, records, positions[own], normals[own], moves)
    lists = tuple(part._replace(vertices=own[part.vertices]) for part in found)
    close = without_own(close, own, tree, faces)
    return SurfelPlan(faces, first, tree, corner_table(faces, len(positions)), lists, close), records


def part_arrays(
    plan: SurfelPlan,
    positions: Float[Any, "v 3"],
    normals: Float[Any, "v 3"],
    xp: ModuleType = np,
) -> tuple[Part, ...]:
    """The parts of the graph (module docstring); NumPy, or with `xp` = jax.numpy under jit."""
    both = xp.concatenate([positions, normals], axis=1)
    cover = surfel_cover(plan.close, plan.tree, plan.faces, positions, normals, xp)
    parts = []
    for vertices, table, weight in plan.lists:
        own = xp.take(both, vertices, axis=0)
        place, facing = own[:, :3], own[:, 3:]
        # the normals of the corners stay as they are
        origin = xp.concatenate([place, xp.zeros_like(facing)], axis=1)[:, None]
        near = xp.take(both, plan.corners[vertices], axis=0) - origin
        part = {"position": place, "normal": facing, "near": near.reshape(len(vertices), 6 * NEAR)}
        part["cover"] = xp.take(cover, vertices, axis=0)
        parts.append(part | {"table": xp.asarray(table), "weight": xp.asarray(weight)})
    return tuple(parts)


def with_surfels(part: Part, records: Float[Any, "s d"], xp: ModuleType = np) -> Part:
    """What the network reads of a part: the records in place of the table."""
    rest = {name: array for name, array in part.items() if name != "table"}
    return rest | {"surfel": xp.take(records, part["table"], axis=0)}


def vertex_slots(plan: SurfelPlan) -> Int[np.ndarray, "v"]:
    """The place of every vertex in the order of the parts."""
    order = np.concatenate([part.vertices for part in plan.lists])
    slot = np.zeros(len(plan.first), np.int32)
    slot[order] = np.arange(len(order), dtype=np.int32)
    return slot[plan.first]


def check_together(plan: SurfelPlan, positions: Float[np.ndarray, "v 3"]) -> None:
    """Raise MeshError where vertices that are one to the plan are apart in a pose (positions in units of the mesh)."""
    others = np.flatnonzero(plan.first != np.arange(len(plan.first)))
    apart = np.abs(positions[others] - positions[plan.first[others]]).max(axis=1, initial=0) > APART
    if apart.any():
        copy = others[np.argmax(apart)]
        raise MeshError(
            f"vertices {plan.first[copy]} and {copy} are one point of the surface in the first pose, not in this one: "
            "start from a pose in which they are apart"
        )


def surfel_graph(mesh: Mesh) -> SurfelGraph:
    """The graph of a mesh."""
    shape = NormalisedMesh(mesh)
    positions, center, unit = normalised(shape)
    plan, records = plan_surfels(shape, positions)
    return planned_graph(plan, records, positions, mesh.normals, center, unit)


def planned_graph(
    plan: SurfelPlan,
    records: Float[np.ndarray, "s d"],
    positions: Float[np.ndarray, "v 3"],
    normals: Float[np.ndarray, "v 3"],
    center: Float[np.ndarray, "3"],
    unit: float,
) -> SurfelGraph:
    """The graph of a plan at these positions."""
    parts = part_arrays(plan, positions, normals.astype(np.float32))
    return SurfelGraph(records, parts, vertex_slots(plan), np.asarray(center, np.float32), np.asarray(unit, np.float32))
