"""`gash light` and `gash render` as users call them: names, what is said of a light, windows, negative pixels."""

from pathlib import Path

import numpy as np
import pytest

import gash_jax
from gash_jax.apps.cli import gash, main
from gash_jax.formats.hdr import write_hdr
from gash_jax.light.environment import load_light
from gash_jax.light.layouts import pixel_directions
from gash_jax.prt.transfer import Transfer, save_transfer
from gash_jax.shapes.primitives import icosphere


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A ball without shadows."""
    monkeypatch.chdir(tmp_path)
    ball = icosphere(2)
    save_transfer("ball.npz", Transfer(np.asarray(gash_jax.unshadowed_transfer(ball.normals, 3)), None, *ball, {}))
    return tmp_path


def run(*arguments: str) -> None:
    gash.main(list(arguments), standalone_mode=False)


def test_a_light_by_name_is_written_and_described(folder: Path, capsys: pytest.CaptureFixture) -> None:
    run("light", "sun-sky:elevation=30,azimuth=90", "-o", "sunny.npz", "--bands", "4")
    said = capsys.readouterr().out
    assert "azimuth 90 degrees from +z towards +x" in said and "degrees above the horizon" in said
    assert "its 4 bands ring, down to -" in said and "--window radiance" in said
    assert load_light("sunny.npz", 4).metadata["source"] == "sun-sky:elevation=30,azimuth=90"
    run("light", "constant", "-o", "even.npz")
    said = capsys.readouterr().out
    assert "most light" not in said and "ring" not in said


def test_a_map_that_is_upside_down_is_noticed(folder: Path, capsys: pytest.CaptureFixture) -> None:
    sky = np.repeat(np.clip(pixel_directions(16, 32)[..., 1:2], 0, 1) + 0.1, 3, axis=-1).astype(np.float32)
    write_hdr("sky.hdr", sky)
    write_hdr("turned.hdr", sky[::-1])
    run("light", "sky.hdr", "-o", "l.npz")
    assert "90 degrees above the horizon" in capsys.readouterr().out
    run("light", "turned.hdr", "-o", "l.npz")
    assert "90 degrees below the horizon: flip the rows of the map if it is upside down" in capsys.readouterr().out


def test_negative_pixels_are_counted_and_a_window_removes_them(folder: Path, capsys: pytest.CaptureFixture) -> None:
    sun = "directional:direction=0,0,1"  # behind the camera, which then sees none of the dark side's dip from the back
    run("render", "ball.npz", "--light", sun, "-o", "a.png", "--size", "48", "--view", "back")
    said = capsys.readouterr().out
    assert "pixels of the mesh are negative in a colour (" in said and "--window radiance avoids it" in said
    for window, words in (("radiance", "keeps 0.50 of l = 1 and 0.10 of l = 2"), ("irradiance", "keeps 0.58 of l = 1")):
        run("render", "ball.npz", "--light", sun, "-o", "b.png", "--size", "48", "--view", "back", "--window", window)
        said = capsys.readouterr().out
        assert words in said and "negative" not in said
    run("render", "ball.npz", "--light", sun, "-o", "c.png", "--size", "48", "--view", "back", "--quiet")
    assert capsys.readouterr().out == ""


def test_the_python_picture_takes_the_window(folder: Path) -> None:
    transfer, sun = gash_jax.load_transfer("ball.npz"), gash_jax.directional_light([0.0, 0, 1])
    plain, damped = (
        gash_jax.render(transfer, sun, exposure=1.0, camera="back", size=32, window=w).astype(int)
        for w in (None, "hann")
    )
    assert np.abs(plain - damped).max() > 5


@pytest.mark.parametrize("size", [(4, 8), (1, 2), (64, 128)])
def test_one_pixel_suns_and_small_maps(folder: Path, size: tuple[int, int], capsys: pytest.CaptureFixture) -> None:
    image = np.full((*size, 3), 1e-3, np.float32)
    image[0, 0] = 6e4
    write_hdr("sun.hdr", image)
    run("render", "ball.npz", "--light", "sun.hdr", "-o", "a.png", "--size", "32", "--window", "radiance")
    assert "negative" not in capsys.readouterr().out


def test_black_light_is_said_to_be_black(folder: Path, capsys: pytest.CaptureFixture) -> None:
    write_hdr("black.hdr", np.zeros((4, 8, 3), np.float32))
    run("light", "black.hdr", "-o", "l.npz")
    assert "the light is black" in capsys.readouterr().out
    for window in ("radiance", "irradiance", "hann"):
        run("render", "ball.npz", "--light", "l.npz", "-o", "a.png", "--size", "32", "--window", window)
        assert "negative" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("light", "sun-sky:elevation=100", "-o", "l.npz"), "elevation is 100.0: use a number from 0 to 90"),
        (("light", "moon", "-o", "l.npz"), "lights by name are constant, directional, sphere, studio, sun-sky"),
        (("light", "studio", "-o", "l.npz", "--layout", "cross"), "has no layout"),
        (("render", "ball.npz", "--light", "studio", "-o", "l.npz.png", "--window", "box"), "hann"),
    ],
)
def test_mistakes_are_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, arguments: tuple, words: str
) -> None:
    monkeypatch.setattr("sys.argv", ["gash", *arguments])
    with pytest.raises(SystemExit) as left:
        main()
    error = capsys.readouterr().err
    assert left.value.code == 2 and error.startswith("error: ") and error.count("\n") == 1 and words in error
    assert not Path("l.npz").exists() and not Path("l.npz.png").exists()
