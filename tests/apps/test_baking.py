"""`gash bake --error`, `--auto` and `gash plan`, as a user runs them."""

import json
from pathlib import Path

import numpy as np
import pytest

from gash_jax.apps.cli import gash
from gash_jax.formats.hdr import write_hdr
from gash_jax.formats.meshes import save_mesh
from gash_jax.light.studio import studio_light
from gash_jax.prt.transfer import load_transfer
from gash_jax.shapes.primitives import bumpy_sphere


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    save_mesh("bumpy.ply", bumpy_sphere(8))
    write_hdr("studio.hdr", studio_light(32))
    return tmp_path


def run(*arguments: str) -> None:
    gash.main(list(arguments), standalone_mode=False)


def test_bake_to_an_error_writes_what_it_did(folder: Path, capsys: pytest.CaptureFixture) -> None:
    run("bake", "bumpy.ply", "-o", "t.npz", "--error", "0.05")
    said = capsys.readouterr()
    assert "estimated relative error" in said.out + said.err
    baked = load_transfer(folder / "t.npz")
    assert baked.metadata["method"] == "guided bake to error" and baked.metadata["parameters"]["error"] == 0.05
    assert baked.metadata["estimated_error"] <= 0.05
    assert sum(entry["rays"] for entry in baked.metadata["rounds"]) == baked.metadata["rays_total"]
    assert baked.metadata["modelled"]["bands"] == "3, as asked"
    assert baked.standard_error is None and np.all(np.asarray(baked.predicted_error) > 0)
    run("bake", "bumpy.ply", "-o", "u.npz", "--error", "0.05", "--unbiased", "--quiet")
    alone = load_transfer(folder / "u.npz")
    assert alone.metadata["method"] == "bake to error" and alone.predicted_error is None
    assert alone.standard_error is not None and np.all(alone.standard_error > 0)


def test_guided_bake_of_few_rays(folder: Path, capsys: pytest.CaptureFixture) -> None:
    run("bake", "bumpy.ply", "-o", "t.npz", "--guided")
    said = capsys.readouterr()
    assert "estimated relative error" in said.out + said.err
    baked = load_transfer(folder / "t.npz")
    assert baked.metadata["method"] == "guided bake" and baked.metadata["rays_total"] == 8 * len(baked.vertices)
    assert baked.predicted_error is not None and baked.metadata["modelled"]["reconstructed_over_edges"]
    with pytest.raises(ValueError, match="power of two, not 12"):
        run("bake", "bumpy.ply", "-o", "t.npz", "--guided", "--rays", "12")


def test_auto_follows_its_plan_and_the_light_decides_the_bands(folder: Path, capsys: pytest.CaptureFixture) -> None:
    run("plan", "bumpy.ply", "--light", "studio.hdr", "--error", "0.05", "--json")
    plan = json.loads(capsys.readouterr().out)
    run("bake", "bumpy.ply", "-o", "t.npz", "--auto", "--light", "studio.hdr", "--error", "0.05", "--quiet")
    baked = load_transfer(folder / "t.npz")
    assert baked.bands == plan["bands"] == baked.metadata["plan"]["bands"]
    assert 0 < plan["radiance_left_out"] <= 0.05
    assert f"leave out at most {plan['radiance_left_out']:.2%} of the radiance" in baked.metadata["modelled"]["bands"]
    assert plan["rays_total"] == pytest.approx(baked.metadata["rays_total"], rel=1 / 3)
    size = (folder / "t.npz").stat().st_size
    assert plan["bytes"] <= size <= plan["bytes"] + 16384


def test_plan_for_people(folder: Path, capsys: pytest.CaptureFixture) -> None:
    run("plan", "bumpy.ply")
    said = capsys.readouterr().out
    for word in ("occluded vertices", "bands                3 (as asked", "rays", "time", "file"):
        assert word in said


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--error", "0.05", "--rays", "64"), "choose one way"),
        (("--guided", "--unbiased"), "choose one"),
        (("--guided", "--error", "0.05"), "guided unless --unbiased"),
        (("--guided", "--glossy"), "leave out --glossy"),
        (("--auto", "--replicates", "2"), "choose one way"),
        (("--light", "studio.hdr"), "add --auto"),
    ],
)
def test_options_that_contradict_each_other(folder: Path, arguments: tuple[str, ...], reason: str) -> None:
    with pytest.raises(Exception, match=reason):
        run("bake", "bumpy.ply", "-o", "t.npz", *arguments)
    assert not (folder / "t.npz").exists()


@pytest.mark.parametrize("error", ["0", "0.0001", "2", "nan"])
def test_errors_out_of_range(folder: Path, error: str) -> None:
    with pytest.raises(ValueError, match="error must be from"):
        run("bake", "bumpy.ply", "-o", "t.npz", "--error", error)
    with pytest.raises(ValueError, match="error must be from"):
        run("plan", "bumpy.ply", "--error", error)
    assert not (folder / "t.npz").exists()
