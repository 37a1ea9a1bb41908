"""Predictions a few vertices at a time are those of the whole, however many work on them, and under JAX."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh
from gash_jax.graph import surfel_lists
from gash_jax.graph.surfel_graph import SurfelGraph
from gash_jax.graph.surfel_lists import WIDTHS
from gash_jax.models import surfel_inference as inference
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.models.model import Model, load_model, save_model
from gash_jax.models.surfel_inference import (
    apply_surfels,
    by_vertex,
    compile_calls,
    predict_bounces,
    predict_on_host,
    predict_surfels,
)
from gash_jax.nn import surfel_kernel
from gash_jax.nn.surfel_net import by_band
from gash_jax.prt.bounce_series import summed
from tests.helpers.bumpy import bumpy_mesh, random_variables, surfel_parts
from tests.helpers.split import split_mesh

CONFIG: Any = model_config("local", bands=3, channels=8, layers=1, known_bands=6, known_bounces=2)
MODULE: Any = build_model(CONFIG)


def _mesh() -> Mesh:
    mesh = split_mesh(bumpy_mesh(150, 7))[0]
    mesh.normals[3] = 0
    return mesh


@cache
def _graph() -> SurfelGraph:
    return model_graph(CONFIG, _mesh())


@cache
def _params() -> Any:
    return random_variables(MODULE, _graph(), spread=0.1)["params"]


@cache
def _whole(bands: int = 3, bounces: int = 0) -> np.ndarray:
    """What the network says of every vertex, applied at once."""
    module = MODULE.clone(bands=bands, bounces=bounces)
    parts = tuple(part for part in surfel_parts(_graph()) if len(part["normal"]))
    return np.asarray(jax.jit(module.apply)({"params": _params()}, parts))[_graph().slot]


@pytest.mark.parametrize("workers", [1, 3, None])
@pytest.mark.parametrize("vertices", [inference.VERTICES, 64])
def test_calls_predict_as_the_whole_does(workers: int | None, vertices: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """One call or many, each of few vertices."""
    monkeypatch.setattr(inference, "VERTICES", vertices)
    coefficients, error = predict_surfels(MODULE, _params(), _graph(), workers)
    np.testing.assert_allclose(coefficients, _whole()[:, :9], atol=1e-5)
    np.testing.assert_allclose(error, by_band(jnp.asarray(_whole()[:, 9:]), 3), atol=1e-5)
    assert coefficients.shape == error.shape == (len(_mesh().vertices), 9)
    assert not coefficients[3].any() and not error[3].any() and np.abs(coefficients).max() > 0.1
    on_host = predict_on_host(MODULE, _params(), _graph(), workers)
    assert all(isinstance(array, np.ndarray) for array in on_host)
    np.testing.assert_array_equal(on_host[0], coefficients)


def test_the_size_of_calls_by_hand() -> None:
    """Multiples of 8 that keep to 16384 pairs: 16384 / 80 = 204.8."""
    assert [surfel_lists.call_size(width) for width in (24, 48, 80, 128, 256)] == [680, 336, 200, 128, 64]
    assert all(0 < surfel_lists.call_size(width) * width <= surfel_lists.CALL for width in WIDTHS)


def test_as_a_jax_function_it_predicts_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    graph, plain = _graph(), _whole()
    # whole parts at once, and a few vertices at a time
    for pairs in (surfel_lists.CALL, 3072):
        monkeypatch.setattr(surfel_lists, "CALL", pairs)
        found, error = jax.jit(lambda params, graph: apply_surfels(MODULE, params, graph))(_params(), graph)
        np.testing.assert_allclose(found, plain[:, :9], atol=1e-5)
        np.testing.assert_allclose(error, by_band(jnp.asarray(plain[:, 9:]), 3), atol=1e-5)
    other = jax.tree.map(lambda leaf: leaf * np.float32(0.9), _params())
    both = jax.tree.map(lambda *leaves: np.stack(leaves), _params(), other)
    two = jax.vmap(lambda params: apply_surfels(MODULE, params, graph)[0])(both)
    for one, params in zip(two, (_params(), other), strict=True):
        np.testing.assert_allclose(one, predict_on_host(MODULE, params, graph)[0], atol=1e-5)
    assert np.abs(np.asarray(two[0] - two[1])).max() > 1e-3


def test_gradients_reach_records_and_positions() -> None:
    graph = _graph()

    def loss(params: Any, records: Any, shift: Any) -> jax.Array:
        parts = tuple({**part, "position": jnp.asarray(part["position"]) + shift[None]} for part in graph.parts)
        return jnp.sum(apply_surfels(MODULE, params, graph._replace(records=records, parts=parts))[0] ** 2)

    shift = jnp.zeros(3, jnp.float32)
    gradients = jax.jit(jax.grad(loss, argnums=(0, 1, 2)))(_params(), jnp.asarray(graph.records), shift)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradients))
    assert float(jnp.abs(gradients[1]).max()) > 0 and float(jnp.abs(gradients[2]).max()) > 0
    # all vertices shifted one way is all surfels shifted the other way
    back = -jnp.sum(gradients[1][:, :3], axis=0)
    np.testing.assert_allclose(gradients[2], back, rtol=2e-2, atol=2e-2 * float(jnp.abs(back).max()))


@pytest.mark.parametrize("bounces", [0, 1, 2])
def test_bounces_are_those_of_the_network(bounces: int) -> None:
    whole, k = _whole(3, bounces), 9
    terms = predict_bounces(MODULE, _params(), _graph(), bounces)
    assert terms.coefficients.shape == terms.errors.shape == (bounces + 1, len(_mesh().vertices), k)
    for i in range(bounces + 1):
        np.testing.assert_allclose(terms.coefficients[i], whole[:, i * k : (i + 1) * k], atol=1e-5)
        errors = whole[:, (bounces + 1) * k :][:, i * 3 : (i + 1) * 3]
        np.testing.assert_allclose(terms.errors[i], by_band(jnp.asarray(errors), 3), atol=1e-5)
    direct = predict_on_host(MODULE, _params(), _graph())
    np.testing.assert_allclose(terms.coefficients[0], direct[0], atol=1e-5)


def test_output_by_vertex_by_hand() -> None:
    """Two bands, one bounce; vertices 0 and 2 are one."""
    rows = np.stack([np.arange(12.0), 100 + np.arange(12.0)])
    terms = by_vertex(rows, np.array([1, 0, 1]), 2, 1)
    np.testing.assert_array_equal(terms.coefficients[0], [[100, 101, 102, 103], [0, 1, 2, 3], [100, 101, 102, 103]])
    np.testing.assert_array_equal(terms.coefficients[1, 1], [4, 5, 6, 7])
    np.testing.assert_array_equal(terms.errors[:, 1], [[8, 9, 9, 9], [10, 11, 11, 11]])


def test_no_vertices_and_no_area() -> None:
    whole, points = _graph(), np.eye(4, 3, dtype=np.float32)
    nobody = tuple({name: array[:0] for name, array in part.items()} for part in whole.parts)
    empty = whole._replace(parts=nobody, slot=whole.slot[:0])
    loose = model_graph(CONFIG, Mesh(points, np.zeros_like(points), np.array([[0, 1, 1]], np.int32)))
    for count, graph in ((0, empty), (4, loose)):
        traced = jax.jit(lambda graph: apply_surfels(MODULE, _params(), graph))(graph)
        for found, error in (predict_surfels(MODULE, _params(), graph), traced):
            assert found.shape == error.shape == (count, 9) and not np.any(found) and not np.any(error)
        assert predict_bounces(MODULE, _params(), graph, 2).coefficients.shape == (3, count, 9)


def test_calls_are_compiled_before_they_are_needed() -> None:
    def compiled() -> tuple[int, int]:
        decode: Any = inference.decode_found
        return decode._cache_size(), len(surfel_kernel.encode.signatures)

    module, before = MODULE.clone(bands=2), compiled()  # of its own for this test
    compile_calls(module, _params(), _graph())
    after = compiled()
    # tests before this one may have compiled the loops, for other arrays too
    assert after[0] == before[0] + 2 and after[1] >= max(before[1], 1)
    predict_surfels(module, _params(), _graph())
    predict_surfels(module, _params(), model_graph(CONFIG, bumpy_mesh(333)))
    assert compiled() == after


def test_a_model_predicts_bounces_off_one_albedo() -> None:
    model, mesh = Model(CONFIG, _params()), _mesh()
    terms = predict_bounces(MODULE, _params(), _graph(), 2)
    grey = model.predict(mesh, bounces=2, albedo=0.5)
    by_hand = terms.coefficients[0] + 0.5 * terms.coefficients[1] + 0.25 * terms.coefficients[2]
    np.testing.assert_allclose(grey.coefficients, by_hand, atol=1e-5)
    expected = terms.errors[0] + 0.5 * terms.errors[1] + 0.25 * terms.errors[2]
    np.testing.assert_allclose(np.asarray(grey.predicted_error), expected, atol=1e-5)
    colour = model.predict(mesh, bounces=1, albedo=[0.1, 0.5, 0.9])
    assert colour.coefficients.shape == (len(mesh.vertices), 9, 3)
    for channel, albedo in enumerate((0.1, 0.5, 0.9)):
        np.testing.assert_allclose(colour.coefficients[..., channel], summed(terms.coefficients[:2], albedo), atol=1e-5)
    np.testing.assert_allclose(model.predict(mesh).coefficients, terms.coefficients[0], atol=1e-5)
    assert grey.metadata["parameters"]["bounces"] == 2
    with pytest.raises(ValueError, match="bounces=3: model local knows 2"):
        model.predict(mesh, bounces=3, albedo=0.5)
    with pytest.raises(ValueError, match="one albedo"):
        model.predict(mesh, bounces=1, albedo=np.linspace(0, 1, len(mesh.vertices)))
    with pytest.raises(ValueError, match="give bounces=1"):
        model.predict(mesh, albedo=0.5)
    none = Model(model_config("local", channels=8), {})
    with pytest.raises(ValueError, match="model local knows none"):
        none.predict(mesh, bounces=1, albedo=0.5)


def test_a_file_serves_any_number_of_bands(tmp_path: Any) -> None:
    save_model(tmp_path / "net.npz", CONFIG, _params())
    assert load_model(tmp_path / "net.npz").config == CONFIG
    for bands in (1, 2, 4, 6):
        model = load_model(tmp_path / "net.npz", bands=bands)
        assert (model.config.bands, model.config.learnt_bands, model.config.known_bounces) == (bands, 6, 2)
        found = model(_graph())
        np.testing.assert_allclose(found, _whole(6)[:, : bands**2], atol=1e-5)
        # and comes back from a file of its own
        save_model(tmp_path / "other.npz", model.config, model.params)
        np.testing.assert_array_equal(load_model(tmp_path / "other.npz")(_graph()), found)
    with pytest.raises(ValueError, match="bands=7: model local knows 6 bands"):
        load_model(tmp_path / "net.npz", bands=7)
    with pytest.raises(ValueError, match="bands"):
        load_model(tmp_path / "net.npz", bands=0)
