"""Error of the 25-direction rules, index by index: `.venv/bin/python experiments/sampler/run.py --output FILE.json`."""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from sampler import RULES, errors

from gash_jax.files.atomic import write_json
from gash_jax.measure.provenance import provenance


def main(output: Path | None) -> dict:
    rules = {}
    for name in RULES:
        values = errors(name)
        rules[name] = {"mse": float(values.mean()), "mse_per_coefficient": values.tolist()}
        share = np.round(values / values.sum(), 3)
        print(f"{name}: MSE {values.mean():.5f}, share of each index (from 1): {share}")
    results = {**provenance(seed=0, arguments={"directions": 25, "normals": 20000}), "rules": rules}
    if output:
        write_json(output, results)
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path)
    main(parser.parse_args().output)
