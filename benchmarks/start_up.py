"""Seconds of whole `gash` processes, cold and warm: `.venv/bin/python -m benchmarks.start_up MESH`.

A cold start finds an empty folder of compiled programs, a warm one what an earlier process left there; Python's own
byte code is there in both. The yardsticks are an interpreter that does nothing and one that imports JAX. Wall and CPU
seconds (of all threads), medians of --repeats; the commands run in turn, so that a busy machine meets all of them
alike. The targets are for 3,000 vertices on two idle cores.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gash_jax.measure.provenance import provenance

GASH = [sys.executable, "-m", "gash_jax"]
TARGETS = {"gash --help": 0.8, "gash bake": 2.2, "gash predict": 3.0}  # wall seconds of a warm start


class Seconds(NamedTuple):
    wall: float
    cpu: float


def process_seconds(command: list[str], cache: str) -> Seconds:
    """Run a command to its end."""
    environment = {**os.environ, "GASH_CACHE": cache}
    for name in ("PYTHONDONTWRITEBYTECODE", "JAX_COMPILATION_CACHE_DIR"):
        environment.pop(name, None)
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Seconds(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def measure(commands: dict[str, list[str]], repeats: int) -> dict[str, dict[str, Seconds]]:
    """Medians by command, "cold" and "warm"; the first round is not counted."""
    times: dict[str, dict[str, list[Seconds]]] = {name: {"cold": [], "warm": []} for name in commands}
    with tempfile.TemporaryDirectory() as warm:
        for step in range(repeats + 1):
            for name, command in commands.items():
                with tempfile.TemporaryDirectory() as empty:
                    cold = process_seconds(command, empty)
                found = process_seconds(command, warm)
                if step:
                    times[name]["cold"].append(cold)
                    times[name]["warm"].append(found)
    return {
        name: {start: Seconds(*np.median(values, axis=0).tolist()) for start, values in both.items()}
        for name, both in times.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--output", type=Path, help="write the figures to this JSON file")
    arguments = parser.parse_args()
    mesh = str(arguments.mesh)
    with tempfile.TemporaryDirectory() as folder:
        output = ["-o", f"{folder}/t.npz", "--quiet"]
        commands = {
            "python": [sys.executable, "-c", "pass"],
            "python, import jax": [sys.executable, "-c", "import jax"],
            "gash --help": [*GASH, "--help"],
            "gash bake": [*GASH, "bake", mesh, "--rays", "64", *output],
            "gash predict": [*GASH, "predict", mesh, *output],
        }
        rows = measure(commands, arguments.repeats)
    print(f"{arguments.mesh.name}, wall (CPU) seconds, medians of {arguments.repeats}")
    print(f"{'':20s} {'cold start':>15s} {'warm start':>15s}   target")
    for name, both in rows.items():
        cells = " ".join(f"{both[start].wall:7.2f} ({both[start].cpu:5.2f})" for start in ("cold", "warm"))
        print(f"{name:20s} {cells}   {TARGETS.get(name, '')}")
    if arguments.output:
        figures = {name: {start: found._asdict() for start, found in both.items()} for name, both in rows.items()}
        result = provenance(mesh=arguments.mesh.name, repeats=arguments.repeats, targets=TARGETS, seconds=figures)
        arguments.output.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
