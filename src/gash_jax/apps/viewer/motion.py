"""What a page holds of animations: every frame as it is, or what fits of them.

Frames that fit stay: coefficients, visibility and normals in float16, positions as whole numbers of 16 bits on the grid
that `metadata["grid"]` names (value = low + number * step), which is 1.5e-5 of the size of the whole motion. Of an
animation that is too large either every n-th frame stays, or all frames in principal components (`components`), as
`NAME_mean`, `NAME_components` and `NAME_weights`: whichever is less wrong over all frames of the animation, a frame
that was left out being shown as the one before it. Wrong is the root mean square over all arrays, coefficients,
visibility and normals relative to their own root mean square, positions to a tenth of half the diagonal of the box
around the motion: they count ten times, as a thousandth of the size is seen at an edge and a hundredth of the
coefficients hardly.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.apps.viewer.components import Components, Error, Progress, Series, in_components, repeated_error
from gash_jax.apps.viewer.contents import PageFile, as_half
from gash_jax.apps.viewer.moving import Moving

_STEPS, _POSITIONS = 65535, 10
_WORDS = {"coefficients": "coefficients", "visibility": "visibility", "vertices": "positions", "normals": "normals"}


class Kept(NamedTuple):
    """What is kept of several animations with the same frames: some of the frames, or components by name."""

    frames: list[int]
    components: dict[str, Components] | None
    notes: list[str]


def moving_files(names: Sequence[str], found: Sequence[Moving], room: int, progress: Progress | None) -> list[PageFile]:
    """The page's files of animations with the same frames, in `room` bytes if possible; the first has the mesh."""
    series = {f"{i} {name}": one for i, moving in enumerate(found) for name, one in _series(moving, i == 0).items()}
    first, files = found[0], []
    still = 0 if len(first.vertices) > 1 else 12 * first.vertices.size
    kept = keep(series, room - first.faces.nbytes - still, progress)
    counted = f"{first.vertices.shape[1]} vertices, {len(first.faces)} faces, {len(first.coefficients)} frames"
    for i, (name, moving) in enumerate(zip(names, found, strict=True)):
        arrays, metadata = _arrays(moving, i, kept)
        notes = {"notes": [counted, *kept.notes]} if i == 0 else {}
        files.append(PageFile("transfer", name, arrays, {**notes, **metadata}))
    return files


def keep(series: Mapping[str, Series], room: int, progress: Progress | None = None) -> Kept:
    """All frames of some series, or every n-th, or components, whatever fits and is least wrong; with its notes."""
    count = len(next(iter(series.values())))
    size = sum(2 * one.size for one in series.values())
    step = max(1, -(-count * size // max(room, 1)))
    frames = list(range(0, count, step))
    if step == 1:
        return Kept(frames, None, [])
    found = in_components(series, room, progress)
    repeated = {name: repeated_error(one, frames) for name, one in series.items()}
    if found is None or total(repeated) <= total({name: one.error for name, one in found.items()}):
        return Kept(frames, None, [f"{len(frames)} of {count} frames: a page of all of them would be too large"])
    worse = max(one.rms for name, one in repeated.items() if name.endswith("coefficients"))
    notes = [
        f"all {count} frames, rebuilt from principal components: a page of them as they are would be too large",
        f"one in {step} of the frames would fit, and be further off: coefficients by {_percent(worse)}",
    ]
    return Kept(list(range(count)), found, [*notes, *_listed(found)])


def total(errors: Mapping[str, Error]) -> float:
    """The error over all series, root mean square."""
    return float(np.sqrt(sum(error.rms**2 for error in errors.values())))


def _listed(found: Mapping[str, Components]) -> list[str]:
    """Components and errors of each kind of array, the worst of several results."""
    listed = []
    for kind, words in _WORDS.items():
        ones = [one for name, one in found.items() if name.split()[1] == kind]
        if ones:
            many = min(len(one.components) for one in ones)
            scale = _POSITIONS if kind == "vertices" else 1
            rms, largest = (max(getattr(one.error, which) for one in ones) / scale for which in ("rms", "largest"))
            of = "the object's size" if kind == "vertices" else "their root mean square"
            errors = f"root mean square error {_percent(rms)} of {of}, largest error {_percent(largest)}"
            listed.append(f"{words} from {many} components: {errors}")
    return listed


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"


def _series(moving: Moving, mesh: bool) -> dict[str, Series]:
    """The arrays of an animation that have frames, as they are to be kept."""
    found = {"coefficients": Series(moving.coefficients, _size(moving.coefficients))}
    if moving.visibility is not None:
        found["visibility"] = Series(moving.visibility, _size(moving.visibility))
    if mesh and len(moving.vertices) > 1:
        low, high = _box(moving)
        found["vertices"] = Series(moving.vertices, float(np.linalg.norm(high - low)) / 2 / _POSITIONS)
        found["normals"] = Series(moving.normals, 3**-0.5)
    return found


def _size(array: np.ndarray) -> float:
    """Root mean square of all frames."""
    squares = [np.mean(np.square(frame, dtype=np.float64)) for frame in array]
    return float(np.sqrt(np.mean(squares)))


def _box(moving: Moving) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Corners of the box around the faces in all frames."""
    used = np.unique(moving.faces)
    ends = [(frame[used].min(axis=0), frame[used].max(axis=0)) for frame in moving.vertices]
    low, high = (np.asarray(end, np.float64) for end in zip(*ends, strict=True))
    return low.min(axis=0), high.max(axis=0)


def _arrays(moving: Moving, number: int, kept: Kept) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays of the page's file of an animation, and what its metadata says of them."""
    arrays: dict[str, np.ndarray] = {}
    metadata: dict[str, Any] = {}
    for name in ("coefficients", "visibility", "normals", "vertices"):
        array = getattr(moving, name)
        if array is None or (number > 0 and name in ("normals", "vertices")):
            continue
        found = None if kept.components is None else kept.components.get(f"{number} {name}")
        if found:
            parts = {"mean": found.mean, "components": found.components, "weights": found.weights}
            arrays |= {f"{name}_{part}": value for part, value in parts.items()}
            continue
        some = array[kept.frames] if len(array) > 1 else array[0]
        if name == "vertices":
            arrays[name], metadata["grid"] = _on_grid(some, *_box(moving))
        else:
            arrays[name] = as_half(np.asarray(some))
    return arrays | ({"faces": moving.faces} if number == 0 else {}), metadata


def _on_grid(
    vertices: np.ndarray, low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]
) -> tuple[np.ndarray, dict[str, list[float]]]:
    step = np.where(high > low, (high - low) / _STEPS, 1.0)
    grid = np.clip(np.rint((np.asarray(vertices, np.float64) - low) / step), 0, _STEPS).astype(np.uint16)
    return grid, {"low": low.tolist(), "step": step.tolist()}
