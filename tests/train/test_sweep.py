"""Sweep files: combinations, linked keys, repeats, names by content, every mistake named."""

from pathlib import Path
from typing import Any

import pytest

from gash_jax.files.settings import ConfigError
from gash_jax.train.sweep import load_sweep, run_folder

SPEC = """
name = "s"
config = "two-stage"
set = ["data.shapes=64"]
[axes.latent]
keys = ["model.channels", "model.visibility_channels"]
values = [8, 16]
[axes.depth]
keys = ["model.layers"]
values = [1, 2, 3]
[[repeats]]
seeds = [1, 2]
points = [{ latent = 8, depth = 3 }]
"""


def _write(folder: Path, text: str = SPEC) -> Path:
    path = folder / "sweep.toml"
    path.write_text(text)
    return path


def test_every_combination_once_and_the_repeats(tmp_path: Path) -> None:
    name, runs = load_sweep(_write(tmp_path))
    assert name == "s" and len(runs) == 8 and len({run.id for run in runs}) == 8
    assert [tuple(run.point.values()) for run in runs[:3]] == [(8, 1), (8, 2), (8, 3)]
    assert [(run.point, run.seed) for run in runs[6:]] == [({"latent": 8, "depth": 3}, seed) for seed in (1, 2)]
    for run in runs:
        model: Any = run.config.model
        assert model.channels == model.visibility_channels == run.point["latent"]
        assert model.layers == run.point["depth"] and run.config.data.shapes == 64
        assert run.config.train.seed == run.seed
    assert runs[-1].config.name == "s-latent8-depth3-seed2"


def test_a_changed_sweep_keeps_what_still_belongs_to_it(tmp_path: Path) -> None:
    before = {run.id for run in load_sweep(_write(tmp_path))[1]}
    more = {run.id for run in load_sweep(_write(tmp_path, SPEC.replace("[8, 16]", "[8, 16, 32]")))[1]}
    other = {run.id for run in load_sweep(_write(tmp_path, SPEC.replace("shapes=64", "shapes=32")))[1]}
    assert before < more and len(more) == 11 and not before & other


def test_names_do_not_count_and_folders_can_be_read(tmp_path: Path) -> None:
    first, renamed = (load_sweep(_write(tmp_path, SPEC.replace('"s"', f'"{name}"')))[1] for name in ("s", "t"))
    assert [run.id for run in first] == [run.id for run in renamed]
    assert first[0].config.name != renamed[0].config.name
    assert first[0].folder == f"latent_8-depth_1-seed_0-{first[0].id}"
    (tmp_path / first[0].folder).mkdir()
    assert run_folder(tmp_path, first[0].id) == tmp_path / first[0].folder
    with pytest.raises(ConfigError, match="holds no run"):
        run_folder(tmp_path, first[1].id)


def test_a_config_beside_the_sweep(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('name = "mine"\n[model]\nname = "two-stage"\nheads = 2\n')
    _, runs = load_sweep(_write(tmp_path, SPEC.replace('"two-stage"', '"mine.toml"')))
    assert runs[0].config.model.to_dict()["heads"] == 2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('name = "s"', ""), "lacks name"),
        (('name = "s"', "name = "), "not a TOML file"),
        (("values = [8, 16]", ""), "config axes.latent: .*values"),
        (("values = [8, 16]", "values = []"), "needs keys and values"),
        (('"model.layers"', '"model.lairs"'), "unknown key 'model.lairs'"),
        (("latent = 8, depth = 3", "latent = 8"), "must name every axis"),
        (('"two-stage"', '"nothing"'), "no such config"),
        (("[axes.depth]", "[axes.depth]\nword = 1"), "unknown key 'axes.depth.word'"),
        (('"data.shapes=64"', '"data.shapes"'), "key=value"),
        (("seeds = [1, 2]", "points_ = 1"), "seeds and points"),
    ],
)
def test_every_mistake_is_named(change: tuple[str, str], words: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=words):
        load_sweep(_write(tmp_path, SPEC.replace(*change)))


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such sweep file"):
        load_sweep(tmp_path / "absent.toml")
