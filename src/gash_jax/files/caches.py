"""Where what can be made again is kept: corpora, references, compiled programs.

Compiled programs are JAX's persistent compilation cache, which finds them by a hash of the program, the compiler's
version and its options. Machine code also depends on the processor and on the number of cores it is meant for, which
that hash leaves out: both are in the name of the folder. JAX reads, writes and evicts under a lock (filelock). A
process that is killed while it writes leaves an entry without the time of its last use, on which every later eviction
would fail: such entries are removed here, under the same lock.
"""

import hashlib
import os
import platform
import shutil
import sys
import time
import warnings
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path

from gash_jax.files.cores import available_cores

LARGEST_BYTES = 32 << 20  # some 1500 programs in one folder; JAX looks at each of them when it adds one
UNUSED_DAYS = 30  # after which the folder of another processor or version is removed
LOCK_SECONDS = 2.0  # who would wait longer does without the cache
SETTINGS = {
    "compilation_cache_max_size": LARGEST_BYTES,
    "persistent_cache_min_compile_time_secs": 0.0,
    "persistent_cache_min_entry_size_bytes": -1,  # none
}
PROCESSORS = Path("/proc/cpuinfo")
FEATURES = ("vendor_id", "cpu family", "model", "model name", "flags", "Features", "CPU implementer", "CPU part")


def cache_folder() -> Path:
    """$GASH_CACHE, or the user's cache folder."""
    if chosen := os.environ.get("GASH_CACHE"):
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gash_jax"


def keep_compiled_programs() -> Path | None:
    """Have JAX keep what it compiles below the cache folder and find it there again, in this process and its children.

    To be called before JAX has compiled anything; the command line does. What the environment or the user's program
    has set for JAX's cache stays as it is. Returns the folder of the compiled programs, or None where no file can be
    written: everything is then compiled anew, as without this call.

    >>> folder = gash_jax.keep_compiled_programs()
    """
    try:
        root = cache_folder() / "compiled"
    except RuntimeError:  # a user without a home
        return None
    jax = sys.modules.get("jax")  # a command that needs no JAX should not import it for this
    chosen = os.environ.get("JAX_COMPILATION_CACHE_DIR") if jax is None else jax.config.jax_compilation_cache_dir
    if chosen and Path(chosen).parent != root:
        return Path(chosen)
    folder = root / machine_name()
    if not _tidied(folder):
        return None
    quiet_compiler()
    # a cache that fails costs time, nothing else
    warnings.filterwarnings("ignore", message="Error (reading|writing) persistent compilation cache entry")
    for name, value in SETTINGS.items():
        said = os.environ.setdefault(f"JAX_{name.upper()}", str(value))
        if jax is not None:
            jax.config.update(f"jax_{name}", type(value)(said))
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    if jax is not None:
        jax.config.update("jax_compilation_cache_dir", str(folder))
    return folder


def quiet_compiler() -> None:
    """Keep the compiler's own messages off the error stream, unless the user has asked for them: failures raise.

    Each program that it reads back it says to be "not supported on the host machine", as it takes its preferences
    (+prefer-no-gather) for features of the processor.
    """
    if os.environ.get("TF_CPP_MIN_LOG_LEVEL", "1") != "1":  # 1 is JAX's own choice, which its child processes inherit
        return
    os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"
    if (jax := sys.modules.get("jax")) is not None:  # too late for that
        level = jax.config.jax_logging_level
        jax.config.update("jax_logging_level", "CRITICAL")  # sets the compiler's level as well, which stays
        jax.config.update("jax_logging_level", level)


def machine_name() -> str:
    """Name of the folder for this compiler on this machine: version, cores, hash of what the processor can do."""
    try:
        lines = PROCESSORS.read_text().split("\n\n", 1)[0].splitlines()  # of the first core
        processor = [line for line in lines if line.split(":")[0].strip() in FEATURES]
    except OSError:
        processor = [platform.processor()]
    digest = hashlib.sha256("\n".join([platform.machine(), *processor]).encode()).hexdigest()
    return f"jaxlib-{version('jaxlib')}-{available_cores()}-cores-{digest[:12]}"


def _tidied(folder: Path) -> bool:
    """Make the folder and remove what nobody can use; False where it cannot be written to."""
    from filelock import FileLock, Timeout  # takes longer than all of `gash --help`

    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        with FileLock(folder / ".lockfile", timeout=LOCK_SECONDS):  # JAX's own
            names = set(os.listdir(folder))
            for name in names:
                if name.endswith("-cache") and f"{name.removesuffix('-cache')}-atime" not in names:
                    (folder / name).unlink()
        for other in folder.parent.iterdir():
            if other.stat().st_mtime < time.time() - UNUSED_DAYS * 86400:
                shutil.rmtree(other, ignore_errors=True)
    except (OSError, NotImplementedError, Timeout):  # read-only, full, or a file system without locks
        return False
    return True


@cache
def source_hash(rooms: tuple[str, ...]) -> str:
    """Hash of the source of some rooms of the package: what they made is found again as long as they stay the same."""
    package = Path(__file__).parents[1]
    return _hash(file for room in rooms for file in sorted((package / room).glob("*.py")))


def _hash(files: Iterable[Path]) -> str:
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
