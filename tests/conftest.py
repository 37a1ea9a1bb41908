"""The session is strict: no silent broadcasting of ranks, warnings are errors. It shares one fresh cache folder.

Most of the suite's time would be compilation. So every worker and every process that a test starts uses the same
folder of compiled programs, and the compiler skips LLVM's optimiser and its slow code generator for fused loops: the
programs are the same, the machine code is simpler. Tests marked `optimised` check the numbers that users see; `make
test` runs them by themselves, compiled as users compile them (`pytest -m optimised`).

$GASH_TEST_CACHE keeps the folder from one session to the next, on one machine.
"""

import atexit
import gc
import os
import shutil
import sys
import tempfile
from pathlib import Path

import pytest

MOST_MAPS = 30_000
FAST_COMPILATION = "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"


def _share_cache(folder: str) -> None:
    os.environ["GASH_CACHE"] = folder
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(Path(folder) / "programs")
    # small programs too: there are thousands
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
    # for every program that is read the compiler says that its own preferences are no features of the processor
    os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"


def pytest_configure(config: pytest.Config) -> None:
    """Before workers start and before JAX is imported: they inherit the environment."""
    os.environ["JAX_NUMPY_RANK_PROMOTION"] = "raise"
    if config.option.markexpr != "optimised":
        os.environ.setdefault("XLA_FLAGS", FAST_COMPILATION)
    if "GASH_TEST_CACHE" not in os.environ:
        os.environ["GASH_TEST_CACHE"] = tempfile.mkdtemp(prefix="gash-test-cache-")
        atexit.register(shutil.rmtree, os.environ["GASH_TEST_CACHE"], ignore_errors=True)
    _share_cache(os.environ["GASH_TEST_CACHE"])


def _memory_maps() -> int:
    """How many pieces of memory this process has mapped; 0 where the system does not say."""
    maps = Path("/proc/self/maps")
    return len(maps.read_bytes().splitlines()) if maps.exists() else 0


def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Every compiled program maps memory, and at 65530 maps Linux refuses more, which the compiler does not survive."""
    if (nextitem is None or nextitem.path != item.path) and "jax" in sys.modules and _memory_maps() > MOST_MAPS:
        sys.modules["jax"].clear_caches()
        gc.collect()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Slow tests first, so that no worker is left alone with one at the end; the others file by file."""
    items.sort(key=lambda item: "slow" not in item.keywords)
