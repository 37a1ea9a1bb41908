"""A command imports what it needs and nothing else; `gash --help` imports none of them."""

import subprocess
import sys
from pathlib import Path

import pytest

from gash_jax.apps import commands
from gash_jax.apps.cli import COMMANDS, gash, load_command
from gash_jax.formats.meshes import save_mesh
from gash_jax.shapes.primitives import icosphere

PROGRAM = """
import sys
sys.argv = ["gash", *sys.argv[1:]]
from gash_jax.apps.cli import main
try:
    main()
finally:
    print("imported:", *sys.modules)
"""
NETWORKS = {"flax", "optax", "orbax", "jraph"}
REPORTS = {"skimage", "matplotlib", "tensorboardX", "rich", "PIL", "scipy.stats"}
OTHERS = {"trimesh", "OpenEXR", "scipy.spatial", "scipy.ndimage"}


def imported(folder: Path, *arguments: str) -> set[str]:
    """Modules in memory at the end of a command."""
    run = subprocess.run([sys.executable, "-c", PROGRAM, *arguments], cwd=folder, capture_output=True, text=True)
    assert run.returncode == 0 and run.stderr == "", run.stderr
    return set(run.stdout.split("imported:")[1].split())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("start")
    save_mesh(path / "ball.ply", icosphere(1))
    return path


def test_a_bake_imports_no_network_and_no_picture(folder: Path) -> None:
    found = imported(folder, "bake", "ball.ply", "-o", "ball.npz", "--rays", "16")
    assert {"jax", "embreex"} <= found
    assert not found & (NETWORKS | REPORTS | OTHERS)


def test_a_prediction_imports_no_training_and_no_picture(folder: Path) -> None:
    found = imported(folder, "predict", "ball.ply", "-o", "ball.npz", "--quiet")
    assert {"jax", "flax"} <= found
    assert not found & (REPORTS - {"rich"} | OTHERS | {"orbax", "optax"})  # flax imports rich


def test_help_imports_no_command(folder: Path) -> None:
    assert not imported(folder, "--help") & {
        "jax",
        "numpy",
        "scipy",
        "rich",
        *(f"{commands.__name__}.{n}" for n in COMMANDS),
    }


def test_the_list_holds_every_command_in_its_own_words() -> None:
    files = {path.stem for path in Path(commands.__path__[0]).glob("*.py")} - {"__init__"}
    assert set(COMMANDS) == files
    for name in COMMANDS:
        listed, command = gash.commands[name], load_command(name)
        assert listed.name == command.name == name
        assert listed.get_short_help_str(1000) == command.get_short_help_str(1000)
