"""What is measured of `local` alone: measures on known values, the scripts in their quick mode, the tables."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs import local_page, local_tables, reach_tables
from experiments.local import before_after, measures, reach, trust
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.reference import Reference
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.models.model import save_model
from gash_jax.prt.transfer import Transfer
from tests.helpers.bumpy import bumpy_mesh, random_variables
from tests.helpers.first_edition import first_edition_of


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A small network that knows four bands and a bounce, with a bound."""
    config = model_config("local", channels=8, layers=1, known_bands=4, known_bounces=1)
    weights = random_variables(build_model(config), model_graph(config, bumpy_mesh(30)), spread=0.1)["params"]
    path = tmp_path_factory.mktemp("models") / "small.npz"
    save_model(path, config, weights, name="small", bound=2.0)
    return str(path)


def test_what_jumps_at_blocks_is_found() -> None:
    mesh = bumpy_mesh(600)
    _, place = measures.edges_and_places(mesh)
    smooth = (mesh.vertices @ np.ones((3, 9))).astype(np.float32)
    level = np.random.default_rng(0).normal(0, 0.3, (600, 1))[place // measures.BLOCK]
    even, jumping = (measures.jumps(mesh, smooth + step, 0 * smooth) for step in (0, level.astype(np.float32)))
    assert even["error"] is not None and even["shifted"] is not None and 0.8 < even["shifted"] < 1.2
    assert jumping["error"] > 1.5 * even["error"] and jumping["shifted"] > 1.3  # type: ignore[operator]
    assert measures.jumps(mesh, smooth, smooth)["error"] is None  # no error, no jump
    assert measures.jumps(mesh, 0 * smooth, smooth)["reference"] == pytest.approx(even["error"])


def test_relative_error_counts_what_is_dark() -> None:
    """An error of a tenth of the closed form: .1/1.05 where all arrives, .1/.05 where nothing does."""
    mesh = bumpy_mesh(40)
    formula = np.asarray(unshadowed_transfer(mesh.normals, 3))
    for arrives, expected in ((1.0, 0.1 / 1.05), (0.0, 2.0)):
        truth = np.float32(arrives) * formula
        assert measures.relative_error(mesh, truth + 0.1 * formula, truth) == pytest.approx(expected, rel=1e-4)
    dark = Mesh(mesh.vertices, 0 * mesh.normals, mesh.faces)
    assert measures.relative_error(dark, 0 * formula, 0 * formula) is None


def test_both_editions_stand_in_one_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def readers(folder: Path | None, quick: bool) -> dict[str, Any]:
        return {name: lambda: bumpy_mesh(60) for name in ("generated 1", "igea")}

    monkeypatch.setattr(before_after, "load_meshes", readers)
    monkeypatch.setattr(
        before_after, "predictions", lambda *_: dict.fromkeys(readers(None, True), np.zeros((60, 9), np.float32))
    )
    (path,) = before_after.main(None, tmp_path, quick=True)  # of igea no picture may be shown
    assert path.name == "editions_generated_1.png" and path.stat().st_size > 1000


def test_a_mesh_is_cut_without_being_changed() -> None:
    mesh = bumpy_mesh(60)
    apart = trust.cut_apart(mesh)
    for whole, cut in zip(mesh[:2], apart[:2], strict=True):
        np.testing.assert_array_equal(whole[mesh.faces], cut[apart.faces])
    assert len(mesh.vertices) < len(apart.vertices) <= 2 * len(mesh.vertices)


def test_the_bound_counts_partly_hidden_vertices_of_all_meshes_alike() -> None:
    mesh = bumpy_mesh(200)
    formula = np.asarray(unshadowed_transfer(mesh.normals, 3))
    share = np.where(np.arange(200) < 100, 1, 0.5)[:, None]  # half of them are not hidden at all
    truth = (share * formula).astype(np.float32)
    reference = Reference(truth, np.zeros_like(truth), {}, 64)

    def of(error: float) -> dict[str, Any]:
        said = np.where(share < 1, np.float32(0.01), 0) * np.ones_like(truth)
        return trust.errors(mesh, Transfer(truth + error, None, *mesh, {}, said), reference)

    found = trust.calibration({"good": of(0.01), "bad": of(0.04)}, 2.0)
    good, bad = found["meshes"]
    assert (good["inside"], bad["inside"], found["inside"]) == (1.0, 0.0, 0.5)
    assert good["partly_hidden"] == 0.5 and good["most_where_unhidden"] == 0
    np.testing.assert_allclose(found["tenths"]["said"], 0.01, rtol=1e-5)
    assert found["tenths"]["found"][0] >= 0.01 - 1e-6
    assert trust.calibration({"good": of(0.01)}, None)["inside"] is None
    told = local_tables.bounded({"calibration": found})
    assert "2.00 times" in told and "50.0% of the partly hidden vertices of all meshes, 0.0% to 100.0%" in told


def test_bands_and_bounces_of_a_network(network: str) -> None:
    row = reach.measure(network, bumpy_mesh(60), 64, 64)
    assert [entry["bands"] for entry in row["bands"]] == [1, 2, 3, 4]
    assert row["bands"][2]["relrmse"] == pytest.approx(row["relrmse"])
    assert [entry["bounces"] for entry in row["bounces"]] == [1] and row["bounces"][0]["left_out"] > 0
    assert len(reach.measure("mlp", bumpy_mesh(60), 64, 64)["bands"]) == 3  # who knows no more is asked for no more


@pytest.mark.slow
def test_reach_and_trust_are_measured_and_shown(network: str, tmp_path: Path) -> None:
    far = reach.main(network, None, tmp_path / "reach.json", quick=True)
    assert json.loads((tmp_path / "reach.json").read_text()) == far
    assert {row["kind"] for row in far["shapes"]} <= set(reach.ALL_KINDS)
    for write in (reach_tables.arriving, reach_tables.kinds, reach_tables.bands, reach_tables.bounces):
        assert write(far).count("\n|") >= 2
    trusted = trust.main(network, None, None, quick=True)
    assert all(row["seam"] == 0 < row["copies"] for row in trusted["continuity"])
    for of in trusted["convex"].values():
        assert of["difference"] < 1e-4 and of["expected"] == 0
    assert trusted["calibration"]["bound"] == 2.0 and 0 <= trusted["calibration"]["inside"] <= 1


def test_both_editions_stand_side_by_side() -> None:
    methods = {"local": {"skill": 0.9, "relrmse": 0.1, "equivalent_rays": ">= 512"}}
    results = {
        "local_first_edition": first_edition_of(["a"]),
        "neural_gash": {"rows": [{"mesh": name, "methods": methods} for name in ("a", "unknown")]},
        "local_trust": {"continuity": [{"mesh": "a", "error": 1.1, "shifted": 1.0}]},
        "local_reach": {"rows": [{"mesh": "a", "relative": 0.2}]},
        "local_speed": {"rows": []},
    }
    text = reach_tables.editions(results)
    cells = "0.500 → 0.900 | 0.5000 → 0.1000 | 0.500 → 0.200 | 0.50 → 1.10 | 0.50 → 1.00 | 0.5 → >= 512 | 0.5 → -"
    assert f"| a | {cells} |" in text and "unknown" not in text
    assert text.endswith(
        "| median | 0.500 → 0.900 | 0.5000 → 0.1000 | 0.500 → 0.200 | 0.50 → 1.10 | 0.50 → 1.00 | - | - |"
    )
    assert reach_tables.block_jump(results) == "0.50 → 1.00"


def test_missing_and_old_results_say_what_to_run(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="local_reach.json is missing: write it with .*experiments.local.reach"):
        local_page.read_result("local_reach", tmp_path)
    (tmp_path / "local_trust.json").write_text('{"machine": {}, "calibration": {}}')
    with pytest.raises(ValueError, match="local_trust.json is older than the page .*experiments.local.trust"):
        local_page.read_result("local_trust", tmp_path)
