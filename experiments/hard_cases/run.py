"""Run the hard cases: `.venv/bin/python -m experiments.hard_cases.run [--output docs/results/hard_cases.json]`.

Prints one line for each case: measured, bound, verdict, and what the user is told. Exit code 1 if any is over its
bound or not refused as it should be. `.venv/bin/python -m docs` makes the table of docs/hard_cases.md from the output.
"""

import sys
import time
from pathlib import Path

from benchmarks.options import options, saved
from experiments.hard_cases.case import Result, judge
from experiments.hard_cases.cases import CASES
from gash_jax.measure.provenance import provenance


def _number(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.1e}"


def line(result: Result) -> str:
    """One result in words."""
    head = f"{'ok  ' if result.passed else 'FAIL'} {result.name}: {result.measured}"
    if isinstance(result.bound, str):
        return f"{head}: {result.value}" + ("" if result.passed else f", expected: {result.bound}")
    return f"{head} {_number(result.value)}, bound {_number(result.bound)} ({result.why}); told: {result.told}"


def main(output: Path | None) -> int:
    """Run all cases, slow ones included; the exit code."""
    results, started = [], time.perf_counter()
    for case in CASES:
        results.append(judge(case))
        print(line(results[-1]), flush=True)
    failed = [result.name for result in results if not result.passed]
    print(f"{len(results)} cases, {len(failed)} over their bounds, {time.perf_counter() - started:.0f} s")
    saved(output, provenance(rows=[result._asdict() for result in results]))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(**options(__doc__, "output")))
