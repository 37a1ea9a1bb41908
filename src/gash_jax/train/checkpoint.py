"""Training state on disk: the only file that imports Orbax (its API moves; published models are npz instead).

A checkpoint holds parameters, optimiser state, step, phase and the position in the data, so that a resumed run
continues as the uninterrupted one would have. The one before it is kept beside it. Every checkpoint carries the digest
of its own files: one that was cut, emptied or changed is recognised, and the run goes on from the one before."""

import hashlib
import shutil
from pathlib import Path
from typing import TypeVar

import jax
import orbax.checkpoint as ocp

from gash_jax.files.settings import ConfigError

State = TypeVar("State")
NEWEST, BEFORE, DIGEST = "checkpoint", "previous", "sha256"


def _digest(folder: Path) -> str:
    """Hash of the names and contents of all files of a checkpoint but the digest itself."""
    total = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and path.name != DIGEST):
        total.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return total.hexdigest()


def _is_whole(folder: Path) -> bool:
    """Whether a checkpoint is what was written. Those of before the digests are believed."""
    if not folder.is_dir() or not any(folder.iterdir()):
        return False
    said = folder / DIGEST
    return not said.is_file() or said.read_text(encoding="utf-8") == _digest(folder)


def save_checkpoint(folder: str | Path, state: object) -> None:
    """Write the state beside the previous checkpoint, then swap: an interrupted save loses nothing."""
    folder = Path(folder).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    fresh, current, old = folder / "writing", folder / NEWEST, folder / BEFORE
    shutil.rmtree(fresh, ignore_errors=True)
    with ocp.StandardCheckpointer() as checkpointer:
        checkpointer.save(fresh, state)
        checkpointer.wait_until_finished()
    (fresh / DIGEST).write_text(_digest(fresh), encoding="utf-8")
    if current.exists():
        shutil.rmtree(old, ignore_errors=True)
        current.rename(old)
    fresh.rename(current)


def has_checkpoint(folder: str | Path) -> bool:
    """Whether a run left something to continue from."""
    return any((Path(folder) / name).is_dir() for name in (NEWEST, BEFORE))


def restore_checkpoint(folder: str | Path, template: State) -> tuple[State, str]:
    """The newest whole checkpoint in the structure of `template`, and what there is to say: "" if it is the newest.

    Raises ConfigError where none is whole.
    """
    folder = Path(folder).resolve()
    for name in (NEWEST, BEFORE):
        if not _is_whole(folder / name):
            continue
        try:
            with ocp.StandardCheckpointer() as checkpointer:
                state = checkpointer.restore(folder / name, jax.tree.map(ocp.utils.to_shape_dtype_struct, template))
        except (ValueError, KeyError, OSError, TypeError):  # whole, but of another structure or another Orbax
            continue
        note = f"{folder / NEWEST} is damaged: continued from the checkpoint before it"
        return state, "" if name == NEWEST else note
    raise ConfigError(
        f"{folder} holds no whole checkpoint, {NEWEST} and {BEFORE} are damaged: delete it and start again"
    )
