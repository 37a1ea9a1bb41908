"""Time of a computation: after a warm-up, waiting for the device, median of several calls."""

import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np


def timed(work: Callable[[], Any], repeats: int = 5) -> tuple[Any, float]:
    """Result and median seconds of `repeats` calls after one that is not counted."""
    result, seconds = jax.block_until_ready(work()), []
    for _ in range(repeats):
        started = time.perf_counter()
        jax.block_until_ready(work())
        seconds.append(time.perf_counter() - started)
    return result, float(np.median(seconds))
