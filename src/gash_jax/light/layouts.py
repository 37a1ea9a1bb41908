"""Where the pixels of an environment map look, for every way of laying the sphere out in a rectangle.

A map is seen from inside, its centre (of a cross: the centre of its middle face) along -z, right of it +x, above it +y.

- latlong: t = (i + 1/2) pi / H from +y, p = ((j + 1/2) / W - 1/2) 2 pi, d = (sin t sin p, cos t, -sin t cos p).
- angular (light probe, Debevec 1998): a disk; at (u, v) in it, both from -1 to 1, right and up, with r² = u² + v²,
  d = (sin(pi r) u / r, sin(pi r) v / r, -cos(pi r)): the rim is +z all around.
- cross: six faces of a cube, the front in the middle of left, right, top, bottom; the back right of the right one
  (4:3) or below the bottom one, upside down (3:4).
- equal-area: octahedral square (Clarberg 2008) as in pbrt-v4, whose centre is up and whose corners are down, turned as
  its tool `makeequiarea` turns a latlong map: pbrt's left-handed (x, y, z), z up, are (-y, z, x) here.

Solid angles are exact for latlong, cross and equal-area; for angular they are those at the pixel centres (together 4 pi
to 2e-4 from 32 pixels on), 0 outside the disk.

A map that is twice as wide as high is taken as latlong, one whose picture can be nothing else as what it is; any other
is refused until its layout is named.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Shaped

from gash_jax.formats.picture import LightError

LAYOUTS = ("latlong", "angular", "cross", "equal-area")
_LIT_RIM = 0.9  # share of the pixels just inside the disk that must not be black in an angular map
# right, up and outward of the faces of a cross
_FRONT = np.array([[1, 0, 0], [0, 1, 0], [0, 0, -1]])
_RIGHT = np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0]])
_LEFT = np.array([[0, 0, -1], [0, 1, 0], [-1, 0, 0]])
_BACK = np.array([[-1, 0, 0], [0, 1, 0], [0, 0, 1]])
_TOP = np.array([[1, 0, 0], [0, 0, 1], [0, 1, 0]])
_BOTTOM = np.array([[1, 0, 0], [0, 0, -1], [0, -1, 0]])
_BELOW = np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1]])  # the back of a vertical cross
_VERTICAL = ((None, _TOP, None), (_LEFT, _FRONT, _RIGHT), (None, _BOTTOM, None), (None, _BELOW, None))
_HORIZONTAL = ((None, _TOP, None, None), (_LEFT, _FRONT, _RIGHT, _BACK), (None, _BOTTOM, None, None))


class Pixels(NamedTuple):
    """Unit directions of pixel centres, and the solid angle that each pixel stands for (0 outside the sphere)."""

    directions: Float[np.ndarray, "h w 3"]
    solid_angles: Float[np.ndarray, "h w"]


def layout_of(image: Shaped[np.ndarray, "h w 3"], named: str | None = None) -> tuple[str, tuple[str, ...]]:
    """The layout of a map, `named` by the user or by its file if not None, and a note where it was recognised.

    Raises LightError for an unknown name, for a shape that the named layout cannot have, and for a map that is not
    twice as wide as high and not certain to be something else.
    """
    height, width = image.shape[:2]
    if named is not None:
        _check_shape(named, height, width)
        return named, ()
    if width == 2 * height:
        return "latlong", ()
    if _faces(height, width) is not None and _is_blank_outside(image, height, width):
        return "cross", ("read as a cube cross by its shape and its empty corners; say so with --layout if it is none",)
    if height == width and _is_angular(image):
        return "angular", ("read as an angular map (light probe) by its black corners; name another with --layout",)
    raise LightError(
        f"the map has {width} x {height} pixels and is not twice as wide as high: "
        f"say how it is laid out with --layout {'|'.join(LAYOUTS)}"
    )


def pixel_rays(layout: str, height: int, width: int, rows: slice = slice(None)) -> Pixels:
    """Directions and solid angles of the pixels of a map, float64; of some rows if given.

    Raises LightError for an unknown layout and for a shape that the layout cannot have.
    """
    _check_shape(layout, height, width)
    kinds = {"latlong": _latlong, "angular": _angular, "cross": _cross, "equal-area": _equal_area}
    return kinds[layout](height, width, rows)


def _check_shape(layout: str, height: int, width: int) -> None:
    if layout not in LAYOUTS:
        raise LightError(f"unknown layout {layout!r}: choose one of {', '.join(LAYOUTS)}")
    if layout in ("angular", "equal-area") and height != width:
        raise LightError(f"an {layout} map is square, this one has {width} x {height} pixels: name another layout")
    if layout == "cross" and _faces(height, width) is None:
        raise LightError(
            f"a cube cross is 3 faces wide and 4 high or 4 wide and 3 high, "
            f"this map has {width} x {height} pixels: name another layout"
        )


def pixel_directions(height: int, width: int, rows: slice = slice(None)) -> Float[np.ndarray, "h w 3"]:
    """Unit directions of the pixel centres of a latlong map, float64; of some rows if given."""
    t = ((np.arange(height) + 0.5) / height * np.pi)[rows, None]
    p = (((np.arange(width) + 0.5) / width - 0.5) * 2.0 * np.pi)[None]
    return np.stack(np.broadcast_arrays(np.sin(t) * np.sin(p), np.cos(t), -np.sin(t) * np.cos(p)), axis=-1)


def pixel_solid_angles(height: int, width: int) -> Float[np.ndarray, "h"]:
    """Exact solid angle of one pixel of each row of a latlong map, float64; all pixels together cover 4 pi."""
    edges = np.cos(np.arange(height + 1) / height * np.pi)
    return (edges[:-1] - edges[1:]) * 2.0 * np.pi / width


def _latlong(height: int, width: int, rows: slice) -> Pixels:
    directions = pixel_directions(height, width, rows)
    return Pixels(directions, np.repeat(pixel_solid_angles(height, width)[rows, None], width, axis=1))


def _square(size: int, rows: slice) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Coordinates of pixel centres from -1 to 1, to the right and up."""
    along = (np.arange(size) + 0.5) / size * 2.0 - 1.0
    u, v = np.broadcast_arrays(along[None], -along[rows, None])
    return u, v


def _angular(height: int, width: int, rows: slice) -> Pixels:
    u, v = _square(width, rows)
    radius = np.hypot(u, v)
    slope = np.pi * np.sinc(radius)  # sin(pi r) / r
    directions = np.stack([slope * u, slope * v, -np.cos(np.pi * radius)], axis=-1)
    return Pixels(directions, np.where(radius < 1, np.pi * slope * (2.0 / width) ** 2, 0.0))


def _equal_area(height: int, width: int, rows: slice) -> Pixels:
    """EqualAreaSquareToSphere of pbrt-v4, whose second coordinate grows downwards."""
    u, up = _square(width, rows)
    v = -up
    inside = 1.0 - (np.abs(u) + np.abs(v))
    radius = 1.0 - np.abs(inside)
    angle = ((np.abs(v) - np.abs(u)) / np.where(radius > 0, radius, 1.0) + 1.0) * np.pi / 4.0
    z = np.copysign(1.0 - radius**2, inside)
    across = radius * np.sqrt(np.maximum(2.0 - radius**2, 0.0))
    x, y = np.copysign(np.cos(angle), u) * across, np.copysign(np.sin(angle), v) * across
    return Pixels(np.stack([-y, z, x], axis=-1), np.full(u.shape, 4.0 * np.pi / (height * width)))


def _faces(height: int, width: int) -> tuple[int, tuple] | None:
    """Pixels along a face of a cross and its rows of faces; None for another shape."""
    for faces in (_VERTICAL, _HORIZONTAL):
        size = width // len(faces[0])
        if size and (len(faces) * size, len(faces[0]) * size) == (height, width):
            return size, faces
    return None


def _cross(height: int, width: int, rows: slice) -> Pixels:
    found = _faces(height, width)
    assert found is not None  # checked by pixel_rays
    size, faces = found
    across = np.arange(size + 1) / size * 2.0 - 1.0
    number, local = np.divmod(np.arange(height)[rows], size)
    middle = (across[:-1] + across[1:]) / 2.0
    corners = np.arctan2(np.multiply.outer(across, across), np.sqrt(1.0 + np.add.outer(across**2, across**2)))
    directions, solid_angles = np.zeros((len(number), width, 3)), np.zeros((len(number), width))
    for row, line in enumerate(faces):
        for column, frame in enumerate(line):
            if frame is None:
                continue
            own, columns = number == row, slice(column * size, (column + 1) * size)
            right, up, outward = frame
            rays = middle[None, :, None] * right - middle[local[own], None, None] * up + outward
            directions[own, columns] = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
            steps = corners[:, 1:] - corners[:, :-1]
            solid_angles[own, columns] = (steps[1:] - steps[:-1])[local[own]]
    return Pixels(directions, solid_angles)


def _is_blank_outside(image: Shaped[np.ndarray, "h w 3"], height: int, width: int) -> bool:
    """Whether every square of a cross without a face has one colour."""
    found = _faces(height, width)
    assert found is not None
    size, faces = found
    blank = [
        image[row * size : (row + 1) * size, column * size : (column + 1) * size]
        for row, line in enumerate(faces)
        for column, frame in enumerate(line)
        if frame is None
    ]
    return all((square == square[0, 0]).all() for square in blank)


def _is_angular(image: Shaped[np.ndarray, "h w 3"]) -> bool:
    """Whether a square map is exactly black outside its disk, and lit along its rim."""
    u, v = _square(len(image), slice(None))
    radius, lit = np.asarray(np.hypot(u, v)), np.asarray(image.any(axis=-1))
    step = 2.0 / len(image)
    rim, outside = (radius < 1 - step) & (radius > 1 - 4 * step), radius > 1 + step
    if not rim.any() or not outside.any():  # too few pixels to tell
        return False
    return not lit[outside].any() and bool(lit[rim].mean() > _LIT_RIM)
