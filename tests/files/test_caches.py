"""Compiled programs are found again: in the next process, beside others, and never at the cost of the work itself."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gash_jax.files import caches

# compiles a few programs; says how many the cache held, how many it got, and what came out
PROGRAM = """
import json, sys
if "jax first" in sys.argv:
    import jax
from gash_jax.files import caches
if "small" in sys.argv:
    caches.SETTINGS["compilation_cache_max_size"] = SMALL
folder = caches.keep_compiled_programs()
import jax, jax.numpy as jnp
events = []
jax.monitoring.register_event_listener(lambda name, **_: events.append(name.rsplit("/")[-1]))
x = jnp.linspace(0.0, 1.0, 1000)
values = [float(jax.jit(lambda x, n=n: jnp.sum(jnp.sin(x) ** n))(x)) for n in range(1, 5)]
print(json.dumps({
    "folder": folder and str(folder), "values": values, "largest": jax.config.jax_compilation_cache_max_size,
    "hits": events.count("cache_hits"), "misses": events.count("cache_misses"),
}))
"""


SMALL = 10000  # bytes, where all programs take more


def start(cache: Path, *arguments: str, **environment: str) -> subprocess.Popen:
    names = ("JAX_", "GASH_")  # not those of this session
    kept = {name: value for name, value in os.environ.items() if not name.startswith(names)}
    command = [sys.executable, "-c", PROGRAM.replace("SMALL", str(SMALL)), *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, env={**kept, "GASH_CACHE": str(cache), **environment}, **pipes)


def finish(process: subprocess.Popen) -> dict:
    """What the program said; it must not have said anything on the error stream."""
    said, complaints = process.communicate(timeout=120)
    assert process.returncode == 0 and complaints == "", complaints
    return json.loads(said)


@pytest.fixture(scope="module")
def cold(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """A cache folder that one process has filled, and what that process said."""
    cache = tmp_path_factory.mktemp("cache")
    return cache, finish(start(cache))


@pytest.mark.parametrize("arguments", [(), ("jax first",)], ids=["before jax", "after jax"])
def test_the_second_process_compiles_nothing(cold: tuple[Path, dict], arguments: tuple[str, ...]) -> None:
    cache, first = cold
    assert first["hits"] == 0 and first["misses"] >= 4 and first["largest"] == caches.LARGEST_BYTES
    assert Path(first["folder"]) == cache / "compiled" / caches.machine_name()
    second = finish(start(cache, *arguments))
    assert second == {**first, "hits": first["misses"], "misses": 0}


def test_processes_side_by_side_fill_one_cache(tmp_path: Path) -> None:
    processes = [start(tmp_path) for _ in range(3)]
    values = [finish(process)["values"] for process in processes]
    assert values[0] == values[1] == values[2]
    last = finish(start(tmp_path))
    assert last["misses"] == 0 and last["values"] == values[0]


def test_what_a_killed_process_left_is_no_hindrance(tmp_path: Path) -> None:
    """Half an entry is removed and made again; an entry that cannot be read costs its compilation, nothing else."""
    first = finish(start(tmp_path))
    half, damaged, *others = sorted(Path(first["folder"]).glob("*-cache"))
    for entry in (half, damaged):
        entry.write_bytes(entry.read_bytes()[:100])
    half.with_name(half.name.replace("-cache", "-atime")).unlink()
    found = finish(start(tmp_path))
    assert found["values"] == first["values"] and found["hits"] == len(others)
    assert half.stat().st_size > 100 and finish(start(tmp_path))["hits"] == len(others) + 1


def test_the_cache_is_bounded(tmp_path: Path) -> None:
    for _ in range(2):
        found = finish(start(tmp_path, "small"))
        assert found["misses"] > 0  # some had to go
        kept = [entry.stat().st_size for entry in Path(found["folder"]).glob("*-cache")]
        assert SMALL / 2 < sum(kept) <= SMALL


def test_without_a_place_to_write_everything_is_compiled(tmp_path: Path, cold: tuple[Path, dict]) -> None:
    (tmp_path / "file").write_text("in the way")
    assert finish(start(tmp_path / "file")) == {**cold[1], "folder": None, "misses": 0, "largest": -1}


def test_a_user_without_a_home_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", homeless)
    for name in ("GASH_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    assert caches.keep_compiled_programs() is None


def test_where_the_cache_folder_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    for name in ("GASH_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    assert caches.cache_folder() == tmp_path / ".cache" / "gash_jax"
    monkeypatch.setenv("XDG_CACHE_HOME", "/xdg")
    assert caches.cache_folder() == Path("/xdg/gash_jax")
    monkeypatch.setenv("GASH_CACHE", "/own")
    assert caches.cache_folder() == Path("/own")


def test_a_read_only_cache_is_left_alone(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    if os.access(tmp_path, os.W_OK):
        pytest.skip("this user may write everywhere")
    assert finish(start(tmp_path))["folder"] is None


def test_the_users_own_choice_stays(tmp_path: Path) -> None:
    own = tmp_path / "own"
    assert finish(start(tmp_path, JAX_COMPILATION_CACHE_DIR=str(own)))["folder"] == str(own)
    assert not (tmp_path / "compiled").exists()


def test_a_library_user_is_asked_first() -> None:
    """Neither the package nor a bake changes JAX's settings."""
    program = "import jax, gash_jax; gash_jax.bake_transfer; print(jax.config.jax_compilation_cache_dir)"
    kept = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    assert subprocess.check_output([sys.executable, "-c", program], env=kept, text=True).strip() == "None"


def test_the_folder_is_named_by_what_code_depends_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(caches, "PROCESSORS", tmp_path / "cpuinfo")
    first = "processor : 0\nmodel name : A\nflags : fpu avx2\ncpu MHz : 2000\n\n"

    def name(text: str) -> str:
        caches.PROCESSORS.write_text(text)
        return caches.machine_name()

    before = name(first)
    assert name(first.replace("2000", "3000")) == before == name(first + first.replace("avx2", "sse"))
    assert name(first.replace("avx2", "avx512f")) != before != name(first.replace("A", "B"))
    monkeypatch.setattr(caches, "available_cores", lambda: 1000)
    assert name(first) != before
    caches.PROCESSORS.unlink()
    assert caches.machine_name() == caches.machine_name() != before  # a system that does not say


def test_folders_that_nobody_uses_go(tmp_path: Path) -> None:
    old, young = tmp_path / "compiled" / "old", tmp_path / "compiled" / "young"
    for folder, days in ((old, caches.UNUSED_DAYS + 1), (young, caches.UNUSED_DAYS - 1)):
        folder.mkdir(parents=True)
        then = time.time() - days * 86400
        os.utime(folder, (then, then))
    assert Path(finish(start(tmp_path))["folder"]).is_dir() and young.is_dir() and not old.exists()
