"""Training runs side by side, each in a process of its own on cores of its own."""

import multiprocessing
import os
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock

from gash_jax.files.caches import keep_compiled_programs
from gash_jax.files.cores import available_cores
from gash_jax.files.settings import ConfigError
from gash_jax.measure.provenance import provenance
from gash_jax.train.sweep import Run, train_run

# a run and its news: the fraction that is done, at the end its line of results, or what went wrong
TellFn = Callable[[Run, float | dict[str, Any] | str], None]


def train_in_processes(runs: Sequence[Run], folder: Path, jobs: int, tell: TellFn) -> None:
    """Train every run in its folder below `folder`, `jobs` at a time; `tell` is called by one thread at a time.

    Raises ConfigError where the machine has fewer cores than jobs.
    """
    cores, waiting, lock = _core_sets(jobs), queue.Queue(), threading.Lock()
    for run in runs:
        waiting.put(run)

    def tell_alone(run: Run, news: float | dict[str, Any] | str) -> None:
        with lock:
            tell(run, news)

    threads = [threading.Thread(target=_work, args=(waiting, own, folder, tell_alone), daemon=True) for own in cores]
    for thread in threads:
        thread.start()
    for thread in threads:
        while thread.is_alive():  # a plain join would not let Ctrl-C through
            thread.join(0.2)


def _core_sets(jobs: int) -> list[list[int]]:
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(available_cores()))
    if jobs > len(cores):
        raise ConfigError(f"--jobs {jobs}: this machine has {len(cores)} cores to give")
    return [list(map(int, part)) for part in np.array_split(cores, jobs)]


def _work(waiting: "queue.Queue[Run]", cores: list[int], folder: Path, tell: TellFn) -> None:
    """A thread that runs one process after the other on its cores."""
    context = multiprocessing.get_context("spawn")
    while True:
        try:
            run = waiting.get_nowait()
        except queue.Empty:
            return
        mine, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_child, args=(run, folder / run.folder, cores, theirs), daemon=True)
        process.start()
        theirs.close()
        try:
            while not isinstance(message := mine.recv(), dict | str):
                tell(run, message)
            tell(run, message)
        except EOFError:
            tell(run, "the process ended without a word (killed, or out of memory)")
        process.join()


def _child(run: Run, folder: Path, cores: list[int], pipe: Any) -> None:
    """One run in its own process, on its own cores; sends fractions, then the line or the error."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    keep_compiled_programs()  # those for so many cores
    try:
        with _alone(folder):
            line = train_run(run, folder, lambda phase, fraction, values: pipe.send(fraction))
        pipe.send({**line, **provenance()})
    except KeyboardInterrupt:
        pass
    except Exception as error:  # noqa: BLE001 - whatever it was, the other runs go on and the user is told
        pipe.send(f"{type(error).__name__}: {' '.join(str(error).split())}")


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold the lock of a run, which ends with its process: another process, of any machine, would write into it, too.

    Where the file system knows no locks, runs are trained without.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder / ".lock")
    try:
        lock.acquire()
    except (NotImplementedError, OSError):
        yield
        return
    try:
        yield
    finally:
        lock.release()


def _end_with_parent() -> None:
    """A child of a process that was killed would train on, unseen."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
