"""Train everything that is compared; stopped and started at will.

.venv/bin/python -m experiments.neural_gash.train --runs runs/neural_gash [NAME...]
"""

from pathlib import Path

from benchmarks.options import parser
from experiments.neural_gash.variants import run_configs
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
    command = parser(__doc__, "runs")
    command.add_argument("names", nargs="*")
    main(**vars(command.parse_args()))
