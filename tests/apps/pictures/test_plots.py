"""Figures: labels that can be read."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.figure import Figure

from gash_jax.apps.pictures import plots


def _labels(points: np.ndarray, lines: list[np.ndarray]) -> tuple[list, np.ndarray]:
    """Boxes of the labels, and pixels along the lines."""
    plot = Figure(figsize=(7, 4.5)).subplots()
    plot.plot(*points.T, "o")
    plot.margins(0.2)
    boxes = plots.label_points(plot, [f"latent {i} depth 1" for i in range(len(points))], points, lines)
    ends = [plot.transData.transform(line) for line in lines]
    return boxes, np.concatenate([np.linspace(line[0], line[-1], 50) for line in ends])


CLOSE = np.stack([1.0 + 0.02 * np.arange(4), 1.0 + 0.01 * np.arange(4)], -1)
SPREAD = np.array([[1.0, 1.0], [2.0, 1.1], [3.0, 0.9], [4.0, 1.0], [5.0, 1.2]])


def _overlaps(boxes: list) -> int:
    return sum(bool(a.overlaps(b)) for a, b in combinations(boxes, 2))


def test_labels_cover_neither_each_other_nor_what_is_drawn() -> None:
    points = np.concatenate([SPREAD, CLOSE + [2.0, 0.0]])
    boxes, drawn = _labels(points, [np.stack([p - [0, 0.05], p + [0, 0.05]]) for p in points])
    assert _overlaps(boxes) == 0 and not any(box.count_contains(drawn) for box in boxes)


def test_without_other_places_they_would(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plots, "PLACES", plots.PLACES[:1])
    assert _overlaps(_labels(np.concatenate([SPREAD, CLOSE]), [CLOSE])[0]) > 0
