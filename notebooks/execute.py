"""Execute the notebooks in full and keep their outputs: `.venv/bin/python -m notebooks.execute [NAME...]`."""

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).parent


def executed(path: Path, timeout: int) -> nbformat.NotebookNode:
    """The notebook with fresh outputs; nbclient's CellExecutionError where a cell fails or takes so many seconds."""
    notebook = nbformat.read(path, as_version=4)
    resources = {"metadata": {"path": str(path.parent)}}
    NotebookClient(notebook, timeout=timeout, kernel_name="python3", resources=resources).execute()
    return notebook


def main(names: list[str]) -> None:
    for path in sorted(HERE.glob("*.ipynb")):
        if names and path.stem not in names:
            continue
        notebook = executed(path, timeout=1800)
        for cell in notebook.cells:
            cell.metadata.pop("execution", None)  # times of day would change every file every time
        nbformat.write(notebook, path)
        print(f"executed {path.name}")


if __name__ == "__main__":
    main(sys.argv[1:])
