"""Many frames in few numbers: a mean and principal components of the frames, each frame a sum of them.

An array of frames X (t, n) is kept as

    X[i] = mean + weights[i] @ components        mean (n,) float32, components (k, n) int16, weights (t, k) float32,

the components those directions in which the frames scatter most (at most `SAMPLE` frames, spread evenly, decide which),
orthogonal, each on a scale of its own that stands in the weights. Of several arrays, coefficients and positions say,
the components are taken one at a time, always the one that removes most error for its bytes, until they fill the room
or less than `FINE` is left. Errors are root mean squares over all frames, each array's relative to its `unit`; what is
written is measured as it is read back, rounded numbers and all.

The other way is to keep every n-th frame, each shown until the next: `repeated_error`. For so many components as frames
would fit it cannot be the better one (Eckart & Young 1936), but for rounding, and for frames that do repeat.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Shaped

SAMPLE = 1000  # frames that decide on the components
FINE = 1e-4  # root mean square error at which no more components are taken
_COLUMNS, _ROWS = 1 << 14, 16  # numbers of a frame, and frames, that are looked at together
_STEPS = 32767
Progress = Callable[[int, int], None]


class Series(NamedTuple):
    """An array for every frame, and the size that its errors are relative to."""

    frames: Shaped[np.ndarray, "t *n"]  # may lie in a file
    unit: float

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def size(self) -> int:
        """Numbers of a frame."""
        return int(np.prod(self.frames.shape[1:]))

    def frame(self, number: int) -> Float[np.ndarray, "n"]:
        """A frame, flat, float32."""
        return np.asarray(self.frames[number], np.float32).ravel()


class Error(NamedTuple):
    """What is wrong with frames, in units of their series."""

    rms: float
    largest: float


class Components(NamedTuple):
    """Frames as a mean and components (module docstring), and what that has changed."""

    mean: Float[np.ndarray, "*n"]
    components: Int[np.ndarray, "k *n"]
    weights: Float[np.ndarray, "t k"]
    error: Error


class _Spectrum(NamedTuple):
    mean: Float[np.ndarray, "n"]
    sample: Int[np.ndarray, "s"]
    directions: Float[np.ndarray, "s d"]  # as sums of frames of the sample, most important first
    removed: Float[np.ndarray, "d"]  # mean squared error that each takes away, in units


def in_components(
    series: Mapping[str, Series], room: int, progress: Progress | None = None
) -> dict[str, Components] | None:
    """Every series in components, together at most `room` bytes; None where there is no room for one of each."""
    spectra, found, steps = {}, {}, 2 * len(series)
    for name, one in series.items():
        spectra[name] = _spectrum(one)
        if progress:
            progress(len(spectra), steps)
    counts = share_room(
        {name: spectrum.removed for name, spectrum in spectra.items()},
        {name: 2 * one.size + 4 * len(one) for name, one in series.items()},
        room - sum(4 * one.size for one in series.values()),
    )
    if min(counts.values()) == 0:
        return None
    for name, one in series.items():
        found[name] = _components(one, spectra[name], counts[name])
        if progress:
            progress(len(spectra) + len(found), steps)
    return found


def share_room(removed: Mapping[str, Float[np.ndarray, "_"]], costs: Mapping[str, int], room: int) -> dict[str, int]:
    """How many components each series gets: at least one each, more by what they take away for their bytes."""
    counts = dict.fromkeys(removed, 0)
    left = {name: float(values.sum()) for name, values in removed.items()}
    while True:
        open_ones = [name for name in counts if counts[name] < len(removed[name]) and costs[name] <= room]
        first = [name for name in open_ones if counts[name] == 0]
        if not open_ones or (not first and sum(left.values()) <= FINE**2):
            return counts
        best = max(first or open_ones, key=lambda name: removed[name][counts[name]] / costs[name])
        left[best] -= float(removed[best][counts[best]])
        counts[best] += 1
        room -= costs[best]


def expanded(found: Components) -> Float[np.ndarray, "t *n"]:
    """The frames that components stand for, float32."""
    flat = found.components.reshape(len(found.components), -1).astype(np.float32)
    return (found.mean.ravel() + found.weights @ flat).reshape(-1, *found.mean.shape)


def repeated_error(series: Series, kept: Sequence[int]) -> Error:
    """What is wrong where each of the `kept` frames, the first one among them, is shown until the next."""
    squares, largest, held = 0.0, 0.0, series.frame(kept[0])
    for number in range(len(series)):
        frame = series.frame(number)
        if number in kept:
            held = frame
        apart = held - frame
        squares += float(np.sum(np.square(apart, dtype=np.float64)))
        largest = max(largest, float(np.abs(apart).max(initial=0)))
    return _error(series, squares, largest)


def _error(series: Series, squares: float, largest: float) -> Error:
    unit = series.unit or 1.0
    return Error(float(np.sqrt(squares / max(len(series) * series.size, 1))) / unit, largest / unit)


def _spectrum(series: Series) -> _Spectrum:
    """Principal directions of a series from the products of its frames with each other."""
    sample = np.unique(np.linspace(0, len(series) - 1, SAMPLE).astype(int))
    mean = np.zeros(series.size)
    for number in range(len(series)):
        mean += series.frame(number)
    mean /= len(series)
    products = np.zeros((len(sample), len(sample)))
    for part in _parts(series):
        values = _columns(series, sample, part) - mean[part]
        products += values @ values.T
    values, directions = np.linalg.eigh(products)
    values, directions = values[::-1].clip(0), directions[:, ::-1]
    count = int(np.count_nonzero(values > 1e-12 * max(values[0], 1e-30)))  # below that rounding is left
    scale = len(sample) * series.size * (series.unit or 1.0) ** 2
    return _Spectrum(mean.astype(np.float32), sample, directions[:, : max(count, 1)], values[: max(count, 1)] / scale)


def _components(series: Series, spectrum: _Spectrum, count: int) -> Components:
    """So many components, rounded, with the weights that fit the rounded ones best, and their error."""
    found = np.zeros((count, series.size), np.float32)
    turned = spectrum.directions[:, :count].T.astype(np.float32)
    for part in _parts(series):
        found[:, part] = turned @ (_columns(series, spectrum.sample, part) - spectrum.mean[part])
    largest = np.maximum(np.abs(found).max(axis=1, keepdims=True), np.float32(1e-30))
    rounded = np.rint(found / largest * _STEPS).astype(np.int16)
    wide = (rounded / np.float32(_STEPS)).astype(np.float32)
    inverse = np.linalg.pinv((wide @ wide.T).astype(np.float64), rcond=1e-12, hermitian=True)
    weights, squares, worst = np.zeros((len(series), count), np.float32), 0.0, 0.0
    for first in range(0, len(series), _ROWS):
        rows = slice(first, min(first + _ROWS, len(series)))
        apart = np.stack([series.frame(number) for number in range(rows.start, rows.stop)]) - spectrum.mean
        fitted = ((apart @ wide.T) @ inverse).astype(np.float32)
        apart -= fitted @ wide
        weights[rows] = fitted / np.float32(_STEPS)
        squares += float(np.sum(np.square(apart, dtype=np.float64)))
        worst = max(worst, float(np.abs(apart).max(initial=0)))
    inner = series.frames.shape[1:]
    error = _error(series, squares, worst)
    return Components(spectrum.mean.reshape(inner), rounded.reshape(count, *inner), weights, error)


def _parts(series: Series) -> list[slice]:
    return [slice(first, min(first + _COLUMNS, series.size)) for first in range(0, series.size, _COLUMNS)]


def _columns(series: Series, numbers: Int[np.ndarray, "s"], part: slice) -> Float[np.ndarray, "s c"]:
    """Some columns of some frames, float32."""
    flat = series.frames.reshape(len(series), -1)
    return np.stack([np.asarray(flat[number, part], np.float32) for number in numbers])
