"""The guided bake's training and evaluation run, small."""

from pathlib import Path

import numpy as np
import pytest

from experiments.guided import calibrate, examples, run, train
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


def test_calibration_runs(tmp_path: Path) -> None:
    results = calibrate.main(tmp_path / "results.json", quick=True)
    assert [level["rays"] for level in results["levels"]] == [8, 16, 32] and (tmp_path / "results.json").exists()


def test_a_calibration_finds_the_line_that_is_there() -> None:
    """Halves worth 0.4, errors e^-0.3 ratio^0.7 of those expected; a shape with a poor reference is left out."""
    expected = np.geomspace(1e-6, 1e-2, 10)
    rows = [
        {"shape": str(i), "rays": 16, "law": 1.0, "own": r, "halves": r / 0.4, "expected": 0.5, "doubt": 1e-4}
        | {"guided": 0.5 * np.exp(-0.3) * r**0.7, "tenths": [expected**0.8, expected, 1e-9 * expected]}
        for i, r in enumerate(np.geomspace(0.5, 2, 9))
    ]
    rows.append({**rows[0], "shape": "poor", "guided": 10.0, "doubt": 9.0})
    (level,) = calibrate.fit(rows)
    assert level["shapes"] == 9
    found = [level[name] for name in ("worth", "power", "level", "slope", "spread_after")]
    np.testing.assert_allclose(found, [0.4, 0.7, -0.3, -0.2, 0], atol=1e-6)
