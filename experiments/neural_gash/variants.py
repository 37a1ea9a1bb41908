"""The runs that are compared: every variant in every reading, 5 minutes of CPU time on 64 shapes; two for long.

The paper leaves open in which frame its visibilities and coefficients are (`nn.output`, docs/choices.md). A reading is
a frame, with or without residual. The tables show all variants in one, READING, which is also that of the long runs
and of the weights that ship; the others stand beside it by their skills.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from gash_jax.train.config import RunConfig, load_config

BUDGET = ["train.seconds=300", "train.clock=cpu", "train.checkpoint_every=100"]
SUBSET = ["data.shapes=64", "train.batch_vertices=10752", *BUDGET]
# strategy (i) of the paper is a deeper network *and* more data
ENRICHED = {"mlp-deep": ["data.shapes=432"]}
# the teacher comes before its students
SHORT = ("mlp", "mlp-deep", "gnn", "teacher", "student-mlp", "student-gnn", "two-stage")
LONG = {"mlp": 900, "two-stage": 5400}
READING = ("vertex", False)
READINGS = (READING, ("vertex", True), ("world", False), ("world", True), ("mixed", False))
# what the reading "mixed" differs for from "world": the others know no visibility
TOLD = ("teacher", "two-stage")


class Run(NamedTuple):
    """A variant (the name of the config that ships), its reading, and whether it has the long budget."""

    variant: str
    frame: str
    residual: bool
    long: bool = False

    @property
    def name(self) -> str:
        """What its folder is called."""
        return f"{self.variant}-{self.frame}{'-residual' * self.residual}{'-long' * self.long}"

    @property
    def shown(self) -> bool:
        """Whether the tables show all of it, times included."""
        return (self.frame, self.residual) == READING

    def config(self, runs: Path) -> RunConfig:
        """What `gash train` is told; `runs` holds the folder of the teacher."""
        changes = [f"name={self.name}", f"model.frame={self.frame}", f"model.residual={str(self.residual).lower()}"]
        if self.variant.startswith("student"):
            teacher = self._replace(variant="teacher").name
            changes.append(f"train.teacher={runs / teacher / 'model.npz'}")
        if self.long:
            return load_config(self.variant, [*changes, f"train.seconds={LONG[self.variant]}", "train.clock=cpu"])
        return load_config(self.variant, [*SUBSET, *ENRICHED.get(self.variant, []), *changes])


def _compared(variant: str, frame: str, residual: bool) -> bool:
    """Whether a variant is trained in a reading: each where it differs, the deeper MLP for its strategy's sake once."""
    if variant in ENRICHED:
        return (frame, residual) == READING
    return frame != "mixed" or variant in TOLD


RUNS = {
    run.name: run
    for run in (
        *(Run(name, *reading) for reading in READINGS for name in SHORT if _compared(name, *reading)),
        *(Run(name, *READING, long=True) for name in LONG),
    )
}

# the runs whose weights are in the package
SHIPPED = {name: Run(name, *READING, long=True).name for name in LONG}


def run_configs(runs: Path) -> dict[Path, Callable[[], RunConfig]]:
    """Run folders and what makes their configs, in the order to train them."""
    return {runs / name: lambda r=run: r.config(runs) for name, run in RUNS.items()}
