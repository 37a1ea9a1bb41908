"""The load test of benchmarks/service.py in small: nothing is lost, and it would notice."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import service
from docs import service_tables
from gash_jax.apps.service.limits import Limits
from gash_jax.models.held import HeldMesh
from gash_jax.models.model import save_model
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.service import served, tiny_model

MESH = bumpy_sphere(4)


@pytest.mark.slow
def test_nothing_is_lost_under_load(tmp_path: Path) -> None:
    model, weights = tiny_model(), tmp_path / "tiny.npz"
    save_model(weights, model.config, model.params)
    found = service.main(None, True, str(weights), clients=4, requests=10, repeats=1)
    load = found["load"]
    assert (load["answered"], load["refused"] + load["cut off"], load["lost"]) == (36, 4, 0)
    assert len(load["memory_mib"]) == 10 and max(load["memory_mib"]) < 4 * min(load["memory_mib"])
    assert found["arguments"]["exit_code"] == 0
    (row,) = found["rows"]
    for kind in ("new", "pose"):
        parts = [row[kind][stage] for stage in service_tables.STAGES]
        assert min(parts) >= 0 and sum(parts) == pytest.approx(row[kind]["total"])
    assert "| new mesh | 252 |" in service_tables.latency_table(found)
    assert "| 4 | 40 | 36 |" in service_tables.load_table(found)


@pytest.mark.parametrize("wrong", [0.0, 0.1])
def test_wrong_coefficients_are_counted_as_lost(wrong: float) -> None:
    model = tiny_model()
    held = HeldMesh(model, MESH)
    poses = [(MESH.vertices.tobytes(), held.predict(MESH.vertices).coefficients + np.float32(wrong))]
    with served({"tiny": model}, Limits()) as port:
        client = service.Client(port, poses, MESH, seed=0)
        client.run(4, lambda: None)
    assert client.counts == ({"lost": 4} if wrong else {"answered": 4})


def test_a_service_that_is_gone_is_noticed() -> None:
    with served({"tiny": tiny_model()}, Limits()) as port:
        pass
    client = service.Client(port, [(MESH.vertices.tobytes(), np.zeros((len(MESH.vertices), 9), np.float32))], MESH, 0)
    client.run(3, lambda: None)
    assert client.counts == {"lost": 3}
