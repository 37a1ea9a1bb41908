"""Train everything that is compared; stopped and started at will.

.venv/bin/python experiments/neural_gash/train.py --runs runs/neural_gash [NAME...]
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from variants import run_configs

from gash_jax.apps.progress import progress_bar
from gash_jax.train.run import run_config


def main(runs: Path, names: list[str]) -> None:
    for folder, make in run_configs(runs).items():
        if (names and folder.name not in names) or (folder / "model.npz").exists():
            continue
        with progress_bar(folder.name) as update:
            report = lambda phase, fraction, values, u=update: u(round(1000 * fraction), 1000)  # noqa: E731
            run_config(make(), folder, report=report)
        print(f"trained {folder.name}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=Path, default=Path("runs/neural_gash"))
    parser.add_argument("names", nargs="*")
    options = parser.parse_args()
    main(options.runs, options.names)
