"""Procedural triangle meshes from (seed, index): the shapes that models are trained on.

Every kind is a recipe (generator, vertex count) -> surface. What real meshes differ in is varied on purpose: the
occlusion (limbs, furrows, cavities, plates, contact between parts), the tessellation (grids, Delaunay, marching
cubes, local refinement, decimation, long thin triangles) and the pose (bent, twisted, tapered, any way up).
Sources of the recipes: `organic`, `turned`, `mechanical`, `lattices`; `enclosed` for kinds dark inside, `drawn` for
parts with as few vertices as drawing programs give them. `broken` makes of all these what no network is trained on.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import WholeNumber, as_array, shown, whole_number
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh, RawMesh
from gash_jax.shapes.broken import BROKEN, LOOSE
from gash_jax.shapes.drawn import drilled, shaft, stacked
from gash_jax.shapes.enclosed import figure, housing, layers, machine, mouth, skull
from gash_jax.shapes.lattices import boxes, lattice, lattice_surface
from gash_jax.shapes.mechanical import bracket, gear, plate
from gash_jax.shapes.organic import blob, cavity, displaced, folded, limbs
from gash_jax.shapes.retessellation import collapse, jitter, refine_regions, refine_to, relax
from gash_jax.shapes.triangles import join, moved, random_rotation
from gash_jax.shapes.turned import grooved, knot, needle, sheet, superquadric, vessel

Recipe = Callable[[np.random.Generator, int], RawMesh]


def posed(rng: np.random.Generator, target: int) -> RawMesh:
    """A body of another kind, tapered, twisted and bent."""
    recipe = (limbs, lattice, grooved, bracket, blob, gear, superquadric, cavity)[int(rng.integers(8))]
    surface = refine_to(recipe(rng, target), target)
    axis = surface.vertices.std(axis=0).argmax()
    vertices = np.roll(surface.vertices, 1 - int(axis), axis=1)
    low, high = vertices[:, 1].min(), vertices[:, 1].max()
    height = high - low
    vertices = vertices * (2.0 / height) - [0, low * 2.0 / height + 1, 0]
    vertices = _bent(_twisted(_tapered(vertices, rng.uniform(-0.45, 0.45)), rng.uniform(-1.6, 1.6)), rng)
    return RawMesh(vertices, surface.faces)


def _tapered(vertices: Float[np.ndarray, "v 3"], amount: float) -> Float[np.ndarray, "v 3"]:
    factor = 1 + amount * vertices[:, 1]
    return np.stack([vertices[:, 0] * factor, vertices[:, 1], vertices[:, 2] * factor], -1)


def _twisted(vertices: Float[np.ndarray, "v 3"], amount: float) -> Float[np.ndarray, "v 3"]:
    x, y, z = vertices.T
    c, s = np.cos(amount * y), np.sin(amount * y)
    return np.stack([c * x + s * z, y, c * z - s * x], -1)


def _bent(vertices: Float[np.ndarray, "v 3"], rng: np.random.Generator) -> Float[np.ndarray, "v 3"]:
    """Bend the y axis into an arc in the xy plane, never so far that the inside of the arc folds over."""
    x, y, z = vertices.T
    curvature = min(rng.uniform(0.1, 1.3), 0.8 / max(x.max(), 1e-3))
    radius = 1 / curvature - x
    return np.stack([1 / curvature - radius * np.cos(curvature * y), radius * np.sin(curvature * y), z], -1)


def scene(rng: np.random.Generator, target: int) -> RawMesh:
    """Several bodies close together: on a plate, heaped, or beside a wall; some touch, some run into each other."""
    kinds = (blob, folded, displaced, limbs, superquadric, vessel, gear, lattice, knot, grooved, boxes, cavity)
    count = int(rng.integers(2, 6))
    grounded = rng.random() < 0.65
    share = target // (count + grounded)
    parts = []
    for number in range(count):
        recipe = kinds[int(rng.integers(len(kinds)))]
        body = retessellated(recipe, rng, share)
        if rng.random() < 0.5:
            body = moved(body, random_rotation(rng))
        size = np.linalg.norm(np.ptp(body.vertices, axis=0))
        body = moved(body, scale=float(rng.uniform(0.5, 1.1) / size))
        spot = 0.42 * np.sqrt(number) * np.array([np.cos(2.4 * number), 0.0, np.sin(2.4 * number)])
        low = body.vertices.min(axis=0) + [0.5 * np.ptp(body.vertices[:, 0]), 0.0, 0.5 * np.ptp(body.vertices[:, 2])]
        lift = rng.uniform(-0.02, 0.02) if grounded else rng.uniform(-0.3, 0.3)
        parts.append(moved(body, offset=spot - low + [0, lift, 0]))
    if grounded:
        x, y, z = rng.uniform(0.7, 1.2), rng.uniform(0.05, 0.2), rng.uniform(0.7, 1.2)
        slab = lattice_surface(np.ones((1, 1, 1), bool), [np.array([-x, x]), np.array([-y, y]), np.array([-z, z])], rng)
        parts.append(moved(refine_to(slab, share), offset=(0.0, -y, 0.0)))
    return join(parts)


RECIPES: dict[str, Recipe] = {
    "blob": blob,
    "folded": folded,
    "displaced": displaced,
    "limbs": limbs,
    "cavity": cavity,
    "knot": knot,
    "superquadric": superquadric,
    "vessel": vessel,
    "grooved": grooved,
    "needle": needle,
    "sheet": sheet,
    "gear": gear,
    "plate": plate,
    "bracket": bracket,
    "lattice": lattice,
    "boxes": boxes,
    "posed": posed,
    "scene": scene,
}
SHAPE_KINDS = tuple(RECIPES)
ENCLOSED: dict[str, Recipe] = {
    "mouth": mouth,
    "skull": skull,
    "housing": housing,
    "machine": machine,
    "layers": layers,
    "figure": figure,
}
DRAWN: dict[str, Recipe] = {"drilled": drilled, "shaft": shaft, "stacked": stacked}
WHOLE = RECIPES | ENCLOSED | DRAWN
ALL_KINDS = (*SHAPE_KINDS, *ENCLOSED, *DRAWN)
CHOICES = {"base": SHAPE_KINDS, "all": ALL_KINDS, "broken": tuple(BROKEN)}
# without long flat fans and sharp rims, which moving vertices would tear
SMOOTH_RECIPES = (blob, folded, displaced, limbs, cavity, bracket, superquadric, sheet)


def retessellated(recipe: Recipe, rng: np.random.Generator, target: int) -> RawMesh:
    """The recipe's surface as it is, or decimated, locally refined, relaxed, jittered; about `target` vertices.

    What a drawing program would export is left as it is.
    """
    if recipe in DRAWN.values():
        return recipe(rng, target)
    way = rng.choice(["plain", "decimated", "regions", "edges"], p=[0.35, 0.25, 0.2, 0.2])
    ratio = {"plain": 1.0, "decimated": rng.uniform(1.15, 1.6), "regions": rng.uniform(0.5, 0.8), "edges": 0.7}[way]
    surface = recipe(rng, round(ratio * target))
    if recipe in SMOOTH_RECIPES and rng.random() < 0.5:
        surface = relax(surface, int(rng.integers(1, 6)))
    if way == "regions":
        surface = refine_regions(surface, rng, target)
    metric = np.exp(rng.normal(scale=0.9, size=3)) if rng.random() < 0.5 else None
    surface = collapse(refine_to(surface, round(0.9 * target), metric), rng, round(1.1 * target))
    if recipe in SMOOTH_RECIPES and rng.random() < 0.4:
        surface = jitter(surface, rng, rng.uniform(0.1, 0.45))
    return surface


def shape_kind(seed: int, index: int, kinds: str = "base") -> str:
    """Kinds come in shuffled rounds: as many indices as there are kinds hold each once.

    `kinds` is "base" for the SHAPE_KINDS, "all" for ALL_KINDS or "broken" for BROKEN. Raises ValueError for
    anything else.
    """
    if not isinstance(kinds, str) or kinds not in CHOICES:
        raise ValueError(f"kinds is {shown(kinds)}: use {', '.join(CHOICES)}")
    names = CHOICES[kinds]
    block, place = divmod(index, len(names))
    return names[int(np.random.default_rng([seed, 0, block]).permutation(len(names))[place])]


def make_shape(
    seed: WholeNumber,
    index: WholeNumber,
    vertices: Sequence[WholeNumber] | np.ndarray = (1000, 4000),
    kinds: str = "base",
) -> tuple[str, Mesh]:
    """Shape number `index` of the corpus `seed`: its kind and its mesh, the same in every process.

    The vertex count is drawn log-uniformly from the range and met to about 30 %. Half of the shapes are turned
    freely, the others stand along the axes in one of 24 ways. `kinds` is "base" or "all", which has nine kinds more:
    dark inside, or of few large faces; or "broken", which is unlike all of them. Raises ValueError for a range that
    is none and for other kinds.

    >>> kind, mesh = gash_jax.make_shape(0, 5, vertices=(200, 300))
    >>> mesh.faces.shape[1]
    3
    """
    seed, index = whole_number(seed, "seed", 0), whole_number(index, "index", 0)
    span = np.asarray(as_array(vertices))
    if span.shape != (2,) or span.dtype.kind not in "iu" or not 4 <= span[0] <= span[1]:
        raise ValueError(f"vertices is {shown(vertices)}: give the lowest and the highest count, 4 or more")
    kind = shape_kind(seed, index, kinds)
    rng = np.random.default_rng([seed, 1, index])
    target = round(float(np.exp(rng.uniform(*np.log(span)))))
    surface = _broken(kind, rng, target) if kind in BROKEN else retessellated(WHOLE[kind], rng, target)
    rotation = random_rotation(rng) if rng.random() < 0.5 else _axis_rotation(rng)
    mesh, _ = prepare_mesh(moved(surface, rotation).vertices.astype(np.float32), surface.faces.astype(np.int32))
    return kind, mesh


def _broken(kind: str, rng: np.random.Generator, target: int) -> RawMesh:
    """A whole shape of any kind, broken."""
    recipe = WHOLE[ALL_KINDS[int(rng.integers(len(ALL_KINDS)))]]
    return BROKEN[kind](rng, retessellated(recipe, rng, max(target // 6, 60) if kind in LOOSE else target))


def _axis_rotation(rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    """One of the 24 rotations of the cube."""
    matrix = np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], size=3)
    return matrix * np.linalg.det(matrix)
