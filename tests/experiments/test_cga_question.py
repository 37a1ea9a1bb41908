"""The comparison of encodings: its sweep is what it says, unseen meshes are scored once, intervals by hand."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs import cga_table
from experiments.cga import unseen
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.models.model import save_model
from gash_jax.train.sweep import load_sweep
from tests.helpers.bumpy import bumpy_mesh, random_variables

ROOT = Path(__file__).parents[2]


def test_the_sweeps_give_everyone_the_same_budget_and_shapes() -> None:
    files = ("published", "ours", "versor")
    published, ours, versor = (load_sweep(ROOT / "experiments" / "cga" / f"{name}.toml")[1] for name in files)
    runs = [*published, *ours, *versor]
    assert [len(some) for some in (published, ours, versor)] == [20, 25, 5] and len({run.id for run in runs}) == 50
    assert len({(run.config.train, run.config.optim, run.config.data) for run in runs}) == 5  # by seed
    for some in (published, ours[:20]):
        assert [run.seed for run in some] == sorted(run.seed for run in some)
    values = [run.config.model.to_dict() for run in runs]
    forms = {(each["name"], each.get("frame")) for each in values}
    assert forms == {("gnn", "vertex"), ("rings", None), ("versor", None)}
    assert {name for name, _ in forms} == set(cga_table.FORMS)
    cells = {(each["name"], each["encoding"]) for each in values}
    assert {encoding for _, encoding in cells} == set(cga_table.ENCODINGS) and len(cells) == 10


def test_unseen_meshes_are_scored_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = model_config("mlp", channels=4, layers=1, encoding="position-normal")
    weights = random_variables(build_model(config), model_graph(config, bumpy_mesh(30)))["params"]
    line = {"form": "gnn", "encoding": "position-normal", "parameters": 9, "steps": 5, "skill": 0.1, "commit": "c"}
    for seed in (0, 1):
        folder = tmp_path / "runs" / f"run{seed}"
        folder.mkdir(parents=True)
        save_model(folder / "model.npz", config, weights, name="x")
    lines = [json.dumps({**line, "id": f"run{seed}", "seed": seed}) for seed in (0, 1)]
    (tmp_path / "results.jsonl").write_text(lines[0] + "\n")
    output = tmp_path / "results.json"
    first = unseen.main(tmp_path, None, output, quick=True)["rows"]
    assert set(first[0]["meshes"]) == {"generated 1", "generated 2"}
    assert all(isinstance(value, float) for value in first[0]["meshes"].values())
    (tmp_path / "results.jsonl").write_text("\n".join(lines) + "\n")
    loaded: list[Any] = []
    monkeypatch.setattr(unseen, "load_model", lambda path, load=unseen.load_model: loaded.append(path) or load(path))
    second = unseen.main(tmp_path, None, output, quick=True)["rows"]
    assert second[0] == first[0] and [path.parent.name for path in loaded] == ["run1"]
    assert second[1]["meshes"] == first[0]["meshes"] and json.loads(output.read_text())["rows"] == second


def test_intervals_by_hand() -> None:
    # t of 4 degrees of freedom 2.776, deviation sqrt(2.5): 2.776 sqrt(2.5 / 5) = 1.963
    assert cga_table.interval(np.array([1.0, 2, 3, 4, 5])) == "3.000 ± 1.963"
    assert cga_table.interval(np.array([0.25])) == "0.250"


def test_differences_are_taken_seed_by_seed() -> None:
    row = {"form": "gnn", "parameters": 7, "commit": "c"}
    plain = [
        {
            **row,
            "encoding": "position-normal",
            "seed": s,
            "steps": 10,
            "skill": float(s),
            "meshes": {"a": 0.0, "b": 1.0},
        }
        for s in range(3)
    ]
    motor = [
        {**row, "encoding": "motor", "seed": s, "steps": 20, "skill": s + 0.5, "meshes": {"a": 1.0, "b": "no transfer"}}
        for s in (1, 2)
    ]
    lines = cga_table.encodings({"rows": [*plain, *motor]}).splitlines()
    assert len(lines) == 4
    assert (
        lines[2]
        == "| published: GATv2 | position and normal, 6 numbers | 7 | 10 | 3 | 1.000 ± 2.484 |  | 0.500 ± 0.000 |  |"
    )
    start = "| published: GATv2 | motor, 32 numbers | 7 | 20 | 2 | 2.000 ± 6.353 | 0.500 ± 0.000 "
    assert lines[3] == f"{start}| 1.000 ± 0.000 | 0.500 ± 0.000 |"
