"""The session is strict: no silent broadcasting of ranks, warnings are errors, the cache is a fresh folder."""

import os
import tempfile

os.environ["JAX_NUMPY_RANK_PROMOTION"] = "raise"
os.environ["GASH_CACHE"] = os.environ.get("GASH_TEST_CACHE", tempfile.mkdtemp(prefix="gash-test-cache-"))
