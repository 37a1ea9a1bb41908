"""Error of the 25-direction rules, index by index: `.venv/bin/python -m experiments.sampler.run --output FILE.json`."""

from pathlib import Path

import numpy as np

from benchmarks.options import options, saved
from experiments.sampler.sampler import RULES, errors
from gash_jax.measure.provenance import provenance


def main(output: Path | None) -> dict:
    rules = {}
    for name in RULES:
        values = errors(name)
        rules[name] = {"mse": float(values.mean()), "mse_per_coefficient": values.tolist()}
        share = np.round(values / values.sum(), 3)
        print(f"{name}: MSE {values.mean():.5f}, share of each index (from 1): {share}")
    return saved(output, {**provenance(seed=0, arguments={"directions": 25, "normals": 20000}), "rules": rules})


if __name__ == "__main__":
    main(**options(__doc__, "output"))
