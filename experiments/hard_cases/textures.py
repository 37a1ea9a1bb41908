"""What is hard about transfer in textures: coordinates of other tiles, turned over, missing or overlapping; seams."""

import numpy as np

from experiments.hard_cases.directions import SILENT
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.seams import seam_jumps
from gash_jax.prt.texture import TransferTexture
from gash_jax.prt.texture_bake import bake_texture, lay_out
from gash_jax.shapes.primitives import bumpy_sphere

SIZE = 48
TWO_FACES = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], np.float32)


def square() -> Mesh:
    """Two faces, flat, open."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    normals = np.tile(np.array([0, 0, 1], np.float32), (4, 1))
    return Mesh(corners, normals, np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def every_face_apart(mesh: Mesh) -> np.ndarray:
    """Texture coordinates that give each face a square of its own: every edge is a seam."""
    side = int(np.ceil(np.sqrt(len(mesh.faces))))
    row, column = np.divmod(np.arange(len(mesh.faces)), side)
    corners = np.array([[0.15, 0.15], [0.85, 0.15], [0.15, 0.85]])
    return ((np.stack([column, row], 1)[:, None] + corners) / side).astype(np.float32)


def _baked(uv: np.ndarray) -> TransferTexture:
    return bake_texture(square(), rays=16, size=SIZE, uv=uv)


def beside_the_tile() -> tuple[float, str]:
    """Coordinates of one tile beside 0 to 1 against those within."""
    moved, plain = _baked(TWO_FACES + np.array([3, -2], np.float32)), _baked(TWO_FACES)
    return float(np.abs(moved.texture.astype(np.float32) - plain.texture).max()), SILENT


def turned_over() -> tuple[float, str]:
    """Mirrored coordinates of a flat sheet, whose transfer is the closed form at every texel."""
    exact = np.asarray(unshadowed_transfer(np.array([[0.0, 0.0, 1.0]], np.float32), 3))
    mirrored = _baked(TWO_FACES * np.array([-1, 1], np.float32) + np.array([1, 0], np.float32))
    return float(np.abs(mirrored.texture.astype(np.float32) - exact).max()), SILENT


def seams_everywhere() -> tuple[float, str]:
    """Difference of both lookups at the points on seams where each edge is one and faces have few texels."""
    mesh = bumpy_sphere(3)
    uv = every_face_apart(mesh)
    baked = bake_texture(mesh, rays=64, size=2 * SIZE, uv=uv)
    values = baked.texture.reshape(len(baked.texture) ** 2, -1).astype(np.float64)
    jumps = seam_jumps(values, lay_out(mesh, 2 * SIZE, uv).seams)
    return float(np.abs(jumps).max() / np.abs(values).max()), SILENT


def overlapping() -> object:
    """Both faces in the same place of the texture."""
    return _baked(TWO_FACES[[0, 0]])


def several_tiles() -> object:
    """Coordinates that repeat the texture three times."""
    return _baked(TWO_FACES * 3)


def not_finite() -> object:
    """A corner without a place."""
    uv = TWO_FACES.copy()
    uv[1, 2, 0] = np.nan
    return _baked(uv)


def none_of_its_own() -> object:
    """A mesh without texture coordinates, asked for its own."""
    return bake_texture(square(), rays=16, size=SIZE, uv="own")
