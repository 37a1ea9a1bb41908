"""`gash bake --glossy`, `gash render --exponent`, `--roughness` and `gash plan --glossy`, as a user runs them."""

import json
from pathlib import Path

import click
import numpy as np
import pytest
from PIL import Image

from gash_jax.algebra.sh import evaluate_sh
from gash_jax.apps.cli import gash
from gash_jax.apps.pictures.render import render
from gash_jax.apps.pictures.views import toward_camera
from gash_jax.formats.hdr import write_hdr
from gash_jax.formats.meshes import save_mesh
from gash_jax.light.brdf import ggx, phong
from gash_jax.light.environment import load_light
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.prt.transfer import load_transfer
from gash_jax.shapes.primitives import bumpy_sphere, icosphere

RENDER = ("render", "t.npz", "--light", "studio.hdr", "-o", "t.png", "--size", "48", "--view", "front", "--quiet")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mesh, a light, a glossy bake and one that is not."""
    made = tmp_path_factory.mktemp("glossy")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(made)
        save_mesh("bumpy.ply", bumpy_sphere(8))
        write_hdr("studio.hdr", studio_light(32))
        run("bake", "bumpy.ply", "-o", "t.npz", "--glossy", "--rays", "64", "--quiet")
        run("bake", "bumpy.ply", "-o", "diffuse.npz", "--rays", "64", "--quiet")
    return made


@pytest.fixture(autouse=True)
def there(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


def run(*arguments: str) -> None:
    gash.main(list(arguments), standalone_mode=False)


def test_a_glossy_bake_is_the_diffuse_one_with_visibility(capsys: pytest.CaptureFixture) -> None:
    glossy, plain = load_transfer("t.npz"), load_transfer("diffuse.npz")
    np.testing.assert_array_equal(glossy.coefficients, plain.coefficients)
    assert glossy.visibility is not None and glossy.visibility.dtype == np.float16 and plain.visibility is None
    run("bake", "bumpy.ply", "-o", "again.npz", "--glossy", "--rays", "16")
    said = capsys.readouterr()
    assert "estimated relative error of the visibility" in said.out + said.err


def test_bounced_light_is_stored_as_matrices(capsys: pytest.CaptureFixture) -> None:
    run("bake", "bumpy.ply", "-o", "b.npz", "--glossy", "--rays", "16", "--bounces", "1", "--albedo", "0.5")
    baked = load_transfer("b.npz")
    assert baked.matrices is not None and baked.matrices.shape[1:] == (9, 9) and baked.visibility is None
    said = capsys.readouterr()
    assert "estimated relative error of the matrices" in said.out + said.err


def test_components_are_written_and_expanded() -> None:
    run("bake", "bumpy.ply", "-o", "small.npz", "--glossy", "--rays", "64", "--components", "16", "--quiet")
    small, whole = load_transfer("small.npz"), load_transfer("t.npz")
    assert small.visibility is not None and whole.visibility is not None
    assert 0 < small.metadata["compression"]["relative_error"] < 0.1
    assert np.load("small.npz")["visibility_weights"].shape == (len(whole.vertices), 16)
    assert whole.visibility_error is not None and small.visibility_error is None
    apart = np.linalg.norm(small.visibility.astype(float) - whole.visibility) / np.linalg.norm(
        whole.visibility.astype(float)
    )
    assert apart == pytest.approx(small.metadata["compression"]["relative_error"], rel=1e-3)


@pytest.mark.parametrize(("option", "lobe"), [(("--exponent", "30"), phong(30)), (("--roughness", "0.3"), ggx(0.3))])
def test_a_picture_is_that_of_render(option: tuple[str, str], lobe: object) -> None:
    run(*RENDER, *option)
    drawn = np.asarray(Image.open("t.png"))
    expected = render(load_transfer("t.npz"), load_light("studio.hdr"), lobe=lobe, size=48)  # type: ignore[arg-type]
    assert np.array_equal(drawn[-48 - 12 : -12, 12:-12], expected)
    diffuse = render(load_transfer("t.npz"), load_light("studio.hdr"), size=48)
    assert np.abs(expected.astype(int) - diffuse).max() > 30


def test_a_highlight_follows_the_camera() -> None:
    """On a sphere under a small light at +y the brightest spot lies half way to the camera."""
    mesh = icosphere(3)
    save_mesh("ball.ply", mesh)
    run("bake", "ball.ply", "-o", "ball.npz", "--glossy", "--bands", "4", "--rays", "16", "--quiet")
    transfer = load_transfer("ball.npz")
    up = np.array([[0.0, 1, 0]], np.float32)
    light = np.repeat(np.asarray(evaluate_sh(up, 4)).T, 3, axis=1)
    for view in ("front", "side", (40.0, 20.0)):
        toward = toward_camera(transfer.mesh, view)
        radiance = np.asarray(shade(transfer, light, view=toward, lobe=phong(60)))[:, 0]
        brightest = int(np.argmax(radiance))
        half = up[0] + toward[brightest]
        assert transfer.normals[brightest] @ half / np.linalg.norm(half) > np.cos(np.radians(8))
        np.testing.assert_allclose(np.linalg.norm(toward, axis=1), 1, atol=1e-6)


def test_plan_counts_rays_and_bytes(capsys: pytest.CaptureFixture) -> None:
    plans = []
    for option in ((), ("--glossy",)):
        run("plan", "bumpy.ply", "--error", "0.1", "--json", *option)
        plans.append(json.loads(capsys.readouterr().out))
    plain, glossy = plans
    assert glossy["rays_total"] == pytest.approx(2 * plain["rays_total"], rel=0.01)
    assert glossy["bytes"] - plain["bytes"] == 2 * 2 * 25 * plain["vertices"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("bake", "bumpy.ply", "-o", "x.npz", "--glossy", "--error", "0.1"), "give --rays in place of --error"),
        (("bake", "bumpy.ply", "-o", "x.npz", "--components", "4"), "give it with --glossy"),
        (("bake", "bumpy.ply", "-o", "x.npz", "--glossy", "--components", "26"), "3 bands have 25 components"),
        ((*RENDER, "--exponent", "3", "--roughness", "0.3"), "give one of them"),
    ],
)
def test_options_that_exclude_each_other(arguments: tuple[str, ...], words: str) -> None:
    with pytest.raises(click.UsageError, match=words):
        run(*arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((*RENDER, "--exponent", "-1"), "use a number of 0 or more"),
        ((*RENDER, "--roughness", "1.5"), "use a number from 0 to 1"),
        (("render", "diffuse.npz", *RENDER[2:], "--exponent", "3"), "gash bake --glossy"),
        (
            ("bake", "bumpy.ply", "-o", "x.npz", "--glossy", "--bounces", "1", "--albedo", "1,0.5,0"),
            "give a grey albedo",
        ),
        (("plan", "bumpy.ply", "--glossy", "--bounces", "1", "--albedo", "1,0.5,0"), "give a grey albedo"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(arguments: tuple[str, ...], words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        run(*arguments)
    assert "\n" not in str(caught.value)
    assert not Path("x.npz").exists()
