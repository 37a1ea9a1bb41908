"""The session is strict: no silent broadcasting of ranks, warnings are errors, the cache is a fresh folder.

Kernels are compiled without LLVM's optimiser: most of the suite's time is compilation, and the programs are the same.
"""

import atexit
import os
import shutil
import tempfile

os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
os.environ["JAX_NUMPY_RANK_PROMOTION"] = "raise"
cache = os.environ.get("GASH_TEST_CACHE")
if not cache:
    cache = tempfile.mkdtemp(prefix="gash-test-cache-")
    atexit.register(shutil.rmtree, cache, ignore_errors=True)
os.environ["GASH_CACHE"] = cache
