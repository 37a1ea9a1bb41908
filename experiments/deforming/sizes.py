"""The sweep of DeepPRT's U-Net over width, depth and the size of its images, as one file of results.

    .venv/bin/python -m experiments.deforming.sizes --write-cloth runs/deforming
    gash sweep experiments/deforming/sizes.toml -o runs/sizes
    .venv/bin/python -m experiments.deforming.sizes --runs runs/sizes --output docs/results/deforming_sizes.json

All networks see the same frames of the cloth, 450 of 256 rays, and are held against 50 others of 4096 rays.
"""

import json
from pathlib import Path
from typing import Any

from benchmarks.options import parser, saved
from experiments.deforming.objects import object_file
from gash_jax.files.settings import ConfigError
from gash_jax.measure.provenance import provenance
from gash_jax.train.sweep import load_sweep

SWEEP = Path(__file__).with_name("sizes.toml")
KEPT = ("width", "depth", "images", "parameters", "bytes", "steps", "cpu_seconds", "relrmse", "accuracy", "l1", "skill")


def main(runs: Path | None, write_cloth: Path | None, output: Path | None) -> dict[str, Any]:
    """Write the cloth, or gather the lines of a sweep. Raises ConfigError where runs of it are missing."""
    if write_cloth:
        return {"written": str(object_file("cloth", None, write_cloth))}
    asked = load_sweep(SWEEP)[1]
    if runs is None:
        raise ConfigError("give --write-cloth FOLDER, or --runs FOLDER of a sweep that was trained")
    lines = {line["id"]: line for line in map(json.loads, (runs / "results.jsonl").read_text().splitlines())}
    missing = [run.folder for run in asked if run.id not in lines]
    if missing:
        raise ConfigError(f"{len(missing)} runs are missing (first: {missing[0]}): run gash sweep {SWEEP} -o {runs}")
    rows = [{name: lines[run.id][name] for name in KEPT} for run in asked]
    seconds = asked[0].config.train.seconds
    return saved(output, {**provenance(seed=0, arguments={"seconds": seconds}), "rows": rows})


if __name__ == "__main__":
    options = parser(__doc__, "output")
    options.add_argument("--runs", type=Path, help="folder of the sweep")
    options.add_argument("--write-cloth", type=Path, metavar="FOLDER", help="write the file of the cloth there instead")
    main(**vars(options.parse_args()))
