"""Closed forms of transfer, and the transfer of polygons and convex bodies as boundary integrals over the sky.

Transfer is (1/pi) integral V max(n.w, 0) Y_k(w) dw; ambient occlusion AO is the same without Y, t_0 = Y_00 AO.
The form factor F of an occluder is what it takes away: AO = 1 - F. All float64; nine coefficients are in the frame
of the normal z unless a normal is given.
"""

import numpy as np
import sphericart
from scipy.special import comb

from gash_jax.geometry.mesh import Mesh, face_normals

Y00 = 0.5 / np.sqrt(np.pi)


def sh9(d: np.ndarray) -> np.ndarray:
    """The first nine harmonics, spelt out: (..., 3) unit vectors -> (..., 9)."""
    x, y, z = np.moveaxis(d, -1, 0)
    a, b, c = np.sqrt(3 / (4 * np.pi)), np.sqrt(15 / (4 * np.pi)), np.sqrt(5 / (16 * np.pi))
    second = [b * x * y, b * y * z, c * (3 * z * z - 1), b * x * z, b / 2 * (x * x - y * y)]
    return np.stack([Y00 + 0 * x, a * y, a * z, a * x, *second], axis=-1)


def rotation9(rotation: np.ndarray) -> np.ndarray:
    """D with sh9(R d) = D sh9(d), solved for on a few directions."""
    d = unit(np.random.default_rng(0).normal(size=(40, 3)))
    return np.linalg.lstsq(sh9(d), sh9(d @ rotation.T), rcond=None)[0].T


def clamped_cosine(band: int) -> float:
    """A_l: the integral of max(n.w, 0) Y_lm is A_l Y_lm(n) (Ramamoorthi & Hanrahan 2001)."""
    if band == 1:
        return 2 * np.pi / 3
    if band % 2:
        return 0.0
    return 2 * np.pi * (-1) ** (band // 2 - 1) / ((band + 2) * (band - 1)) * float(comb(band, band // 2)) / 2**band


def free_transfer(normals: np.ndarray) -> np.ndarray:
    """Nine coefficients of unoccluded vertices."""
    factors = np.repeat([clamped_cosine(band) for band in range(3)], [1, 3, 5])
    return sh9(normals) * factors / np.pi


def unshadowed(normals: np.ndarray, bands: int) -> np.ndarray:
    """The same to any number of bands."""
    factors = np.concatenate([[clamped_cosine(band)] * (2 * band + 1) for band in range(bands)])
    return np.asarray(sphericart.SphericalHarmonics(bands - 1).compute(normals)) * factors / np.pi


def cone_transfer(half_angle: float) -> np.ndarray:
    """Nine coefficients of a vertex that sees a circular cone about its normal."""
    u, result = np.cos(half_angle), np.zeros(9)
    result[0] = np.sqrt(np.pi) / 2 * (1 - u**2)
    result[2] = np.sqrt(np.pi / 3) * (1 - u**3)
    result[6] = np.sqrt(5 * np.pi) / 8 * (1 - u**2) * (1 + 3 * u**2)
    return result / np.pi


def groove_transfer(opening: float) -> np.ndarray:
    """Nine coefficients on a face of an endless groove: edge along y, face in xy, n = z, open side +x."""
    w, c, s, q = opening, np.cos(opening), np.sin(opening), 3 * np.pi / 8
    one, two = np.sqrt(3 / (4 * np.pi)), np.sqrt(15 / (4 * np.pi))
    t10 = one * 4 / 3 * (w / 2 - np.sin(2 * w) / 4)
    t11 = one * 4 / 3 * s**2 / 2
    t20 = np.sqrt(5 / (16 * np.pi)) * (3 * q * (2 / 3 - c + c**3 / 3) - np.pi / 2 * (1 - c))
    t21 = two * q * s**3 / 3
    t22 = two / 2 * (q * (1 - c**3) / 3 - np.pi / 8 * (1 - c))
    return np.array([Y00 * np.pi / 2 * (1 - c), 0, t10, t11, 0, 0, t20, t21, t22]) / np.pi


def cavity_ao(half_angle: float) -> float:
    """Anywhere inside a sphere with a circular opening."""
    return (1 - np.cos(half_angle)) / 2


def wall_ao(height: float, distance: np.ndarray) -> np.ndarray:
    """On the ground before an endless wall."""
    return 1 - (1 - 1 / np.sqrt(1 + (height / distance) ** 2)) / 2


def sphere_ao(radius: float, distance: float, angle: np.ndarray) -> np.ndarray:
    """Below a sphere, its centre at an angle from the normal, all of it above the horizon."""
    return 1 - np.cos(angle) * (radius / distance) ** 2


def sphere_transfer(radius: float, distance: float) -> np.ndarray:
    """Nine coefficients below a sphere straight above."""
    return cone_transfer(np.pi / 2) - cone_transfer(np.arcsin(radius / distance))


def convex_on_plane_ao(normals: np.ndarray, up: np.ndarray) -> np.ndarray:
    """On a convex body that stands on an endless plane."""
    return (1 + normals @ up) / 2


def disk_form_factor(radius: float, height: float) -> float:
    """A parallel disk, its centre straight above."""
    return radius**2 / (radius**2 + height**2)


def rectangle_form_factor(a: float, b: float, height: float) -> float:
    """A parallel rectangle of sides a and b, one corner straight above."""
    p, q = a / height, b / height
    r, s = np.sqrt(1 + p * p), np.sqrt(1 + q * q)
    return float((p / r * np.arctan(q / r) + q / s * np.arctan(p / s)) / (2 * np.pi))


def polygon_form_factor(points: np.ndarray, normals: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Lambert's formula for a polygon (c, 3) above the horizon of all points."""
    rays = unit(polygon[None] - points[:, None])
    axis, angle = arcs(rays, np.roll(rays, -1, axis=1))
    return np.abs(np.einsum("pc,pci,pi->p", angle, axis, normals)) / (2 * np.pi)


# ---- the value of a mesh: boundary integrals ------------------------------------------------------------------------


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def arcs(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit axis and angle of the great-circle arcs between unit vectors."""
    cross = np.cross(start, end)
    sine = np.linalg.norm(cross, axis=-1)
    return cross / np.where(sine == 0, 1, sine)[..., None], np.arctan2(sine, np.sum(start * end, axis=-1))


def boundary_transfer(normal: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Nine coefficients of a region of the sky above the horizon, bounded by arcs (e, 3) -> (e, 3) in any order.

    In polar coordinates about the normal: along the arcs, dphi times the integral over theta from the pole to the
    arc, both by Gauss-Legendre. The sign is chosen such that t_0 is positive.
    """
    axis, angle = arcs(start, end)
    nodes, weights = (a / 2 for a in np.polynomial.legendre.leggauss(32 if angle.max() > 0.5 else 6))
    turn = angle[:, None] * (nodes + 0.5)
    d = np.cos(turn)[..., None] * start[:, None] + np.sin(turn)[..., None] * np.cross(axis, start)[:, None]
    z = d @ normal
    side = d - z[..., None] * normal
    sine = np.maximum(np.linalg.norm(side, axis=-1), 1e-30)
    dphi = (axis @ normal * angle)[:, None] * weights / sine**2
    polar = np.arctan2(sine, z)
    nodes, weights = (a / 2 for a in np.polynomial.legendre.leggauss(10))
    theta = polar[..., None] * (nodes + 0.5)
    inner = np.sin(theta)[..., None] * (side / sine[..., None])[..., None, :] + np.cos(theta)[..., None] * normal
    measure = np.sin(theta) * np.cos(theta) * (dphi * polar)[..., None] * weights
    result = np.einsum("enr,enrk->k", measure, sh9(inner)) / np.pi
    return result * np.sign(result[0])


def polygon_transfer(points: np.ndarray, normals: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Nine coefficients (p, 9) of the part of the sky above the horizon that a polygon (c, 3) covers."""
    result = np.zeros((len(points), 9))
    for index, (point, normal) in enumerate(zip(points, normals, strict=True)):
        rays = _above_horizon(polygon - point, normal)
        if len(rays):
            result[index] = boundary_transfer(normal, unit(rays), unit(np.roll(rays, -1, axis=0)))
    return result


def _above_horizon(rays: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The part of a polygon with n.x >= 0 (Sutherland & Hodgman 1974)."""
    kept, height = [], rays @ normal
    for a, b, p, q in zip(height, np.roll(height, -1), rays, np.roll(rays, -1, axis=0), strict=True):
        if a >= 0:
            kept.append(p)
        if a * b < 0:
            crossing = p + a / (a - b) * (q - p)
            kept.append(crossing - normal * (crossing @ normal))
    return np.array(kept)


def convex_transfer(points: np.ndarray, normals: np.ndarray, body: Mesh) -> np.ndarray:
    """Nine coefficients (p, 9) of the sky that a convex body above the horizon covers: all edges of its silhouette."""
    corners = body.vertices.astype(np.float64)
    facing = face_normals(corners, body.faces)
    tail, head = body.faces.ravel(), body.faces[:, [1, 2, 0]].ravel()
    forth, back = tail.astype(np.int64) << 32 | head, head.astype(np.int64) << 32 | tail
    order = np.argsort(forth)
    twin = order[np.searchsorted(forth[order], back)] // 3
    result = np.zeros((len(points), 9))
    for index, (point, normal) in enumerate(zip(points, normals, strict=True)):
        front = np.einsum("fi,fi->f", facing, point - corners[body.faces[:, 0]]) > 0
        rim = np.repeat(front, 3) & ~front[twin]
        result[index] = boundary_transfer(normal, unit(corners[tail[rim]] - point), unit(corners[head[rim]] - point))
    return result
