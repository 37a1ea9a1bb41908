"""The command line that the scripts of benchmarks/ and experiments/ share, and the file that they write.

A script's `main` takes its options by name, so that a test can call it as the command line does:

    if __name__ == "__main__":
        main(**options(__doc__, "meshes", "output", "quick"))
"""

import argparse
from pathlib import Path
from typing import Any

from gash_jax.files.atomic import write_json

SHARED: dict[str, dict[str, Any]] = {
    "output": {"type": Path, "help": "write the figures to this JSON file"},
    "meshes": {"type": Path, "metavar": "FOLDER", "help": "with .ply files; without it, only generated meshes"},
    "maps": {"type": Path, "metavar": "FOLDER", "help": "with .hdr maps; without it, lights from code"},
    "quick": {"action": "store_true", "help": "small generated meshes, few rays: to see that it runs"},
    "runs": {"type": Path, "metavar": "FOLDER", "help": "with the trained networks", "default": "runs/neural_gash"},
    "model": {"help": "a network: the name of one that ships, or a file", "default": "local"},
}


def parser(doc: str | None, *shared: str, **defaults: Any) -> argparse.ArgumentParser:
    """A parser that shows a script's docstring, with some of the shared options and other defaults for them."""
    result = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in shared:
        result.add_argument(f"--{name}", **SHARED[name])
    result.set_defaults(**defaults)
    return result


def options(doc: str | None, *shared: str, **defaults: Any) -> dict[str, Any]:
    """What the command line says, of a script that has shared options only."""
    return vars(parser(doc, *shared, **defaults).parse_args())


def saved(output: Path | None, results: dict[str, Any]) -> dict[str, Any]:
    """The results, written to a JSON file where one was asked for."""
    if output:
        write_json(output, results)
    return results
