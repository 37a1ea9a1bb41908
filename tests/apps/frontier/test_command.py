"""`gash bench frontier` as a user meets it: results, table, figure, going on where it was, and errors in one line."""

import json
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from gash_jax.apps.cli import gash, main
from gash_jax.apps.frontier import command, measuring, methods
from gash_jax.apps.frontier.measuring import key_of, pool, read_piece, write_piece
from gash_jax.apps.pictures.frontier import draw_frontier
from gash_jax.formats.meshes import save_mesh
from gash_jax.measure.frontier import pareto_front
from gash_jax.shapes.primitives import bumpy_sphere, icosphere

FEW = ("--methods", "closed-form,plain,error", "--rays", "64", "--rounds", "1")


def frontier(*arguments: str) -> None:
    gash.main(["bench", "frontier", *arguments], standalone_mode=False)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "compiled_anew", nullcontext)  # the session's cache is there to be used
    monkeypatch.setattr(methods, "PLAIN_RAYS", (8, 64))
    for module in (methods, measuring):
        monkeypatch.setattr(module, "ERRORS", (0.2, 0.1))
    save_mesh("bumpy.ply", bumpy_sphere(4))
    save_mesh("ball.ply", icosphere(1))
    return tmp_path


@pytest.mark.slow
def test_a_whole_run(folder: Path, capsys: pytest.CaptureFixture) -> None:
    frontier("bumpy.ply", "ball.ply", "--light", "studio", "-o", "out", *FEW)
    said = capsys.readouterr().out
    assert "bake to an error" in said and "wrote out/results.json and out/frontier.png" in said
    results = json.loads((folder / "out/results.json").read_text())
    assert {"machine", "commit", "software", "arguments"} <= set(results)
    assert [mesh["mesh"] for mesh in results["meshes"]] == ["bumpy", "ball"]
    for mesh in results["meshes"]:
        rows = mesh["rows"]
        assert {row["method"] for row in rows} == {"closed-form", "plain", "error"} and mesh["skipped"] == {}
        assert all(row["seconds"]["median"] >= row["seconds_without_set_up"]["median"] > 0 for row in rows)
        assert all(row["psnr"] > 0 for row in rows)
        assert [entry["target"] for entry in mesh["targets"]] == [0.2, 0.1]
        costs = np.array([[row["seconds"]["median"], float(f"{row['relrmse']:.3g}")] for row in rows])
        assert [row["on_front"] for row in rows] == [i in pareto_front(costs) for i in range(len(rows))]
    # nothing shadows a convex body, so the formula is better than the reference itself
    ball = {(row["method"], row["setting"]): row["relrmse"] for row in results["meshes"][1]["rows"]}
    assert ball["closed-form", ""] < 0.01 < ball["plain", "8"]
    (together,) = results["pooled"]
    assert together["meshes"] == 2 and {row["label"] for row in together["rows"]} >= {"plain bake"}
    with Image.open(folder / "out/frontier.png") as picture:
        pixels = np.asarray(picture.convert("RGB"), float)
    assert pixels.shape[0] > 300 and pixels.shape[1] > 800
    dark = (pixels.max(axis=2) < 200).mean()
    colourful = (np.ptp(pixels, axis=2) > 60).mean()
    assert 0.005 < dark < 0.5 and colourful > 0.001


def test_a_second_call_measures_only_what_is_missing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    measured: list[int] = []
    whole = command.measure_mesh

    def counted(task: Any, *rest: Any) -> dict[str, Any]:
        measured.append(len(task.mesh.vertices))
        if len(task.mesh.vertices) == 42 and len(measured) == 2:
            raise KeyboardInterrupt
        return whole(task, *rest)

    monkeypatch.setattr(command, "measure_mesh", counted)
    few = ("--methods", "closed-form", "--rays", "64", "--rounds", "1", "--quiet")
    with pytest.raises(BaseException):  # noqa: B017  # click makes its own of Ctrl-C
        frontier("bumpy.ply", "ball.ply", "-o", "out", *few)
    assert not Path("out/results.json").exists()
    frontier("bumpy.ply", "ball.ply", "-o", "out", *few)
    assert measured == [162, 42, 42]
    first = json.loads(Path("out/results.json").read_text())
    frontier("bumpy.ply", "ball.ply", "-o", "out", *few)
    assert measured == [162, 42, 42] and json.loads(Path("out/results.json").read_text()) == first
    # damaged, of another mesh, asked otherwise: measured again
    piece = Path("out/pieces/ball.json")
    piece.write_text(piece.read_text().replace('"vertices": 42', '"vertices": 43'))
    save_mesh("bumpy.ply", bumpy_sphere(5))
    frontier("bumpy.ply", "ball.ply", "-o", "out", *few)
    assert measured == [162, 42, 42, 252, 42]
    frontier("ball.ply", "-o", "out", *few[:-1], "--rounds", "2", "--quiet")
    assert measured[5:] == [42]


def test_pieces_are_believed_only_whole_and_of_the_same(tmp_path: Path) -> None:
    path, mesh, other = tmp_path / "a" / "piece.json", bumpy_sphere(2), bumpy_sphere(3)
    key = key_of([mesh], 1, np.ones(2))
    assert read_piece(path, key) is None
    write_piece(path, key, {"x": 1})
    assert read_piece(path, key) == {"x": 1}
    for wrong in (key_of([mesh], 2, np.ones(2)), key_of([mesh], 1, np.zeros(2)), key_of([other], 1, np.ones(2))):
        assert wrong != key and read_piece(path, wrong) is None
    path.write_text(path.read_text().replace('"x": 1', '"x": 2'))
    assert read_piece(path, key) is None
    path.write_text("[1, 2")
    assert read_piece(path, key) is None


@pytest.mark.slow
def test_animations_and_bounces_stand_apart(folder: Path, capsys: pytest.CaptureFixture) -> None:
    still = bumpy_sphere(3)
    frames = np.stack([still.vertices * size for size in (1.0, 1.2, 1.4)]).astype(np.float32)
    np.savez("grows.npz", verts=frames, faces=still.faces)
    few = ("--methods", "closed-form,plain,pseudo-random", "--rays", "64", "--rounds", "1")
    frontier("bumpy.ply", "grows.npz", "-o", "out", "--bounces", "0", "--bounces", "1", *few)
    results = json.loads((folder / "out/results.json").read_text())
    names = ["bumpy", "bumpy, 1 bounce", "grows", "grows, 1 bounce"]
    assert [mesh["mesh"] for mesh in results["meshes"]] == names
    assert [mesh["frames"] for mesh in results["meshes"]] == [0, 0, 3, 3]
    assert [(each["moving"], each["bounces"]) for each in results["pooled"]] == [
        *((False, 0), (False, 1)),
        *((True, 0), (True, 1)),
    ]
    assert results["meshes"][1]["skipped"] == {"pseudo-random": "knows no light that bounces"}
    assert "left out: pseudo-random (knows no light that bounces)" in capsys.readouterr().out
    error = {
        mesh["mesh"]: {row["setting"]: row["relrmse"] for row in mesh["rows"] if row["method"] == "plain"}
        for mesh in results["meshes"]
    }
    # the same mesh three times as large or small has the same error; bounced light has its own reference
    assert all(found["64"] < 0.1 < found["8"] for found in error.values()), error


BAD = {
    "missing mesh": ("no.ply -o out", "no such file"),
    "unknown method": ("bumpy.ply -o out --methods plain,plian", "unknown method 'plian', did you mean 'plain'?"),
    "no method": ("bumpy.ply -o out --methods kept", "none of the methods can be run"),
    "missing weights": ("bumpy.ply -o out --methods single-stage", "give them with --model"),
    "unknown model": ("bumpy.ply -o out --model gpt", "no model 'gpt'"),
    "model twice": ("bumpy.ply -o out --model local", "two models are called local"),
    "one name": ("bumpy.ply deeper/bumpy.ply -o out", "two meshes are called bumpy"),
    "no output": ("bumpy.ply", "--output"),
    "output is a file": ("bumpy.ply -o ball.ply", "it is a file, give a folder"),
    "output nowhere": ("bumpy.ply -o no/such/out", "does not exist"),
    "rounds": ("bumpy.ply -o out --rounds 0", "--rounds"),
    "rays": ("bumpy.ply -o out --rays 8", "--rays"),
    "light": ("bumpy.ply -o out --light no.hdr", "no such file"),
    "no mesh": ("-o out", "MESH"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_calls(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, name: str) -> None:
    (folder / "deeper").mkdir()
    save_mesh("deeper/bumpy.ply", bumpy_sphere(2))
    before = sorted(path.name for path in folder.rglob("*"))
    arguments, message = BAD[name]
    monkeypatch.setattr("sys.argv", ["gash", "bench", "frontier", *arguments.split()])
    monkeypatch.setattr("gash_jax.apps.cli.keep_compiled_programs", lambda: None)
    with pytest.raises(SystemExit) as caught:
        main()
    said = capsys.readouterr().err
    assert caught.value.code == 2 and said.startswith("error: ") and said.count("\n") == 1 and message in said, said
    assert sorted(path.name for path in folder.rglob("*")) == before


def test_help_has_an_example_that_parses(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit):
        gash.main(["bench", "frontier", "--help"])
    text = capsys.readouterr().out
    example = text.split("Example:\n")[1].split()
    assert example[:3] == ["gash", "bench", "frontier"]
    assert command.frontier.make_context("frontier", example[3:]).params["output"] == Path("frontier")


def test_a_figure_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="nothing to draw"):
        draw_frontier({"meshes": [], "pooled": pool([])}, tmp_path / "x.png")
    assert not (tmp_path / "x.png").exists()
