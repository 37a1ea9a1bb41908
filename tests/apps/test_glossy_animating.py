"""Glossy surfaces that deform, from the command line: what docs/deforming.md says runs, and what does not fit."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from gash_jax.apps.cli import gash
from gash_jax.files.atomic import FileError
from gash_jax.files.npz import read_npz
from gash_jax.files.settings import ConfigError
from gash_jax.geometry.animation import Blend
from gash_jax.light.environment import load_light
from gash_jax.models.deforming_model import load_deforming_model
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere

SECTION = (Path(__file__).parents[2] / "docs" / "deforming.md").read_text(encoding="utf-8")
SECTION = SECTION.split("## Glossy under a light\n")[1].split("\n## ")[0]
TINY = "model.size=16 model.levels=2 model.channels=2 train.steps=3 "
TINY += "data.frames=4 data.test_frames=2 data.rays=8 data.test_rays=8"


def run(*arguments: object) -> None:
    gash.main([str(argument) for argument in arguments], standalone_mode=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Blendshapes, frames of them, and what the commands of the document make of both."""
    folder = tmp_path_factory.mktemp("glossy")
    moving = blendshape_animation(bumpy_sphere(3), 0, 4, 2)
    motion = moving.motion
    assert isinstance(motion, Blend)
    commands = re.findall(r"^gash ([a-z]+ .+)$", SECTION, re.MULTILINE)
    assert [command.split()[0] for command in commands] == ["train", "evaluate", "animate", "export"]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        np.savez("face.npz", base=motion.rest, delta=motion.deltas, faces=moving.mesh.faces)
        np.savez("talk.npz", verts=np.stack(list(moving.frames())), faces=moving.mesh.faces)
        for command in commands:
            arguments = shlex.split(command.split("#")[0])
            more = {"train": TINY.split(), "evaluate": ["--rays", "64", "-o", "scores.json"]}
            run(*arguments, *more.get(arguments[0], []), "--quiet")
    return folder


@pytest.fixture(autouse=True)
def there(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


def test_the_scores_are_those_that_radiance_has() -> None:
    (row,) = json.loads(Path("scores.json").read_text())["rows"]
    trained = json.loads(Path("runs/glossy/scores.json").read_text())
    assert row["frames"] == 4 and {"accuracy", "l1", "relrmse", "flicker"} <= row.keys()
    assert {"accuracy", "l1", "relrmse"} <= trained.keys()
    assert "skill" not in row and "skill" not in trained


def test_what_is_written_says_its_light() -> None:
    arrays, metadata = read_npz("talk_lit.npz", "frames", ("radiance",))
    model, frames = load_deforming_model("runs/glossy"), np.load("talk.npz")["verts"]
    assert "coefficients" not in arrays and arrays["radiance"].shape == (*frames.shape[:2], 16, 3)
    np.testing.assert_array_equal(arrays["radiance"][2], np.asarray(model.radiance(frames[2]), np.float16))
    np.testing.assert_array_equal(arrays["vertices"], frames)
    studio = np.asarray(load_light("studio", 4).coefficients, np.float32)
    for light in (arrays["light"], model.light, load_deforming_model("glossy.npz").light):
        np.testing.assert_array_equal(light, studio)
    assert metadata["format"] == "gash-animated-radiance" and metadata["method"] == "deep-prt"


def test_info_names_the_light(capsys: pytest.CaptureFixture) -> None:
    for file, kind in (("glossy.npz", "deforming-model"), ("talk_lit.npz", "animated-radiance")):
        run("info", file, "--json")
        told = json.loads(capsys.readouterr().out)
        assert told["kind"] == kind and told["arrays"]["light"] == [16, 3]
        if kind == "deforming-model":
            assert told["run"]["data"]["light"] == "studio"


def test_the_python_example_shades_a_pose() -> None:
    (example,) = re.findall(r"```python\n(.*?)```", SECTION, re.DOTALL)
    names: dict = {}
    exec(example, names)
    assert names["shaded"].shape == (len(names["positions"]), 3) and np.any(names["shaded"])


def test_an_onnx_file_of_it_is_written(capsys: pytest.CaptureFixture) -> None:
    pytest.importorskip("onnx", reason="needs the extra onnx: pip install onnx")
    run("export", "glossy.npz", "-o", "glossy.onnx", "--quiet")
    run("info", "glossy.onnx", "--json")
    assert "radiance" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("error", "words", "arguments"),
    [
        (ConfigError, "train momo-prt or deep-prt", ("train", "deform", "data.light=studio")),
        (ValueError, "lights by name are", ("train", "momo-prt", "data.animation=talk.npz", "data.light=lamp")),
        (FileError, "which a page cannot turn: shade it", ("view", "talk_lit.npz")),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(error: type, words: str, arguments: tuple[str, ...]) -> None:
    with pytest.raises(error, match=words) as caught:
        run(*arguments, "-o", "new.html")
    assert "\n" not in str(caught.value) and not Path("new.html").exists()
