"""Every `gash` command and the Python example of the README run as they stand (training with a tiny budget)."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from gash_jax.apps.cli import gash, load_command
from gash_jax.formats.hdr import write_hdr
from gash_jax.formats.meshes import save_mesh
from gash_jax.light.studio import studio_light
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.textured import SQUARE_OBJ

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
SWEEP = """
name = "readme"
config = "mlp"
set = ["data.shapes=2", "data.validation_shapes=1", "data.rays=16", "data.min_vertices=150",
       "data.max_vertices=300", "train.steps=2"]
[axes.width]
keys = ["model.channels"]
values = [4, 8]
"""
TINY = "train.seconds=1 train.batch_vertices=512 "
TINY += "data.shapes=2 data.validation_shapes=1 data.rays=16 data.min_vertices=150 data.max_vertices=300"


def test_readme_commands_and_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    save_mesh("bunny.ply", bumpy_sphere(10))
    for name in ("room.ply", "hero.ply"):
        save_mesh(name, bumpy_sphere(3))
    Path("chair.obj").write_text(SQUARE_OBJ)
    frames = np.stack([bumpy_sphere(3).vertices * size for size in (1, 1.5)])
    np.savez("dance.npz", verts=frames.astype(np.float32), faces=bumpy_sphere(3).faces)
    write_hdr("studio.hdr", studio_light(32))
    Path("sweep.toml").write_text(SWEEP)
    commands = re.findall(r"^gash ([a-z]+ .+)$", README, re.MULTILINE)
    assert {c.split()[0] for c in commands} == set(gash.commands) - {"demo"}
    for command in commands:
        arguments = shlex.split(command.split("#")[0])
        if arguments[0] == "serve":  # would serve for ever; tests/apps/service runs it
            load_command("serve").make_context("serve", arguments[1:])
            continue
        if arguments[0] in ("train", "corpus"):
            arguments += [*TINY.split(), "model.channels=8", "model.layers=1"]
        if arguments[0] in ("evaluate", "bench"):
            arguments += ["--rays", "64"]
        if arguments[:2] == ["bench", "frontier"]:  # all methods: tests/apps/frontier
            arguments += ["--methods", "closed-form,plain", "--rounds", "1"]
        if "--texture" in arguments:
            arguments += ["--rays", "1"]
        gash.main(arguments, standalone_mode=False)
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names: dict = {}
    exec(example, names)
    assert names["radiance"].shape == (len(names["mesh"].vertices), 3)
