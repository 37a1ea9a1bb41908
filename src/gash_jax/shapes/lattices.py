"""Recipes for right-angled shapes: solids of a box lattice in one piece, stacks and heaps of boxes.

A recipe maps a generator and a vertex count to a closed surface of about unit size with fewer vertices than that:
flat faces need few, and the caller refines where it wants more.
"""

import numpy as np
from jaxtyping import Bool, Float

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.triangles import join, moved, random_rotation, without_unused


def lattice(rng: np.random.Generator, target: int) -> RawMesh:
    """Right-angled solids of one piece: combs, stairs, frames, channels, chairs, mazes."""
    style = int(rng.integers(5))
    if style == 0:  # fins on a base
        filled = np.zeros((2 * int(rng.integers(3, 11)) + 1, 2, int(rng.integers(1, 3))), bool)
        filled[:, 0], filled[::2, 1] = True, True
    elif style == 1:  # stairs
        steps = int(rng.integers(3, 9))
        filled = np.repeat((np.arange(steps)[:, None] >= np.arange(steps))[:, :, None], 2, axis=2)
        filled[: steps // 2, :, 1] &= rng.random() < 0.5
    elif style == 2:  # table, chair or shelf: slabs on posts
        filled = np.zeros((3, 2 * int(rng.integers(1, 4)) + 1, 3), bool)
        filled[::2, :, ::2], filled[:, 1::2] = True, True
        filled[:, -1, 0] = True
    elif style == 3:  # frame with windows
        filled = np.zeros((2 * int(rng.integers(1, 5)) + 1, 2 * int(rng.integers(1, 4)) + 1, 1), bool)
        filled[::2], filled[:, ::2] = True, True
    else:  # boxes added to a core and cut from it
        size = rng.integers(4, 8, size=3)
        filled = np.zeros(size, bool)
        for number in range(int(rng.integers(4, 11))):
            low = [int(rng.integers(0, n - 1)) for n in size]
            high = [int(rng.integers(start + 1, n + 1)) for start, n in zip(low, size, strict=True)]
            filled[tuple(map(slice, low, high))] = number == 0 or rng.random() < 0.6
        filled[tuple(slice(n // 2, n // 2 + 1) for n in size)] = True
    return lattice_surface(_without_loose(filled), _spans(rng, filled.shape, style), rng)


def _spans(rng: np.random.Generator, shape: tuple[int, ...], style: int) -> list[Float[np.ndarray, "_"]]:
    """Grid coordinates: posts and fins thin, gaps wide or narrow, everything within about the unit cube."""
    spans = []
    for axis, count in enumerate(shape):
        widths = rng.uniform(0.5, 1.0, size=count)
        if count % 2 and style in (0, 2, 3):
            widths = np.where(np.arange(count) % 2, widths, rng.uniform(0.1, 0.6))
        if style == 0 and axis == 1:
            widths = np.array([rng.uniform(0.1, 0.3), rng.uniform(0.3, 1.2)])
        scale = rng.uniform(0.6, 2.0) / widths.sum() if count > 1 else rng.uniform(0.1, 0.8) / widths.sum()
        spans.append(np.concatenate([[0.0], np.cumsum(widths * scale)]))
    return spans


def _without_loose(filled: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Fill cells until no two filled cells touch along an edge alone."""
    for _ in range(8):
        padded = filled.copy()
        for axis_a, axis_b in ((0, 1), (0, 2), (1, 2)):
            view = np.moveaxis(padded, (axis_a, axis_b), (0, 1))
            a, b, c, d = view[:-1, :-1], view[1:, 1:], view[1:, :-1], view[:-1, 1:]
            c |= a & b & ~d
            a |= c & d & ~b
        if (padded == filled).all():
            break
        filled = padded
    return filled


def lattice_surface(
    filled: Bool[np.ndarray, "x y z"], spans: list[Float[np.ndarray, "_"]], rng: np.random.Generator
) -> RawMesh:
    """Faces between filled and empty cells, welded at the lattice points, centred on the origin."""
    occupied = np.pad(filled, 1)
    shape = np.array(filled.shape) + 1
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    quads = []
    for axis in range(3):
        for side in (1, 0):
            outside = np.roll(occupied, -1 if side else 1, axis=axis)
            cell = np.argwhere(occupied & ~outside) - 1
            p, q = (axis + 1) % 3, (axis + 2) % 3
            base = cell @ strides + side * strides[axis]
            ring = [base, base + strides[p], base + strides[p] + strides[q], base + strides[q]]
            quads.append(np.stack(ring if side else ring[::-1], -1))
    a, b, c, d = np.concatenate(quads).T
    first = (rng.random(len(a)) < 0.5)[:, None]
    faces = np.concatenate(
        [
            np.where(first, np.stack([a, b, c], -1), np.stack([a, b, d], -1)),
            np.where(first, np.stack([a, c, d], -1), np.stack([b, c, d], -1)),
        ]
    )
    middles = [span - 0.5 * (span[0] + span[-1]) for span in spans]
    points = np.stack(np.meshgrid(*middles, indexing="ij"), -1).reshape(-1, 3)
    return without_unused(RawMesh(points, faces))


def boxes(rng: np.random.Generator, target: int) -> RawMesh:
    """Stacks, heaps and rows of boxes with small gaps or overlaps between them."""
    style, count = int(rng.integers(3)), int(rng.integers(3, 25))
    parts = []
    for number in range(min(count, target // 8)):
        half = rng.uniform(0.08, 0.5, size=3) * (1.0 if style == 0 else 0.6)
        yaw = rng.uniform(-0.4, 0.4)
        turn = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
        if style == 0:  # a tower: each on the one before
            low = parts[-1].vertices[:, 1].max() + rng.uniform(-0.01, 0.02) if parts else 0.0
            offset = np.array([rng.uniform(-0.15, 0.15), low + half[1], rng.uniform(-0.15, 0.15)])
        elif style == 1:  # buildings on the ground
            half[1] *= rng.uniform(0.5, 3.0)
            offset = np.array([rng.uniform(-1, 1), half[1], rng.uniform(-1, 1)])
        else:  # a heap
            offset, turn = rng.normal(scale=0.4, size=3), random_rotation(rng)
        cuts = [np.linspace(-h, h, int(rng.integers(2, 5))) for h in half]
        cube = lattice_surface(np.ones([len(c) - 1 for c in cuts], bool), cuts, rng)
        parts.append(moved(cube, turn, offset + 1e-3 * number))
    if style == 1:
        ground = [np.linspace(-1.4, 1.4, 6), np.array([-0.15, 0.0]), np.linspace(-1.4, 1.4, 6)]
        parts.append(moved(lattice_surface(np.ones((5, 1, 5), bool), ground, rng), offset=(0, -0.075, 0)))
    return join(parts)
