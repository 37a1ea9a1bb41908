"""The session is strict: no silent broadcasting of ranks, warnings are errors, the cache is a fresh folder.

Kernels are compiled without LLVM's optimiser: most of the suite's time is compilation, and the programs are the same.
"""

import os
import tempfile

os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
os.environ["JAX_NUMPY_RANK_PROMOTION"] = "raise"
os.environ["GASH_CACHE"] = os.environ.get("GASH_TEST_CACHE", tempfile.mkdtemp(prefix="gash-test-cache-"))
