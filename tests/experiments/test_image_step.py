"""The benchmark of one training step of the U-Net: it runs, and a gradient that is wrong shows."""

from typing import Any

import jax
import pytest

from benchmarks import image_step


def test_it_measures_a_step() -> None:
    (row,) = image_step.main(None, quick=True)["rows"]
    assert row["slope_over_gradient"] == pytest.approx(1, abs=0.05) and row["finite"]
    assert row["losses"][-1] < row["losses"][0] and row["parameters"] > 1000
    assert row["bytes"] > 4 * row["parameters"] and row["flops"] > 1e6 and row["seconds"] > 0


def test_a_wrong_gradient_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    right = jax.grad
    monkeypatch.setattr(jax, "grad", lambda f: lambda p: jax.tree.map(lambda g: g[::-1], right(f)(p)))
    (row,) = image_step.main(None, quick=True)["rows"]
    wrong: Any = row["slope_over_gradient"]
    assert abs(wrong - 1) > 0.2
