"""Execute the notebooks and keep their outputs: `.venv/bin/python -m notebooks.execute [NAME...]`.

What a notebook shows is that of a full run. Beside it the notebook keeps what its short run printed (GASH_SHORT=1: tiny
budgets) and a hash of its code. The tests run it short and compare, so that outputs of older code are found, whatever
changed them, and a change that changes nothing asks for no new run. Cells with the tag "timing" are not compared.
"""

import hashlib
import os
import re
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).parent
KEPT = "gash_jax"  # key in the metadata of a notebook
TOLERANCE = 0.02  # relative, of printed numbers: another processor or version rounds differently
NUMBER = r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?"


def executed(path: Path, timeout: int, short: bool) -> nbformat.NotebookNode:
    """The notebook with fresh outputs; nbclient's CellExecutionError where a cell fails or takes so many seconds."""
    notebook = nbformat.read(path, as_version=4)
    resources = {"metadata": {"path": str(path.parent)}}
    client = NotebookClient(notebook, timeout=timeout, kernel_name="python3", resources=resources)
    client.execute(env={**os.environ, "GASH_SHORT": "1" if short else "0"})
    return notebook


def code_hash(notebook: nbformat.NotebookNode) -> str:
    """Of all code cells."""
    code = "\0".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    return hashlib.sha256(code.encode()).hexdigest()[:16]


def printed(notebook: nbformat.NotebookNode) -> list[str]:
    """What every code cell printed, without those whose tag says that it is seconds."""
    cells = [c for c in notebook.cells if c.cell_type == "code" and "timing" not in c.metadata.get("tags", [])]
    streams = [[o.text for o in c.outputs if o.output_type == "stream" and o.name == "stdout"] for c in cells]
    return ["".join(texts) for texts in streams]


def differences(kept: list[str], now: list[str]) -> list[str]:
    """Cells that print other words or numbers than they did, each as a line."""
    found = [] if len(kept) == len(now) else [f"{len(kept)} cells printed, now {len(now)}"]
    for old, new in zip(kept, now, strict=False):
        before, after = ([float(x) for x in re.findall(NUMBER, text)] for text in (old, new))
        close = len(before) == len(after) and all(
            abs(a - b) <= TOLERANCE * max(abs(a), abs(b)) + 1e-6 for a, b in zip(before, after, strict=True)
        )
        if not close or re.sub(NUMBER, "", old).split() != re.sub(NUMBER, "", new).split():
            found.append(f"{old!r} is now {new!r}")
    return found


def main(names: list[str]) -> None:
    for path in sorted(HERE.glob("*.ipynb")):
        if names and path.stem not in names:
            continue
        short = printed(executed(path, timeout=300, short=True))
        notebook = executed(path, timeout=1800, short=False)
        notebook.metadata[KEPT] = {"code": code_hash(notebook), "printed": short}
        for cell in notebook.cells:
            cell.metadata.pop("execution", None)  # times of day would change every file every time
        nbformat.write(notebook, path)
        print(f"executed {path.name}")


if __name__ == "__main__":
    main(sys.argv[1:])
