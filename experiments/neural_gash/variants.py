"""The runs that are compared: every variant, 5 minutes of CPU time on the same 64 shapes; two of them also for long."""

from collections.abc import Callable
from pathlib import Path

from gash_jax.train.config import RunConfig, load_config

SUBSET = ["data.shapes=64", "train.seconds=300", "train.clock=cpu", "train.batch_vertices=10752"]
# strategy (i) of the paper is a deeper network *and* more data
ENRICHED = ["data.shapes=432"]
# the teacher comes before its students
SHORT = ("mlp", "mlp-deep", "gnn", "teacher", "student-mlp", "student-gnn", "two-stage")
LONG = {"mlp": 900, "two-stage": 5400}


def folder_of(runs: Path, name: str, long: bool) -> Path:
    """Where a run lives."""
    return runs / (f"{name}-long" if long else name)


def run_configs(runs: Path) -> dict[Path, Callable[[], RunConfig]]:
    """Run folders and what makes their configs, in the order to train them."""
    found: dict[Path, Callable[[], RunConfig]] = {}
    for name in SHORT:
        extra = ENRICHED if name == "mlp-deep" else []
        if name.startswith("student"):
            extra = [f"train.teacher={folder_of(runs, 'teacher', False) / 'model.npz'}"]
        found[folder_of(runs, name, False)] = lambda n=name, e=extra: load_config(n, [*SUBSET, *e])
    for name, seconds in LONG.items():
        changes = [f"train.seconds={seconds}", "train.clock=cpu"]
        found[folder_of(runs, name, True)] = lambda n=name, c=changes: load_config(n, c)
    return found
