"""`gash sweep` from the command line: lines, table, picture; continued, and with a run that fails."""

import csv
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from gash_jax.apps.cli import gash
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere

SPEC = """
name = "tiny"
config = "mlp"
set = ["data.shapes=2", "data.validation_shapes=1", "data.rays=16", "data.min_vertices=150",
       "data.max_vertices=300", "train.steps=4", "train.batch_vertices=BATCH"]
[axes.width]
keys = ["model.channels"]
values = VALUES
[[repeats]]
seeds = [1]
points = [{ width = 4 }]
"""


def _sweep(values: str, batch: int = 512) -> None:
    Path("sweep.toml").write_text(SPEC.replace("VALUES", values).replace("BATCH", str(batch)))
    gash.main(["sweep", "sweep.toml", "-o", "out"], standalone_mode=False)


def _lines() -> list[dict]:
    return [json.loads(line) for line in Path("out/results.jsonl").read_text().splitlines()]


@pytest.mark.slow
def test_a_sweep_is_finished_in_two_calls_and_survives_failing_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    _sweep("[4]")
    first = _lines()
    assert "2 runs, 0 done before" in capsys.readouterr().out and len(first) == 2
    with open("out/results.jsonl", "a", encoding="utf-8") as file:
        file.write('{"id": "a line that was cut by a ki')
    _sweep("[4, 8]")
    assert "3 runs, 2 done before" in capsys.readouterr().out
    lines = _lines()
    assert lines[:2] == first and {(line["width"], line["seed"]) for line in lines} == {(4, 0), (4, 1), (8, 0)}
    assert {"machine", "commit", "skill", "relrmse", "parameters", "steps"} <= set(lines[2])
    assert lines[2]["phase_steps"] == {"coefficients": 4}
    assert lines[2]["wall_seconds"] > 0 and lines[2]["cpu_seconds"] > 0
    assert len([path for path in Path("out/runs").iterdir() if path.name.startswith("width_")]) == 3
    with open("out/results.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["width"] for row in rows] == ["4", "8"] and [row["seeds"] for row in rows] == ["2", "1"]
    pair = [line["relrmse"] for line in first]
    assert float(rows[0]["relrmse"]) == pytest.approx(np.mean(pair))
    assert float(rows[0]["relrmse_std"]) == pytest.approx(np.std(pair, ddof=1)) and rows[1]["relrmse_std"] == ""
    assert float(rows[0]["us_per_vertex"]) > 0
    assert float(rows[0]["cpu_seconds"]) == pytest.approx(np.mean([line["cpu_seconds"] for line in first]))
    with Image.open("out/pareto.png") as picture:
        assert picture.size[0] > 500
    with pytest.raises(ValueError, match=r"2 of 2 runs failed.*batch_vertices"):
        _sweep("[4]", batch=8)
    assert _lines() == lines


def test_more_jobs_than_cores_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sweep.toml").write_text(SPEC.replace("VALUES", "[4]").replace("BATCH", "512"))
    with pytest.raises(ValueError, match="--jobs 1000"):
        gash.main(["sweep", "sweep.toml", "-o", "out", "--jobs", "1000"], standalone_mode=False)


CHILD = """
import multiprocessing, os, sys, time
from gash_jax.apps import run_processes

def child(path):
    import threading
    threading.Thread(target=run_processes._end_with_parent, daemon=True).start()
    open(path, "w").write(str(os.getpid()))
    time.sleep(60)

if __name__ == "__main__":
    process = multiprocessing.get_context("spawn").Process(target=child, args=(sys.argv[1],))
    process.start()
    time.sleep(60)
"""


def test_a_child_ends_with_its_parent(tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(CHILD)
    parent = subprocess.Popen([sys.executable, tmp_path / "parent.py", tmp_path / "pid"])
    until = time.monotonic() + 60
    while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
        assert time.monotonic() < until, "the child did not start"
        time.sleep(0.1)
    child = int((tmp_path / "pid").read_text())
    parent.kill()
    parent.wait()
    while time.monotonic() < until:
        try:
            os.kill(child, 0)
        except ProcessLookupError:
            return
        time.sleep(0.1)
    raise AssertionError("the child lives on")


MOVING = """
name = "moving"
config = "deep-prt-small"
set = ["data.animation=bumps.npz", "data.frames=4", "data.test_frames=2", "data.rays=8", "data.test_rays=16",
       "train.steps=2", "model.size=16"]
[axes.width]
keys = ["model.channels"]
values = [2, 3]
[axes.depth]
keys = ["model.levels"]
values = [1, 2]
"""


@pytest.mark.slow
def test_models_of_one_object_are_swept_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GASH_CACHE", str(tmp_path / "cache"))
    moving = blendshape_animation(bumpy_sphere(4), 0, 2, 3)
    motion: Any = moving.motion
    np.savez("bumps.npz", base=motion.rest, delta=motion.deltas, faces=moving.mesh.faces, names=np.array(moving.names))
    Path("sweep.toml").write_text(MOVING)
    gash.main(["sweep", "sweep.toml", "-o", "out", "--quiet"], standalone_mode=False)
    lines = _lines()
    assert [(line["width"], line["depth"]) for line in lines] == [(2, 1), (2, 2), (3, 1), (3, 2)]
    assert all(line["steps"] == 2 and 0 <= line["accuracy"] <= 1 and line["cpu_seconds"] > 0 for line in lines)
    assert lines[0]["parameters"] < lines[1]["parameters"] < lines[3]["parameters"]
    with open("out/results.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {"relrmse", "accuracy", "l1", "us_per_vertex"} <= set(rows[0]) and "shadow_mse" not in rows[0]
    with Image.open("out/pareto.png") as picture:
        assert picture.width > 400
