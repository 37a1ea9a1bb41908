"""Run the hard cases: `.venv/bin/python experiments/hard_cases/run.py [--output docs/results/hard_cases.json]`.

Prints one line for each case: measured, bound, verdict, and what the user is told. Exit code 1 if any is over its
bound or not refused as it should be. `docs/write_tables.py` makes the table of docs/hard_cases.md from the output.
"""

import argparse
import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))  # the cases import each other from the root, as the tests do

from experiments.hard_cases.cases import CASES, Result, judge  # noqa: E402
from gash_jax.measure.provenance import provenance  # noqa: E402


def _number(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.1e}"


def line(result: Result) -> str:
    """One result in words."""
    head = f"{'ok  ' if result.passed else 'FAIL'} {result.name}: {result.measured}"
    if isinstance(result.bound, str):
        return f"{head}: {result.value}" + ("" if result.passed else f", expected: {result.bound}")
    return f"{head} {_number(result.value)}, bound {_number(result.bound)} ({result.why}); told: {result.told}"


def main() -> None:
    """Run all cases, slow ones last in the list included."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, help="write the results to this JSON file")
    arguments = parser.parse_args()
    results, started = [], time.perf_counter()
    for case in CASES:
        results.append(judge(case))
        print(line(results[-1]), flush=True)
    failed = [result.name for result in results if not result.passed]
    print(f"{len(results)} cases, {len(failed)} over their bounds, {time.perf_counter() - started:.0f} s")
    if arguments.output:
        rows = [result._asdict() for result in results]
        arguments.output.write_text(json.dumps(provenance(rows=rows), indent=1, ensure_ascii=False) + "\n")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
