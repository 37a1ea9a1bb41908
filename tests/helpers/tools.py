"""Command line tools that are installed beside Python; tests that need one skip where it is absent."""

import shutil
import subprocess
from pathlib import Path

import pytest

PACKAGES = {"glslangValidator": "glslang-tools", "mcs": "mono-mcs", "mono": "mono-mcs"}


def tool(name: str, *arguments: Path | str) -> subprocess.CompletedProcess[str]:
    """What a tool answers, or skip the test."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"needs {name}: apt-get install {PACKAGES[name]}")
    return subprocess.run([found, *map(str, arguments)], capture_output=True, text=True, timeout=120)
