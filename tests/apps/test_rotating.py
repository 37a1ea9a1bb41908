"""`--rotate` of `gash render` and `gash light`."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import gash_jax
from gash_jax.apps.cli import gash, main
from gash_jax.formats.hdr import write_hdr
from gash_jax.light.environment import load_light
from gash_jax.prt.transfer import Transfer, save_transfer
from gash_jax.shapes.primitives import icosphere


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A ball without shadows, and a map that is bright where the camera of "front" stands: at +z, its left edge."""
    monkeypatch.chdir(tmp_path)
    ball = icosphere(2)
    coefficients = np.asarray(gash_jax.unshadowed_transfer(ball.normals, 3))
    save_transfer("ball.npz", Transfer(coefficients, None, *ball, {}))
    image = np.full((16, 32, 3), 0.01, np.float32)
    image[6:10, [0, 1, 30, 31]] = 20.0
    write_hdr("behind.hdr", image)
    return tmp_path


def run(*arguments: str) -> None:
    gash.main(list(arguments), standalone_mode=False)


def brightness(*rotate: str, light: str = "behind.hdr") -> tuple[np.ndarray, float, float]:
    """The picture from the front, and how bright its left and its right half are."""
    run("render", "ball.npz", "--light", light, "-o", "p.png", "--size", "64", "--view", "front", "--quiet", *rotate)
    with Image.open("p.png") as picture:
        pixels = np.asarray(picture.convert("L"), float)
    ball = pixels[-64:]  # below the name of the view
    middle = ball.shape[1] // 2
    return pixels, ball[:, middle - 24 : middle].mean(), ball[:, middle : middle + 24].mean()


def test_positive_degrees_turn_the_light_counter_clockwise_seen_from_above(folder: Path) -> None:
    """From +z a quarter turn about +y takes the light to +x, which the front view has on its right."""
    still, left, right = brightness()
    assert abs(left - right) < 0.05 * left
    turned, left, right = brightness("--rotate", "90")
    assert right > 2 * left
    _, left, right = brightness("--rotate", "-90")
    assert left > 2 * right
    np.testing.assert_array_equal(brightness("--rotate", "0.707,0,0.707,0")[0], turned)
    np.testing.assert_array_equal(brightness("--rotate", "360")[0], still)
    assert brightness("--rotate", "180")[0].sum() < still.sum()


def test_a_light_file_turned_once_is_a_light_turned_in_the_picture(folder: Path, capsys: pytest.CaptureFixture) -> None:
    turned = brightness("--rotate", "30")[0]
    run("light", "behind.hdr", "-o", "l.npz", "--rotate", "10", "--quiet")
    run("light", "l.npz", "-o", "l2.npz", "--rotate", "20", "--quiet")
    np.testing.assert_allclose(brightness(light="l2.npz")[0], turned, atol=1.0)
    angle = np.radians(30)
    expected = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    light = load_light("l2.npz")
    np.testing.assert_allclose(light.metadata["rotation"], expected, atol=1e-12)
    np.testing.assert_allclose(
        light.coefficients, gash_jax.rotate_light(load_light("behind.hdr"), expected).coefficients, atol=1e-5
    )
    run("info", "l2.npz", "--json")
    assert json.loads(capsys.readouterr().out)["kind"] == "light"


REFUSED = {
    "y": "give degrees about +y, as in 90, or a quaternion w,x,y,z",
    "90,0": "give degrees about +y",
    "nan": "give degrees about +y",
    "1e400": "give degrees about +y",
    "": "give degrees about +y",
    "1,2,3,": "give degrees about +y",
    "1,1,0,0": "quaternion of length 1.414: divide it by its length",
    "0,0,0,0": "quaternion of length 0",
}


@pytest.mark.parametrize("command", ["render ball.npz --light behind.hdr -o x.png", "light behind.hdr -o x.npz"])
@pytest.mark.parametrize("text", REFUSED)
def test_what_is_no_rotation_is_refused_in_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, command: str, text: str
) -> None:
    monkeypatch.setattr("sys.argv", ["gash", *command.split(), "--rotate", text])
    with pytest.raises(SystemExit) as caught:
        main()
    said = capsys.readouterr()
    assert caught.value.code == 2 and said.out == ""
    assert said.err.startswith("error: ") and said.err.count("\n") == 1
    assert "--rotate" in said.err and REFUSED[text] in said.err
    assert not list(folder.glob("x.*"))
