"""The comparison of the variants runs in its quick mode, and the results page is made of what it writes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import corpus_sizes
from docs import results_page, trial_tables
from docs.conclusions import median_rays
from docs.method_names import method_name
from experiments.local import reach, speed, trust
from experiments.neural_gash import curves, evaluate, latency, linear, pictures, scene, stages, validation, variants
from gash_jax.measure.reference import make_reference
from gash_jax.models.examples import Item
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.models.model import Model, load_model, save_model
from tests.helpers.bumpy import bumpy_mesh, random_variables
from tests.helpers.first_edition import first_edition_of

SMALL = {"channels": 8, "layers": 1, "heads": 2, "neighbours": 6}
HEADER = (
    "latent,depth,seeds,parameters,us_per_vertex,relrmse,relrmse_std,skill,skill_std,shadow_mse,shadow_mse_std,steps"
)
SWEEP = f"""{HEADER}
8,1,3,2746,4.75,0.9,0.1,-0.2,0.05,0.02,0.001,100
16,1,1,8274,8.55,0.8,,0.1,,0.01,,90
"""


def test_every_variant_has_a_config_and_the_same_budget(tmp_path: Path) -> None:
    configs: Any = {folder.name: make() for folder, make in variants.run_configs(tmp_path).items()}
    assert list(configs) == list(variants.RUNS) and all(name == config.name for name, config in configs.items())
    short = [config for name, config in configs.items() if not name.endswith("-long")]
    assert {(c.train.seconds, c.train.clock) for c in short} == {(300.0, "cpu")}
    assert {c.data.shapes for c in short if not c.name.startswith("mlp-deep")} == {64}
    longer = [config for config in configs.values() if config not in short]
    assert {c.model.name: c.train.seconds for c in longer} == variants.LONG
    assert {c.data.shapes for c in longer} == {432} == {configs["mlp-deep-vertex"].data.shapes}


def test_runs_say_frame_and_residual(tmp_path: Path) -> None:
    """Every reading of the paper; what would be the same run twice is there once; students after their teachers."""
    configs: Any = {folder.name: make() for folder, make in variants.run_configs(tmp_path).items()}
    assert len(configs) == 7 + 3 * 6 + len(variants.TOLD) + len(variants.LONG)
    for name, run in variants.RUNS.items():
        model = configs[name].model
        assert (model.frame, model.residual) == (run.frame, run.residual)
        assert run.shown == ((model.frame, model.residual) == variants.READING)
        if name.startswith("student"):
            teacher = Path(configs[name].train.teacher).parent.name
            taught: Any = configs[teacher].model
            assert (taught.name, taught.frame, taught.residual) == ("teacher", model.frame, model.residual)
            assert list(configs).index(teacher) < list(configs).index(name)
    blind = {run.variant for run in variants.RUNS.values()} - set(variants.TOLD)
    assert not any(hasattr(configs[f"{name}-vertex"].model, "visibility_directions") for name in blind)


def test_of_a_log_the_best_validation_of_each_phase_counts(tmp_path: Path) -> None:
    def line(phase: str, step: int, loss: float, **measures: float) -> str:
        return json.dumps({"phase": phase, "step": step, "validation": loss, "cpu_seconds": 1.0, **measures})

    seen = {"balanced_accuracy": 0.7, "majority_accuracy": 0.8}
    said = {"relrmse": 0.2, "shadow_mse": 0.1}
    lines = [
        line("visibility", 100, 0.6, accuracy=0.5, **seen),
        line("visibility", 200, 0.4, accuracy=0.75, **seen),
        json.dumps({"phase": "coefficients", "step": 50, "loss": 0.0}),
        line("coefficients", 100, 0.01, skill=0.5, **said),
        line("coefficients", 200, 0.02, skill=0.25, **said),
    ]
    folder = tmp_path / "two-stage-vertex"
    folder.mkdir()
    (folder / "metrics.jsonl").write_text("\n".join(lines))
    assert validation.main(tmp_path, None)["rows"] == []  # not finished
    (folder / "model.npz").write_bytes(b"")
    result = validation.main(tmp_path, None)
    (row,) = result["rows"]
    assert (row["skill"], row["coefficients_steps"], row["accuracy"], row["visibility_steps"]) == (0.5, 100, 0.75, 200)
    table = trial_tables.validation(result)
    assert "| TransformerConv + GATv2 | frame vertex | 0.500 | 0.200 | 0.750 | 0.700 | 0.800 |" in table


def test_methods_are_called_by_what_they_are() -> None:
    assert method_name("teacher-vertex") == "GATv2, visibility given"
    assert method_name("two-stage-world-residual + AO").startswith(
        "TransformerConv + GATv2, frame world, residual; with"
    )
    assert method_name("mlp-vertex-long") == "MLP, 15 min" and method_name("closed form") == "closed form, no shadows"


def test_curves_count_minutes_from_the_start_of_each_phase(tmp_path: Path) -> None:
    def line(phase: str, seconds: float, **more: float) -> str:
        return json.dumps({"phase": phase, "cpu_seconds": seconds, **more})

    lines = [
        line("visibility", 60.0, loss=1.0),
        line("visibility", 180.0, validation=0.5, balanced_accuracy=0.7),
        line("coefficients", 600.0, loss=1.0),
        line("coefficients", 660.0, validation=0.5, skill=0.25),
        line("coefficients", 780.0, validation=0.4, skill=0.5),
    ]
    for name in ("two-stage-vertex-long", "two-stage-vertex"):  # the second did not have long
        (tmp_path / name).mkdir()
        (tmp_path / name / "metrics.jsonl").write_text("\n".join(lines))
    result = curves.main(tmp_path, tmp_path / "curves.json")
    assert [row["curve"] for row in result["rows"]] == [[[2.0, 0.7]], [[1.0, 0.25], [3.0, 0.5]]]
    assert (tmp_path / "curves.png").stat().st_size > 5000


@pytest.fixture(scope="module")
def shapes() -> tuple[list[Item], list[Item]]:
    return linear.corpus(quick=True)


@pytest.mark.parametrize(("frame", "residual"), linear.ENDS)
def test_a_linear_fit_finds_the_map_that_made_its_labels(
    frame: str, residual: bool, shapes: tuple[list[Item], list[Item]]
) -> None:
    items, unseen = shapes
    weights = np.random.default_rng(0).normal(0, 0.1, (26, 9))
    made = linear.LinearMap(weights, frame, residual)
    labelled = [item._replace(coefficients=linear.predict(made, item.mesh)) for item in items]
    found = linear.fit(labelled, frame, residual)
    predicted = linear.predict(found, unseen[0].mesh)
    np.testing.assert_allclose(predicted, linear.predict(made, unseen[0].mesh), atol=1e-4)


def test_in_the_frame_of_the_vertex_a_linear_fit_is_residual_anyway(shapes: tuple[list[Item], list[Item]]) -> None:
    items, unseen = shapes
    plain, residual = (linear.predict(linear.fit(items, "vertex", r), unseen[0].mesh) for r in (False, True))
    np.testing.assert_allclose(plain, residual, atol=1e-4)


def test_the_linear_row_is_worth_something_in_the_frame_of_the_vertex_alone(tmp_path: Path) -> None:
    result = linear.main(tmp_path / "linear.json", quick=True)
    first = {(row["frame"], row["residual"]): row["skills"][0] for row in result["rows"]}
    assert first["vertex", False] > 0.8 > 0 > first["world", False] > first["mixed", False]
    assert (tmp_path / "linear.json").stat().st_size > 500


@pytest.mark.parametrize("frame", ["vertex", "world"])
def test_skill_of_stage_two_by_what_it_is_told(frame: str) -> None:
    mesh = bumpy_mesh(60)
    small: Any = {"channels": 8, "layers": 1, "heads": 2, "neighbours": 6, "frame": frame, "residual": True}
    sizes: Any = {"visibility_channels": 8, "visibility_layers": 1}
    reference = make_reference(mesh, rays=64)
    for config in (model_config("teacher", **small), model_config("two-stage", **small, **sizes)):
        weights = random_variables(build_model(config), model_graph(config, mesh), spread=0.1)["params"]
        model = Model(config, weights)
        skills, own = (
            stages.stage_two_skills(model, mesh, reference),
            evaluate.score(np.asarray(model(mesh)), mesh, reference),
        )
        usual = "predicted" if config.name == "two-stage" else "traced"
        assert skills[f"skill_{usual}"] == pytest.approx(own["skill"], abs=1e-4)
        assert set(skills) == {f"skill_{name}" for name in ("traced", usual, "constant")}
        assert len(set(skills.values())) == len(skills)
    assert stages.stage_two_skills(load_model("mlp"), mesh, reference) == {}


@pytest.mark.slow
def test_the_page_is_made_of_the_experiments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluate, "GENERATED", {"generated 1": (11, 4)})
    options = {"visibility_channels": 8, "visibility_layers": 1, **SMALL}
    for config in (model_config("mlp", channels=8, layers=1), model_config("two-stage", **options)):  # type: ignore[arg-type]
        weights = random_variables(build_model(config), model_graph(config, bumpy_mesh(30)))["params"]
        for name in (f"{config.name}-vertex", f"{config.name}-world"):
            (tmp_path / name).mkdir()
            save_model(tmp_path / name / "model.npz", config, weights, name=name)
    result = evaluate.main(tmp_path, None, tmp_path / "results.json", quick=True)
    moving = scene.main(tmp_path, None, tmp_path / "scene.json", quick=True)
    assert (tmp_path / "results.json").stat().st_size > 1000 and (tmp_path / "scene.json").stat().st_size > 1000
    times = latency.main(str(tmp_path / "two-stage-vertex" / "model.npz"), None, tmp_path / "latency.json", quick=True)
    assert all(row["stage1"] > 0 and row["bake"] > 0 for row in times["rows"])
    (picture,) = pictures.main(None, tmp_path, quick=True)
    assert picture.name == "generated_1.png" and picture.stat().st_size > 1000
    (tmp_path / "sweep.csv").write_text(SWEEP)
    trusted = trust.main("local", None, tmp_path / "trust.json", quick=True)
    assert all(row["same_max"] < 1e-4 and row["rebuilt_rms"] < 5e-3 for row in trusted["equivariance"])
    assert all(row["rotor"]["moved"] < 1e-4 < 0.1 < row["rotor"]["turned"] for row in trusted["equivariance"])
    assert all(of["difference"] < 1e-4 for of in trusted["convex"].values())
    fast = speed.main("local", None, None, tmp_path / "speed.json", quick=True)
    assert all(row["network"] > 0 for row in fast["rows"]) and fast["sizes"][0]["vertices"] == 10242
    assert all(row["bake, 64 rays"]["flicker"] > 0 for row in fast["motions"].values())
    results = {"neural_gash": result, "latency": times, "scene": moving, "local_trust": trusted, "local_speed": fast}
    # of a network that is quick to measure; test_local.py measures one that knows more
    results["local_reach"] = reach.main("mlp", None, None, quick=True)
    results["local_first_edition"] = first_edition_of(["generated 1"])
    run = {"form": "gnn", "encoding": "motor", "seed": 0, "parameters": 1, "steps": 2, "skill": 0.5, "commit": "c"}
    committed = Path(results_page.__file__).parent / "results"
    kept = ("calibration", "error_target", "versor_speed")
    results |= {name: json.loads((committed / f"{name}.json").read_text()) for name in kept}
    results["cga"] = {**{key: result[key] for key in ("machine", "commit")}, "rows": [{**run, "meshes": {"a": 0.25}}]}
    text = results_page.page(results, tmp_path / "sweep.csv")
    assert (
        "<!--" not in text
        and "| TransformerConv + GATv2; with ambient occlusion |" in text
        and "| 8 | 1 | 2746 | 4.8 | 0.900 ± 0.100 |" in text
    )
    (row,) = result["rows"]
    assert row["methods"]["closed form"]["skill"] == pytest.approx(0.0, abs=1e-6)
    assert f"{row['methods']['local']['skill']:.3f}" in text
    told = row["methods"]["two-stage-vertex"]
    assert told["skill_predicted"] == pytest.approx(told["skill"], abs=1e-3) and "majority_accuracy" in told
    assert "graph_us" in told and "graph_us" not in row["methods"]["two-stage-world"]
    assert "| linear in 25 rays, frame vertex |" in text and "| linear in 25 rays, frame world |" not in text
    skills = [f"{row['methods'][name]['skill']:.2f}" for name in ("two-stage-vertex", "two-stage-world")]
    assert f"| TransformerConv + GATv2 | {skills[0]} ({skills[0]}) | - | {skills[1]} ({skills[1]}) | - | - |" in text
    renewed = evaluate.renew(["mlp-vertex"], tmp_path, None, tmp_path / "results.json", quick=True)
    assert renewed["rows"][0]["methods"]["mlp-vertex"]["skill"] == pytest.approx(row["methods"]["mlp-vertex"]["skill"])
    assert "Measured later: MLP:" in results_page.renewed(renewed)


def test_sizes_of_the_corpora() -> None:
    base, local = corpus_sizes.main(None, quick=True)["rows"]
    assert (base["asked"], local["asked"]) == ([1000, 10000], [200, 10000])
    assert 0.6 * 1000 < base["least"] <= base["median"] <= base["most"] < 1.5 * 10000


def test_median_of_equivalent_rays_knows_bounds() -> None:
    assert median_rays(["< 4", 8.25, ">= 512"]) == "8.2"
    assert median_rays(["< 4", "< 4", 16.0]) == "< 4"


def test_the_moving_scene_keeps_its_vertices() -> None:
    first, second = scene.frames(2, 150)
    assert (first.faces == second.faces).all()
    moved = (first.vertices != second.vertices).any(axis=1)
    assert 0.1 < moved.mean() < 0.6
