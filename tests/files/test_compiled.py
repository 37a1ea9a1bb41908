"""Compiled loops: what they compute, and that they work where nothing can be kept."""

from typing import no_type_check

import pytest
from numba.core.caching import CompileResultCacheImpl

from gash_jax.files.compiled import compiled


@no_type_check
def _sum(count):
    total = 0
    for i in range(count):
        total += i
    return total


def test_a_loop_is_compiled_and_kept() -> None:
    loop = compiled()(_sum)
    assert loop(10) == loop.py_func(10) == 45
    assert len(loop.signatures) == 1 and loop.targetoptions["nogil"]
    assert loop.stats.cache_path


def test_options_are_passed_on() -> None:
    assert compiled(fastmath={"contract"})(_sum).targetoptions["fastmath"] == {"contract"}


def test_without_a_folder_it_is_compiled_in_every_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CompileResultCacheImpl, "_locator_classes", [])
    loop = compiled()(_sum)
    assert loop(4) == 6 and not loop.stats.cache_path
