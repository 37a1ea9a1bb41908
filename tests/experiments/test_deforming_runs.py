"""Experiments that train models of one object: the sweep of sizes, gloss, `local` trained on for the object."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs.deforming_tables import glossy_table, sizes_table
from experiments.deforming import fine_tuned, glossy, objects, sizes
from gash_jax.files.settings import ConfigError
from gash_jax.models.model import load_model
from gash_jax.train.config import load_config
from gash_jax.train.run import run_config
from gash_jax.train.sweep import load_sweep


def test_the_sweep_of_sizes_is_gathered_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = load_sweep(sizes.SWEEP)[1]
    assert len(runs) == 8 and {run.config.model.name for run in runs} == {"deep-prt"}
    lines = [
        {"id": run.id, **run.point, **dict.fromkeys(sizes.KEPT[3:], 0.25), "relrmse": number / 100}
        for number, run in enumerate(runs)
    ]
    (tmp_path / "results.jsonl").write_text("\n".join(map(json.dumps, lines[:-1])))
    with pytest.raises(ConfigError, match=r"1 runs are missing \(first: width_32-depth_4-images_128-.*run gash sweep"):
        sizes.main(tmp_path, None, None)
    with pytest.raises(ConfigError, match="give --write-cloth FOLDER, or --runs FOLDER"):
        sizes.main(None, None, None)
    (tmp_path / "results.jsonl").write_text("\n".join(map(json.dumps, lines)))
    found = sizes.main(tmp_path, None, tmp_path / "sizes.json")
    assert [row["relrmse"] for row in found["rows"]] == [number / 100 for number in range(8)]
    assert json.loads((tmp_path / "sizes.json").read_text())["arguments"] == {"seconds": 40.0}
    text = sizes_table(found)
    assert "| 32 | 4 | 128² |" in text and "40 CPU seconds of a core each" in text
    monkeypatch.setattr(objects, "FRAMES", 3)
    assert Path(sizes.main(None, tmp_path, None)["written"]).name == "cloth.npz"


def test_models_of_radiance_stand_beside_bakes_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(glossy, "RAYS", (8, 32))
    file = objects.object_file("bumps", None, tmp_path)
    data = [f"data.animation={file}", "data.light=studio", "data.frames=8", "data.test_frames=2", "data.rays=16"]
    data += ["data.test_rays=64", "model.bands=2"]
    run_config(load_config("momo-prt", data), tmp_path / "linear")
    small = ["model.size=16", "model.levels=1", "model.channels=2", "train.steps=2"]
    run_config(load_config("deep-prt-small", [*data, *small]), tmp_path / "images")
    asked = [f"momo-prt={tmp_path / 'linear'}", f"deep-prt-small={tmp_path / 'images'}"]
    found = glossy.main(asked, tmp_path / "glossy.json")
    rows = {row["method"]: row for row in found["rows"]}
    assert list(rows) == ["mean", "momo-prt", "deep-prt-small", "glossy bake, 8 rays", "glossy bake, 32 rays"]
    assert rows["glossy bake, 32 rays"]["relrmse"] < rows["glossy bake, 8 rays"]["relrmse"]
    assert rows["momo-prt"]["bytes"] > 0 and rows["deep-prt-small"]["fit_cpu_seconds"] > 0
    alone: Any = json.loads((tmp_path / "linear" / "scores.json").read_text())
    assert rows["momo-prt"]["relrmse"] == pytest.approx(alone["relrmse"], rel=1e-5)
    text = glossy_table(found)
    assert all(f"| {name} |" in text for name in rows) and "bumps, 2 bands, light `studio`" in text
    with pytest.raises(ConfigError, match="--run NAME=FOLDER"):
        glossy.main([], None)


@pytest.mark.slow
def test_local_is_trained_on_from_its_own_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(fine_tuned, "POSES", 3)
    monkeypatch.setattr(fine_tuned, "VALIDATION", 1)
    model = load_model(fine_tuned.main("bumps", None, "", 8, 0.5, tmp_path))
    assert model.config == load_model("local").config
    moved = [
        float(np.abs(a - b).max()) for a, b in zip(model_leaves(model), model_leaves(load_model("local")), strict=True)
    ]
    assert 0 < max(moved) < 0.1  # it started there, and went a little way
    assert len(list((tmp_path / "training").iterdir())) == 3 and len(list((tmp_path / "validation").iterdir())) == 1


def model_leaves(model: Any) -> list[np.ndarray]:
    import jax

    return [np.asarray(leaf) for leaf in jax.tree.leaves(model.params)]
