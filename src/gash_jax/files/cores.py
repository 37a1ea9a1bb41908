"""How many cores there are to use, and work that is spread over them."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Item, Result = TypeVar("Item"), TypeVar("Result")


def available_cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool(process: int, workers: int) -> ThreadPoolExecutor:
    """The threads of a process, which wait for work: to start them takes as long as a small mesh does."""
    return ThreadPoolExecutor(workers, f"gash-{process}")


def in_threads(function: Callable[[Item], Result], items: Iterable[Item], workers: int | None = None) -> list[Result]:
    """What the function returns for each item, in their order, with a thread for every core.

    For functions that let go of the interpreter, and do not call this one.
    """
    items = list(items)
    workers = workers or available_cores()
    if min(workers, len(items)) < 2:
        return [function(item) for item in items]
    return list(_pool(os.getpid(), workers).map(function, items))
