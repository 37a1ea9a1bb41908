"""Real meshes and maps that may lie beside the checkout; tests that need them skip where they are absent."""

from pathlib import Path

import pytest

SHARED = Path(__file__).parents[2].parent / "shared"


def shared_file(name: str) -> Path:
    """Path of a file of the optional data folder, or skip the test."""
    path = SHARED / "data" / name
    if not path.exists():
        pytest.skip(f"needs the optional data folder beside the checkout: {name} is absent")
    return path


def shared_case(name: str) -> Path:
    """Path of a file of the optional folder of inputs that once went wrong, or skip the test."""
    path = SHARED / "cases" / name
    if not path.exists():
        pytest.skip(f"needs the optional folder of cases beside the checkout: {name} is absent")
    return path
