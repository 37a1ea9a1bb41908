"""What is hard about gloss: the ends of the lobes, no light, no normal, many bands, a large mesh."""

import tempfile
from pathlib import Path

import numpy as np

from experiments.hard_cases.directions import SILENT
from gash_jax.algebra.closed_forms import hemisphere
from gash_jax.algebra.sh import PRODUCT_BANDS, band_index, evaluate_sh
from gash_jax.light.brdf import phong
from gash_jax.light.shading import shade
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.plan import transfer_bytes
from gash_jax.prt.transfer import Transfer, save_transfer
from gash_jax.shapes.primitives import bumpy_sphere, icosphere

BANDS = 4
EYE = np.array([0.5, 0.3, 4.0])


def _ball(bands: int = BANDS) -> Transfer:
    return bake_transfer(icosphere(2), bands, 64, glossy=True)


def constant_light(exponent: float) -> tuple[float, str]:
    """On a convex body under constant light the radiance is sum_l k_l H_l (2l+1)/(4 pi) P_l(n.r)."""
    ball, light = _ball(), np.zeros((BANDS**2, 3))
    light[0] = 2 * np.sqrt(np.pi)
    lobe = phong(exponent)
    toward = EYE - ball.vertices
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    cosine = np.einsum("vi,vi->v", ball.normals, toward)  # r and v are as far from n
    weights = [float(lobe.factors[band]) * hemisphere(band) * (2 * band + 1) / (4 * np.pi) for band in range(BANDS)]
    expected = np.polynomial.legendre.legval(cosine, weights)
    found = np.asarray(shade(ball, light, view=EYE, lobe=lobe))
    return float(np.abs(found - expected[:, None]).max()), SILENT


def black_light() -> tuple[float, str]:
    """Radiance without any light."""
    found = shade(_ball(), np.zeros((BANDS**2, 3)), view=EYE, lobe=phong(1e4))
    return float(np.abs(found).max()), SILENT


def no_normal() -> tuple[float, str]:
    """Radiance of a vertex without a normal."""
    mesh = icosphere(1)
    normals = mesh.normals.copy()
    normals[3] = 0
    baked = bake_transfer(mesh._replace(normals=normals), BANDS, 64, glossy=True)
    found = shade(baked, np.ones((BANDS**2, 3)), view=EYE, lobe=phong(30))
    return float(np.abs(found[3]).max()), SILENT


def ten_bands() -> tuple[float, str]:
    """Visibility of a convex body in the 19 bands that products of ten have, against the hemisphere's."""
    ball = _ball(10)
    factors = np.array([hemisphere(int(band)) for band in band_index(PRODUCT_BANDS)])
    expected = np.asarray(evaluate_sh(ball.normals, PRODUCT_BANDS), np.float64) * factors
    assert ball.visibility is not None
    return float(np.abs(ball.visibility - expected).max()), SILENT


def million_vertices() -> tuple[float, str]:
    """Planned bytes of a glossy bake of a million vertices against those of its file."""
    mesh = bumpy_sphere(317)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "t.npz"
        save_transfer(path, bake_transfer(mesh, 3, 16, glossy=True))
        size = path.stat().st_size
    planned = transfer_bytes(mesh, 3, glossy=True)
    return abs(size / planned - 1), f"{planned / 2**20:.0f} MiB planned"


def without_visibility() -> object:
    """A lobe on a bake that is not glossy."""
    return shade(bake_transfer(icosphere(1), rays=16), np.ones((9, 3)), view=EYE, lobe=phong(30))
