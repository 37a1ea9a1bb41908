"""What is generated in the documents is what the committed results and the imports make of it."""

import json
from pathlib import Path

import pytest

from docs import tables
from docs.__main__ import generated
from gash_jax.models.model import shipped_models

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def documents() -> dict[str, str]:
    return generated()


GENERATED = (
    "README.md",
    "CONTRIBUTING.md",
    "docs/animation.md",
    "docs/api.md",
    "docs/baking.md",
    "docs/choices.md",
    "docs/deforming.md",
    "docs/hard_cases.md",
    "docs/light.md",
    "docs/model_cards.md",
    "docs/model_file.md",
    "docs/service.md",
    "docs/transport.md",
)


@pytest.mark.parametrize("document", [*GENERATED, "docs/results.md"])
def test_documents_are_the_generated_ones(documents: dict[str, str], document: str) -> None:
    assert documents[document] == (ROOT / document).read_text(encoding="utf-8"), "run .venv/bin/python -m docs"


def test_no_generated_document_goes_unseen(documents: dict[str, str]) -> None:
    assert set(documents) == {*GENERATED, "docs/results.md"}


def test_every_shipped_model_has_a_card(documents: dict[str, str]) -> None:
    assert shipped_models() and all(f"## `{name}`" in documents["docs/model_cards.md"] for name in shipped_models())


def test_results_say_where_they_come_from() -> None:
    for table in tables.TABLES:
        result = json.loads((ROOT / "docs" / "results" / table.results).read_text(encoding="utf-8"))
        assert {"machine", "commit", "software"} <= set(result), table.results
        assert table.render(result).count("\n|") >= 2


def test_errors_in_equal_time_lie_between_the_settings() -> None:
    """Half-way between 1 and 4 s in the logarithm, so between .08 and .02; a method that is not so quick has none."""
    rows = [("local", 2.0, 0.05), ("guided", 1.0, 0.08), ("guided", 4.0, 0.02), ("plain", 3.0, 0.01)]
    mesh = {
        **{"mesh": "body", "vertices": 1000, "bounces": 0, "frames": 0, "skipped": {}},
        "rows": [{"method": name, "seconds": {"median": s}, "relrmse": error} for name, s, error in rows],
    }
    machine = {"processor": "a processor", "cores": 2, "device": "cpu"}
    told = {"meshes": [mesh], "arguments": {"rounds": 3, "rays": 64}, "machine": machine, "commit": "abc"}
    assert "| body | 1000 | 2000.00 | 0.0500 | 0.0400 | inf | guided |" in tables.frontier_tables.equal_time_table(told)


def test_filling_replaces_one_table_and_nothing_else() -> None:
    text = "before\n<!-- A -->\nold\n<!-- /A -->\nbetween\n<!-- B -->\nkept\n<!-- /B -->\n"
    filled = tables.fill(text, "A", r"new \1")
    assert filled == text.replace("old", r"new \1")
    assert tables.fill(filled, "A", "old") == text


@pytest.mark.parametrize("text", ["no marker", "<!-- A -->\nnever closed", 2 * "<!-- A -->\nx\n<!-- /A -->\n"])
def test_missing_or_repeated_markers_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="table A must stand in the document once"):
        tables.fill(text, "A", "new")


def test_a_case_over_its_bound_shows_in_the_table() -> None:
    machine = {"machine": {"processor": "P", "cores": 1}, "commit": "c"}
    number = {"name": "n", "measured": "m", "value": 0.25, "bound": 0.5, "why": "w", "told": "t", "passed": True}
    refusal = {**number, "value": "no", "bound": "no", "passed": True}
    table = tables.hard_cases_table({**machine, "rows": [number, refusal]})
    assert "| n | m | 2.5e-01 | 5.0e-01 | w | t |" in table
    assert "| n | refusal |  |  |  | `error: no` |" in table
    bad = [{**row, "passed": False} for row in (number, refusal)]
    assert (text := tables.hard_cases_table({**machine, "rows": bad})).count("EXCEEDED") == 1
    assert text.count("NOT REFUSED") == 1
