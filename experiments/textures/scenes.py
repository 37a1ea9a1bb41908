"""Low-poly meshes whose shadows are finer than their faces: two that are generated, and Spot with few of its faces."""

from pathlib import Path

import numpy as np

from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh, concatenate, transform
from gash_jax.shapes.organic import displaced
from gash_jax.shapes.primitives import box, icosphere, plane

SPOT_FACES = 600
SEED = 0


def table_on_a_floor() -> Mesh:
    """A floor of two triangles, a table on it, and an icosahedron cut once on the table."""
    top = transform(box((1.6, 0.08, 1.0)), translation=np.array([0.0, 0.9, 0.0]))
    leg = box((0.08, 0.86, 0.08))
    places = [np.array([x, 0.43, z]) for x in (-0.7, 0.7) for z in (-0.4, 0.4)]
    ball = transform(icosphere(1), translation=np.array([0.3, 1.24, 0.0]), scale=0.3)
    return concatenate([plane(3.2, 1), top, *(transform(leg, translation=place) for place in places), ball])


def body(vertices: int = 250) -> Mesh:
    """A closed body with ridges, of few faces."""
    surface = displaced(np.random.default_rng(SEED), vertices)
    return prepare_mesh(surface.vertices.astype(np.float32), surface.faces.astype(np.int32))[0]


def low_poly_spot(path: Path) -> Mesh:
    """Spot (Keenan Crane, public domain) with `SPOT_FACES` faces, by fast-simplification."""
    import fast_simplification  # type: ignore[import-not-found]

    whole = load_mesh(path)
    vertices, faces = fast_simplification.simplify(
        whole.vertices, whole.faces, target_reduction=1 - SPOT_FACES / len(whole.faces)
    )
    return prepare_mesh(vertices, faces.astype(np.int32))[0]


def scenes(folder: Path | None) -> dict[str, Mesh]:
    """The meshes by name; Spot where a folder holds it."""
    found = {"table": table_on_a_floor(), "body": body()}
    if folder is not None and (path := folder / "spot.ply").exists():
        found["Spot"] = low_poly_spot(path)
    return found
