"""Shards of every command that has them: any order, twice, side by side; bit for bit the result of one run."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest

from gash_jax.apps.cli import gash
from gash_jax.files.npz import read_npz
from gash_jax.formats.meshes import save_mesh
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train.truth import FRAMES

TINY = ["mlp", "model.bands=2", "data.shapes=4", "data.validation_shapes=1", "data.rays=16"]
TINY += ["data.min_vertices=150", "data.max_vertices=200"]
SWEEP = """
name = "tiny"
config = "mlp"
set = ["data.shapes=2", "data.validation_shapes=1", "data.rays=16", "data.min_vertices=150",
       "data.max_vertices=300", "train.steps=4", "train.batch_vertices=512"]
[axes.width]
keys = ["model.channels"]
values = [4, 8]
"""
CLOCKS = {"wall_seconds", "cpu_seconds"}


def run(*arguments: object) -> None:
    gash.main([str(argument) for argument in arguments], standalone_mode=False)


def fail(capsys: pytest.CaptureFixture, *arguments: object) -> str:
    """The one line with which a command refuses."""
    with pytest.raises(Exception) as caught:
        run(*arguments)
    text = caught.value.format_message() if isinstance(caught.value, click.ClickException) else str(caught.value)
    assert "\n" not in text
    return text


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of three meshes and a cache of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GASH_CACHE", str(tmp_path / "cache"))
    for name, size in (("a", 3), ("b", 4), ("c", 3)):
        save_mesh(f"{name}.ply", bumpy_sphere(size))
    return tmp_path


BAKE = ("bake", "c.ply", "a.ply", "b.ply", "--bands", "2", "--rays", "16", "-o")


def contents(folder: str | Path) -> dict[str, Any]:
    """Arrays and metadata of all files of a folder, but for seconds."""
    found = {}
    for path in sorted(Path(folder).glob("*.npz")):
        arrays, metadata = read_npz(path, "file", ())
        kept = {name: value for name, value in metadata.items() if "seconds" not in name}
        found[path.name] = {**{name: (a.dtype.str, a.tobytes()) for name, a in arrays.items()}, "metadata": kept}
    return found


def stamps(folder: str | Path) -> dict[str, int]:
    return {str(path): path.stat().st_mtime_ns for path in Path(folder).rglob("*") if path.is_file()}


@pytest.mark.parametrize("order", [(1, 2, 3), (3, 1, 2), (2, 3, 1)])
def test_shards_in_any_order_are_the_bakes_of_single_meshes(order: tuple[int, ...]) -> None:
    Path("one").mkdir()
    for name in "abc":
        run("bake", f"{name}.ply", "--bands", 2, "--rays", 16, "-o", f"one/{name}.npz", "--quiet")
    for number in order:
        run(*BAKE, "many", "--shard", f"{number}/3", "--quiet")
    run(*BAKE, "many", "--merge", 3, "--quiet")
    assert contents("many") == contents("one")


def test_a_shard_does_only_what_is_missing(capsys: pytest.CaptureFixture) -> None:
    run(*BAKE, "many", "--shard", "1/2")
    assert sorted(path.name for path in Path("many").glob("*.npz")) == ["a.npz", "c.npz"]
    before = stamps("many")
    run(*BAKE, "many", "--shard", "1/2")
    assert stamps("many") == before
    run(*BAKE, "many")  # the rest, in one run
    assert before.items() <= stamps("many").items() and len(list(Path("many").glob("*.npz"))) == 3
    capsys.readouterr()
    run(*BAKE, "many", "--merge", 2)
    assert capsys.readouterr().out == "3 bakes in many are there and whole\n"
    run(*BAKE, "many", "--seed", 1, "--shard", "1/3")  # other options are another piece
    assert stamps("many")["many/a.npz"] != before["many/a.npz"]
    assert "many/a.npz is damaged or of another bake" in fail(capsys, *BAKE, "many", "--merge", 3)
    save_mesh("b.ply", bumpy_sphere(3))  # so is another mesh
    assert "run --shard 2/3 and --shard 3/3 again" in fail(capsys, *BAKE, "many", "--seed", 1, "--merge", 3)


def test_a_damaged_bake_is_refused_and_baked_again(capsys: pytest.CaptureFixture) -> None:
    run(*BAKE, "many", "--quiet")
    before, path = contents("many"), Path("many/b.npz")
    path.write_bytes(path.read_bytes()[:-60])
    assert fail(capsys, *BAKE, "many", "--merge", 2) == (
        "cannot merge, many/b.npz is damaged or of another bake: run --shard 2/2 again, then --merge 2"
    )
    run(*BAKE, "many", "--shard", "2/2", "--quiet")
    run(*BAKE, "many", "--merge", 2, "--quiet")
    assert contents("many") == before


def test_a_mesh_that_is_none_keeps_no_other_from_its_bake(capsys: pytest.CaptureFixture) -> None:
    Path("aa.ply").write_text("hello")
    assert fail(capsys, *BAKE, "many", "aa.ply").startswith("1 of 4 meshes failed, the others are kept: aa.ply: not a")
    assert sorted(path.name for path in Path("many").glob("*.npz")) == ["a.npz", "b.npz", "c.npz"]
    assert "many/aa.npz is missing: run --shard 2/4" in fail(capsys, *BAKE, "many", "aa.ply", "--merge", 4)
    assert "absent.ply" in fail(capsys, "bake", "a.ply", "absent.ply", "-o", "more", "--rays", 1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("bake", "a.ply", "b.ply", "-o", "x.npz"), "x.npz names a file: several meshes are baked into a folder"),
        (("bake", "a.ply", "b.ply", "-o", "a.ply"), "a.ply is a file: several meshes are baked into a folder"),
        (("bake", "a.ply", "sub/a.ply", "-o", "x"), "a.ply and sub/a.ply would both be x/a.npz"),
        (("bake", "a.ply", "b.ply", "-o", "x", "--rays", "250"), "use 248 or 252"),
        (("bake", "a.ply", "b.ply", "-o", "x", "--uv", "own"), "--uv says where texels lie"),
        (("bake", "a.ply", "-o", "."), "is a folder, give a file name"),
        (("bake", "a.ply", "-o", "x", "--shard", "3/2"), "there is no shard 3/2: the shards are 1/2 to 2/2"),
        (("corpus", "mlp", "--shard", "0/2"), "there is no shard 0/2"),
        (("sweep", "sweep.toml", "-o", "x", "--shard", "a/b"), "'a/b' is no shard: give its number"),
        (("animate", "a.npz", "-o", "x.npz", "--shard", "1/2", "--merge", "2"), "give one of them"),
        (("corpus", "mlp", "--wait"), "give them with --cluster"),
        (("corpus", "mlp", "--job", "timeout_min=3", "--shard", "1/2"), "give them with --cluster"),
        (("corpus", "mlp", "--merge", "0"), "--merge"),
        (("animate", "a.npz", "-o", "x.npz", "--model", "run", "--shard", "1/2"), "leave out --model"),
    ],
)
def test_what_does_not_fit_is_refused(arguments: tuple[str, ...], message: str, capsys: pytest.CaptureFixture) -> None:
    before = sorted(path for path in Path().rglob("*") if "cache" not in path.parts)
    assert message in fail(capsys, *arguments)
    assert sorted(path for path in Path().rglob("*") if "cache" not in path.parts) == before


def test_two_shards_and_one_of_them_twice_at_the_same_time() -> None:
    command = [sys.executable, "-m", "gash_jax", *BAKE, "many", "--quiet", "--shard"]
    running = [subprocess.Popen([*command, shard]) for shard in ("1/2", "2/2", "2/2", "1/1")]
    assert [process.wait() for process in running] == [0, 0, 0, 0]
    run(*BAKE, "many", "--merge", 2, "--quiet")
    run(*BAKE, "one", "--quiet")
    assert contents("many") == contents("one")
    assert not list(Path("many").rglob("*.tmp"))


def _frames() -> tuple[object, ...]:
    moving = blendshape_animation(bumpy_sphere(3), 0, 2 * FRAMES + 1, 2)
    np.savez("frames.npz", verts=np.stack(list(moving.frames())), faces=moving.mesh.faces)
    return ("animate", "frames.npz", "--bands", 2, "--rays", 4, "-o")


def test_frames_of_shards_are_the_file_of_one_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    animate = _frames()
    run(*animate, "one.npz", "--quiet")
    monkeypatch.setenv("GASH_CACHE", "shared")
    run(*animate, "many.npz", "--shard", "2/2")
    assert f"shard 2/2: {FRAMES} of {2 * FRAMES + 1} frames" in capsys.readouterr().out
    first = f"the file of frames 0 to {FRAMES - 1} is missing (and 1 more of 3 pieces): run --shard 1/2 again"
    assert first in fail(capsys, *animate, "many.npz", "--merge", 2) and not Path("many.npz").exists()
    before = stamps("shared/frames")
    run(*animate, "many.npz", "--shard", "1/2", "--quiet")
    run(*animate, "many.npz", "--shard", "2/2", "--quiet")
    assert before.items() <= stamps("shared/frames").items() and len(stamps("shared/frames")) == 3
    run(*animate, "many.npz", "--merge", 2, "--quiet")
    assert Path("many.npz").read_bytes() == Path("one.npz").read_bytes()
    (piece,) = before
    Path(piece).write_bytes(Path(piece).read_bytes()[:-9])
    damaged = f"the file of frames {FRAMES} to {2 * FRAMES - 1} is damaged: run --shard 2/2 again"
    assert damaged in fail(capsys, *animate, "many.npz", "--merge", 2)


def test_the_corpus_of_shards_is_that_of_one_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    run("corpus", *TINY)
    whole = capsys.readouterr().out
    monkeypatch.setenv("GASH_CACHE", "shared")
    run("corpus", *TINY, "--shard", "3/3")
    assert "shard 3/3: 1 of 5 shapes" in capsys.readouterr().out
    assert "shape 0 is missing (and 3 more of 5 pieces): run --shard 1/3 and --shard 2/3" in fail(
        capsys, "corpus", *TINY, "--merge", 3
    )
    before = stamps("shared/corpus")
    for shard in ("1/3", "2/3", "3/3"):
        run("corpus", *TINY, "--shard", shard, "--quiet")
    assert before.items() <= stamps("shared/corpus").items()
    capsys.readouterr()
    run("corpus", *TINY, "--merge", 3)
    assert capsys.readouterr().out == whole
    files = {path.name: path.read_bytes() for path in Path("cache/corpus").iterdir()}
    assert files == {path.name: path.read_bytes() for path in Path("shared/corpus").iterdir()} and len(files) == 5
    (piece,) = before
    data = bytearray(Path(piece).read_bytes())
    data[len(data) // 2] ^= 1
    Path(piece).write_bytes(data)
    assert "shape 2 is damaged: run --shard 3/3 again" in fail(capsys, "corpus", *TINY, "--merge", 3)
    run("corpus", *TINY, "--shard", "3/3", "--quiet")
    run("corpus", *TINY, "--merge", 3, "--quiet")


def _lines(folder: str) -> list[dict[str, Any]]:
    lines = [json.loads(line) for line in Path(folder, "results.jsonl").read_text().splitlines()]
    return [{name: value for name, value in line.items() if name not in CLOCKS} for line in lines]


@pytest.mark.slow
def test_the_sweep_of_shards_is_that_of_one_run(capsys: pytest.CaptureFixture) -> None:
    Path("sweep.toml").write_text(SWEEP)
    run("sweep", "sweep.toml", "-o", "many", "--shard", "2/2")
    assert "1 of 2 runs are of shard 2/2, 0 done before" in capsys.readouterr().out
    refused = fail(capsys, "sweep", "sweep.toml", "-o", "many", "--merge", 2)
    assert refused.startswith("cannot merge, the run tiny-width4-seed0 is missing: run --shard 1/2 again")
    run("sweep", "sweep.toml", "-o", "many", "--shard", "1/2")
    before = stamps("many/runs")
    run("sweep", "sweep.toml", "-o", "many", "--shard", "2/2")
    assert "1 done before" in capsys.readouterr().out and stamps("many/runs") == before
    run("sweep", "sweep.toml", "-o", "many", "--merge", 2, "--quiet")
    run("sweep", "sweep.toml", "-o", "one", "--quiet")
    assert _lines("many") == _lines("one") and len(_lines("one")) == 2
    one, many = (
        {p.parent.name: read_npz(p, "model", ())[0] for p in Path(f).glob("runs/*/model.npz")} for f in ("one", "many")
    )
    np.testing.assert_equal(many, one)
    assert {"results.csv", "pareto.png"} <= set(os.listdir("many"))
    Path("many/results.jsonl").unlink()
    run("sweep", "sweep.toml", "-o", "many")  # without a merge, what shards did counts as well
    assert "2 runs, 2 done before" in capsys.readouterr().out
    (model,) = Path("many/runs").glob("width_8*/model.npz")
    model.write_bytes(model.read_bytes()[:-9])
    assert "tiny-width8-seed0 is damaged: run --shard 2/2" in fail(
        capsys, "sweep", "sweep.toml", "-o", "many", "--merge", 2
    )
