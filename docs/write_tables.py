"""Write the tables of README.md from docs/results/*.json: `.venv/bin/python docs/write_tables.py`.

Text between <!-- NAME --> and <!-- /NAME --> is replaced; nothing in those tables is typed by hand. The results are
copies of what `make demo` and `benchmarks/bake_speed.py --output` wrote.
"""

import json
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


def _origin(result: dict[str, Any]) -> str:
    machine = result["machine"]
    return f"{machine['processor']}, {machine['cores']} cores, commit {result['commit']}"


def _cell(value: Any, digits: int) -> str:
    return f"{value:.{digits}f}" if isinstance(value, float) else str(value)


def demo_table(result: dict[str, Any]) -> str:
    """Speed against error on the demo's mesh."""
    lines = ["| method | seconds | relrmse | skill | equivalent rays |", "|---|--:|--:|--:|--:|"]
    for row in result["rows"]:
        numbers = [_cell(row["seconds"], 3), _cell(row["relrmse"], 4), _cell(row["skill"], 3)]
        lines.append(f"| {row['method']} | {' | '.join(numbers)} | {_cell(row['equivalent_rays'], 1)} |")
    arguments = result["arguments"]
    lines += ["", f"{arguments['mesh'].capitalize()}, {result['vertices']} vertices, {_origin(result)}, seed 0."]
    return "\n".join(lines)


def speed_table(result: dict[str, Any]) -> str:
    """The bake against raw embreex."""
    raw, build, bake, process = (result[key] for key in ("raw_s", "build_s", "bake_s", "process_s"))
    rows = [
        ("raw embreex, the same rays, scene built before", raw, ""),
        ("embreex scene build", build, ""),
        (
            "`bake_transfer`, scene build included",
            bake,
            f"{bake / raw:.2f} x raw, {bake / (raw + build):.2f} x raw and build",
        ),
        ("`gash bake`, the whole process", process, f"1.6 x raw + {process - 1.6 * raw:.1f} s"),
    ]
    lines = [f"| {result['mesh']}, {result['rays']} rays per vertex | seconds | |", "|---|--:|---|"]
    lines += [f"| {name} | {seconds:.3f} | {remark} |" for name, seconds, remark in rows]
    return "\n".join([*lines, "", f"Peak memory of the process {result['peak_mib']:.0f} MiB; {_origin(result)}."])


def main() -> None:
    readme = ROOT / "README.md"
    text = readme.read_text(encoding="utf-8")
    for name, table, file in (("DEMO", demo_table, "demo.json"), ("SPEED", speed_table, "bake_speed.json")):
        result = json.loads((ROOT / "docs" / "results" / file).read_text())
        block = f"<!-- {name} -->\n{table(result)}\n<!-- /{name} -->"
        text, count = re.subn(f"<!-- {name} -->.*?<!-- /{name} -->", lambda _, b=block: b, text, flags=re.DOTALL)
        if count != 1:
            raise SystemExit(f"error: README.md must hold the markers of table {name} once, found {count}")
    readme.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
