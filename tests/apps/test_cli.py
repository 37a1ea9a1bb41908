"""The command line as a user meets it: outputs, help, and one line for every mistake."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gash_jax.apps.cli import gash, load_command, main
from gash_jax.files.npz import write_npz
from gash_jax.formats.hdr import write_hdr
from gash_jax.formats.meshes import save_mesh
from gash_jax.light.studio import studio_light
from gash_jax.prt.transfer import load_transfer
from gash_jax.shapes.primitives import bumpy_sphere, icosphere


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mesh, a map, a light, bakes of two meshes."""
    path = tmp_path_factory.mktemp("cli")
    save_mesh(path / "bumpy.ply", bumpy_sphere(16))
    save_mesh(path / "ball.ply", icosphere(2))
    write_hdr(path / "studio.hdr", studio_light(32))
    for arguments in (
        ["bake", "bumpy.ply", "-o", "bumpy.npz", "--rays", "64", "--quiet"],
        ["bake", "bumpy.ply", "-o", "reference.npz", "--rays", "1024", "--quiet"],
        ["bake", "ball.ply", "-o", "ball.npz", "--rays", "64", "--quiet"],
        ["bake", "bumpy.ply", "-o", "four.npz", "--rays", "16", "--bands", "4", "--quiet"],
        ["light", "studio.hdr", "-o", "light.npz", "--quiet"],
    ):
        run(path, *arguments)
    return path


def run(folder: Path, *arguments: str) -> None:
    """Run a command inside `folder`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        gash.main(list(arguments), standalone_mode=False)


def fail(folder: Path, capsys: pytest.CaptureFixture, *arguments: str) -> str:
    """Run a command that must fail: exit 2, one line "error: ..." and no new file; returns the line."""
    before = sorted(p.name for p in folder.rglob("*"))
    capsys.readouterr()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("sys.argv", ["gash", *arguments])
        patch.setattr("gash_jax.apps.cli.keep_compiled_programs", lambda: None)  # the session's own settings stay
        with pytest.raises(SystemExit) as caught:
            main()
    captured = capsys.readouterr()
    assert caught.value.code == 2
    assert captured.err.startswith("error: ") and captured.err.count("\n") == 1, captured.err
    assert "Traceback" not in captured.err
    assert sorted(p.name for p in folder.rglob("*")) == before
    return captured.err


def test_bake_says_what_it_did(folder: Path, capsys: pytest.CaptureFixture) -> None:
    run(folder, "bake", "bumpy.ply", "-o", "spoken.npz", "--rays", "64")
    said = capsys.readouterr().out
    assert "x 64 rays" in said and "estimated relative error" in said and "wrote spoken.npz" in said


def test_compare_prints_the_contract_keys(folder: Path, capsys: pytest.CaptureFixture) -> None:
    run(folder, "compare", "bumpy.npz", "reference.npz", "--json")
    values = json.loads(capsys.readouterr().out)
    assert {"relrmse", "skill", "mse", "std", "shadow_mse", "equivalent_rays"} <= set(values)
    assert len(values["std"]) == 9
    assert 0 < values["relrmse"] < 0.2
    run(folder, "compare", "bumpy.npz", "reference.npz")
    assert "equivalent_rays" in capsys.readouterr().out


def test_a_bake_to_an_error_is_a_reference_where_it_is_much_better(folder: Path, capsys: pytest.CaptureFixture) -> None:
    for name, error in (("fine.npz", "0.005"), ("coarse.npz", "0.05")):
        run(folder, "bake", "bumpy.ply", "-o", name, "--error", error, "--quiet")
    run(folder, "bake", "bumpy.ply", "-o", "rough.npz", "--rays", "16", "--quiet")
    capsys.readouterr()
    run(folder, "compare", "rough.npz", "fine.npz", "--json")
    said = capsys.readouterr()
    values = json.loads(said.out)
    assert said.err == "" and values["reference_error"] <= 0.005
    spent = load_transfer(folder / "fine.npz")
    assert values["reference_rays"] == pytest.approx(spent.metadata["rays_total"] / len(spent.vertices), abs=1)
    assert 4 < values["equivalent_rays"] < 64
    run(folder, "compare", "bumpy.npz", "coarse.npz")
    said = capsys.readouterr()
    assert said.err.startswith("warning: coarse.npz states a relative error of ") and said.err.count("\n") == 1
    assert f"{load_transfer(folder / 'coarse.npz').metadata['estimated_error']:.4g}" in said.err
    assert "more than a quarter of the relrmse" in said.err
    assert "relrmse" in said.out


def test_info_tells_every_kind_of_file(folder: Path, capsys: pytest.CaptureFixture) -> None:
    for name, kind in (("bumpy.ply", "mesh"), ("bumpy.npz", "transfer"), ("light.npz", "light")):
        run(folder, "info", name, "--json")
        assert json.loads(capsys.readouterr().out)["kind"] == kind
    run(folder, "info", "bumpy.npz")
    assert "rays_total" in capsys.readouterr().out


def test_render_writes_a_picture_of_the_mesh(folder: Path) -> None:
    for light in ("studio.hdr", "light.npz"):
        run(folder, "render", "bumpy.npz", "--light", light, "-o", "p.png", "--size", "64", "--view", "front")
        with Image.open(folder / "p.png") as picture:
            pixels = np.asarray(picture.convert("L"), float)
        assert pixels.shape[1] >= 64
        middle = pixels[-40:-20, 20:44]
        assert middle.std() > 3 and middle.mean() > 20


@pytest.mark.parametrize("name", sorted(gash.commands))
def test_help_has_an_example_that_parses(name: str, capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as caught:
        gash.main([name, "--help"])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    example = text.split("Example:\n")[1].split()
    assert example[:2] == ["gash", name]
    load_command(name).make_context(name, example[2:])


def test_the_help_of_train_lists_configs_and_settings(capsys: pytest.CaptureFixture) -> None:
    gash.main(["train", "--help"], standalone_mode=False)
    said = " ".join(capsys.readouterr().out.split())
    assert "two-stage The GNN paper's network" in said
    assert "train.clock seconds on the wall, or CPU seconds for each core [one of wall, cpu; default 'wall']" in said
    assert 'model.name="local": model.bands SH bands B' in said


BAD_BAKES = {
    "absent.ply": "no such file",
    "folder": "folder",
    "text.ply": "error",
    "unknown.xyz": "unknown mesh format",
    "empty.ply": "no vertices",
    "points.ply": "no faces",
    "nan.ply": "not finite",
    "inf.ply": "not finite",
    "range.ply": "does not exist",
    "cut.ply": "error",
}


def _write_bad_meshes(folder: Path) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex {v}\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face {f}\nproperty list uchar int vertex_indices\nend_header\n"
    corner = "0 0 0\n1 0 0\n0 1 0\n"
    texts = {
        "text.ply": "hello, I am no mesh\n",
        "unknown.xyz": corner,
        "empty.ply": header.format(v=0, f=0),
        "points.ply": header.format(v=3, f=0) + corner,
        "nan.ply": header.format(v=3, f=1) + "nan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "inf.ply": header.format(v=3, f=1) + "inf 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "range.ply": header.format(v=3, f=1) + corner + "3 0 1 7\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    (folder / "folder").mkdir(exist_ok=True)
    whole = (folder / "bumpy.ply").read_bytes()
    (folder / "cut.ply").write_bytes(whole[: len(whole) // 2])


@pytest.mark.parametrize("name", BAD_BAKES)
def test_bad_meshes(folder: Path, capsys: pytest.CaptureFixture, name: str) -> None:
    _write_bad_meshes(folder)
    message = fail(folder, capsys, "bake", name, "-o", "bad.npz")
    assert BAD_BAKES[name] in message


BAD_CALLS = {
    "truncated npz": ("compare cut.npz reference.npz", "not a readable npz"),
    "another mesh": ("compare ball.npz reference.npz", "different meshes"),
    "other bands": ("compare four.npz reference.npz", "bands"),
    "mesh as transfer": ("compare bumpy.ply reference.npz", "not a readable npz"),
    "light as transfer": ("render light.npz --light light.npz -o x.png", "not a transfer"),
    "truncated hdr": ("light cut.hdr -o l2.npz", "truncated"),
    "text as hdr": ("light text.hdr -o l2.npz", "error"),
    "missing light": ("render bumpy.npz --light no.hdr -o x.png", "no such file"),
    "picture of another kind": (
        "render bumpy.npz --light no.hdr -o x.gif",
        "pictures are written as .png, .jpg, .jpeg",
    ),
    "rays 0": ("bake bumpy.ply -o x.npz --rays 0", "--rays"),
    "bands 99": ("bake bumpy.ply -o x.npz --bands 99", "--bands"),
    "replicates": ("bake bumpy.ply -o x.npz --rays 250", "use 248 or 252"),
    "negative seed": ("bake bumpy.ply -o x.npz --seed -1", "--seed"),
    "up": ("bake bumpy.ply -o x.npz --up w", "--up"),
    "no output folder": ("bake bumpy.ply -o no/x.npz", "does not exist"),
    "output is a folder": ("bake bumpy.ply -o .", "is a folder"),
    "no such option": ("bake bumpy.ply -o x.npz --ray 3", "--ray"),
    "no such command": ("bakes bumpy.ply", "bakes"),
    "missing argument": ("bake", "MESH"),
    "unknown config key": ("train bad.toml", "unknown key 'train.stepss'"),
    "missing config": ("train no.toml", "no such config"),
    "unknown model": ("predict bumpy.ply -o x.npz --model gpt", "no model 'gpt'"),
    "not a model": ("predict bumpy.ply -o x.npz --model bumpy.npz", "not a model"),
    "info of foreign npz": ("info foreign.npz", "not"),
}


@pytest.mark.parametrize("name", BAD_CALLS)
def test_bad_calls(folder: Path, capsys: pytest.CaptureFixture, name: str) -> None:
    (folder / "cut.npz").write_bytes((folder / "bumpy.npz").read_bytes()[:-300])
    (folder / "cut.hdr").write_bytes((folder / "studio.hdr").read_bytes()[:-500])
    (folder / "text.hdr").write_text("hello")
    (folder / "bad.toml").write_text("[train]\nstepss = 3\n")
    write_npz(folder / "foreign.npz", {"a": np.zeros(2)}, {})
    arguments, message = BAD_CALLS[name]
    assert message in fail(folder, capsys, *arguments.split())


def test_a_failed_command_keeps_an_existing_output(folder: Path, capsys: pytest.CaptureFixture) -> None:
    before = (folder / "bumpy.npz").read_bytes()
    fail(folder, capsys, "bake", "absent.ply", "-o", "bumpy.npz")
    assert (folder / "bumpy.npz").read_bytes() == before
