"""Tables of the results page on how far `local` reaches, and on what it did before.

From docs/results/local_reach.json and local_first_edition.json, beside those of the meshes that it is measured on.
"""

from typing import Any

import numpy as np

from docs.local_tables import decimals, table


def _text(value: Any, digits: int) -> str:
    return f"{value:.{digits}f}" if isinstance(value, float) else value or "-"


def _known(values: list[Any]) -> list[float]:
    return [value for value in values if isinstance(value, float)]


def _median(values: list[Any], digits: int) -> str:
    known = _known(values)
    return _text(float(np.median(known)) if known else None, digits)


def arriving(result: dict[str, Any]) -> str:
    """Error relative to what arrives, mesh by mesh, beside the closed form and a plain bake of few rays."""
    others = list(result["rows"][0]["others"])
    rows = []
    for row in result["rows"]:
        cells = [_text(row["relative"], 3), *(_text(row["others"][name], 3) for name in others)]
        rows.append([row["mesh"], *cells, _text(row["skill"], 3), _text(row["relrmse"], 4)])
    columns = [[row["relative"] for row in result["rows"]]]
    columns += [[row["others"][name] for row in result["rows"]] for name in others]
    ends = [_median([row[key] for row in result["rows"]], digits) for key, digits in (("skill", 3), ("relrmse", 4))]
    rows.append(["median", *(_median(column, 3) for column in columns), *ends])
    return table(["mesh", "`local`", *others, "skill", "relrmse"], rows)


def kinds(result: dict[str, Any]) -> str:
    """The same of kinds of shapes: means over those of a kind, the largest errors last."""
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for row in result["shapes"]:
        by_kind.setdefault(row["kind"], []).append(row)
    others = list(result["shapes"][0]["others"])

    def mean(values: list[Any]) -> float | None:
        known = _known(values)
        return float(np.mean(known)) if known else None

    rows = []
    for kind, found in sorted(by_kind.items(), key=lambda item: mean([r["relative"] for r in item[1]]) or 0.0):
        cells = [_text(mean([row["relative"] for row in found]), 3)]
        cells += [_text(mean([row["others"][name] for row in found]), 3) for name in others]
        cells += [_text(mean([row[key] for row in found]), digits) for key, digits in (("skill", 3), ("relrmse", 4))]
        rows.append([kind, str(len(found)), *cells])
    return table(["kind", "shapes", "`local`", *others, "skill", "relrmse"], rows)


def bands(result: dict[str, Any]) -> str:
    """relrmse of so many bands and skill of the last of them alone, medians over meshes and over shapes."""
    rows = []
    for at, first in enumerate(result["rows"][0]["bands"]):
        cells = []
        for key, digits in (("relrmse", 4), ("skill_of_last", 3)):
            cells += [_median([row["bands"][at][key] for row in result[of]], digits) for of in ("rows", "shapes")]
        rows.append([str(first["bands"]), *cells])
    header = ["bands", "relrmse, meshes", "generated shapes", "skill of the last band, meshes", "generated shapes"]
    return table(header, rows)


def bounces(result: dict[str, Any]) -> str:
    """relrmse with bounces, beside what it is without them; medians over meshes and over shapes."""
    rows = []
    for at, first in enumerate(result["rows"][0]["bounces"]):
        cells = [
            _median([row["bounces"][at][key] for row in result[of]], 4)
            for of in ("rows", "shapes")
            for key in ("relrmse", "left_out")
        ]
        rows.append([str(first["bounces"]), *cells])
    header = ["bounces", "relrmse, meshes", "bounces left out", "relrmse, generated shapes", "bounces left out"]
    return table(header, rows)


def _change(before: Any, after: Any, digits: int) -> str:
    return f"{_text(before, digits)} → {_text(after, digits)}"


def editions(results: dict[str, dict[str, Any]]) -> str:
    """What the first edition did and what this one does, mesh by mesh; medians of the meshes that both know."""
    first = results["local_first_edition"]["meshes"]
    rows, columns = [], []
    for name, after in _after(results).items():
        before = first.get(name)
        if before is None:
            continue
        old = {**before, "jump": before.get("jumps", {}).get("error")}
        old["shifted"] = before.get("jumps", {}).get("shifted")
        both = [(old.get(key), after.get(key), digits) for key, digits in COLUMNS.values()]
        rows.append([name, *(_change(*pair) for pair in both)])
        columns.append(both)
    medians = []
    for pairs in zip(*columns, strict=True):
        shared = [(a, b) for a, b, _ in pairs if isinstance(a, float) and isinstance(b, float)]
        medians.append(" → ".join(_median(list(side), pairs[0][2]) for side in zip(*shared, strict=True)) or "-")
    return table(["mesh", *COLUMNS], [*rows, ["median", *medians]])


COLUMNS = {
    "skill": ("skill", 3),
    "relrmse": ("relrmse", 4),
    "relative to what arrives": ("relative", 3),
    "jump at blocks": ("jump", 2),
    "beside shifted blocks": ("shifted", 2),
    "equivalent rays": ("equivalent_rays", 1),
    "predict, us a vertex": ("predict", 1),
}


def _after(results: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The figures of this edition by mesh, by the names of COLUMNS."""
    found: dict[str, dict[str, Any]] = {}
    for row in results["neural_gash"]["rows"]:
        found[row["mesh"]] = {key: row["methods"]["local"][key] for key in ("skill", "relrmse", "equivalent_rays")}
    for row in results["local_trust"]["continuity"]:
        found.setdefault(row["mesh"], {}).update(jump=row["error"], shifted=row["shifted"])
    for row in results["local_reach"]["rows"]:
        found.setdefault(row["mesh"], {}).update(relative=row["relative"])
    for row in results["local_speed"]["rows"]:
        found.setdefault(row["mesh"], {}).update(predict=row["predict"])
    return found


def flickers(results: dict[str, dict[str, Any]]) -> str:
    """Flicker of the first edition and of this one, the graph renewed for every frame, beside a plain bake."""
    first, rows = results["local_first_edition"]["motions"], []
    for name, row in results["local_speed"]["motions"].items():
        if name in first:
            change = _change(first[name]["flicker"], row["plan renewed"]["flicker"], 4)
            rows.append([name, change, f"{row['bake, 64 rays']['flicker']:.4f}"])
    return table(["motion", "flicker, graph renewed", "plain bake of 64 rays"], rows)


def block_jump(results: dict[str, dict[str, Any]]) -> str:
    """Medians over meshes of the jump beside shifted blocks: of the first edition, and of this one."""
    before = [row.get("jumps", {}).get("shifted") for row in results["local_first_edition"]["meshes"].values()]
    after = [row["shifted"] for row in results["local_trust"]["continuity"]]
    return " → ".join(decimals(float(np.median(_known(values)))) for values in (before, after))
