"""docs/new_network.md is run as it stands: one file and one entry make a network that trains and predicts."""

import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from gash_jax.models.families import FAMILIES

PAGE = Path(__file__).parents[2] / "docs" / "new_network.md"


def test_the_documented_network_trains_and_predicts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    module = ModuleType("new_network")
    monkeypatch.setitem(sys.modules, "new_network", module)
    monkeypatch.setitem(FAMILIES, "mean", FAMILIES["mlp"])  # taken out again after the test
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 4
    for block in blocks:
        exec(block, vars(module))
        said = [line.split("  # ")[1] for line in block.splitlines() if line.strip().startswith("print(")]
        assert capsys.readouterr().out.splitlines()[-len(said) or None :] == said or not said
