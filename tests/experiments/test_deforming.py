"""The experiment on deforming objects runs on a small generated one, and its table says what it found."""

from pathlib import Path

import pytest

from docs.deforming_tables import deforming_table
from experiments.deforming import run


def test_it_runs_and_its_table_has_every_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(run, "RANKS", (4, 12))
    monkeypatch.setattr(run, "COMPONENTS", (3, 9, 99))
    monkeypatch.setattr(run, "RAYS", (4, 16))
    sizes = {"frames": 12, "test_frames": 3, "rays": 8, "test_rays": 64}
    result = run.main(None, "", "bumps", **sizes, work=tmp_path / "work", output=tmp_path / "result.json")
    rows = {row["method"]: row for row in result["rows"]}
    assert rows["PCA floor, 9 components"]["relrmse"] < rows["PCA floor, 3 components"]["relrmse"]
    assert rows["PCA floor, 3 components"]["relrmse"] < rows["mean of the training frames"]["relrmse"]
    assert rows["bake, 16 rays"]["relrmse"] < rows["bake, 4 rays"]["relrmse"]
    assert rows["deform, 4 numbers"]["bytes"] < rows["deform, 12 numbers"]["bytes"]
    assert all(0 <= row["accuracy"] <= 1 for row in rows.values())
    text = deforming_table(result)
    assert all(f"| {name} |" in text for name in rows) and "bumps, 642 vertices" in text
