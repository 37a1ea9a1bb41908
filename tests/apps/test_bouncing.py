"""`gash bake` with bounces, points and occluders, and `gash plan --bounces`, as a user runs them."""

import json
from pathlib import Path

import click
import numpy as np
import pytest

from gash_jax.apps.cli import gash
from gash_jax.formats.meshes import load_mesh, save_mesh
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.transfer import Transfer, load_transfer
from gash_jax.shapes.primitives import patch, spherical_bowl

BOWL = spherical_bowl(np.radians(60), 4)
FLOOR = patch(np.array([-2.0, -1.1, -2]), np.array([0.0, 0, 4]), np.array([4.0, 0, 0]))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    save_mesh("bowl.ply", BOWL)
    save_mesh("floor.ply", FLOOR)
    corners = zip(BOWL.vertices, np.linspace(0, 1, len(BOWL.vertices)), strict=True)
    lines = [f"v {x} {y} {z} {c} 0 1" for (x, y, z), c in corners]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in BOWL.faces]
    Path("coloured.obj").write_text("\n".join(lines))
    np.save("albedo.npy", np.linspace(0, 1, len(BOWL.vertices)))
    np.savez("colours.npz", albedo=np.full((len(BOWL.vertices), 3), 0.5))
    np.savez("two.npz", a=np.ones(3), b=np.ones(3))
    return tmp_path


def run(*arguments: str) -> None:
    gash.main(list(arguments), standalone_mode=False)


def bake(*arguments: str) -> Transfer:
    run("bake", *arguments, "-o", "t.npz", "--rays", "16", "--quiet")
    return load_transfer("t.npz")


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("0.6", 0.6),
        ("0.9,0.5,0.2", [0.9, 0.5, 0.2]),
        ("albedo.npy", np.linspace(0, 1, 65)),
        ("colours.npz", np.full((65, 3), 0.5)),
    ],
)
def test_an_albedo_is_what_it_says(folder: Path, said: str, meant: object) -> None:
    found = bake("bowl.ply", "--bounces", "2", "--albedo", said)
    expected = bake_transfer(load_mesh("bowl.ply"), rays=16, bounces=2, albedo=meant)  # type: ignore[arg-type]
    np.testing.assert_array_equal(found.coefficients, expected.coefficients)
    assert found.metadata["parameters"]["bounces"] == 2 and found.metadata["bounced"]["hits_bytes"] > 0


def test_colours_of_the_vertices_are_srgb(folder: Path) -> None:
    found = bake("coloured.obj", "--bounces", "1", "--albedo", "vertex")
    srgb = np.stack([np.linspace(0, 1, 65), np.zeros(65), np.ones(65)], axis=1)
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    expected = bake_transfer(load_mesh("coloured.obj"), rays=16, bounces=1, albedo=linear)
    np.testing.assert_allclose(found.coefficients, expected.coefficients, atol=1e-6)
    direct = bake("coloured.obj")
    np.testing.assert_array_equal(found.coefficients[..., 1], direct.coefficients)


def test_occluders_and_points(folder: Path) -> None:
    found = bake("bowl.ply", "--occluders", "floor.ply", "--points", "floor.ply")
    expected = bake_transfer(BOWL, rays=16, occluders=[FLOOR], points=FLOOR.vertices, normals=FLOOR.normals)
    np.testing.assert_allclose(found.coefficients, expected.coefficients, atol=1e-6)
    assert len(found.vertices) == 4 and len(found.faces) == 0
    run("bake", "bowl.ply", "-o", "t.npz", "--error", "0.2", "--occluders", "floor.ply", "--quiet")
    assert len(load_transfer("t.npz").vertices) == len(BOWL.vertices)
    up = bake("bowl.ply", "--occluders", "floor.ply", "--up", "z")
    np.testing.assert_allclose(up.vertices, BOWL.vertices[:, [0, 2, 1]] * [1, 1, -1], atol=1e-7)


def test_to_an_error(folder: Path, capsys: pytest.CaptureFixture) -> None:
    run("bake", "bowl.ply", "-o", "t.npz", "--error", "0.05", "--bounces", "20", "--albedo", "0.5")
    told, transfer = capsys.readouterr().out, load_transfer("t.npz")
    assert transfer.metadata["estimated_error"] <= 0.05 and transfer.metadata["method"] == "bake to error"
    counted = transfer.metadata["counted_bounces"]
    assert counted < 20 and f"{counted} bounces: further ones would add" in told and "estimated relative error" in told
    run("bake", "bowl.ply", "-o", "t.npz", "--error", "0.05", "--bounces", "1", "--albedo", "0.5")
    assert "1 bounces: as many as were asked for" in capsys.readouterr().out


def test_a_plan_of_bounces(folder: Path, capsys: pytest.CaptureFixture) -> None:
    run("plan", "bowl.ply", "--bounces", "2", "--rays", "16", "--albedo", "0.9,0.5,0.2", "--json")
    plan = json.loads(capsys.readouterr().out)
    bake("bowl.ply", "--bounces", "2", "--albedo", "0.9,0.5,0.2")
    size = Path("t.npz").stat().st_size
    assert plan["bytes"] <= size <= plan["bytes"] + 16384 and plan["rays_total"] == 16 * 65
    run("plan", "bowl.ply", "--bounces", "2")
    said = capsys.readouterr().out
    for word in ("reflected rays", "bounces              2, 3 bands", "time", "memory", "file", "256 per vertex"):
        assert word in said


def test_coloured_light_is_compared_over_all_colours(folder: Path, capsys: pytest.CaptureFixture) -> None:
    for name, rays in (("few.npz", "16"), ("many.npz", "256")):
        run("bake", "bowl.ply", "-o", name, "--rays", rays, "--bounces", "2", "--albedo", "0.9,0.5,0.2", "--quiet")
    capsys.readouterr()
    run("compare", "few.npz", "many.npz", "--json", "--quiet")
    values = json.loads(capsys.readouterr().out)
    few, many = (load_transfer(name).coefficients for name in ("few.npz", "many.npz"))
    assert values["relrmse"] == pytest.approx(float(np.linalg.norm(few - many) / np.linalg.norm(many)), rel=1e-5)
    assert values["equivalent_rays"] == "no yardstick" and 0.5 < values["skill"] < 1
    assert len(values["mse_per_coefficient"]) == 9 and values["shadow_mse"] > 0
    for name, points in (("a.npz", "floor.ply"), ("b.npz", "floor.ply")):
        run("bake", "bowl.ply", "-o", name, "--rays", "64", "--points", points, "--quiet")
    capsys.readouterr()
    run("compare", "a.npz", "b.npz", "--json", "--quiet")
    assert json.loads(capsys.readouterr().out)["relrmse"] == 0


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--bounces", "2", "--error", "0.05"), "leave out --light and --error"),
        (("--bounces", "2", "--light", "a.hdr"), "leave out --light and --error"),
        (("--rays", "64"), "add --bounces"),
    ],
)
def test_plans_that_contradict_themselves(folder: Path, arguments: tuple[str, ...], reason: str) -> None:
    with pytest.raises(click.UsageError, match=reason):
        run("plan", "bowl.ply", *arguments)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--bounces", "2", "--auto", "--albedo", "0.5"), "give --rays or --error with --bounces"),
        (("--bounces", "2", "--albedo", "0.5", "--error", "5"), "error must be from 0.001 to 1"),
        (("--bounces", "2"), "--bounces and --albedo go together"),
        (("--albedo", "0.5"), "--bounces and --albedo go together"),
        (("--auto", "--occluders", "floor.ply"), "--auto plans a mesh alone"),
        (("--bounces", "1", "--albedo", "1.5"), "1 of 1 albedos are not from 0 to 1"),
        (("--bounces", "1", "--albedo", "0.5,0.5"), "has 2 numbers: give one, or three"),
        (("--bounces", "1", "--albedo", "none.npy"), "no such file: none.npy"),
        (("--bounces", "1", "--albedo", "bowl.ply"), "is no albedo: give a number, R,G,B, vertex"),
        (("--bounces", "1", "--albedo", "two.npz"), "two.npz holds 2 arrays"),
        (("--bounces", "1", "--albedo", "vertex"), "bowl.ply has no colours of vertices"),
        (("--bounces", "1", "--albedo", "albedo.npy", "--occluders", "floor.ply"), r"albedo has shape \(65,\)"),
        (("--occluders", "none.ply"), "no such file: none.ply"),
        (("--points", "coloured.obj"), "points are read from .ply files"),
    ],
)
def test_what_cannot_be_meant_is_refused(folder: Path, arguments: tuple[str, ...], reason: str) -> None:
    with pytest.raises(Exception, match=reason) as caught:
        run("bake", "bowl.ply", "-o", "t.npz", *arguments)
    assert not (folder / "t.npz").exists() and "\n" not in str(caught.value)


def test_no_input_is_written_over(folder: Path) -> None:
    for name, option in (("albedo.npy", "--albedo"), ("floor.ply", "--occluders"), ("floor.ply", "--points")):
        before = Path(name).read_bytes()
        more = ("--bounces", "1") if option == "--albedo" else ()
        with pytest.raises(ValueError, match="it is the input"):
            run("bake", "bowl.ply", "-o", name, option, name, *more)
        assert Path(name).read_bytes() == before
