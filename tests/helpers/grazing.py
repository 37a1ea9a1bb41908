"""Which rays are too close to call: decided in float64, apart from any float32 answer.

A ray is grazing for a triangle if it runs nearly in its plane (|n . d| < 1e-4), passes within 1e-5 of an edge in
barycentric coordinates, or meets it within the ray offset of its origin.
"""

import numpy as np

BARYCENTRIC, COSINE, ROUNDING = 1e-5, 1e-4, 1e-7


def grazing_rays(
    vertices: np.ndarray, faces: np.ndarray, origins: np.ndarray, directions: np.ndarray, offset: float
) -> np.ndarray:
    """Bool per ray: some triangle meets it in a way that float32 may decide either way."""
    corners = vertices.astype(np.float64)[faces]
    a, edge1, edge2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(edge1, edge2)
    area = np.linalg.norm(normal, axis=1)
    keep = area > 0
    a, edge1, edge2, normal, area = a[keep], edge1[keep], edge2[keep], normal[keep], area[keep]
    result = np.zeros(len(origins), bool)
    for start in range(0, len(origins), 256):
        o = origins[start : start + 256, None].astype(np.float64)
        d = directions[start : start + 256, None].astype(np.float64)
        p = np.cross(d, edge2)
        det = (p * edge1).sum(-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = o - a
            q = np.cross(s, edge1)
            u, v, t = (s * p).sum(-1) / det, (q * d).sum(-1) / det, (q * edge2).sum(-1) / det
            w = 1 - u - v
            inside = (u > -BARYCENTRIC) & (v > -BARYCENTRIC) & (w > -BARYCENTRIC) & (t > -ROUNDING)
            border = np.minimum(np.minimum(np.abs(u), np.abs(v)), np.abs(w)) < BARYCENTRIC
            near_hit = inside & (border | (t < offset))
            cosine = np.abs((normal / area[:, None] * d).sum(-1))
            plane = np.abs((s * normal).sum(-1)) / area
            # nearly in the plane counts only for planes the ray's origin is close to, or triangles it reaches
            flat = (cosine < COSINE) & ((plane < offset) | inside)
        result[start : start + 256] = (near_hit | flat).any(1)
    return result
