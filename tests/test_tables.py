"""The tables of the documents are those of the committed results."""

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def writer() -> ModuleType:
    spec = importlib.util.spec_from_file_location("write_tables", ROOT / "docs" / "write_tables.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("document", ["README.md", "docs/baking.md", "docs/hard_cases.md"])
def test_documents_hold_the_generated_tables(writer: ModuleType, document: str) -> None:
    assert writer.documents()[document] == (ROOT / document).read_text(encoding="utf-8")


def test_results_say_where_they_come_from(writer: ModuleType) -> None:
    for table in writer.TABLES:
        result = json.loads((ROOT / "docs" / "results" / table.results).read_text(encoding="utf-8"))
        assert {"machine", "commit", "software"} <= set(result), table.results
        assert table.render(result).count("\n|") >= 2


def test_filling_replaces_one_table_and_nothing_else(writer: ModuleType) -> None:
    text = "before\n<!-- A -->\nold\n<!-- /A -->\nbetween\n<!-- B -->\nkept\n<!-- /B -->\n"
    filled = writer.fill(text, "A", r"new \1")
    assert filled == text.replace("old", r"new \1")
    assert writer.fill(filled, "A", "old") == text


@pytest.mark.parametrize("text", ["no marker", "<!-- A -->\nnever closed", 2 * "<!-- A -->\nx\n<!-- /A -->\n"])
def test_missing_or_repeated_markers_are_refused(writer: ModuleType, text: str) -> None:
    with pytest.raises(ValueError, match="table A must stand in the document once"):
        writer.fill(text, "A", "new")


def test_a_case_over_its_bound_shows_in_the_table(writer: ModuleType) -> None:
    machine = {"machine": {"processor": "P", "cores": 1}, "commit": "c"}
    number = {"name": "n", "measured": "m", "value": 0.25, "bound": 0.5, "why": "w", "told": "t", "passed": True}
    refusal = {**number, "value": "no", "bound": "no", "passed": True}
    table = writer.hard_cases_table({**machine, "rows": [number, refusal]})
    assert "| n | m | 2.5e-01 | 5.0e-01 | w | t |" in table
    assert "| n | refusal |  |  |  | `error: no` |" in table
    bad = [{**row, "passed": False} for row in (number, refusal)]
    assert (text := writer.hard_cases_table({**machine, "rows": bad})).count("EXCEEDED") == 1
    assert text.count("NOT REFUSED") == 1
