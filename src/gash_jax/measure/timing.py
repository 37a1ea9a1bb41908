"""Time of a computation: after a warm-up, waiting for the device, median of several calls."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np


class Seconds(NamedTuple):
    """What a call takes: on the wall, and of all cores together, which other work on the machine prolongs little."""

    wall: float
    cpu: float


def timed(work: Callable[[], Any], repeats: int = 5) -> tuple[Any, float]:
    """Result and median seconds on the wall of `repeats` calls after one that is not counted."""
    result, seconds = timed_on_both_clocks(work, repeats)
    return result, seconds.wall


def timed_on_both_clocks(work: Callable[[], Any], repeats: int = 5) -> tuple[Any, Seconds]:
    """Result and median seconds of `repeats` calls after one that is not counted."""
    result, seconds = jax.block_until_ready(work()), []
    for _ in range(repeats):
        started = time.perf_counter(), time.process_time()
        jax.block_until_ready(work())
        seconds.append((time.perf_counter() - started[0], time.process_time() - started[1]))
    return result, Seconds(*np.median(seconds, axis=0).tolist())
