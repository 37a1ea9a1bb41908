"""Gloss written out in float64, apart from the package: lobes, microfacets, integrals over directions and pixels.

Directions are (n, 3), areas the solid angle of each, so that a sum over them is an integral.
"""

import numpy as np
import sphericart


def harmonics(directions: np.ndarray, bands: int) -> np.ndarray:
    """Y_k at (n, 3) directions, (n, k)."""
    return np.asarray(sphericart.SphericalHarmonics(bands - 1).compute(np.ascontiguousarray(directions, np.float64)))


def half_sphere(normal: np.ndarray, nodes: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Directions and areas over the hemisphere of a normal: Gauss-Legendre in z times equal steps of azimuth, exact
    for polynomials below degree 2 nodes."""
    z, weight = np.polynomial.legendre.leggauss(nodes)
    z, weight = (z + 1) / 2, weight / 2
    azimuth = np.arange(2 * nodes) * np.pi / nodes
    r = np.sqrt(1 - z**2)[:, None]
    local = np.stack(np.broadcast_arrays(r * np.cos(azimuth), r * np.sin(azimuth), z[:, None]), -1).reshape(-1, 3)
    side = np.cross(normal, [0.0, 1.0, 0.0] if abs(normal[1]) < 0.9 else [1.0, 0.0, 0.0])
    side = side / np.linalg.norm(side)
    frame = np.stack([side, np.cross(normal, side), normal], axis=1)
    return local @ frame.T, np.repeat(weight * np.pi / nodes, 2 * nodes)


def phong_lobe(cosine: np.ndarray, exponent: float) -> np.ndarray:
    """(s + 1) / (2 pi) max(x, 0)^s; 0^0 counts as 1 above the plane only."""
    return (exponent + 1) / (2 * np.pi) * np.where(cosine > 0, np.maximum(cosine, 0.0) ** exponent, 0.0)


def cut_lobe(cosine: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """The lobe of as many bands as there are factors: sum of (2l+1)/(4 pi) k_l P_l."""
    bands = np.arange(len(factors))
    return np.polynomial.legendre.legval(cosine, (2 * bands + 1) / (4 * np.pi) * np.asarray(factors, np.float64))


def microfacets(normals: np.ndarray, toward: np.ndarray, directions: np.ndarray, alpha: float) -> np.ndarray:
    """GGX f(v, w) (n.w) without Fresnel, with height-correlated masking, 0 below the horizon. All (..., 3)."""
    half = directions + toward
    half = half / np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-12)
    nv, nw, nh = (np.sum(normals * other, axis=-1) for other in (toward, directions, half))
    facets = alpha**2 / (np.pi * (nh**2 * (alpha**2 - 1) + 1) ** 2)
    slope_v, slope_w = (np.sqrt(alpha**2 + (1 - alpha**2) * c**2) for c in (nv, nw))
    above = (nw > 0) & (nv > 0)
    return np.where(above, facets * nw / (2 * np.where(above, nw * slope_v + nv * slope_w, 1.0)), 0.0)


def mirrored(normals: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """2 (n.v) n - v."""
    return 2 * np.sum(normals * toward, axis=-1, keepdims=True) * normals - toward


def viewers(normals: np.ndarray, angle: float, seed: int = 0) -> np.ndarray:
    """A direction for each normal, at an angle from it in degrees, its azimuth at random."""
    side = np.cross(normals, np.random.default_rng(seed).normal(size=normals.shape))
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    return np.cos(np.radians(angle)) * normals + np.sin(np.radians(angle)) * side


def map_radiance(image: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Radiance of a latlong map along directions (n, 3): the pixel that holds each."""
    height, width = image.shape[:2]
    row = np.arccos(np.clip(directions[:, 1], -1, 1)) / np.pi * height
    column = (np.arctan2(directions[:, 0], -directions[:, 2]) / (2 * np.pi) + 0.5) * width
    return image[np.clip(row.astype(int), 0, height - 1), column.astype(int) % width].astype(np.float64)
