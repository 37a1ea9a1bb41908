"""`gash bake --texture` and what the other commands do with its file, as a user runs them."""

import json
from pathlib import Path

import click
import numpy as np
import pytest
from PIL import Image

from gash_jax.apps.cli import gash
from gash_jax.formats.hdr import write_hdr
from gash_jax.formats.meshes import save_mesh
from gash_jax.light.studio import studio_light
from gash_jax.prt.texture import load_texture
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.textured import SQUARE_OBJ


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "square.obj").write_text(SQUARE_OBJ)
    (tmp_path / "doubled.obj").write_text(SQUARE_OBJ.replace("1/1 3/3 4/4", "1/1 3/2 4/3"))
    (tmp_path / "tiled.obj").write_text(SQUARE_OBJ.replace("vt 1 1", "vt 3 3"))
    save_mesh("plain.ply", bumpy_sphere(4))
    write_hdr("studio.hdr", studio_light(32))
    return tmp_path


def run(*arguments: str) -> None:
    gash.main(list(arguments), standalone_mode=False)


def test_bake_render_and_info(folder: Path, capsys: pytest.CaptureFixture) -> None:
    run("bake", "square.obj", "-o", "t.npz", "--texture", "8", "--rays", "16", "--bands", "2")
    said = capsys.readouterr()
    said = said.out + said.err
    assert "texture 8 x 8: 64 texels (100%) x 16 rays = 0.00102 M rays" in said and "texture coordinates: own" in said
    texture = load_texture(folder / "t.npz")
    assert texture.texture.shape == (8, 8, 4) and texture.metadata["health"]["faces"] == 2
    run("render", "t.npz", "--light", "studio.hdr", "-o", "t.png", "--size", "32", "--view", "front")
    picture = np.asarray(Image.open(folder / "t.png"))
    assert picture.std() > 5
    capsys.readouterr()
    run("info", "t.npz", "--json")
    told = json.loads(capsys.readouterr().out)
    assert told["kind"] == "transfer-texture" and told["arrays"]["texture"] == [8, 8, 4]


def test_bounces_in_colour_and_up(folder: Path) -> None:
    options = ("--bounces", "1", "--albedo", "0.8,0.5,0.2", "--up", "z", "--quiet")
    run("bake", "square.obj", "-o", "t.npz", "--texture", "4", "--rays", "16", *options)
    texture = load_texture(folder / "t.npz")
    assert texture.texture.shape == (4, 4, 9, 3)
    np.testing.assert_allclose(texture.normals, np.tile([0, 1, 0], (4, 1)), atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("doubled.obj", "--texture", "64"), "overlap"),
        (("tiled.obj", "--texture", "64"), "several tiles"),
        (("plain.ply", "--texture", "64", "--uv", "own"), "no texture coordinates"),
        (("square.obj", "--texture", "5000"), "5000"),
        (("square.obj", "--texture", "8", "--error", "0.1"), "--texture"),
        (("square.obj", "--texture", "8", "--auto"), "--texture"),
        (("square.obj", "--texture", "8", "--glossy"), "--texture"),
        (("square.obj", "--texture", "8", "--points", "plain.ply"), "--texture"),
        (("square.obj", "--uv", "own"), "--texture 512"),
    ],
)
def test_what_is_refused_writes_nothing(folder: Path, arguments: tuple[str, ...], words: str) -> None:
    with pytest.raises((ValueError, click.ClickException), match=words) as refusal:
        run("bake", *arguments, "-o", "t.npz")
    assert "\n" not in str(refusal.value) and not (folder / "t.npz").exists()


def test_a_plan_of_a_texture(folder: Path, capsys: pytest.CaptureFixture) -> None:
    run("plan", "square.obj", "--texture", "32", "--rays", "16", "--json")
    plan = json.loads(capsys.readouterr().out)
    run("bake", "square.obj", "-o", "t.npz", "--texture", "32", "--rays", "16", "--quiet")
    size = (folder / "t.npz").stat().st_size
    assert plan["bytes"] <= size <= plan["bytes"] + 16384 and plan["uv"] == "own"
    assert plan["rays_total"] == load_texture(folder / "t.npz").metadata["rays_total"] == 16 * plan["texels"]
    run("plan", "square.obj", "--texture", "32", "--rays", "16")
    assert "texels               1024, 100% of 32 x 32 (texture coordinates: own)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("square.obj", "--texture", "8", "--error", "0.1"), "leave out --bounces, --glossy, --light and --error"),
        (("square.obj", "--texture", "8", "--glossy"), "leave out --bounces"),
        (("square.obj", "--uv", "own"), "--texture 512"),
        (("plain.ply", "--texture", "8", "--uv", "own"), "no texture coordinates"),
        (("doubled.obj", "--texture", "64"), "overlap"),
    ],
)
def test_plans_of_textures_that_cannot_be(folder: Path, arguments: tuple[str, ...], words: str) -> None:
    with pytest.raises((ValueError, click.ClickException), match=words) as refusal:
        run("plan", *arguments)
    assert "\n" not in str(refusal.value)


def test_other_commands_say_that_it_is_a_texture(folder: Path) -> None:
    run("bake", "square.obj", "-o", "t.npz", "--texture", "4", "--rays", "16", "--quiet")
    with pytest.raises(click.UsageError, match="is a texture"):
        run("render", "t.npz", "--light", "studio.hdr", "-o", "t.png", "--exponent", "10")
    with pytest.raises(ValueError, match="not a transfer file"):
        run("compare", "t.npz", "t.npz")
    damaged = (folder / "t.npz").read_bytes()
    (folder / "t.npz").write_bytes(damaged[:-300])
    with pytest.raises(ValueError, match="truncated"):
        run("render", "t.npz", "--light", "studio.hdr", "-o", "t.png")
    assert not (folder / "t.png").exists()
