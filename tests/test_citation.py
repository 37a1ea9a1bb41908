"""CITATION.cff names the version that is built."""

import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]


def test_the_citation_names_this_version_and_licence() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= citation.keys()  # what CFF 1.2.0 requires
    assert citation["version"] == project["version"]
    assert citation["license"] == project["license"]
    assert all(reference.keys() >= {"authors", "title", "type"} for reference in citation["references"])
