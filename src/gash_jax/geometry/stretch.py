"""How much a map to the plane stretches a surface (Sander, Snyder, Gortler & Hoppe 2001, section 3).

For the linear map of a triangle from the plane to space with partial derivatives S_s and S_t, a = S_s.S_s and
c = S_t.S_t, the L2 stretch is sqrt((a + c)/2): the root mean square length of the images of all unit vectors. That of
a surface is the root mean square over its area in space. It is multiplied here by sqrt(area in the plane / area in
space), so that 1 is the least possible, of a map that keeps lengths up to a scale; units do not count.
"""

import numpy as np
from jaxtyping import Float, Int

from gash_jax.geometry.mesh import face_areas


def signed_areas(uv: Float[np.ndarray, "n 2"], faces: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, "m"]:
    """Area of each face in the plane, positive where it is counter-clockwise."""
    a, b, c = (uv[faces[:, i]] for i in range(3))
    (ux, uy), (wx, wy) = (b - a).T, (c - a).T
    return (ux * wy - uy * wx) / 2


def face_stretch(
    uv: Float[np.ndarray, "n 2"], points: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]
) -> Float[np.ndarray, "m"]:
    """L2 stretch of each face, in lengths a unit of the plane; infinite for a face without area there."""
    (s1, t1), (s2, t2), (s3, t3) = (uv[faces[:, i]].T for i in range(3))
    q1, q2, q3 = (points[faces[:, i]] for i in range(3))
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / (2 * signed_areas(uv, faces))[:, None]
        along_s = (q1 * (t2 - t3)[:, None] + q2 * (t3 - t1)[:, None] + q3 * (t1 - t2)[:, None]) * scale
        along_t = (q1 * (s3 - s2)[:, None] + q2 * (s1 - s3)[:, None] + q3 * (s2 - s1)[:, None]) * scale
        stretch = np.sqrt(((along_s**2).sum(axis=1) + (along_t**2).sum(axis=1)) / 2)
    return np.where(np.isfinite(stretch), stretch, np.inf)


def total_stretch(
    uv: Float[np.ndarray, "n 2"],
    points: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    growth: Float[np.ndarray, "m"] | None = None,
) -> float:
    """L2 stretch of a surface; 1 is the least possible (module docstring).

    With `growth`, that of the surface whose faces keep their shapes but have their areas multiplied.
    """
    squares, area = _squares(uv, points, faces, growth)
    solid = area > 0  # what has no area in space cannot be stretched
    plane = np.abs(signed_areas(uv, faces)).sum()
    return float(np.sqrt(squares[solid] @ area[solid] * plane) / area.sum())


def vertex_stretch(
    uv: Float[np.ndarray, "n 2"],
    points: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    growth: Float[np.ndarray, "m"] | None = None,
) -> Float[np.ndarray, "n"]:
    """Root mean square of the stretch of the faces around each vertex, weighted by their areas (`growth` as above)."""
    squares, area = _squares(uv, points, faces, growth)
    area = np.maximum(area, np.finfo(float).tiny)
    corner = faces.ravel()
    top, bottom = (np.bincount(corner, np.repeat(values, 3), len(points)) for values in (squares * area, area))
    return np.sqrt(top / np.maximum(bottom, np.finfo(float).tiny))


def _squares(
    uv: np.ndarray, points: np.ndarray, faces: np.ndarray, growth: np.ndarray | None
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
    """Squared stretch and area of each face, with its area multiplied where `growth` says so."""
    area = face_areas(points, faces)
    squares = face_stretch(uv, points, faces) ** 2
    return (squares, area) if growth is None else (squares * growth, area * growth)
