"""A sheet of cloth that falls over a ball which moves: extended position-based dynamics (Macklin, Müller & Chentanez
2016, "XPBD").

The sheet is a grid. Its constraints keep the distances of neighbours along rows and columns (stiff), along diagonals
(shear) and of next neighbours (bending, soft). They are solved in groups without a common vertex, each group at once:
along one direction of the grid every second pair. Gravity, air drag, and a floor under everything; a vertex that gets
into the ball or the floor is put back on its surface, and what it would slide there is damped. The sheet passes
through itself.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.geometry.animation import Animation, Recorded
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import lengths
from gash_jax.shapes.primitives import grid

SIDE, RADIUS, FLOOR = 2.0, 0.45, -0.9  # of the sheet, of the ball (about the origin at first), height of the floor
GAP = 0.02  # that the cloth keeps from ball and floor, as cloth has a thickness
STEP, SUBSTEPS, ROUNDS = 1 / 60, 4, 4  # seconds a frame; steps in it; rounds over all constraints in a step
GRAVITY, DRAG, FRICTION = 9.81, 0.6, 0.4
SOFT = {"stretch": 1e-8, "shear": 1e-5, "bend": 1e-3}  # compliance, metres per newton for a vertex of 1 kg


class Group(NamedTuple):
    """Constraints without a common vertex."""

    first: Int[np.ndarray, "c"]
    second: Int[np.ndarray, "c"]
    rest: Float[np.ndarray, "c"]
    compliance: float


def cloth_groups(points: Float[np.ndarray, "v 3"], count: int) -> list[Group]:
    """All constraints of a sheet of count x count vertices, row by row."""
    row, column = np.divmod(np.arange(count * count), count)
    kinds = (((0, 1), "stretch"), ((1, 0), "stretch"), ((1, 1), "shear"), ((1, -1), "shear"))
    groups = []
    for (down, right), kind in (*kinds, ((0, 2), "bend"), ((2, 0), "bend")):
        inside = (row + down < count) & (0 <= column + right) & (column + right < count)
        length = max(abs(down), abs(right))
        part = (row if down else column) // length % 2  # every second pair along the direction
        for parity in (0, 1):
            first = np.flatnonzero(inside & (part == parity))
            second = first + down * count + right
            groups.append(Group(first, second, lengths(points[first] - points[second]), SOFT[kind]))
    return groups


def ball_center(time: float) -> Float[np.ndarray, "3"]:
    """Where the ball is: it sways from side to side and turns in a circle."""
    return np.array([0.35 * np.sin(1.7 * time), 0.0, 0.25 * np.sin(1.1 * time)])


def cloth_animation(seed: WholeNumber, frames: WholeNumber, vertices_along: WholeNumber = 64) -> Animation:
    """A square sheet of vertices_along² vertices that falls over a swaying ball; frames of a sixtieth of a second.

    The seed gives the small bumps that the sheet starts with. Frame 0 is the rest: the sheet flat above the ball.
    """
    rng = np.random.default_rng([whole_number(seed, "seed", 0), 3])
    frames, count = whole_number(frames, "frames", 1), whole_number(vertices_along, "vertices_along", 4)
    u, w, faces = grid(count - 1, count - 1)
    points = SIDE * np.stack([w - 0.5, np.full(len(u), 0.3), u - 0.5], axis=1)
    points[:, 1] += 0.3 * RADIUS + 1e-3 * rng.normal(size=len(u))
    groups, velocity, found = cloth_groups(points, count), np.zeros_like(points), [points.astype(np.float32)]
    for number in range(1, frames):
        for part in range(SUBSTEPS):
            points, velocity = cloth_step(points, velocity, groups, STEP * (number - 1 + (part + 1) / SUBSTEPS))
        found.append(points.astype(np.float32))
    mesh, _ = prepare_mesh(found[0], faces.astype(np.int32))
    return Animation(
        mesh,
        np.arange(frames, dtype=np.float64)[:, None],
        ("frame",),
        Recorded(np.stack(found)),
        STEP * np.arange(frames),
    )


def cloth_step(
    points: Float[np.ndarray, "v 3"], velocity: Float[np.ndarray, "v 3"], groups: list[Group], time: float
) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 3"]]:
    """Positions and velocities one substep later; vertices weigh 1."""
    step = STEP / SUBSTEPS
    velocity = velocity * (1 - DRAG * step)
    velocity[:, 1] -= GRAVITY * step
    moved = points + step * velocity
    strain = [np.zeros(len(group.first)) for group in groups]
    for _ in range(ROUNDS):
        for group, pull in zip(groups, strain, strict=True):
            apart = moved[group.first] - moved[group.second]
            long = np.maximum(lengths(apart), 1e-12)
            soft = group.compliance / step**2
            change = -(long - group.rest + soft * pull) / (2 + soft)
            pull += change
            push = (change / long)[:, None] * apart
            moved[group.first] += push
            moved[group.second] -= push
        moved = _outside(points, moved, time)
    return moved, (moved - points) / step


def _outside(
    before: Float[np.ndarray, "v 3"], moved: Float[np.ndarray, "v 3"], time: float
) -> Float[np.ndarray, "v 3"]:
    """Vertices in the ball or the floor put on the surface, their sliding damped."""
    moved = moved.copy()
    center = ball_center(time)
    carried = center - ball_center(time - STEP / SUBSTEPS)
    away = moved - center
    far = lengths(away)
    hit = np.flatnonzero(far < RADIUS + GAP)
    outward = away[hit] / np.maximum(far[hit], 1e-12)[:, None]
    slide = moved[hit] - before[hit] - carried
    slide -= (slide * outward).sum(axis=1, keepdims=True) * outward
    moved[hit] = center + (RADIUS + GAP) * outward - FRICTION * slide
    low = moved[:, 1] < FLOOR + GAP
    moved[low, 1] = FLOOR + GAP
    moved[low] -= FRICTION * (moved[low] - before[low]) * [1, 0, 1]
    return moved
