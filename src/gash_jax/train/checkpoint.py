"""Training state on disk: the only file that imports Orbax (its API moves; published models are npz instead).

A checkpoint holds parameters, optimiser state, step, phase, random key and the position in the data, so that a
resumed run continues as the uninterrupted one would have.
"""

import shutil
from pathlib import Path
from typing import TypeVar

import jax
import orbax.checkpoint as ocp

State = TypeVar("State")
NEWEST = "checkpoint"


def save_checkpoint(folder: str | Path, state: object) -> None:
    """Write the state beside the previous checkpoint, then swap: an interrupted save loses nothing."""
    folder = Path(folder).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    fresh, current, old = folder / "writing", folder / NEWEST, folder / "previous"
    shutil.rmtree(fresh, ignore_errors=True)
    with ocp.StandardCheckpointer() as checkpointer:
        checkpointer.save(fresh, state)
        checkpointer.wait_until_finished()
    shutil.rmtree(old, ignore_errors=True)
    if current.exists():
        current.rename(old)
    fresh.rename(current)
    shutil.rmtree(old, ignore_errors=True)


def has_checkpoint(folder: str | Path) -> bool:
    """Whether a run left something to continue from."""
    return any((Path(folder) / name).is_dir() for name in (NEWEST, "previous"))


def restore_checkpoint(folder: str | Path, template: State) -> State:
    """Read the newest whole checkpoint into the structure of `template`."""
    folder = Path(folder).resolve()
    path = folder / NEWEST if (folder / NEWEST).is_dir() else folder / "previous"
    with ocp.StandardCheckpointer() as checkpointer:
        return checkpointer.restore(path, jax.tree.map(ocp.utils.to_shape_dtype_struct, template))
