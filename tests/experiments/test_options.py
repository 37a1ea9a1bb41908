"""The options that scripts share: their meaning, other defaults, and a file only where one is asked for."""

import json
import sys
from pathlib import Path

import pytest

from benchmarks.options import SHARED, options, saved


def test_main_gets_its_options_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    line = ["script", "--meshes", "folder", "--output", "a.json", "--quick"]
    monkeypatch.setattr(sys, "argv", line)
    found = options("What it does.", *SHARED, runs="runs/other")
    assert found == {
        "meshes": Path("folder"),
        "output": Path("a.json"),
        "quick": True,
        "runs": Path("runs/other"),
        "model": "local",
        "maps": None,
    }
    monkeypatch.setattr(sys, "argv", line[:1])
    assert options("What it does.", "output", "quick") == {"output": None, "quick": False}


def test_an_option_that_a_script_does_not_have_is_refused(monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["script", "--quick"])
    with pytest.raises(SystemExit):
        options("What it does.", "output")
    assert "unrecognized arguments: --quick" in capsys.readouterr().err


def test_results_are_written_where_asked(tmp_path: Path) -> None:
    assert saved(None, {"a": 1}) == saved(tmp_path / "a.json", {"a": 1}) == {"a": 1}
    assert json.loads((tmp_path / "a.json").read_text()) == {"a": 1}
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]
