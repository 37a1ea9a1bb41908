"""Frames in components: exact where they can be, never worse than repeated frames, measured as they are read back."""

import numpy as np
import pytest

from gash_jax.apps.viewer import components
from gash_jax.apps.viewer.components import Components, Series, expanded, in_components, repeated_error, share_room

RNG = np.random.default_rng(3)


def waves(count: int, frames: int = 40, size: int = 300, noise: float = 0.0) -> np.ndarray:
    """Frames (t, size / 3, 3) that move in so many ways, about a mean, and tremble."""
    ways = np.sin(np.linspace(0, 5, frames)[:, None] * np.arange(1, count + 1)) / np.arange(1, count + 1)
    found = ways @ RNG.normal(size=(count, size)) + 3 * RNG.normal(size=size)
    return (found + noise * RNG.normal(size=(frames, size))).astype(np.float32).reshape(frames, size // 3, 3)


def bytes_of(found: Components) -> int:
    return found.mean.nbytes + found.components.nbytes + found.weights.nbytes


def test_few_ways_to_move_take_few_components() -> None:
    frames = waves(4)
    found = in_components({"x": Series(frames, 1.0)}, 1 << 20)
    assert found is not None and len(found["x"].components) == 4 and found["x"].components.dtype == np.int16
    # 16 bits of the largest number of a component: half a step of 1 / 32767 for each of the four
    np.testing.assert_allclose(expanded(found["x"]), frames, atol=4 * 5 / 65534)
    assert found["x"].error.rms < components.FINE


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_errors_are_those_of_what_is_written_and_less_than_of_repeated_frames(noise: float) -> None:
    frames = waves(12, noise=noise)
    series = Series(frames, 2.0)
    kept = list(range(0, 40, 8))
    room = len(kept) * 2 * series.size + 4 * series.size  # as many frames would take, and the mean
    found = in_components({"x": series}, room)
    assert found is not None
    one, repeated = found["x"], repeated_error(series, kept)
    assert bytes_of(one) <= room
    apart = expanded(one) - frames
    assert one.error.rms == pytest.approx(np.sqrt(np.mean(apart.astype(float) ** 2)) / 2, rel=1e-3)
    assert one.error.largest == pytest.approx(np.abs(apart).max() / 2, rel=1e-3)
    assert one.error.rms < repeated.rms
    # the best that so many components can do, by the singular values of all frames
    values = np.linalg.svd((frames - frames.mean(0)).reshape(40, -1), compute_uv=False)
    best = np.sqrt(np.sum(values[len(one.components) :] ** 2) / frames.size) / 2
    assert one.error.rms == pytest.approx(best, rel=0.01)


def test_repeated_frames_are_wrong_by_hand() -> None:
    frames = np.array([[0.0, 0.0], [1.0, 0.0], [4.0, 2.0]], np.float32)[..., None]
    # frame 1 is shown as frame 0: one number of six is off by 1
    found = repeated_error(Series(frames, 0.5), [0, 2])
    assert found.rms == pytest.approx(np.sqrt(1 / 6) / 0.5) and found.largest == 2.0


def test_room_goes_where_it_removes_most_by_hand() -> None:
    removed = {"a": np.array([8.0, 1.0, 0.5]), "b": np.array([6.0, 3.0])}
    # each gets its first; then 3 / 2 of b is more than 1 / 1 of a
    assert share_room(removed, {"a": 1, "b": 2}, 5) == {"a": 1, "b": 2}
    assert share_room(removed, {"a": 1, "b": 2}, 6) == {"a": 2, "b": 2}
    assert share_room(removed, {"a": 1, "b": 2}, 100) == {"a": 3, "b": 2}
    assert min(share_room(removed, {"a": 1, "b": 2}, 2).values()) == 0  # no room for one of each
    # nothing more is taken where nothing is left to remove
    tiny = {"a": np.array([1.0, 1e-10]), "b": np.array([1.0, 1e-10])}
    assert share_room(tiny, {"a": 1, "b": 1}, 100) == {"a": 1, "b": 1}


def test_where_there_is_no_room_there_are_no_components() -> None:
    series = {"x": Series(waves(3), 1.0), "y": Series(waves(3), 1.0)}
    assert in_components(series, 2 * 4 * 300 + 2 * (2 * 300 + 4 * 40)) is not None
    assert in_components(series, 2 * 4 * 300 + 2 * (2 * 300 + 4 * 40) - 1) is None


def test_more_frames_than_are_looked_at_are_kept_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(components, "SAMPLE", 9)
    frames, done = waves(4), []
    found = in_components({"x": Series(frames, 1.0)}, 1 << 20, lambda *counts: done.append(counts))
    assert found is not None and done == [(1, 2), (2, 2)]
    np.testing.assert_allclose(expanded(found["x"]), frames, atol=2e-3)


def test_frames_that_stand_still_are_exact() -> None:
    frames = np.broadcast_to(waves(2)[:1], (12, 100, 3))
    found = in_components({"x": Series(frames, 1.0)}, 1 << 20)
    assert found is not None and found["x"].error == (0.0, 0.0)
    np.testing.assert_array_equal(expanded(found["x"]), frames)
