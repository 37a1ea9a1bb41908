"""The wheel as users get it, on every Python from 3.11 to 3.13 that is here; others are skipped.

In the suite the wheel is built and installed into empty environments that borrow the dependencies of this one: under
the Python that runs the tests it bakes, predicts and tells of files; under the others, for which compiled dependencies
cannot be borrowed, every module is compiled and the command line lists its commands. `make install-check` installs the
wheel with all its dependencies from the package index instead, and does everything under each of them ($GASH_INSTALL).
"""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from gash_jax.apps.cli import COMMANDS
from gash_jax.formats.meshes import save_mesh
from gash_jax.shapes.primitives import bumpy_sphere

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
VERSIONS, OURS = ("3.11", "3.12", "3.13"), f"{sys.version_info[0]}.{sys.version_info[1]}"
WHOLE = bool(os.environ.get("GASH_INSTALL"))
pytestmark = pytest.mark.slow


def _outside() -> dict[str, str]:
    """The environment of processes that are to know nothing of this checkout."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "XLA_FLAGS"))}


def find_python(version: str) -> str | None:
    """An interpreter of a version: this one, one on the path, or one of pyenv's that its shims hide."""
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    found = [str(path) for path in sorted(pyenv.glob(f"{version}.*/bin/python"))]
    for path in [sys.executable] * (version == OURS) + [shutil.which(f"python{version}"), *found]:
        asked = [path, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"]
        if path and subprocess.run(asked, capture_output=True, text=True).stdout.strip() == version:
            return path
    return None


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not find_spec("hatchling"):
        pytest.skip("hatchling is not installed: make setup")
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module", params=VERSIONS)
def installed(
    request: pytest.FixtureRequest, wheel: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Path]:
    """A version and the folder of programs of an environment with the wheel."""
    version = request.param
    python = find_python(version)
    if python is None:
        pytest.skip(f"Python {version} is not here")
    folder = tmp_path_factory.mktemp(f"python{version}")
    subprocess.run([python, "-m", "venv", "--without-pip", str(folder)], env=_outside(), check=True)
    inside = folder / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", str(inside), "install", "--quiet"]
    if WHOLE:
        uv = shutil.which("uv")  # takes seconds where pip takes minutes
        install = [uv, "pip", "install", "--quiet", "--python", str(inside)] if uv else pip
        subprocess.run([*install, f"{wheel}[serve]"], env=_outside(), check=True)
    else:
        subprocess.run([*pip, "--no-deps", "--no-index", str(wheel)], env=_outside(), check=True)
        (site,) = folder.glob("lib/python*/site-packages")
        borrowed = Path(np.__file__).parents[1]
        (site / "borrowed.pth").write_text(f"{borrowed}\n")  # its own .pth files, that of this checkout too, stay out
    return version, inside.parent


def _run(programs: Path, folder: Path, *command: str) -> str:
    """What a program of the environment prints, started outside of the checkout."""
    words = [str(programs / command[0]), *command[1:]]
    done = subprocess.run(words, cwd=folder, env=_outside(), capture_output=True, text=True)
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    return done.stdout


def test_the_wheel_holds_the_package_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if not name.split("/")[0].endswith(".dist-info")}
    package = ROOT / "src" / "gash_jax"
    listed = subprocess.run(["git", "ls-files", "src"], cwd=ROOT, capture_output=True, text=True)
    known = listed.stdout.split() if listed.returncode == 0 else []
    assert set(name.removeprefix("src/") for name in known) <= held
    assert all((package.parent / name).exists() for name in held)
    assert {"gash_jax/weights/local.npz", "gash_jax/configs/local.toml", "gash_jax/py.typed"} <= held


def test_every_module_compiles_and_the_commands_are_listed(installed: tuple[str, Path], tmp_path: Path) -> None:
    version, programs = installed
    place = _run(programs, tmp_path, "python", "-c", "import gash_jax.apps.cli as a; print(a.__file__)").strip()
    assert Path(place).is_relative_to(programs.parent), "the package is that of the wheel"
    _run(programs, tmp_path, "python", "-m", "compileall", "-q", "-f", str(Path(place).parents[1]))
    told = _run(programs, tmp_path, "gash", "--help")
    assert all(re.search(rf"^  {name} ", told, re.MULTILINE) for name in COMMANDS)
    assert PROJECT["version"] in _run(programs, tmp_path, "gash", "--version")


def test_it_bakes_predicts_and_tells(installed: tuple[str, Path], tmp_path: Path) -> None:
    version, programs = installed
    if version != OURS and not WHOLE:
        pytest.skip(f"dependencies compiled for Python {OURS} are of no use to {version}: make install-check")
    save_mesh(tmp_path / "bumpy.ply", bumpy_sphere(6))
    assert "wrote baked.npz" in _run(programs, tmp_path, *"gash bake bumpy.ply -o baked.npz --rays 64".split())
    assert "wrote predicted.npz" in _run(programs, tmp_path, *"gash predict bumpy.ply -o predicted.npz".split())
    assert "kind: transfer" in _run(programs, tmp_path, "gash", "info", "baked.npz")
    with np.load(tmp_path / "baked.npz") as baked, np.load(tmp_path / "predicted.npz") as predicted:
        assert baked["coefficients"].shape == predicted["coefficients"].shape == (362, 9)
        np.testing.assert_allclose(predicted["coefficients"], baked["coefficients"], atol=0.3)


def test_the_readme_tells_of_every_extra() -> None:
    """The table of extras: a row for each, naming every package that it brings."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `gash-jax\[(\w+)\]` \| (.+) \|$", text, re.MULTILINE))
    assert set(rows) == set(PROJECT["optional-dependencies"])
    for name, packages in PROJECT["optional-dependencies"].items():
        for package in packages:
            assert f"`{re.split('[<>=!~]', package)[0]}`" in rows[name]
