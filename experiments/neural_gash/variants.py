"""The runs that are compared: every variant, 5 minutes of CPU time on the same 64 shapes; two of them also for long.

The first ones are the frame "mixed" without residual. The same networks in the two frames that can be read into the GNN
paper (`nn.output`), with and without residual, are in folders that say so: "teacher-vertex", "teacher-world-residual".
"""

from collections.abc import Callable
from pathlib import Path

from gash_jax.train.config import RunConfig, load_config

BUDGET = ["train.seconds=300", "train.clock=cpu", "train.checkpoint_every=100"]
SUBSET = ["data.shapes=64", "train.batch_vertices=10752", *BUDGET]
# strategy (i) of the paper is a deeper network *and* more data
ENRICHED = ["data.shapes=432"]
# the teacher comes before its students
SHORT = ("mlp", "mlp-deep", "gnn", "teacher", "student-mlp", "student-gnn", "two-stage")
LONG = {"mlp": 900, "two-stage": 5400}
READINGS = tuple((frame, residual) for frame in ("vertex", "world") for residual in (False, True))
# no visibility goes in, nor comes from a teacher: in the world's frame they are what they are in the mixed one
BLIND = ("mlp", "mlp-deep", "gnn")


def folder_of(runs: Path, name: str, long: bool) -> Path:
    """Where a run lives."""
    return runs / (f"{name}-long" if long else name)


def reading_name(name: str, frame: str, residual: bool) -> str:
    """What a variant in a frame is called, with or without residual; without a new name where nothing differs."""
    if frame == "world" and not residual and name in BLIND:
        return name
    return f"{name}-{frame}{'-residual' if residual else ''}"


def reading_names() -> list[str]:
    """All runs in the frames that can be read into the paper, one frame after the other, teachers before students."""
    names = (reading_name(name, *reading) for reading in READINGS for name in SHORT)
    return [name for name in names if name not in SHORT]


def run_configs(runs: Path) -> dict[Path, Callable[[], RunConfig]]:
    """Run folders and what makes their configs, in the order to train them."""
    found: dict[Path, Callable[[], RunConfig]] = {}
    for name in SHORT:
        found[folder_of(runs, name, False)] = lambda n=name: load_config(n, _changes(n, runs / "teacher"))
    for name, seconds in LONG.items():
        changes = [f"train.seconds={seconds}", "train.clock=cpu"]
        found[folder_of(runs, name, True)] = lambda n=name, c=changes: load_config(n, c)
    for frame, residual in READINGS:
        end = [f"model.frame={frame}", f"model.residual={str(residual).lower()}"]
        teacher = runs / reading_name("teacher", frame, residual)
        for name in SHORT:
            folder = runs / reading_name(name, frame, residual)
            if folder not in found:
                changes = [f"name={folder.name}", *_changes(name, teacher), *end]
                found[folder] = lambda n=name, c=changes: load_config(n, c)
    return found


def _changes(name: str, teacher: Path) -> list[str]:
    """What a variant's short run changes in the config that ships."""
    extra = ENRICHED if name == "mlp-deep" else []
    return [*SUBSET, *extra, *([f"train.teacher={teacher / 'model.npz'}"] if name.startswith("student") else [])]
