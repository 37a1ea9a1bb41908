"""Data parallel: the same batches and the same loss on four devices as on one."""

import json
import os
import subprocess
import sys

import jax
import numpy as np
import pytest

from gash_jax.models.examples import Example, WholeShapes
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train.objectives import flat, objectives
from tests.helpers.bumpy import random_variables

SCRIPT = """
import json, sys
import jax, numpy as np
from gash_jax.models.examples import Example
from gash_jax.models.families import family_of, model_config, model_graph
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train import loop as train
from gash_jax.train.config import RunConfig, TrainConfig

train.LOG_EVERY, SIZE = 1, 600
config = model_config(**json.loads(sys.argv[1]))
rng, examples = np.random.default_rng(0), []
for size in (2, 3, 4, 3, 2, 4, 3):
    mesh = bumpy_sphere(size)
    labels = rng.normal(0.3, 0.2, (len(mesh.vertices), 9)).astype(np.float32)
    seen = (rng.random((len(mesh.vertices), 25)) < 0.7).astype(np.float32)
    examples.append(Example(model_graph(config, mesh), labels, seen))
run = RunConfig(model=config, train=TrainConfig(steps=6, batch_vertices=SIZE, checkpoint_every=100))
batch = train._placement(jax.devices())(family_of(config).batches(examples).draw(SIZE, 0, 0, len(jax.devices())))
devices = {s.device for s in batch.coefficients.addressable_shards} if len(jax.devices()) > 1 else {0}
path = train.train_model(run, examples, examples[:1], sys.argv[2])
lines = [json.loads(line) for line in open(sys.argv[2] + "/metrics.jsonl")]
print(json.dumps({"devices": len(devices), "losses": [line["loss"] for line in lines if "loss" in line]}))
"""
NETS = {
    "mlp": {"name": "mlp", "channels": 8, "layers": 1},
    "two-stage": {
        **{"name": "two-stage", "channels": 8, "layers": 1, "heads": 2, "neighbours": 6, "dropout": 0.0},
        **{"visibility_channels": 8, "visibility_layers": 1},
    },
    "rings": {"name": "rings", "channels": 8, "layers": 1, "heads": 2},
    "local": {"name": "local", "channels": 8, "layers": 1, "neighbours": 16},
}


def _run(net: str, devices: int, folder: str) -> tuple[int, np.ndarray, dict[str, np.ndarray]]:
    flags = f"--xla_force_host_platform_device_count={devices} --xla_backend_optimization_level=0"
    command = [sys.executable, "-c", SCRIPT, json.dumps(NETS[net]), folder]
    done = subprocess.run(command, env={**os.environ, "XLA_FLAGS": flags}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    said = json.loads(done.stdout.splitlines()[-1])
    with np.load(f"{folder}/model.npz") as archive:
        weights = {name: archive[name] for name in archive.files if name != "metadata"}
    return said["devices"], np.array(said["losses"]), weights


@pytest.mark.slow
@pytest.mark.parametrize("net", NETS)
def test_four_devices_give_the_loss_of_one(net: str, tmp_path) -> None:
    used, losses, weights = _run(net, 4, str(tmp_path / "four"))
    alone, single, same = _run(net, 1, str(tmp_path / "one"))
    assert (used, alone) == (4, 1)
    np.testing.assert_allclose(losses, single, rtol=1e-5)
    for name, value in same.items():
        np.testing.assert_allclose(weights[name], value, atol=1e-4 * max(1, np.abs(value).max()), err_msg=name)


def _examples() -> list[Example]:
    config, rng, found = model_config(**NETS["mlp"]), np.random.default_rng(1), []
    for size in (4, 9, 5, 6):
        mesh = bumpy_sphere(size)
        labels = rng.normal(size, 0.2, (len(mesh.vertices), 9)).astype(np.float32)
        found.append(Example(model_graph(config, mesh), labels, np.ones((len(mesh.vertices), 25), np.float32)))
    return found


def test_shards_hold_the_same_shapes_and_weigh_vertices_not_shards() -> None:
    examples = _examples()
    total = sum(len(example.coefficients) for example in examples) + 1
    module, phase = build_model(model_config(**NETS["mlp"])), objectives(model_config(**NETS["mlp"]))[0]
    params = random_variables(module, examples[0].graph)["params"]
    batches = {shards: WholeShapes(examples).draw(total, 0, 0, shards) for shards in (1, 2, 4)}
    losses = {shards: float(phase.loss(params, batch, None)) for shards, batch in batches.items()}
    labels = {
        s: np.sort(np.asarray(flat(b.coefficients))[np.asarray(flat(b.mask))], axis=0) for s, b in batches.items()
    }
    for shards in (2, 4):
        np.testing.assert_array_equal(labels[shards], labels[1])
        assert losses[shards] == pytest.approx(losses[1], rel=1e-5)
    # a mean of the shards' means would be another number here: the shards have different sizes and labels
    four = batches[4]
    alone = [phase.loss(params, jax.tree.map(lambda a, i=i: a[i : i + 1], four), None) for i in range(4)]
    assert abs(float(np.mean(alone)) - losses[1]) > 1e-2 * losses[1]


def test_devices_without_a_shape_count_for_nothing() -> None:
    examples = _examples()[:2]
    module, phase = build_model(model_config(**NETS["mlp"])), objectives(model_config(**NETS["mlp"]))[0]
    params = random_variables(module, examples[0].graph)["params"]
    one, four = (WholeShapes(examples).draw(2000, 0, 0, shards) for shards in (1, 4))
    assert four.mask.any(axis=1).tolist() == [True, True, False, False] and not four.weight[2:].any()
    assert float(phase.loss(params, four, None)) == pytest.approx(float(phase.loss(params, one, None)), rel=1e-5)
