"""The README's tables are those of the committed results."""

import importlib.util
import json
from pathlib import Path

ROOT = Path(__file__).parents[1]


def _writer():
    spec = importlib.util.spec_from_file_location("write_tables", ROOT / "docs" / "write_tables.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_readme_holds_the_generated_tables() -> None:
    readme, writer = (ROOT / "README.md").read_text(encoding="utf-8"), _writer()
    for table, file in ((writer.demo_table, "demo.json"), (writer.speed_table, "bake_speed.json")):
        result = json.loads((ROOT / "docs" / "results" / file).read_text())
        assert table(result) in readme
        assert {"machine", "commit", "software"} <= set(result)
