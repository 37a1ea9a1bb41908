"""The guided bake's training and evaluation run, small."""

from pathlib import Path

import numpy as np
import pytest

from experiments.guided import examples, run, train
from gash_jax.files.npz import read_npz
from gash_jax.models.reconstruction import load_network
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.shapes.procedural import make_shape


def test_the_estimates_of_an_example_get_better_with_rays() -> None:
    example = examples.make_example(bumpy_sphere(6), seed=0, truth=256, counts=(8, 64, 128))
    errors = np.mean((example.residuals - example.truth) ** 2, axis=(1, 2))
    assert errors[0] > 3 * errors[1] and errors[1] > errors[2]
    assert example.shares.shape == (3, len(example.places)) and (example.doubt >= 0).all()


@pytest.mark.slow
def test_training_gains_and_its_file_is_a_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    counts = (8, 64)
    monkeypatch.setattr(train, "COUNTS", counts)
    monkeypatch.setattr(train, "SIZES", (1024,))
    mesh = make_shape(52, 2, (300, 500))[1]
    meshes = [examples.make_example(mesh, seed, truth=1024, counts=counts) for seed in range(2)]
    monkeypatch.setattr(train, "load_examples", lambda seed, shapes, report=None: meshes)
    _, _, ratios = train.train(meshes, 120)
    # untrained it averages neighbours on a coarse mesh, which with many rays does harm
    assert max(ratios[:10]) > 1 and max(ratios[-30:]) < 1
    train.main(tmp_path / "guided.npz", 2, 5)
    network = load_network(tmp_path / "guided.npz")
    assert network.module.hidden == 10 and set(network.params) == {"first", "second", "error"}
    assert "commit" in read_npz(tmp_path / "guided.npz", "reconstruction", ())[1]


def test_evaluation_runs(tmp_path: Path) -> None:
    results = run.main(None, tmp_path / "results.json", quick=True)
    assert len(results["rows"]) >= 1 and (tmp_path / "results.json").exists()
    for row in results["rows"]:
        assert row["guided"] < row["own"] * 1.1 and row["own"] < row["plain"] * 1.2 and 0.3 < row["score"] < 3
