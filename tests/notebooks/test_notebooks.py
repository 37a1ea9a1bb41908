"""Every notebook runs from top to bottom in its short mode, shows what this code gives, and uses public names only."""

import ast
import os
import re
from pathlib import Path

import nbformat
import pytest

import gash_jax
from notebooks.execute import KEPT, code_hash, differences, executed, printed

NOTEBOOKS = sorted((Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))
# Jupyter's own libraries announce their future to everyone who uses them
pytestmark = pytest.mark.filterwarnings(
    "ignore::DeprecationWarning", "ignore::ResourceWarning", "ignore::FutureWarning"
)


def test_all_nine_are_there() -> None:
    assert [path.stem[0] for path in NOTEBOOKS] == list("123456789")


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs_and_prints_what_it_printed(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAX_NUMPY_RANK_PROMOTION", "allow")
    notebook = executed(path, timeout=300, short=True)
    nbformat.validate(notebook)
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert not [output for output in outputs if output.output_type == "error"]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    kept = nbformat.read(path, as_version=4).metadata[KEPT]["printed"]
    assert differences(kept, printed(notebook)) == [], "run .venv/bin/python -m notebooks.execute"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_its_outputs_are_those_of_its_cells_and_name_no_machine(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert not re.search(r"/(home|root|Users|work|tmp)/", text) and os.path.expanduser("~") + "/" not in text
    notebook = nbformat.read(path, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.execution_count for cell in code), "run .venv/bin/python -m notebooks.execute"
    assert notebook.metadata[KEPT]["code"] == code_hash(notebook), "run .venv/bin/python -m notebooks.execute"
    assert "Traceback" not in text


def private_names(code: str) -> list[str]:
    """What code takes from gash_jax that is not one of its public names."""
    found = []
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "gash_jax":
            found += [f"{node.module}.{alias.name}" for alias in node.names]
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names if alias.name.startswith("gash_jax.")]
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "gash_jax":
            found += [] if node.attr in gash_jax.__all__ else [f"gash_jax.{node.attr}"]
    return found


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_uses_public_names_only(path: Path) -> None:
    cells = nbformat.read(path, as_version=4).cells
    assert [name for cell in cells if cell.cell_type == "code" for name in private_names(cell.source)] == []


@pytest.mark.parametrize(
    "code",
    [
        "from gash_jax.prt.bake import bake_transfer",
        "from gash_jax import apps",
        "import gash_jax.apps",
        "import gash_jax\ngash_jax.apps.cli",
    ],
)
def test_private_names_are_found(code: str) -> None:
    assert len(private_names(code)) == 1 and private_names("import gash_jax\ngash_jax.bake_transfer") == []


def test_other_words_and_numbers_are_found() -> None:
    kept = ["skill 0.9208  rays 16\n", ""]
    assert differences(kept, ["skill  0.9210 rays 16", ""]) == []
    for now in (["skill 0.85 rays 16", ""], ["skil 0.9208 rays 16", ""], ["skill 0.9208 rays", ""], kept[:1]):
        assert len(differences(kept, now)) == 1


def test_code_and_timing_cells_count_as_they_should() -> None:
    cell = nbformat.v4.new_code_cell("1", outputs=[nbformat.v4.new_output("stream", text="a")])
    seconds = nbformat.v4.new_code_cell("2", outputs=cell.outputs, metadata={"tags": ["timing"]})
    one, two = nbformat.v4.new_notebook(cells=[cell, seconds]), nbformat.v4.new_notebook(cells=[cell])
    assert printed(one) == printed(two) == ["a"] and code_hash(one) != code_hash(two)
