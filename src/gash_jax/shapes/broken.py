"""Surfaces as no recipe makes them, out of those that recipes make: torn, thrown about, doubled, wound the wrong way.

Networks are not trained on them. What a network is worth on shapes unlike all that it has seen it can learn from these
alone: from them, beside shapes of the known kinds, `local` learns what errors to expect.

Each maps a generator and a surface to another surface, which need not be closed, nor wound outward, nor one piece.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.triangles import join, moved, random_rotation, without_unused

MOST_THROWN, MOST_PANELS = 600, 60

Breaker = Callable[[np.random.Generator, RawMesh], RawMesh]


def soup(rng: np.random.Generator, surface: RawMesh) -> RawMesh:
    """Some of the triangles, each for itself, of any size, thrown about in a ball."""
    count = round(np.exp(rng.uniform(np.log(30), np.log(MOST_THROWN))))
    corners = surface.vertices[rng.permutation(surface.faces)[:count]]
    corners = corners - corners.mean(axis=1, keepdims=True)
    sizes = np.exp(rng.normal(np.log(rng.uniform(0.1, 0.7)), 0.4, (len(corners), 1, 1)))
    corners = corners / np.maximum(np.abs(corners).max(axis=(1, 2), keepdims=True), 1e-9) * sizes
    return _loose(corners + rng.uniform(0.3, 1) * rng.normal(size=(len(corners), 1, 3)))


def exploded(rng: np.random.Generator, surface: RawMesh) -> RawMesh:
    """Every triangle for itself, smaller or larger about its middle, in half of them moved a little."""
    corners = surface.vertices[surface.faces]
    middle = corners.mean(axis=1, keepdims=True)
    shift = (rng.random() < 0.5) * rng.uniform(0, 0.05) * rng.normal(size=middle.shape)
    return _loose(middle + shift + rng.uniform(0.7, 1.3) * (corners - middle))


def panels(rng: np.random.Generator, surface: RawMesh) -> RawMesh:
    """Patches as sheets of their own, moved and turned a little, so that they stand off, overlap and cross."""
    middle = surface.vertices[surface.faces].mean(axis=1)
    count = int(rng.integers(3, MOST_PANELS))
    seeds = middle[rng.choice(len(middle), min(count, len(middle)), replace=False)]
    nearest = np.argmin(np.linalg.norm(middle[:, None] - seeds, axis=2), axis=1)
    parts, off = [], rng.uniform(0.002, 0.08)
    for number, seed in enumerate(seeds):
        if not np.any(nearest == number):
            continue
        patch = without_unused(RawMesh(surface.vertices - seed, surface.faces[nearest == number]))
        turn = np.linalg.qr(np.eye(3) + rng.uniform(0, 0.3) * rng.normal(size=(3, 3)))[0]
        parts.append(moved(patch, turn * np.sign(np.diag(turn)), seed + off * rng.normal(size=3)))
    return join(parts)


def holed(rng: np.random.Generator, surface: RawMesh) -> RawMesh:
    """With round holes, as scans have them, up to most of the surface."""
    left = ~_in_balls(rng, surface, rng.uniform(0.1, 0.6))
    return without_unused(RawMesh(surface.vertices, surface.faces[left])) if left.sum() > 20 else surface


def noisy(rng: np.random.Generator, surface: RawMesh) -> RawMesh:
    """Every vertex moved by up to a part of an edge's length, as raw scans have it."""
    a, b = (surface.vertices[surface.faces[:, i]] for i in (0, 1))
    edge = np.median(np.linalg.norm(a - b, axis=1)) * rng.uniform(0.05, 0.4)
    return RawMesh(surface.vertices + edge * rng.normal(size=surface.vertices.shape), surface.faces)


def flipped(rng: np.random.Generator, surface: RawMesh) -> RawMesh:
    """Some of the faces, or all, wound the wrong way."""
    share = 1.0 if rng.random() < 0.5 else rng.uniform(0.05, 1)
    turned = rng.random(len(surface.faces)) < share
    return RawMesh(surface.vertices, np.where(turned[:, None], surface.faces[:, ::-1], surface.faces))


def stretched(rng: np.random.Generator, surface: RawMesh) -> RawMesh:
    """Long along one axis, flat along another."""
    turned = moved(surface, random_rotation(rng))
    return RawMesh(turned.vertices * np.exp(rng.normal(0, 0.8, 3)), turned.faces)


def doubled(rng: np.random.Generator, surface: RawMesh) -> RawMesh:
    """Every face a second time, wound the other way; half of them with holes."""
    open_too = holed(rng, surface) if rng.random() < 0.5 else surface
    return RawMesh(open_too.vertices, np.concatenate([open_too.faces, open_too.faces[:, ::-1]]))


BROKEN: dict[str, Breaker] = {
    "soup": soup,
    "exploded": exploded,
    "panels": panels,
    "holed": holed,
    "noisy": noisy,
    "flipped": flipped,
    "stretched": stretched,
    "doubled": doubled,
}
# which have three vertices of its own for every face: about six times as many as the surface
LOOSE = ("soup", "exploded")


def _loose(corners: Float[np.ndarray, "f 3 3"]) -> RawMesh:
    return RawMesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def _in_balls(rng: np.random.Generator, surface: RawMesh, share: float) -> Bool[np.ndarray, "f"]:
    """Faces in balls about some of them, as many balls as hold the share."""
    middle = surface.vertices[surface.faces].mean(axis=1)
    radius = np.ptp(surface.vertices, axis=0).max() / 2
    inside = np.zeros(len(middle), bool)
    while inside.mean() < share:
        centre = middle[rng.integers(len(middle))]
        inside |= np.linalg.norm(middle - centre, axis=1) < radius * rng.uniform(0.05, 0.4)
    return inside
