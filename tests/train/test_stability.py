"""Training stays finite where it is hard: one class, huge logits, no neighbours, constant features, half precision."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.motors import motor
from gash_jax.graph.encodings import edge_features
from gash_jax.models.examples import Batch, Example, collate
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.models.losses import balanced_bce
from gash_jax.nn.attention import GATv2Conv, TransformerConv
from gash_jax.nn.config import ModelConfig
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train import phase_run
from gash_jax.train.config import DataConfig, OptimConfig, RunConfig, TrainConfig
from gash_jax.train.loop import initial_state, train_model
from gash_jax.train.objectives import objectives
from gash_jax.train.step import make_optimizer, train_step
from tests.helpers.bumpy import random_variables

TWO_STAGE = model_config(
    name="two-stage", channels=8, layers=1, heads=2, neighbours=6, visibility_channels=8, visibility_layers=1
)
MESH = bumpy_sphere(6)


def _finite(tree: Any) -> bool:
    return all(np.isfinite(np.asarray(leaf)).all() for leaf in jax.tree.leaves(tree))


def _example(config: ModelConfig = TWO_STAGE, visibility: float | None = None) -> Example:
    rng = np.random.default_rng(0)
    count = len(MESH.vertices)
    seen = (rng.random((count, 25)) < 0.7) if visibility is None else np.full((count, 25), visibility)
    labels = rng.normal(0.3, 0.2, (count, 9)).astype(np.float32)
    return Example(model_graph(config, MESH), labels, seen.astype(np.float32))


def _batch(**options: Any) -> Batch:
    return collate([[_example(**options)]], len(MESH.vertices) + 5)


def _step(config: RunConfig, batch: Batch, half: bool = False, params: Any = None, scale: Any = None) -> tuple:
    """State before, and what one step at rate 0.01 makes of it in the last phase."""
    state = initial_state(config, batch)
    state = state._replace(params=params or state.params, scale=scale or state.scale)
    phase, optimizer = objectives(config.model, half)[-1], make_optimizer(config.optim)
    rate, key = jnp.float32(1e-2), jax.random.key(0)
    out = train_step(
        *(state.params, state.optimizer, state.scale, batch, rate, key),
        **{"objective": phase, "optimizer": optimizer, "half": half},
    )
    return state, out


@pytest.mark.parametrize("visibility", [0.0, 1.0])
def test_one_class_counts_alone(visibility: float) -> None:
    batch, phase = _batch(visibility=visibility), objectives(TWO_STAGE)[0]
    params = random_variables(build_model(TWO_STAGE), model_graph(TWO_STAGE, MESH))["params"]
    loss, gradients = jax.value_and_grad(phase.loss)(params, batch, jax.random.key(0))
    logits = np.asarray(phase.output(params, batch, None))[np.asarray(batch.mask[0])]
    expected = np.mean(np.logaddexp(0, -logits if visibility else logits))
    assert float(loss) == pytest.approx(expected, rel=1e-5) and _finite(gradients)


def test_an_empty_mask_gives_zero_loss_and_gradients() -> None:
    batch = _batch()
    batch = batch._replace(mask=np.zeros_like(batch.mask), weight=np.zeros_like(batch.weight))
    params = random_variables(build_model(TWO_STAGE), model_graph(TWO_STAGE, MESH))["params"]
    for phase in objectives(TWO_STAGE):
        loss, gradients = jax.value_and_grad(phase.loss)(params, batch, jax.random.key(0))
        assert float(loss) == 0 and not any(np.any(leaf) for leaf in jax.tree.leaves(gradients))


@pytest.mark.parametrize("size", [1e4, -1e4])
def test_logits_of_ten_thousand(size: float) -> None:
    labels, mask = jnp.array([[1.0, 0.0]]), jnp.ones(1, bool)
    loss = lambda z: balanced_bce(logits=z, labels=labels, mask=mask)  # noqa: E731
    value, gradient = jax.value_and_grad(loss)(jnp.full((1, 2), size))
    assert float(value) == pytest.approx(5e3) and _finite(gradient) and np.abs(gradient).max() == pytest.approx(0.5)


def test_huge_logits_through_the_whole_network() -> None:
    batch = _batch()
    params = random_variables(build_model(TWO_STAGE), model_graph(TWO_STAGE, MESH))["params"]
    params["visibility"]["head"] = jax.tree.map(lambda leaf: 1e5 * leaf, params["visibility"]["head"])
    for phase in objectives(TWO_STAGE):
        loss, gradients = jax.value_and_grad(phase.loss)(params, batch, jax.random.key(0))
        assert np.isfinite(loss) and _finite(gradients)
    assert np.abs(objectives(TWO_STAGE)[0].output(params, batch, None)).max() > 1e4


@pytest.mark.parametrize("layer", [TransformerConv, GATv2Conv])
@pytest.mark.parametrize("path", ["table", "list"])
def test_fully_masked_neighbours(layer: Any, path: str) -> None:
    """TransformerConv keeps its root, GATv2 its self-loop; gradients are finite."""
    x = np.random.default_rng(0).normal(size=(5, 6)).astype(np.float32)
    table = np.array([[1, 2], [2, 3], [3, 4], [4, 0], [0, 1]], np.int32)
    ends = (table, None) if path == "table" else (table.reshape(-1), np.repeat(np.arange(5, dtype=np.int32), 2))
    mask = np.zeros(ends[0].shape, bool)
    module = layer(3, 2)
    params = random_variables(module, x, *ends)["params"]

    def loss(params: Any, x: Any) -> tuple[jax.Array, jax.Array]:
        out = module.apply({"params": params}, x, *ends, mask)
        return jnp.sum(out**2), out

    gradients, out = jax.grad(loss, argnums=(0, 1), has_aux=True)(params, x)
    kept = params["root"] if layer is TransformerConv else params["source"]
    expected = x @ kept["kernel"] + kept["bias"] + (params["bias"] if layer is GATv2Conv else 0)
    np.testing.assert_allclose(out, expected, atol=1e-5)
    assert _finite(gradients)


@pytest.mark.parametrize("name", ["two-stage", "rings"])
def test_constant_features_in_layer_norm(name: str) -> None:
    """All vertices and all channels the same: the variance is 0."""
    config = TWO_STAGE if name == "two-stage" else model_config("rings", channels=8, layers=1, heads=2)
    batch, phase = _batch(config=config), objectives(config)[0]
    params = random_variables(build_model(config), model_graph(config, MESH))["params"]
    params = jax.tree.map(jnp.zeros_like, params)
    loss, gradients = jax.value_and_grad(phase.loss)(params, batch, jax.random.key(0))
    assert np.isfinite(loss) and _finite(gradients)


NORMALS = {"pole": [0, -1, 0], "near the pole": [1e-8, -1, 0], "near": [1e-4, -1, 1e-5], "none": [0, 0, 0]}


@pytest.mark.parametrize("normal", NORMALS.values(), ids=NORMALS)
def test_gradients_of_the_encoding_at_the_pole(normal: list[float]) -> None:
    position, normal_ = jnp.array([[0.1, 0.2, 0.3]]), jnp.array([normal], jnp.float32)
    weights = jnp.asarray(np.random.default_rng(0).normal(size=32), jnp.float32)
    gradients = jax.grad(lambda p, n: jnp.sum(motor(p, n)[0] * weights), argnums=(0, 1))(position, normal_)
    assert _finite(gradients)


def test_gradients_of_zero_length_edges() -> None:
    offsets = jnp.zeros((3, 3)).at[1].set(jnp.array([1e-30, 0, 0])).at[2].set(jnp.array([0.1, 0, 0]))
    normals, frames = jnp.tile(jnp.array([0.0, 0, 1]), (3, 1)), jnp.tile(jnp.eye(3), (3, 1, 1))
    value = lambda o, n, f: jnp.sum(jnp.sin(edge_features(o, n, f)))  # noqa: E731
    assert _finite(jax.grad(value, argnums=(0, 1, 2))(offsets, normals, frames))


@pytest.mark.parametrize(
    "config", [TWO_STAGE, model_config("rings", channels=8, layers=1, heads=2)], ids=["2", "rings"]
)
def test_training_on_the_pole_and_on_coincident_vertices(config: ModelConfig) -> None:
    vertices, normals = MESH.vertices.copy(), MESH.normals.copy()
    vertices[1], normals[:2] = vertices[0], [[0, -1, 0], [0, -1, 0]]
    mesh = MESH._replace(vertices=vertices, normals=normals)
    example = _example()._replace(graph=model_graph(config, mesh))
    run = RunConfig(model=config, train=TrainConfig(steps=1))
    _, (params, *_, measures) = _step(run, collate([[example]], len(vertices) + 5))
    assert _finite(params) and np.isfinite(measures["loss"])


def test_a_step_that_overflows_half_precision_changes_only_the_scale() -> None:
    run = RunConfig(model=TWO_STAGE, train=TrainConfig(steps=1, precision="float16"))
    batch = _batch()
    state, _ = _step(run, batch)
    huge = jax.tree.map(lambda leaf: leaf, state.params)
    huge["coefficient"]["head"]["kernel"] = jnp.full_like(huge["coefficient"]["head"]["kernel"], 1e6)  # over 65504
    state, (params, moments, scale, _) = _step(run, batch, half=True, params=huge)
    assert float(scale.scale) == float(state.scale.scale) / 2
    jax.tree.map(np.testing.assert_array_equal, (params, moments), (state.params, state.optimizer))
    state, (params, moments, scale, measures) = _step(run, batch, half=True)
    assert float(scale.scale) == float(state.scale.scale) and np.isfinite(measures["loss"])
    same = jax.tree.map(np.array_equal, params["coefficient"], state.params["coefficient"])
    assert not all(jax.tree.leaves(same))


def test_many_good_steps_double_the_scale() -> None:
    run = RunConfig(model=TWO_STAGE, train=TrainConfig(steps=1, precision="float16"))
    state, _ = _step(run, batch := _batch())
    ripe = state.scale.replace(fin_steps=state.scale.growth_interval)
    _, (_, _, scale, _) = _step(run, batch, half=True, scale=ripe)
    assert float(scale.scale) == 2 * float(state.scale.scale) and int(scale.fin_steps) == 0


def test_half_precision_learns_as_float32_does() -> None:
    losses = {}
    for precision in ("float32", "float16"):
        run = RunConfig(model=TWO_STAGE, train=TrainConfig(steps=1, precision=precision))
        half, batch = precision == "float16", _batch()
        state, phase = initial_state(run, batch), objectives(run.model, precision == "float16")[-1]
        optimizer = make_optimizer(run.optim)
        params, moments, scale, values = state.params, state.optimizer, state.scale, []
        for step in range(25):
            key = jax.random.key(step)
            params, moments, scale, measures = train_step(
                *(params, moments, scale, batch, jnp.float32(1e-2), key),
                **{"objective": phase, "optimizer": optimizer, "half": half},
            )
            values.append(float(measures["loss"]))
            assert ("scale" in measures) == half and (half or float(scale.scale) == 1)
        losses[precision] = np.array(values)
        assert all(leaf.dtype == jnp.float32 for leaf in jax.tree.leaves(params))
    assert losses["float16"][-1] < 0.5 * losses["float16"][0]
    np.testing.assert_allclose(losses["float16"], losses["float32"], rtol=0.1)


def test_a_loss_that_is_not_finite_stops_with_one_line(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(phase_run, "LOG_EVERY", 1)
    run = RunConfig(
        model=model_config("mlp", channels=8, layers=1),
        data=DataConfig(),
        optim=OptimConfig(learning_rate=1e38, warmup=0.0),
        train=TrainConfig(steps=40, batch_vertices=len(MESH.vertices) + 5, checkpoint_every=1),
    )
    example = _example(config=run.model)
    with pytest.raises(phase_run.DivergenceError, match="lower optim.learning_rate") as caught:
        train_model(replace(run), [example], [example], tmp_path)
    assert "\n" not in str(caught.value) and (tmp_path / "checkpoint").is_dir()
