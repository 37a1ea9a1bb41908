"""The page that ships is the one that `viewer/` builds, and its source passes its own checks."""

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
SHIPPED = ROOT / "src" / "gash_jax" / "apps" / "viewer" / "page.html"


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of `viewer/` with the packages that its lock file names, or skip the test."""
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("needs npm: apt-get install npm")
    made = tmp_path_factory.mktemp("build") / "viewer"
    shutil.copytree(ROOT / "viewer", made, ignore=shutil.ignore_patterns("node_modules"))
    kept = ROOT / "viewer" / "node_modules"
    if kept.is_dir():
        (made / "node_modules").symlink_to(kept)
        return made
    done = subprocess.run([npm, "ci", "--no-audit", "--no-fund"], cwd=made, capture_output=True, text=True)
    if done.returncode != 0:
        pytest.skip(f"npm cannot fetch the packages of viewer/package-lock.json: {done.stderr[-200:]}")
    return made


def test_the_page_that_ships_is_the_one_that_is_built(source: Path, tmp_path: Path) -> None:
    built = tmp_path / "page.html"
    subprocess.run(["npm", "run", "--silent", "build", "--", str(built)], cwd=source, check=True)
    assert built.read_text() == SHIPPED.read_text(), "run `npm ci && npm run build` in viewer/"
    assert built.read_text().count("</script>") == 1  # nothing inside the script ends it


def test_the_source_passes_its_checks(source: Path) -> None:
    done = subprocess.run(["npm", "run", "--silent", "lint"], cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
