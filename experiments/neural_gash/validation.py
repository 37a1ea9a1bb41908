"""What finished runs reach on the validation shapes of the corpus, from their logs.

    .venv/bin/python -m experiments.neural_gash.validation --runs runs/neural_gash --output docs/results/readings.json

Of each phase the step with the lowest validation loss, whose weights are the ones that are kept. `evaluate.py` measures
meshes from elsewhere.
"""

import json
from pathlib import Path
from typing import Any

from benchmarks.options import options, saved
from experiments.neural_gash.variants import RUNS
from gash_jax.measure.provenance import provenance

KEPT = {
    "coefficients": ("skill", "relrmse", "shadow_mse", "cpu_seconds"),
    "visibility": ("accuracy", "balanced_accuracy", "majority_accuracy"),
}


def best_rows(log: Path) -> dict[str, Any]:
    """The measures of the best validation of every phase in a run's log."""
    rows = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    found: dict[str, Any] = {}
    for phase, keys in KEPT.items():
        own = [row for row in rows if row["phase"] == phase and "validation" in row]
        if own:
            best = min(own, key=lambda row: row["validation"])
            found |= {key: best[key] for key in keys}
            found[f"{phase}_steps"] = best["step"]
    return found


def main(runs: Path, output: Path | None) -> dict[str, Any]:
    done = [name for name in RUNS if (runs / name / "model.npz").exists()]
    rows = [{"run": name, **best_rows(runs / name / "metrics.jsonl")} for name in done]
    for row in rows:
        print(row, flush=True)
    return saved(output, {**provenance(seed=0, arguments={"runs": len(rows)}), "rows": rows})


if __name__ == "__main__":
    main(**options(__doc__, "runs", "output"))
