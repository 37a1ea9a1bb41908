"""Training, prediction and the demo from the command line, on a corpus of a few small shapes."""

import json
import re
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from PIL import Image

from gash_jax.apps.cli import gash
from gash_jax.apps.commands import demo
from gash_jax.apps.pictures import contact_sheet
from gash_jax.formats.meshes import save_mesh
from gash_jax.measure import methods
from gash_jax.models.families import model_config
from gash_jax.models.model import load_model, shipped_models
from gash_jax.prt.transfer import load_transfer
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train.config import DataConfig, TrainConfig, load_config

WEIGHTS = str(shipped_models()["local"])
TINY = """
name = "tiny"
[model]
name = "local"
channels = 8
layers = 1
[data]
shapes = 2
validation_shapes = 1
rays = 16
min_vertices = 150
max_vertices = 300
[train]
steps = 6
batch_vertices = 512
"""


def test_train_then_predict_then_continue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tiny.toml").write_text(TINY)
    save_mesh("bumpy.ply", bumpy_sphere(10))
    gash.main(["train", "tiny.toml", "-o", "run"], standalone_mode=False)
    said = capsys.readouterr().out
    assert "1 validation shapes: skill" in said and "wrote run/model.npz and run/curves.png" in said
    assert re.search(r"^6 steps in \d+\.\d s, \d+\.\d CPU seconds$", said, re.MULTILINE)
    with Image.open("run/curves.png") as curves:
        assert curves.size[0] > 400
    gash.main(["predict", "bumpy.ply", "-o", "p.npz", "--model", "run/model.npz"], standalone_mode=False)
    transfer = load_transfer("p.npz")
    assert transfer.metadata["method"] == "predict" and transfer.metadata["rays_total"] == 0
    assert transfer.standard_error is None and np.isfinite(transfer.coefficients).all()
    assert transfer.predicted_error is not None and (transfer.predicted_error >= 0).all()
    with pytest.raises(ValueError, match="p.npz is not a bake"):
        gash.main(["compare", "p.npz", "p.npz"], standalone_mode=False)
    gash.main(["info", "run/model.npz"], standalone_mode=False)
    assert "parameters" in capsys.readouterr().out
    before = Path("run/model.npz").stat().st_mtime_ns
    gash.main(["train", "tiny.toml", "-o", "run", "--quiet"], standalone_mode=False)  # nothing is left to do
    assert Path("run/model.npz").stat().st_mtime_ns >= before


def _tiny_configs(seconds: float) -> dict:
    data = DataConfig(shapes=2, validation_shapes=1, rays=16, min_vertices=150, max_vertices=300)
    budget = TrainConfig(steps=4, batch_vertices=512)
    mlp = model_config(name="mlp", channels=8, layers=1)  # twice: that each network trains is shown elsewhere
    models = {"mlp": mlp, "two-stage": mlp, "local": model_config(name="local", channels=8, layers=1)}
    return {n: replace(load_config(n), model=m, data=data, train=budget) for n, m in models.items()}


@pytest.mark.parametrize("options", [[], ["--train", "2"]], ids=["shipped", "trained"])
def test_demo_writes_its_table_and_its_picture(
    options: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(demo, "demo_configs", _tiny_configs)
    monkeypatch.setattr(demo, "REFERENCE_RAYS", 256)
    monkeypatch.setattr(methods, "PLAIN_RAYS", (8, 16))
    save_mesh("bumpy.ply", bumpy_sphere(10))
    gash.main(["demo", "-o", "out", "--mesh", "bumpy.ply", *options], standalone_mode=False)
    said = capsys.readouterr().out
    for method in ("closed form", "plain bake, 8 rays", "mlp", "two-stage", "local"):
        assert method in said
    results = json.loads(Path("out/results.json").read_text())
    assert {"machine", "commit", "seed", "rows"} <= set(results)
    assert results["rows"][0]["method"] == "closed form" and abs(results["rows"][0]["skill"]) < 1e-5
    with Image.open("out/picture.png") as picture:
        assert picture.size[0] > 1500
    page = Path("out/page.html").read_text()
    shown = ["reference, 256 rays a vertex", "network mlp", "network two-stage", "network local", "plain bake, 8 rays"]
    assert [name for name in shown if f'data-name="{name}"' not in page] == []


def test_demo_configs_share_corpus_and_have_the_budget() -> None:
    configs = demo.demo_configs(80.0)
    assert {c.train.seconds for n, c in configs.items() if n != "mlp"} == {80.0}
    assert len({c.data for c in configs.values()}) == 1


def test_bench_and_evaluate_agree_with_compare(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(methods, "PLAIN_RAYS", (8,))
    save_mesh("bumpy.ply", bumpy_sphere(8))
    gash.main(["bench", "bumpy.ply", "--rays", "128", "-o", "bench.json", "--json"], standalone_mode=False)
    said = json.loads(capsys.readouterr().out)
    rows = {row["method"]: row for row in said["rows"]}
    assert json.loads(Path("bench.json").read_text()) == said and set(rows) == {
        "closed form",
        "plain bake, 8 rays",
        "local",
    }
    gash.main(["evaluate", WEIGHTS, "bumpy.ply", "--rays", "128", "-o", "scores.json"], standalone_mode=False)
    text = capsys.readouterr().out
    assert "median skill" in text and "bumpy.ply" in text
    (score,) = json.loads(Path("scores.json").read_text())["rows"]
    for name in ("relrmse", "skill", "mse", "equivalent_rays"):
        assert score[name] == rows["local"][name]
    assert all(score[f"{part}{clock}_us"] > 0 for part in ("graph", "network") for clock in ("", "_cpu"))
    gash.main(["bake", "bumpy.ply", "-o", "r.npz", "--rays", "128", "--seed", "99"], standalone_mode=False)
    gash.main(["predict", "bumpy.ply", "-o", "p.npz"], standalone_mode=False)
    capsys.readouterr()
    gash.main(["compare", "p.npz", "r.npz", "--json"], standalone_mode=False)
    assert json.loads(capsys.readouterr().out)["relrmse"] == pytest.approx(score["relrmse"], rel=1e-6)


def test_export_of_a_finished_and_of_an_unfinished_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tiny.toml").write_text(TINY)
    gash.main(["train", "tiny.toml", "-o", "run", "--quiet"], standalone_mode=False)
    gash.main(["export", "run", "-o", "whole.npz", "--quiet"], standalone_mode=False)
    Path("run/model.npz").unlink()
    gash.main(["export", "run", "-o", "cut.npz", "--quiet"], standalone_mode=False)
    whole, cut = load_model("whole.npz"), load_model("cut.npz")
    assert whole.config == cut.config and whole.metadata["run"] == cut.metadata["run"]
    jax.tree.map(np.testing.assert_array_equal, whole.params, cut.params)
    with pytest.raises(ValueError, match="not a run with a checkpoint"):
        gash.main(["export", "elsewhere", "-o", "none.npz"], standalone_mode=False)


def test_corpus_sheet_shows_every_shape(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tiny.toml").write_text(TINY)
    gash.main(["corpus", "tiny.toml", "-o", "sheet.png"], standalone_mode=False)
    assert "2 shapes to train on, 1 to validate" in capsys.readouterr().out
    with Image.open("sheet.png") as sheet:
        assert sheet.size[0] > 3 * contact_sheet.SIZE


def test_a_student_without_its_teacher_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("student-mlp", "student-gnn"):
        with pytest.raises(ValueError, match="no model 'runs/teacher/model.npz'"):
            gash.main(["train", name], standalone_mode=False)
    assert not Path("runs").exists()


def test_predict_with_ambient_occlusion_only_darkens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    save_mesh("bumpy.ply", bumpy_sphere(8))
    gash.main(["predict", "bumpy.ply", "-o", "plain.npz", "--quiet"], standalone_mode=False)
    gash.main(["predict", "bumpy.ply", "-o", "darker.npz", "--ambient", "--quiet"], standalone_mode=False)
    plain, darker = load_transfer("plain.npz"), load_transfer("darker.npz")
    assert "ambient" in darker.metadata["parameters"] and "ambient" not in plain.metadata["parameters"]
    assert np.all(np.abs(darker.coefficients) <= np.abs(plain.coefficients))
    assert np.abs(darker.coefficients - plain.coefficients).max() > 1e-3
