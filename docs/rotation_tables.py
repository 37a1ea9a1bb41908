"""The tables of turning, all from experiments/rotation/results.json."""

from typing import Any

from docs.baking_tables import origin

WAYS = ("rotors", "matrices", "e3nn")
TURNS = {"any": "any turn", "half": "half turns", "tiny": "turns of 1e-8 to 1e-2"}


def _columns(groups: list[str]) -> list[str]:
    """Head of a table with a row for each number of bands and, in each group, a column for each way."""
    heads = [f"{group}: {way}" if way == WAYS[0] else way for group in groups for way in WAYS]
    return [f"| bands | {' | '.join(heads)} |", "|--:|" + "--:|" * len(heads)]


def _rows(rows: list[dict[str, Any]], group: str, groups: list[str], cell: Any) -> list[str]:
    found = {(row["bands"], row[group], row["way"]): cell(row) for row in rows}
    bands = sorted({row["bands"] for row in rows})
    return [f"| {b} | {' | '.join(found[b, name, way] for name in groups for way in WAYS)} |" for b in bands]


def time_table(result: dict[str, Any]) -> str:
    """Microseconds of a light turned, and milliseconds of many vectors, by all three ways."""
    count = f"{result['count']:,}"
    cases = {
        "one light": "a light, us",
        "many alike": f"{count} turned alike, ms",
        "each its own": f"{count} turns, ms",
    }

    def cell(row: dict[str, Any]) -> str:
        seconds = row["seconds"]
        return f"{seconds * 1e6:.0f}" if row["case"] == "one light" else f"{seconds * 1e3:.2f}"

    lines = _columns(list(cases.values())) + _rows(result["times"], "case", list(cases), cell)
    note = f"float32, medians of {result['repeats']} in strict turn; e3nn-jax {result['e3nn']}; {origin(result)}."
    return "\n".join([*lines, "", note])


def error_table(result: dict[str, Any]) -> str:
    """Largest error of float32 coefficients drawn from N(0, 1)."""
    lines = _columns(list(TURNS.values()))
    lines += _rows(result["errors"], "turns", list(TURNS), lambda row: f"{row['largest']:.0e}")
    return "\n".join(
        [*lines, "", f"Largest of 40 turns and more of each kind; seed {result['seed']}; {origin(result)}."]
    )


def composition_table(result: dict[str, Any]) -> str:
    """What is left of a turn after many compositions, and what these take."""
    steps, count = result["compositions"][0]["steps"], result["compositions"][0]["count"]
    lines = [
        f"| kept as | numbers | rms error after {steps:,} turns | off a rotation by | ns each, of {count:,} |",
        "|---|--:|--:|--:|--:|",
    ]
    for row in result["compositions"]:
        numbers = 4 if row["way"].startswith("rotor") else 9
        figures = f"{row['error']:.1e} | {row['from_a_turn']:.1e} | {row['seconds'] / row['count'] * 1e9:.0f}"
        lines.append(f"| {row['way']} | {numbers} | {figures} |")
    return "\n".join([*lines, "", f"20 chains of random turns, float32; {origin(result)}."])


def error_bar_table(result: dict[str, Any]) -> str:
    """Calibration of standard errors as baked and turned, band by band."""
    by_band: dict[int, dict[str, dict[str, Any]]] = {}
    for row in result["error_bars"]:
        by_band.setdefault(row["band"], {})[row["bake"]] = row
    lines = [
        "| band | as baked: z | in 95 % | turned: z | in 95 % | correlations left out |",
        "|--:|--:|--:|--:|--:|--:|",
    ]
    for band, rows in by_band.items():
        cells = [f"{row['ratio']:.2f} | {row['coverage']:.1%}" for row in (rows["as baked"], rows["turned"])]
        low, high = rows["turned"]["neglect"]
        lines.append(f"| {band} | {' | '.join(cells)} | {low:.2f} to {high:.2f} |")
    return "\n".join([*lines, "", origin(result) + "."])
