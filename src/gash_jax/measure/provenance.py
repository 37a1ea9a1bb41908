"""Where a result comes from: machine, commit, versions. Every results.json begins with this."""

import platform
import subprocess
from pathlib import Path
from typing import Any

import jax

from gash_jax.files.cores import available_cores
from gash_jax.prt.transfer import software_versions


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def _commit() -> str:
    """Commit of the checkout the package runs from, with "+" if it was changed since; empty outside one."""
    here = Path(__file__).parent
    try:
        head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=here, capture_output=True, text=True, timeout=10)
        state = subprocess.run(["git", "status", "--porcelain"], cwd=here, capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return "" if head.returncode else head.stdout.strip()[:12] + ("+" if state.stdout.strip() else "")


def provenance(**entries: Any) -> dict[str, Any]:
    """Machine, commit and versions, with whatever else determines the result (seed, arguments)."""
    machine = {"processor": _processor(), "cores": available_cores(), "device": jax.devices()[0].device_kind}
    return {"machine": machine, "commit": _commit(), "software": software_versions(), **entries}
