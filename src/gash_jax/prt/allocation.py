"""Which vertices get more rays in the next round of a bake to an error, and how many rays it will take in all.

Wanted is the least number of rays for which the variances of all vertices add up to the budget. A vertex with N rays
is taken to have the variance v N^-RATE: lattices of points gain faster than the N^-1 of independent rays, but the edges
of shadows keep them from gaining much faster (measured: VARIANCE; RATE is about its slope). With fewest rays in all, N
is proportional to v^(1/(1 + RATE)) (Lagrange multiplier).

What v is has to be guessed from few rays: the four quarters of a lattice say little, and if they have all missed a
shadow they say that there is none. Neighbours on the surface see nearly the same shadows, so v is half a vertex's own
and half the mean of it and its neighbours.

Rays only ever double. A round doubles each vertex that wants at least sqrt(2) times the rays it has. Where no vertex
wants more than one doubling, the round might be the last; as the variance may fall faster than expected, only the half
of them that wants it most is doubled, then it is looked at again.
"""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from gash_jax.geometry.mesh import Mesh

PILOT = 8
RATE = 1.5
LAST_SHARE = 0.05
CLASSES = 16
# variance of lattices of 8, 16, 32 ... rays against that of 8 (`experiments/lattice_error`)
VARIANCE = (1, 0.227, 0.0734, 0.0287, 0.00896, 0.00359, 0.00105, 0.000435, 0.00015)


def lattice_variance(level: Float[np.ndarray, "a"] | Int[np.ndarray, "a"]) -> Float[np.ndarray, "a"]:
    """Variance of a lattice of 8 * 2^level rays against that of 8 rays, on generated shapes; N^-RATE beyond."""
    measured = np.minimum(level, len(VARIANCE) - 1)
    return np.array(VARIANCE)[measured.astype(int)] * np.exp2(-RATE * (level - measured))


def neighbour_mean(mesh: Mesh, active: Int[np.ndarray, "a"]) -> sp.csr_matrix:
    """Matrix (a, a): half a vertex's own value, half the mean over it and its active neighbours along edges."""
    number = np.full(len(mesh.vertices), -1)
    number[active] = np.arange(len(active))
    corners = number[mesh.faces]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    edges = edges[(edges >= 0).all(1)]
    ends = np.concatenate([edges, edges[:, ::-1], np.arange(len(active))[:, None].repeat(2, 1)])
    shape = (len(active), len(active))
    joined = sp.csr_matrix((np.ones(len(ends), np.float32), (ends[:, 0], ends[:, 1])), shape=shape)
    joined.data[:] = 1.0  # an edge counts once, however many faces share it
    mean = sp.diags(1.0 / np.asarray(joined.sum(1)).ravel()) @ joined
    return sp.csr_matrix((sp.identity(len(active)) + mean) / 2)


def _doublings(
    level: Int[np.ndarray, "a"],
    urgency: Float[np.ndarray, "a"],
    unit: Float[np.ndarray, "a"],
    law: Callable[[Float[np.ndarray, "c"]], Float[np.ndarray, "c"]],
    budget: float,
) -> Float[np.ndarray, "a"]:
    """How often each vertex should be doubled, `urgency` plus one multiplier for all, rounded, so that the variances,
    `unit` times `law` of the level, meet the budget."""
    # vertices of one level and nearly one urgency are one class: the search then costs nothing
    step = np.rint(urgency * CLASSES).astype(int)
    first = step.min()
    kind = level * (step.max() - first + 1) + step - first
    held = np.bincount(kind, unit)
    classes = np.flatnonzero(np.bincount(kind))
    class_level, class_step = np.divmod(classes, step.max() - first + 1)
    class_urgency = (class_step + first) / CLASSES

    low, high = -class_urgency.max() - 1.0, 60.0 - class_urgency.min()
    for _ in range(40):
        middle = (low + high) / 2
        count = np.floor(np.maximum(middle + class_urgency, 0.0) + 0.5)
        total = float(np.sum(held[classes] * law(class_level + count)))
        low, high = (middle, high) if total > budget else (low, middle)
    return np.floor(np.maximum(high + step / CLASSES, 0.0) + 0.5)


def choose_rays(
    rays: Int[np.ndarray, "a"], variance: Float[np.ndarray, "a"], budget: float, rate: float
) -> Int[np.ndarray, "a"]:
    """Rays of each vertex, powers of two times what it has, with which variances that fall as N^-rate meet the budget.

    >>> choose_rays(np.array([8, 8]), np.array([4.0, 1.0]), 3.2, 1.0)
    array([16,  8])
    """
    level = np.log2(rays / rays.min()).round().astype(int)
    unit = variance * np.exp2(rate * level)
    urgency = np.log2(np.maximum(unit, 1e-30)) / (1 + rate) - level
    count = _doublings(level, urgency, unit, lambda reached: np.exp2(-rate * reached), budget)
    return rays * np.exp2(count).astype(rays.dtype)


def choose_doublings(
    rays: Int[np.ndarray, "a"], variance: Float[np.ndarray, "a"], smooth: sp.csr_matrix, budget: float
) -> tuple[np.ndarray, float]:
    """Which vertices to double, and the rays that the bake is then expected to need in all.

    `variance` is what each vertex has with its present rays, `smooth` the matrix of `neighbour_mean`. Bisects for the
    multiplier with which the ray counts, rounded to doublings and never less than now, meet the budget.
    """
    level = np.log2(rays / PILOT).round().astype(int)
    unit = smooth @ (variance / lattice_variance(level))  # v, as the variance at PILOT rays
    urgency = np.rint(CLASSES * (np.log2(np.maximum(unit, 1e-30)) / (1 + RATE) - np.log2(rays))) / CLASSES
    count = _doublings(level, urgency, unit, lattice_variance, budget)
    chosen = count > 0
    if not chosen.any():  # the smoothed variances meet a budget that the vertices' own do not
        chosen = urgency >= np.quantile(urgency, 1 - LAST_SHARE)
    elif count.max() == 1 and chosen.mean() > LAST_SHARE:
        # the last doubling: half of it first, as the variance may fall faster than expected
        chosen &= urgency >= np.median(urgency[chosen])
    return chosen, float(np.sum(rays * np.exp2(count)))
