"""The parts of the results page that are about `local` alone, by their markers, and the results that they need."""

import json
from pathlib import Path
from typing import Any

from docs import local_tables, reach_tables
from docs.baking_tables import origin

FOLDER = Path(__file__).parent / "results"
# what a file of results has to say, and what makes it (with --meshes FOLDER --output FILE)
NEEDED = {
    "local_trust": ("continuity", "experiments.local.trust"),
    "local_speed": ("motions", "experiments.local.speed"),
    "local_reach": ("shapes", "experiments.local.reach"),
    "local_first_edition": ("motions", "experiments.local.first_edition"),
}


def read_result(name: str, folder: Path = FOLDER) -> dict[str, Any]:
    """Results by name. Raises ValueError, with what to run, where they are missing or older than the page."""
    path, (key, script) = folder / f"{name}.json", NEEDED.get(name, ("machine", ""))
    told = f"docs/results/{name}.json"
    again = f": write it with .venv/bin/python -m {script} --meshes FOLDER --output {told}" if script else ""
    if not path.exists():
        raise ValueError(f"{told} is missing{again}")
    result = json.loads(path.read_text(encoding="utf-8"))
    old_motions = name == "local_speed" and any("bake, 64 rays" not in row for row in result["motions"].values())
    if key not in result or old_motions:
        raise ValueError(f"{told} is older than the page that shows it{again}")
    return result


def sections(results: dict[str, dict[str, Any]]) -> dict[str, str]:
    """Tables and phrases by marker."""
    trust, speed, reach, first = (results[name] for name in NEEDED)
    asked, before = reach["arguments"], first["origins"]
    return {
        "EQUIVARIANCE": local_tables.equivariance(trust),
        "CONVEX": local_tables.convex(trust),
        "CONTINUITY": local_tables.continuity(trust),
        "BLOCK JUMP": reach_tables.block_jump(results),
        "TENTHS": local_tables.tenths(trust),
        "BOUND": local_tables.bounded(trust),
        "CALIBRATION": local_tables.calibration(trust),
        "TRUST": f"{origin(trust)}, seed {trust['seed']}; reference {trust['arguments']['rays']} rays per vertex.",
        "STAGES": local_tables.stages(speed),
        "FURTHER TIMES": local_tables.further(speed),
        "FASTER": local_tables.faster(speed),
        "SIZES": local_tables.sizes(speed),
        "MOTIONS": local_tables.motions(speed),
        "SPEED": f"{origin(speed)}; reference of the motions {speed['arguments']['rays']} rays per vertex.",
        "ARRIVING": reach_tables.arriving(reach),
        "KINDS": reach_tables.kinds(reach),
        "BANDS": reach_tables.bands(reach),
        "ALBEDO": f"{asked['albedo']:g}",
        "BOUNCES": reach_tables.bounces(reach),
        "REACH": f"{origin(reach)}; references of {asked['rays']} rays per vertex, of generated shapes (seed "
        f"{reach['seed']}) {asked['shape_rays']}, with bounces {asked['bounce_rays']}.",
        "EDITIONS": reach_tables.editions(results),
        "FLICKERS": reach_tables.flickers(results),
        "FIRST EDITION": f"Before: figures of commit {first['arguments']['commit']}, times on "
        f"{origin(before['local_speed'])}; measured again {origin(first)}.",
    }
