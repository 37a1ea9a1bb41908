"""Closed forms of transfer against quadrature over the directions, or over the surface, that they are about."""

import numpy as np
import pytest
import sphericart
from numpy.polynomial.legendre import leggauss

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.shapes.primitives import icosphere
from tests.helpers import transfer_formulas as c
from tests.helpers.closed_forms import moved, turned_by

ONE = c.Y00  # t_0 of a free vertex
X, Y, Z = np.eye(3)


def _product(first: tuple[float, float], second: tuple[float, float], n: int = 80) -> tuple[np.ndarray, ...]:
    """Gauss-Legendre nodes of a rectangle, and weights."""
    nodes, weights = leggauss(n)
    (a, b), (p, q) = first, second
    x, y = np.meshgrid(a + (b - a) * (nodes + 1) / 2, p + (q - p) * (nodes + 1) / 2, indexing="ij")
    return x.ravel(), y.ravel(), np.outer(weights, weights).ravel() * (b - a) * (q - p) / 4


def _polar(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def _transfer(d: np.ndarray, solid_angle: np.ndarray, normal: np.ndarray = Z) -> np.ndarray:
    """(1/pi) sum n.w Y(w) dw, nine coefficients."""
    return (d @ normal * solid_angle) @ c.sh9(d) / np.pi


def _cap(half_angle: float, normal: np.ndarray = Z) -> np.ndarray:
    """Transfer of a round piece of the sky about +z."""
    theta, phi, weight = _product((0, half_angle), (0, 2 * np.pi))
    return _transfer(_polar(theta, phi), weight * np.sin(theta), normal)


def _lune(low: float, high: float) -> np.ndarray:
    """Transfer of the directions between two half-planes through the y axis, at angles from +x."""
    along, around, weight = _product((0, np.pi), (low, high))
    d = np.stack([np.sin(along) * np.cos(around), np.cos(along), np.sin(along) * np.sin(around)], axis=-1)
    return _transfer(d, weight * np.sin(along))


def _surface(points: np.ndarray, area: np.ndarray, origin: np.ndarray, normal: np.ndarray = Z) -> float:
    """Form factor of a surface from its points and vector areas: sum cos cos / (pi r²) dA."""
    rays = points - origin
    square = np.einsum("ni,ni->n", rays, rays)
    return float(np.sum(rays @ normal * np.abs(np.einsum("ni,ni->n", rays, area)) / square**2) / np.pi)


def _disk(radius: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    r, phi, weight = _product((0, radius), (0, 2 * np.pi))
    points = np.stack([r * np.cos(phi), r * np.sin(phi), np.full_like(r, height)], axis=-1)
    return points, (weight * r)[:, None] * Z


def _parallelogram(corner: np.ndarray, right: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    u, v, weight = _product((0, 1), (0, 1))
    return corner + u[:, None] * right + v[:, None] * up, weight[:, None] * np.cross(right, up)


def _wall(height: float, distance: float) -> float:
    """Form factor of an endless wall: it hides elevations up to atan(height cos(phi) / distance)."""
    phi, part, weight = _product((-np.pi / 2, np.pi / 2), (0, 1))
    elevation = np.arctan(height * np.cos(phi) / distance)
    return float(np.sum(weight * elevation * np.sin(part * elevation) * np.cos(part * elevation)) / np.pi)


def _cavity(half_angle: float, polar: float) -> float:
    """Form factor of the opening of a unit sphere about +z, seen from a polar angle inside."""
    points, area = _disk(np.sin(half_angle), np.cos(half_angle))
    origin = _polar(np.array(polar), np.array(0.3))
    return _surface(points, area, origin, -origin)


TILTED = np.array([[-0.7, -0.4, 0.6], [0.9, -0.5, 0.8], [1.1, 0.8, 1.5], [-0.5, 0.9, 1.3]])
LEAN = np.array([np.sin(0.3), 0.0, np.cos(0.3)])

FORMULAS = {  # name -> (formula, quadrature)
    "cone 20": (lambda: c.cone_transfer(0.35), lambda: _cap(0.35)),
    "cone 70": (lambda: c.cone_transfer(1.22), lambda: _cap(1.22)),
    "free up": (lambda: c.free_transfer(Z), lambda: _cap(np.pi / 2)),
    "free aside": (lambda: c.free_transfer(X), lambda: c.rotation9(np.stack([Z, -Y, X])) @ _cap(np.pi / 2)),
    "groove 40": (lambda: c.groove_transfer(0.7), lambda: _lune(0, 0.7)),
    "groove 150": (lambda: c.groove_transfer(2.6), lambda: _lune(0, 2.6)),
    "groove ao": (lambda: np.sin(0.6) ** 2 * ONE, lambda: _lune(0, 1.2)[0]),
    "cavity 40": (lambda: c.cavity_ao(0.7), lambda: _cavity(0.7, 1.5)),
    "cavity 130": (lambda: c.cavity_ao(2.27), lambda: _cavity(2.27, 3.0)),
    "wall low": (lambda: c.wall_ao(0.5, np.array(2.0)), lambda: 1 - _wall(0.5, 2.0)),
    "wall high": (lambda: c.wall_ao(5.0, np.array(2.0)), lambda: 1 - _wall(5.0, 2.0)),
    "corner": (lambda: 0.25 * ONE, lambda: _transfer(*_octant())[0]),
    "sphere leaning": (lambda: c.sphere_ao(0.5, 1.5, np.array(0.9)), lambda: 1 - _leaning_sphere(1 / 3, 0.9)),
    "sphere zonal": (lambda: c.sphere_transfer(1.0, 1.2), lambda: _cap(np.pi / 2) - _cap(np.arcsin(1 / 1.2))),
    "convex on plane": (lambda: c.convex_on_plane_ao(Z, LEAN), lambda: _lune(0, np.pi - 0.3)[0] / ONE),
    "disk": (lambda: c.disk_form_factor(0.8, 1.3), lambda: _surface(*_disk(0.8, 1.3), np.zeros(3))),
    "rectangle": (
        lambda: c.rectangle_form_factor(1.0, 2.0, 0.9),
        lambda: _surface(*_parallelogram(0.9 * Z, 1.0 * X, 2.0 * Y), np.zeros(3)),
    ),
    "polygon": (
        lambda: c.polygon_form_factor(np.array([[0.1, 0.2, 0]]), LEAN[None], TILTED)[0],
        lambda: _surface(
            *_parallelogram(TILTED[0], TILTED[1] - TILTED[0], TILTED[3] - TILTED[0]), np.array([0.1, 0.2, 0]), LEAN
        ),
    ),
}


def _octant() -> tuple[np.ndarray, np.ndarray]:
    theta, phi, weight = _product((0, np.pi / 2), (0, np.pi / 2))
    return _polar(theta, phi), weight * np.sin(theta)


def _leaning_sphere(sine: float, lean: float) -> float:
    """Form factor of a sphere of sin(half-angle) `sine` whose centre is `lean` away from the normal."""
    return float(_cap(np.arcsin(sine), np.array([np.sin(lean), 0, np.cos(lean)]))[0] / ONE)


def _agree(formula: np.ndarray | float, quadrature: np.ndarray | float) -> bool:
    return bool(np.allclose(formula, quadrature, rtol=0, atol=1e-9))


@pytest.mark.parametrize("name", FORMULAS)
def test_formula_is_its_integral(name: str) -> None:
    formula, quadrature = FORMULAS[name]
    assert _agree(formula(), quadrature())


WRONG = {  # slips that leave the size about right
    "cone 70": lambda: c.cone_transfer(1.22) * np.array([1, 1, 1.001, 1, 1, 1, 1, 1, 1]),
    "groove 40": lambda: c.groove_transfer(0.7)[[0, 1, 2, 3, 4, 7, 6, 5, 8]],
    "cavity 40": lambda: np.sin(0.35) ** 2 * 1.001,
    "wall high": lambda: 1 - (1 - 1 / (1 + (5 / 2) ** 2)) / 2,
    "sphere leaning": lambda: 1 - np.cos(0.9) ** 2 * (1 / 3) ** 2,
    "convex on plane": lambda: np.cos(0.3),
    "disk": lambda: 0.8**2 / 1.3**2,
    "rectangle": lambda: 2 * c.rectangle_form_factor(0.5, 2.0, 0.9),
    "polygon": lambda: c.polygon_form_factor(np.array([[0.1, 0.2, 0]]), LEAN[None], TILTED[[0, 2, 1, 3]])[0],
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_formula_is_noticed(name: str) -> None:
    assert not _agree(WRONG[name](), FORMULAS[name][1]())


def test_clamped_cosine_to_ten_bands() -> None:
    """A_l is 2 pi times the integral of z P_l over [0, 1]; and the closed form that the package offers."""
    nodes, weights = leggauss(40)
    z = (nodes + 1) / 2
    factors = [np.sum(weights / 2 * z * np.polynomial.Legendre.basis(band)(z)) * 2 * np.pi for band in range(10)]
    np.testing.assert_allclose([c.clamped_cosine(band) for band in range(10)], factors, atol=1e-13)
    np.testing.assert_allclose(np.array(factors)[[2, 4, 6, 8]] / np.pi, [1 / 4, -1 / 24, 1 / 64, -1 / 128], atol=1e-13)
    normals = c.unit(np.random.default_rng(0).normal(size=(50, 3))).astype(np.float32)
    np.testing.assert_allclose(
        np.asarray(unshadowed_transfer(normals, 10)), c.unshadowed(normals.astype(np.float64), 10), atol=5e-7
    )


def test_nine_harmonics_and_their_rotation() -> None:
    d = c.unit(np.random.default_rng(1).normal(size=(50, 3)))
    np.testing.assert_allclose(c.sh9(d), np.asarray(sphericart.SphericalHarmonics(2).compute(d)), atol=1e-14)
    rotation = turned_by(4)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1)
    matrix = c.rotation9(rotation)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(9), atol=1e-12)
    np.testing.assert_allclose(matrix[1:4, 1:4], rotation[np.ix_([1, 2, 0], [1, 2, 0])], atol=1e-12)


def test_boundary_integral_of_a_parallelogram() -> None:
    """All nine coefficients against a surface integral, and t_0 against Lambert's formula."""
    origin = np.array([0.1, 0.2, 0.0])
    points, area = _parallelogram(TILTED[0], TILTED[1] - TILTED[0], TILTED[3] - TILTED[0])
    rays = points - origin
    solid_angle = np.abs(np.einsum("ni,ni->n", rays, area)) / np.linalg.norm(rays, axis=1) ** 3
    found = c.polygon_transfer(origin[None], LEAN[None], TILTED)[0]
    np.testing.assert_allclose(found, _transfer(c.unit(rays), solid_angle, LEAN), atol=1e-9)
    lambert = c.polygon_form_factor(origin[None], LEAN[None], TILTED)[0]
    assert found[0] / ONE == pytest.approx(lambert, abs=1e-12)


def test_polygons_are_cut_at_the_horizon() -> None:
    """A wall that goes on below the ground hides no more than the part above; a polygon below hides nothing."""
    deep = np.array([[2.0, -3, -4], [2, 3, -4], [2, 3, 1], [2, -3, 1]])  # as wide above as below
    whole = c.polygon_transfer(np.zeros((1, 3)), Z[None], deep)
    above = deep.copy()
    above[:2, 2] = 0
    np.testing.assert_allclose(whole, c.polygon_transfer(np.zeros((1, 3)), Z[None], above), atol=1e-12)
    np.testing.assert_array_equal(c.polygon_transfer(np.zeros((1, 3)), -Z[None], np.abs(deep)), np.zeros((1, 9)))


def test_silhouette_of_a_convex_body() -> None:
    """The faces that face the probe, one by one, against the silhouette."""
    body = moved(icosphere(1), 0.5, np.array([0.3, 0.2, 1.4]))
    corners = body.vertices.astype(np.float64)[body.faces]
    a, b, d = np.moveaxis(corners, 1, 0)
    facing = corners[np.einsum("fi,fi->f", np.cross(b - a, d - a), -a) > 0]
    faces = np.sum([c.polygon_transfer(np.zeros((1, 3)), Z[None], corner) for corner in facing], axis=0)
    np.testing.assert_allclose(c.convex_transfer(np.zeros((1, 3)), Z[None], body), faces, atol=1e-9)
