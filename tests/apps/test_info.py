"""`gash info` on one file of every kind, and on what is none."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gash_jax.apps.cli import gash
from gash_jax.files.npz import read_npz, write_npz
from gash_jax.files.settings import ConfigError
from gash_jax.formats.hdr import write_hdr
from gash_jax.measure.reference import make_reference
from gash_jax.models.model import save_model, shipped_models
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train.config import DataConfig, load_config
from gash_jax.train.corpus import build_item
from tests.helpers.shared_data import shared_file

SWEEP = """
name = "widths"
config = "mlp"
[axes.width]
keys = ["model.channels"]
values = [8, 16, 32]
"""


def told(capsys: pytest.CaptureFixture, path: Path) -> dict[str, Any]:
    capsys.readouterr()
    gash.main(["info", str(path), "--json"], standalone_mode=False)
    values = json.loads(capsys.readouterr().out)
    gash.main(["info", str(path)], standalone_mode=False)
    assert capsys.readouterr().out.startswith(f"kind: {values['kind']}\n")
    return values


def test_maps(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    image = np.full((8, 16, 3), 0.5)
    image[2, 3] = 4.0
    image[5] = 0.0
    write_hdr(tmp_path / "sky.hdr", image)
    values = told(capsys, tmp_path / "sky.hdr")
    assert (values["kind"], values["width"], values["height"]) == ("environment map", 16, 8)
    assert values["layout"] == "latlong" and values["notes"] == []
    assert values["radiance"] == pytest.approx(
        {"least": 0.0, "least_above_0": 0.5, "mean": image.mean(), "most": 4.0}, rel=1e-3
    )
    write_hdr(tmp_path / "square.hdr", np.ones((8, 8, 3)))
    values = told(capsys, tmp_path / "square.hdr")
    assert values["layout"] == "unknown" and "--layout" in values["notes"][0]


def test_what_the_cache_holds(tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path))
    item = build_item(DataConfig(rays=4, min_vertices=100, max_vertices=200), 2, 1)
    values = told(capsys, item)
    assert (values["kind"], values["index"], values["rays"]) == ("corpus item", 1, 4)
    assert values["shape"] and values["arrays"]["coefficients"][1] == 4
    make_reference(bumpy_sphere(2), 2, 64)
    values = told(capsys, next((tmp_path / "references").iterdir()))
    assert values["kind"] == "reference" and set(values["curve"]) == {"4", "8"}


def test_models_are_checked(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    arrays, metadata = read_npz(shipped_models()["mlp"], "model", ())
    write_npz(tmp_path / "m.npz", arrays, metadata)
    assert told(capsys, tmp_path / "m.npz")["parameters"] == sum(array.size for array in arrays.values())
    write_npz(tmp_path / "m.npz", dict(list(arrays.items())[1:]), metadata)
    with pytest.raises(ValueError, match="has no array"):
        told(capsys, tmp_path / "m.npz")


def test_configs(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "own.toml").write_text('name = "own"\n[model]\nname = "mlp"\nchannels = 8\n')
    values = told(capsys, tmp_path / "own.toml")
    assert (values["kind"], values["name"], values["model"]["channels"]) == ("config", "own", 8)
    assert values["train"]["checkpoint_every"] > 0  # what it inherits
    (tmp_path / "sweep.toml").write_text(SWEEP)
    assert told(capsys, tmp_path / "sweep.toml") == {
        **{"kind": "sweep config", "name": "widths", "runs": 3, "axes": ["width"]}
    }


def test_folders(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    run, config = tmp_path / "run", load_config("mlp")
    run.mkdir()
    (run / "config.json").write_text(json.dumps(config.to_dict()))
    lines = [{"phase": "coefficients", "step": step, "validation": 1 / step} for step in (10, 20)]
    (run / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    values = told(capsys, run)
    assert (values["kind"], values["model"], values["finished"], values["checkpoint"]) == ("run", "mlp", False, False)
    assert values["steps"] == {"coefficients": 20} and values["last_validation"]["validation"] == 0.05
    assert told(capsys, run / "config.json")["kind"] == "config"
    save_model(run / "model.npz", config.model, {})
    assert told(capsys, run)["finished"]
    sweep = tmp_path / "sweep"
    (sweep / "runs" / "a").mkdir(parents=True)
    (sweep / "runs" / "b").mkdir()
    rows = [{"id": "x", "skill": 0.2}, {"id": "y", "skill": 0.5}]
    (sweep / "results.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows[:2]))
    assert told(capsys, sweep) == {"kind": "sweep", "finished": 2, "started": 2, "best": rows[1]}


def test_animations(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    mesh = bumpy_sphere(3)
    still = np.tile(np.eye(3, 4), (4, 1, 1, 1))
    rig = {"rest": mesh.vertices, "weights": np.full((len(mesh.vertices), 1), 2.0), "transforms": still}
    np.savez(tmp_path / "rig.npz", **rig, faces=mesh.faces, times=np.arange(4) / 2)
    values = told(capsys, tmp_path / "rig.npz")
    assert values["kind"] == "animation" and values["frames"] == 4 and values["seconds"] == [0.0, 1.5]
    assert (values["bones"], values["shapes"], values["names"], values["clips"]) == (1, 0, ["bone 0"], [])
    assert values["vertices"] == len(mesh.vertices) and "divided by their sum" in values["notes"][0]
    np.savez(tmp_path / "bad.npz", verts=np.full((2, 3, 3), np.nan), faces=np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="not finite"):
        told(capsys, tmp_path / "bad.npz")
    walk = told(capsys, shared_file("animated/CesiumMan.glb"))
    assert walk["kind"] == "animation" and walk["bones"] == 19 and walk["health"]["parts"] == 138
    assert len(walk["clips"]) == 1


def test_what_is_no_such_file(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "a.txt").write_text("hello")
    (tmp_path / "results.json").write_text('{"rows": []}')
    write_npz(tmp_path / "foreign.npz", {"a": np.zeros(2)}, {})
    for name, reason in (
        ("a.txt", "not a kind of file that gash knows"),
        ("absent.ply", "no such file"),
        (".", "of no run"),
        ("foreign.npz", "not written by gash_jax"),
        ("results.json", "unknown key"),
    ):
        with pytest.raises((ValueError, ConfigError), match=reason) as refused:
            told(capsys, tmp_path / name)
        assert "\n" not in str(refused.value)
