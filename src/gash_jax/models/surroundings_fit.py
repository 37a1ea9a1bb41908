"""Choose what each patch reads of a pose (`surroundings`), and how alike the training poses are to it."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from gash_jax.geometry.animation import Animation
from gash_jax.geometry.mesh import referenced
from gash_jax.models.kernel_regression import RIDGES, Machine, known_machine, leave_one_out, spread_poses
from gash_jax.models.pose_reader import spread_in_faces, spread_vertices
from gash_jax.models.surroundings import GROUPS, POINTS, WAYS, matern, seen_points
from gash_jax.models.variance_components import variance_components

ANCHORS = 12
PARTS = 12  # of the body, among which a patch has its groups
NEAREST = 800  # vertices spread over the rest, of which a patch reads the nearest
NEAR, POWER = 0.03, 6.0  # weights of these fall off as 1 / (d² + NEAR²)^(POWER/2), d in diagonals of the rest
WIDER = 2.0  # than that of a part is the reach of a kernel of all that is near
STILL = 1e-4  # of the diagonal: what moves less counts as if it moved so far
TIMES = 600  # poses, at most, that amounts of parts and ridges are estimated from
OWN = POINTS // GROUPS  # points of a part


class Candidates(NamedTuple):
    """What the patches may read: their anchors, the parts of the body, the nearest points, and all of it as seen."""

    anchors: Int[np.ndarray, "q a"]
    axes: Float[np.ndarray, "q a 2"]
    parts: Int[np.ndarray, "c n"]
    near: Int[np.ndarray, "q n"]
    weights: Float[np.ndarray, "q n"]  # of the nearest
    seen: Float[np.ndarray, "t q p 3"]  # points of all parts, and the nearest, in diagonals of the rest


def divide_surface(
    points: Float[np.ndarray, "v 3"], count: int, rounds: int = 8
) -> tuple[Int[np.ndarray, "v"], Float[np.ndarray, "q 3"]]:
    """The patch of every vertex, and the middles of the patches: k-means from vertices far apart."""
    from scipy.spatial import KDTree  # slow to import, and a prediction does without

    middles = points[spread_vertices(points, count)]
    for _ in range(rounds):
        patch = KDTree(middles).query(points)[1]
        size = np.bincount(patch, minlength=len(middles))
        sums = np.stack([np.bincount(patch, axis, len(middles)) for axis in points.T], axis=1)
        middles = np.where(size[:, None] > 0, sums / np.maximum(size, 1)[:, None], middles)
    return np.asarray(KDTree(middles).query(points)[1]), middles


def patch_anchors(
    points: Float[np.ndarray, "v 3"], used: Int[np.ndarray, "u"], middles: Float[np.ndarray, "q 3"], reach: int
) -> tuple[Int[np.ndarray, "q a"], Float[np.ndarray, "q a 2"]]:
    """Anchors of every patch, spread over the `reach` vertices that are nearest to its middle, and their places along
    its two longest axes."""
    near = used[_nearest(points[used], middles, max(reach, ANCHORS))[1]]
    anchors = np.stack([own[spread_vertices(points[own], ANCHORS)] for own in near])
    apart = points[anchors] - points[anchors].mean(axis=1, keepdims=True)
    ways = np.linalg.svd(apart, full_matrices=False)[2]
    size = np.maximum((apart**2).sum(axis=(1, 2)), 1e-30)
    return anchors, np.einsum("qai,qji->qaj", apart, ways[:, :2]) / size[:, None, None]


def find_candidates(animation: Animation, middles: Float[np.ndarray, "q 3"], unit: float) -> Candidates:
    """What patches around these middles may read; `unit` is the diagonal of the rest."""
    mesh = animation.mesh
    used, points = spread_in_faces(mesh, NEAREST), mesh.vertices.astype(np.float64)
    whole = np.flatnonzero(referenced(mesh)) if len(mesh.faces) else used
    anchors, axes = patch_anchors(points, whole, middles, len(whole) // len(middles))
    part, _ = divide_surface(points[whole], min(PARTS, len(whole)))
    owned = [whole[part == number] for number in np.unique(part)]
    parts = np.stack([np.resize(own[spread_vertices(points[own], OWN)], OWN) for own in owned])
    apart, order = (
        np.stack([np.resize(row, POINTS) for row in array]) for array in _nearest(points[used], middles, POINTS)
    )
    chosen = np.concatenate([np.broadcast_to(parts.ravel(), (len(middles), parts.size)), used[order]], axis=1)
    read = jax.jit(lambda frame: seen_points(frame, anchors, axes.astype(np.float32), chosen))
    seen = np.stack([np.asarray(read(frame.astype(np.float32))) for frame in animation.frames()]) / np.float32(unit)
    weights = ((apart / unit) ** 2 + NEAR**2) ** (-POWER / 4)
    return Candidates(anchors, axes, parts, used[order], weights, seen)


def _nearest(
    points: Float[np.ndarray, "n 3"], middles: Float[np.ndarray, "q 3"], count: int
) -> tuple[Float[np.ndarray, "q c"], Int[np.ndarray, "q c"]]:
    """Distances and numbers of the points that are nearest to each middle, at most so many."""
    from scipy.spatial import KDTree  # slow to import, and a prediction does without

    found: Any = KDTree(points).query(middles, k=list(range(1, min(count, len(points)) + 1)))  # type: ignore[arg-type]
    return found


class Told(NamedTuple):
    """Groups of points, and the numbers that they tell of every pose."""

    points: Int[np.ndarray, "g n"]
    places: Float[np.ndarray, "t g n 3"]
    into: Float[np.ndarray, "g d w"]  # d = 3 n
    numbers: Float[np.ndarray, "t g w"]


class Reading(NamedTuple):
    """What one patch reads of all training poses, entries of the arrays of `surroundings`, and the ridge for it."""

    arrays: dict[str, np.ndarray]
    numbers: Float[np.ndarray, "t w"]
    ridge: float

    def kernel(self, poses: Float[np.ndarray, "t w"], known: Float[np.ndarray, "m w"]) -> Float[np.ndarray, "t m"]:
        """As `surroundings.pose_kernel`."""
        from scipy.spatial.distance import cdist

        if self.arrays["together"]:
            return self.arrays["amounts"][0] * matern(cdist(poses, known, "sqeuclidean"))
        found, amounts = np.zeros((len(poses), len(known))), self.arrays["amounts"]
        for amount, one, other in zip(amounts, *(np.split(x, GROUPS, axis=1) for x in (poses, known)), strict=True):
            found += amount * matern(cdist(one, other, "sqeuclidean"))
        return found

    def knowing(self, count: int) -> tuple[Float[np.ndarray, "w m"], Machine]:
        """The numbers of at most so many poses that tell most of the others, and the regression that knows them."""
        chosen = spread_poses(self.kernel(self.numbers, self.numbers), count)
        known = _as_stored(self.numbers[chosen])
        return known.T, known_machine(self.kernel(self.numbers, known), self.kernel(known, known), self.ridge)


def _as_stored(array: np.ndarray) -> np.ndarray:
    """Rounded as model files round it: with small ridges weights are large, and have to be those of what is read."""
    return array.astype(np.float16).astype(np.float64)


def read_patch(candidates: Candidates, patch: int, gram: Float[np.ndarray, "t t"], outputs: int) -> Reading:
    """The reading of a patch whose outputs, less their mean, have these products over the training poses."""
    some = np.unique(np.linspace(0, len(gram) - 1, min(len(gram), TIMES)).astype(int))
    gram = gram[np.ix_(some, some)]
    near, (parts, amounts, noise, added) = _near(candidates, patch), _added(candidates, patch, some, gram, outputs)
    errors = leave_one_out(_kernels(near.numbers[some])[0], gram, RIDGES)
    if errors.min() <= leave_one_out(added, gram, [noise])[0]:
        found, ridge, amounts = near, RIDGES[int(np.argmin(errors))], np.eye(GROUPS)[0]
    else:
        found, ridge = parts, noise
    into = found.into
    if found is parts:  # each group makes its own three numbers of its own points
        into = np.zeros((GROUPS, 3 * OWN, GROUPS, 3))
        into[np.arange(GROUPS), :, np.arange(GROUPS)] = found.into
    into = _as_stored(into.reshape(3 * POINTS, WAYS))
    places = found.places.reshape(-1, POINTS, 3)
    still = places.mean(axis=0)
    arrays = {
        "points": found.points.reshape(POINTS),
        "still": still,
        "into": into,
        "together": np.array(found is near),
        "amounts": amounts,
    }
    return Reading(arrays, (places - still).reshape(len(places), -1) @ into, ridge)


def _told(
    points: Int[np.ndarray, "g n"], places: Float[np.ndarray, "t g n 3"], weights: np.ndarray, ways: int, least: float
) -> Told:
    """Of each group the directions in which its points vary most, in units of how much they vary or of `least`."""
    flat = (weights[..., None] * (places - places.mean(axis=0))).reshape(*places.shape[:2], -1)
    values, axes = np.linalg.eigh(np.einsum("tgi,tgj->gij", flat, flat) / len(flat))
    size = np.sqrt(np.maximum(np.maximum(values, 0).sum(axis=1), least**2))
    into = axes[:, :, : -ways - 1 : -1] / size[:, None, None]
    return Told(points, places, np.repeat(weights, 3, axis=1)[..., None] * into, np.einsum("tgi,giw->tgw", flat, into))


def _near(candidates: Candidates, patch: int) -> Told:
    """The nearest points, as one group."""
    places = candidates.seen[:, patch, None, candidates.parts.size :].astype(np.float64)
    weights = candidates.weights[patch, None] / np.linalg.norm(candidates.weights[patch])
    found = _told(candidates.near[patch, None], places, weights, WAYS, STILL)
    return found._replace(into=found.into / WIDER, numbers=found.numbers / WIDER)


def _added(
    candidates: Candidates, patch: int, some: Int[np.ndarray, "s"], gram: Float[np.ndarray, "s s"], outputs: int
) -> tuple[Told, Float[np.ndarray, "g"], float, Float[np.ndarray, "s s"]]:
    """The parts that change a patch most, how much each does and the noise, relative to their sum, and their kernel of
    some poses."""
    count, own = candidates.parts.shape
    places = candidates.seen[:, patch, : count * own].reshape(-1, count, own, 3).astype(np.float64)
    found = _told(candidates.parts, places, np.ones((count, own)), WAYS // GROUPS, STILL * float(np.sqrt(own)))
    moves = np.sqrt((found.numbers**2).sum(axis=2).mean(axis=0)) > 0.1  # a part at rest would be a mere constant
    kernels = _kernels(found.numbers[some]) * moves[:, None, None]
    components = variance_components(kernels, gram, outputs, min(GROUPS, count))
    best = np.resize(np.argsort(-components.amounts)[:GROUPS], GROUPS)  # a small body has fewer parts
    amounts = np.where(np.arange(GROUPS) < count, components.amounts[best], 0)
    whole = max(float(amounts.sum()), 1e-30)
    told = Told(found.points[best], found.places[:, best], found.into[best], found.numbers[:, best])
    return told, amounts / whole, components.noise / whole, np.tensordot(components.amounts / whole, kernels, axes=1)


def _kernels(numbers: Float[np.ndarray, "t g w"]) -> Float[np.ndarray, "g t t"]:
    """The kernel of each group."""
    from scipy.spatial.distance import pdist, squareform

    return np.stack([matern(squareform(pdist(row, "sqeuclidean"))) for row in numbers.transpose(1, 0, 2)])
