"""What the surfel network minimises: by hand, zero where it is right, and noise of the labels taken off."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.models.phases import (
    ARRIVING,
    RELATIVE,
    coefficient_loss,
    error_likelihood,
    further_loss,
    surfel_loss,
    surfel_phases,
)
from gash_jax.nn.surfel_net import SurfelConfig
from tests.helpers.bumpy import bumpy_mesh, random_variables

CONFIG: Any = model_config("local", bands=4, known_bounces=1)
K, BANDS = 16, 4


def _output(count: int, **fields: Any) -> jax.Array:
    """What stands side by side in `Said`, 0 unless given."""
    widths = {"own": K, "bounced": K, "formula": K, "log_own": BANDS, "log_formula": BANDS, "log_bounced": BANDS}
    said = [np.zeros((count, width)) + fields.get(name, 0.0) for name, width in widths.items()]
    return jnp.asarray(np.concatenate([*said, np.full((count, 1), fields.get("gate", 1.0))], axis=1), jnp.float32)


def _labels(count: int, direct: Any = 0.0, bounced: Any = 0.0, noise: Any = 0.0) -> jax.Array:
    columns = [np.zeros((count, width)) + given for width, given in ((K, direct), (K, bounced), (BANDS, noise))]
    return jnp.asarray(np.concatenate(columns, axis=1), jnp.float32)


def test_the_loss_of_coefficients_by_hand() -> None:
    """Off by 2 in nine base coefficients, by 3 in seven higher ones, by 1 in sixteen of the bounce; 3 arrives."""
    direct = np.where(np.arange(K) < 9, 1.0, 0.0)
    own = np.where(np.arange(K) < 9, 3.0, 3.0)
    labels = _labels(1, direct[None], 5.0)
    output = _output(1, own=own[None], bounced=6.0, formula=4.0)
    # |t| of nine ones is 3, that of nine fours 12
    relative = 36 / (3 + ARRIVING * 12) ** 2
    expected = (36 + RELATIVE * relative) / 9
    assert float(surfel_loss(output, labels, jnp.ones(1), config=CONFIG)) == pytest.approx(expected, rel=1e-5)
    assert float(further_loss(output, labels, jnp.ones(1), config=CONFIG)) == pytest.approx(63 + 16, rel=1e-5)
    # noise of the labels and what is said of errors do not matter
    noisy = _output(1, own=own[None], bounced=6.0, formula=4.0, log_own=1.0, log_bounced=2.0, gate=0.3)
    others = _labels(1, direct[None], 5.0, 0.7)
    assert float(surfel_loss(noisy, others, jnp.ones(1), config=CONFIG)) == pytest.approx(expected, rel=1e-5)
    assert float(further_loss(noisy, others, jnp.ones(1), config=CONFIG)) == pytest.approx(63 + 16, rel=1e-5)


def test_the_loss_counts_vertices_by_their_weights_but_relative_errors_alike() -> None:
    labels, weight = _labels(3, 1.0), jnp.asarray([1.0, 3.0, 0.0])
    own = np.ones((3, K))
    own[:, :9] += np.array([[1.0], [2.0], [50.0]])
    lost = np.array([9.0, 36.0])
    expected = (lost @ [1, 3] / 4 + RELATIVE * np.mean(lost / 9)) / 9
    assert float(surfel_loss(_output(3, own=own), labels, weight, config=CONFIG)) == pytest.approx(expected, rel=1e-5)


def test_who_is_right_loses_nothing_and_dark_vertices_stay_finite() -> None:
    rng = np.random.default_rng(0)
    direct, bounced = rng.normal(size=(5, K)), rng.normal(size=(5, K))
    labels, right = _labels(5, direct, bounced), _output(5, own=direct, bounced=bounced, formula=1.0)

    def loss(output: jax.Array, labels: jax.Array) -> jax.Array:
        losses = (part(output, labels, jnp.ones(5), config=CONFIG) for part in (surfel_loss, further_loss))
        return jnp.sum(jnp.stack(list(losses)))

    assert float(loss(right, labels)) == 0 < float(loss(right + 0.1, labels))
    # nothing arrives, nor would it: a vertex without a normal
    value, gradient = jax.value_and_grad(loss)(_output(5, own=0.0), _labels(5))
    assert float(value) == 0 and np.isfinite(gradient).all()
    value, gradient = jax.jit(jax.value_and_grad(loss))(_output(5, own=0.1), _labels(5))
    assert np.isfinite(value) and np.isfinite(gradient).all()


def test_the_likelihood_of_errors_by_hand() -> None:
    """Network off by 2, closed form by 3, bounce by 1; noise 1 in the labels of the first two."""
    logs = {"log_own": 0.5, "log_formula": 1.0, "log_bounced": -0.5}
    output = _output(1, own=2.0, formula=3.0, bounced=1.0, **logs)
    terms = [0.5 + (4 - 1) * np.exp(-0.5), 1.0 + (9 - 1) * np.exp(-1.0), -0.5 + 1 * np.exp(0.5)]
    found = float(error_likelihood(output, _labels(1, noise=1.0), jnp.ones(1), config=CONFIG))
    assert found == pytest.approx(np.mean(terms), rel=1e-5)


def test_the_likelihood_counts_vertices_alike_above_which_something_stands() -> None:
    output = jnp.concatenate([_output(2, own=np.array([[1.0], [3.0]])), _output(1, own=99.0, gate=0.4)])
    weighted = jnp.asarray([1.0, 5.0, 1.0])
    found = float(error_likelihood(output, _labels(3), weighted, config=CONFIG))
    assert found == pytest.approx((1 + 9) / 2 / 3, rel=1e-5)
    hidden = error_likelihood(output, _labels(3), jnp.asarray([1.0, 0.0, 1.0]), config=CONFIG)
    assert float(hidden) == pytest.approx(1 / 3, rel=1e-5)
    assert float(error_likelihood(output, _labels(3), jnp.zeros(3), config=CONFIG)) == 0


def test_the_most_likely_error_is_that_without_the_labels_noise() -> None:
    """In every band of labels that are noisy and of a network that is off, the mean square of what it is off by."""
    rng, count = np.random.default_rng(0), 4000
    off, noise = np.array([0.1, 0.2, 0.3, 0.4]), np.array([0.3, 0.1, 0.2, 0.05])
    band = np.repeat(np.arange(BANDS), 2 * np.arange(BANDS) + 1)
    own = rng.normal(size=(count, K)) * off[band]
    labels = _labels(count, rng.normal(size=(count, K)) * noise[band], noise=noise**2)

    def loss(log: jax.Array) -> jax.Array:
        output = _output(count, own=own)
        output = output.at[:, 3 * K : 3 * K + BANDS].set(jnp.broadcast_to(log[None], (count, BANDS)))
        return error_likelihood(output, labels, jnp.ones(count), config=CONFIG)

    # the slope is 0 where exp(log) is the mean of squares less noise
    best = jnp.asarray(2 * np.log(off), jnp.float32)
    slope = jax.jit(jax.grad(loss))
    at_best, with_noise = slope(best), slope(jnp.asarray(np.log(off**2 + noise**2), jnp.float32))
    assert float(jnp.abs(at_best).max()) < 0.01
    assert float(with_noise[0]) > 5 * float(jnp.abs(at_best).max())


def test_errors_move_no_coefficients_and_coefficients_no_errors() -> None:
    """Every parameter is trained in one phase; those of errors look at the validation shapes."""
    phases = surfel_phases(CONFIG)
    assert [phase.name for phase in phases] == ["coefficients", "further", "error"]
    assert [phase.held_out for phase in phases] == [False, False, True]
    assert {phase.method for phase in phases} == {"everything"} and {phase.columns for phase in phases} == {K}
    few = surfel_phases(SurfelConfig("local", 3))
    assert [phase.name for phase in few] == ["coefficients", "error"]
    for plan in (phases, few):
        assert sum(phase.share for phase in plan) == pytest.approx(1)
    module, graph = build_model(CONFIG), model_graph(CONFIG, bumpy_mesh(30))
    names = list(random_variables(module, graph)["params"])
    trained = [name for phase in phases for name in phase.trainable or ()]
    assert sorted(trained) == sorted(names) and all("error" in name for name in phases[-1].trainable or ())


def test_of_what_a_network_says_first_is_the_loss_of_others() -> None:
    output, labels = jnp.asarray([[1.0, 2, 99]]), jnp.asarray([[0.0, 0]])
    assert float(coefficient_loss(output, labels, jnp.ones(1))) == pytest.approx(2.5)
