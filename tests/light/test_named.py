"""Lights by name: as the functions make them; files come first; what cannot be read is told what to write."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import gash_jax
from gash_jax.formats.picture import LightError
from gash_jax.light.named import named_light
from gash_jax.light.projection import project_map
from gash_jax.light.studio import studio_light


@pytest.mark.parametrize(
    ("text", "made"),
    [
        ("constant", lambda: gash_jax.constant_light()),
        ("constant:radiance=1,0.5,0.25", lambda: gash_jax.constant_light([1.0, 0.5, 0.25])),
        ("directional:direction=1,2,0.5", lambda: gash_jax.directional_light([1.0, 2.0, 0.5])),
        (
            "directional:irradiance=3,2,1,direction=0,-1,0",
            lambda: gash_jax.directional_light([0.0, -1, 0], [3.0, 2, 1]),
        ),
        ("sphere:position=0,4,3,radius=2,radiance=1e3", lambda: gash_jax.sphere_light([0.0, 4, 3], 2.0, 1e3)),
        ("sun-sky:elevation=10,ground=0,sun=0", lambda: gash_jax.sun_sky_light(10.0, ground=0, sun=0)),
        ("studio", lambda: gash_jax.project_light(studio_light())),
    ],
)
def test_a_name_is_what_its_function_makes(text: str, made: Callable[[], gash_jax.Light]) -> None:
    found = gash_jax.load_light(text)
    np.testing.assert_array_equal(found.coefficients, made().coefficients)
    assert found.metadata["source"] == text and found.bands == 3


def test_bands_are_those_asked_for(tmp_path: Path) -> None:
    light = gash_jax.load_light("sun-sky:elevation=60", bands=5)
    assert light.bands == 5
    gash_jax.save_light(tmp_path / "sunny.npz", light)
    again = gash_jax.load_light(tmp_path / "sunny.npz", 5)
    np.testing.assert_array_equal(again.coefficients, light.coefficients)
    assert again.metadata["source"] == "sun-sky:elevation=60"


def test_a_file_of_that_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("studio").write_bytes(b"no map")
    with pytest.raises(LightError, match="studio has no known light format"):
        gash_jax.load_light("studio")
    assert named_light("studio", 3) is not None and named_light("other", 3) is None
    np.testing.assert_array_equal(gash_jax.load_light(Path("constant")).coefficients[1:], 0)
    assert project_map(studio_light(16), 1).shape == (1, 3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sunsky", "no such file: sunsky; lights by name are constant, directional, sphere, studio, sun-sky"),
        ("sun-sky:height=3", "has no option 'height': it knows elevation, azimuth, turbidity, ground, sun"),
        ("studio:size=3", "has no option 'size': it has none"),
        ("directional", "needs direction: as in directional:direction=1,2,0.5"),
        ("sun-sky:elevation=high", "elevation of the light sun-sky is 'high': write numbers"),
        ("sun-sky:elevation=1,elevation=2", "cannot read 'elevation=2' of the light sun-sky"),
        ("constant:5", "cannot read '5' of the light constant: write constant:option=number,option=number"),
        ("constant:radiance=", "radiance of the light constant is '': write numbers"),
        ("sun-sky:elevation=91", "elevation is 91.0: use a number from 0 to 90"),
        ("constant:bands=3", "has no option 'bands'"),
    ],
)
def test_what_cannot_be_read_is_refused(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        gash_jax.load_light(text)
    assert "\n" not in str(caught.value)


def test_a_name_has_no_layout() -> None:
    with pytest.raises(LightError, match="has no layout"):
        gash_jax.load_light("studio", layout="latlong")
