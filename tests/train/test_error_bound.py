"""The factor that makes expected errors a bound, of a network whose errors are known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gash_jax.models.examples import Example
from gash_jax.models.families import model_config
from gash_jax.train import error_bound as module
from gash_jax.train.error_bound import HELD, error_bound, rms_by_vertex

CONFIG = model_config("local", bands=2)
OPEN = 1 / np.sqrt(4 * np.pi)


def test_root_mean_squares_by_hand() -> None:
    np.testing.assert_allclose(rms_by_vertex(np.array([[3.0, 4, 0, 0], [0, 0, 0, 0]])), [2.5, 0])


def _example(share: Any, noise: Any = None) -> Example:
    """Vertices that receive these shares of what would arrive if nothing stood above them."""
    labels = np.zeros((len(share), 4), np.float32)
    labels[:, 0] = OPEN * np.asarray(share)
    return Example(None, labels, np.ones((len(share), 1), np.float32), None, noise)


def _told(monkeypatch: pytest.MonkeyPatch, off: Any, expected: Any) -> None:
    """A network that is off by so much in every coefficient, and expects so much."""

    def predict(network: Any, params: Any, graph: Any) -> Any:
        said = None if expected is None else np.repeat(expected[:, None], 4, axis=1)
        return params[:, :4] + off[:, None], said

    monkeypatch.setattr(module, "family_of", lambda config: SimpleNamespace(predict_fast=None, predict=predict))
    monkeypatch.setattr(module, "build_model", lambda config: None)


def test_nine_of_ten_vertices_err_less(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    expected = rng.uniform(0.01, 0.2, 2001)
    off = expected * rng.uniform(0, 3, 2001)
    example = _example(np.full(2001, 0.5))
    _told(monkeypatch, off, expected)
    found = error_bound(CONFIG, example.coefficients, [example])
    assert found is not None and found == pytest.approx(np.quantile(off / expected, 0.9), rel=1e-4)
    assert HELD == 0.9 and np.mean(off <= found * expected * (1 + 1e-5)) == pytest.approx(0.9, abs=1e-3)


def test_only_partly_hidden_vertices_of_which_something_is_expected_count(monkeypatch: pytest.MonkeyPatch) -> None:
    example = _example([0.5, 0.5, 0.001, 0.999, 0.5])
    _told(monkeypatch, np.array([0.2, 0.2, 9, 9, 9.0]), np.array([0.1, 0.1, 0.1, 0.1, 0]))
    assert error_bound(CONFIG, example.coefficients, [example]) == pytest.approx(2, rel=1e-4)


def test_noise_of_the_labels_is_taken_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """By band: 0.01 in one coefficient and 0.03 in three is 0.025 in the mean."""
    example = _example([0.5], np.array([[0.01, 0.03]], np.float32))
    _told(monkeypatch, np.array([0.2]), np.array([0.1]))
    expected = np.sqrt(0.04 - 0.025) / 0.1
    assert error_bound(CONFIG, example.coefficients, [example]) == pytest.approx(expected, rel=1e-4)


def test_there_may_be_no_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    example = _example([0.5])
    _told(monkeypatch, np.array([0.2]), None)
    assert error_bound(CONFIG, example.coefficients, [example]) is None
    _told(monkeypatch, np.array([0.2]), np.array([0.0]))
    assert error_bound(CONFIG, example.coefficients, [example]) is None
    assert error_bound(CONFIG, example.coefficients, []) is None
