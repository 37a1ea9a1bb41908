"""Write everything in the documents that is generated: `.venv/bin/python -m docs` from the repository root.

Tables come from docs/results/*.json, copies of what `gash bench frontier` and the scripts of benchmarks/ and
experiments/ wrote; the graph of rooms comes from the imports themselves, conventions from their records.
A test compares.
"""

from docs.api_page import page as api
from docs.conclusions import verdict
from docs.convention_tables import conventions_table, sources_table
from docs.model_cards import committed_cards
from docs.results_page import committed_page, committed_results
from docs.rooms import document as rooms
from docs.tables import ROOT, documents, fill


def generated() -> dict[str, str]:
    """Every document with a generated part, by its path from the root, as it should be."""
    texts = documents()
    texts["README.md"] = fill(texts["README.md"], "VERDICT", verdict(committed_results()))
    light = texts.get("docs/light.md") or (ROOT / "docs/light.md").read_text(encoding="utf-8")
    light = fill(light, "CONVENTIONS", conventions_table())
    texts["docs/light.md"] = fill(light, "CONVENTION SOURCES", sources_table())
    cards, page = committed_cards(), committed_page()
    texts |= {"CONTRIBUTING.md": rooms(), "docs/api.md": api()}
    return {**texts, "docs/model_cards.md": cards, "docs/results.md": page}


if __name__ == "__main__":
    for name, text in generated().items():
        (ROOT / name).write_text(text, encoding="utf-8")
