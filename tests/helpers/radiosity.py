"""Light that bounces, without rays: a sphere with an opening in closed form, two rectangles by form factors."""

import numpy as np

from gash_jax.geometry.mesh import Mesh, concatenate, transform
from gash_jax.shapes.primitives import patch, spherical_bowl
from tests.helpers.transfer_formulas import cavity_ao, free_transfer, polygon_form_factor, polygon_transfer, unshadowed

AXIS = np.array([0.48, 0.64, 0.6])  # of the opening of a cavity
Rectangle = tuple[np.ndarray, np.ndarray, np.ndarray]  # a corner and two sides; it faces first x second

GROOVE = tuple(  # two faces of 1 x 2 that meet at the y axis under 100 degrees
    (np.array([0.0, -1, 0]), *sides)
    for sides in (
        (np.array([1.0, 0, 0]), np.array([0.0, 2, 0])),
        (np.array([0.0, 2, 0]), np.array([np.cos(np.radians(100)), 0, np.sin(np.radians(100))])),
    )
)
PLATES = (  # two squares of side 1 that face each other at a distance of 0.4
    (np.zeros(3), np.array([1.0, 0, 0]), np.array([0.0, 1, 0])),
    (np.array([0.0, 0, 0.4]), np.array([0.0, 1, 0]), np.array([1.0, 0, 0])),
)


def slanted_cavity(half_angle: float, resolution: int = 16) -> Mesh:
    """The inside of a sphere with a circular opening about `AXIS`, its rim of 4 * resolution segments."""
    x = np.cross(AXIS, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return transform(spherical_bowl(half_angle, resolution), np.stack([x, AXIS, np.cross(x, AXIS)], axis=1))


def cavity_gain(half_angle: float, albedo: float, bounces: int, bands: int = 3) -> np.ndarray:
    """What `bounces` add to every coefficient of every vertex of such a cavity.

    t^n_k - t^0_k = (sin² a / 4) (A_l / pi) Y_k(axis) sum over q = 1 .. n of albedo^q (1 - f)^(q-1), f the open part of
    the sphere: from anywhere in it, a bounce brings the mean of what the wall receives.
    """
    closed = 1 - cavity_ao(half_angle)
    series = sum(albedo**q * closed ** (q - 1) for q in range(1, bounces + 1))
    return np.sin(half_angle) ** 2 / 4 * series * unshadowed(AXIS[None], bands)[0]


def rectangles(pair: tuple[Rectangle, ...], resolution: int) -> Mesh:
    """The two as a mesh of (resolution + 1)² vertices each."""
    return concatenate([patch(*one, resolution) for one in pair])


def radiosity(pair: tuple[Rectangle, ...], resolution: int, albedo: tuple[float, float], bounces: int) -> np.ndarray:
    """Nine coefficients (v, 9) at the vertices of `rectangles`: patch by patch, then gathered at the vertices.

    A point sees of the other rectangle what Lambert's formula says of each of its resolution² patches, and past it the
    sky, by a boundary integral. Patches have the light of their middles. Vertices on the other rectangle get nan.
    """
    size = resolution**2
    outlines = [one[0] + np.array([0 * one[1], one[1], one[1] + one[2], one[2]]) for one in pair]
    facing = [np.cross(one[1], one[2]) / np.linalg.norm(np.cross(one[1], one[2])) for one in pair]
    j, i = np.divmod(np.arange(size), resolution)
    corners = np.stack([np.stack([i + a, j + b], axis=1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))], axis=1)
    patches = [one[0] + corners @ np.stack(one[1:]) / resolution for one in pair]  # (patch, corner, 3)
    w, u = np.divmod(np.arange((resolution + 1) ** 2), resolution + 1)
    nodes = [one[0] + np.stack([u, w], axis=1) @ np.stack(one[1:]) / resolution for one in pair]

    def seen(side: int, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Direct transfer at points of one rectangle, and factors to the patches of the other."""
        normals = np.broadcast_to(facing[side], points.shape)
        with np.errstate(invalid="ignore"):
            direct = free_transfer(normals) - polygon_transfer(points, normals, outlines[1 - side])
            return direct, np.stack([polygon_form_factor(points, normals, one) for one in patches[1 - side]], axis=1)

    middles = [seen(side, patches[side].mean(axis=1)) for side in (0, 1)]
    arriving = [direct for direct, _ in middles]
    for _ in range(bounces - 1):
        arriving = [middles[s][0] + middles[s][1] @ (albedo[1 - s] * arriving[1 - s]) for s in (0, 1)]
    ends = [seen(side, nodes[side]) for side in (0, 1)]
    factors = [albedo[1 - s] * arriving[1 - s] * (bounces > 0) for s in (0, 1)]
    return np.concatenate([ends[s][0] + ends[s][1] @ factors[s] for s in (0, 1)])
