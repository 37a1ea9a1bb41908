"""The table of methods: every entry gives settings that work or says why not, and they are what they are called."""

from typing import Any

import numpy as np
import pytest

from gash_jax.apps.frontier import methods, runtimes, traced
from gash_jax.apps.frontier.methods import METHODS, Method, Task, settings_of
from gash_jax.apps.frontier.moving import joined_reference, one_object
from gash_jax.apps.frontier.traced import Unavailable, peer_bake, pseudo_random_bake
from gash_jax.files.settings import from_dict
from gash_jax.geometry.mesh import transform
from gash_jax.measure.frontier import Outcome
from gash_jax.measure.metrics import mse
from gash_jax.measure.reference import Reference, make_reference
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.deforming_model import DeformingModel
from gash_jax.models.model import load_model, shipped_models
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.sequence import posed_meshes
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere

MESH = bumpy_sphere(5)
# the others need a library that is not there, or weights that nobody gave
MAY_LACK = ("single-stage", "open3d", "mitsuba", "warp", "pyg", "one-object", "onnx")
FEW = {"PLAIN_RAYS": (8,), "RANDOM_RAYS": (8,), "DEFAULT_RAYS": (16,), "ERRORS": (0.2,), "PEER_RAYS": (8,)}


def task(**changes: Any) -> Task:
    models = {name: load_model(name) for name in shipped_models()}
    return Task(MESH, 3, models, **changes)


@pytest.mark.slow
def test_every_method_runs_or_says_why_not(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, values in FEW.items():
        monkeypatch.setattr(methods, name, values)
    settings, skipped = settings_of(task())
    assert set(skipped) <= set(MAY_LACK) and all(skipped.values())
    still = {name for name, method in METHODS.items() if method.moving != "only"}
    assert {setting.method for setting in settings} | set(skipped) == still
    assert len({(setting.method, setting.setting) for setting in settings}) == len(settings)
    reference = make_reference(MESH, 3, 1024).coefficients
    for setting in settings:
        outcome = setting.run(1)
        assert outcome.coefficients.shape == reference.shape and outcome.coefficients.dtype == np.float32, setting
        assert 0 <= outcome.set_up < 60 and (outcome.rays is None or outcome.rays > 0), setting
        # whatever it is, it is the transfer of this mesh: wrong by less than all of it
        assert mse(outcome.coefficients, reference) < np.mean(reference**2), setting


def test_other_runtimes_say_what_jax_says() -> None:
    asked = task()
    jax_says = {n: model.predict(MESH).coefficients for n, model in asked.models.items()}
    for name in ("numpy", "onnx"):
        if name == "onnx":
            pytest.importorskip("onnxruntime")
        settings, _ = settings_of(asked, [name])
        assert {setting.setting for setting in settings} == set(jax_says)
        for setting in settings:
            found, truth = setting.run(0).coefficients, jax_says[setting.setting]
            np.testing.assert_allclose(found, truth, atol=1e-4 * np.abs(truth).max())


def test_another_tracer_gives_the_plain_bake_of_the_same_seed() -> None:
    plain = bake_transfer(MESH, 3, 16, replicates=1, seed=5).coefficients
    found = peer_bake("trimesh", MESH, 3, 16)(5)
    # a ray that only just misses an edge may be called otherwise: single rays of single vertices
    different = np.abs(found.coefficients - plain).max(axis=1) > 1e-5
    assert different.mean() < 0.02 and found.rays == 16
    other = np.abs(peer_bake("trimesh", MESH, 3, 16)(6).coefficients - plain).max(axis=1) > 1e-5
    assert other.mean() > 0.5


def test_pseudo_random_rays_have_the_error_of_a_mean_of_independent_ones() -> None:
    reference = make_reference(MESH, 3, 8192).coefficients
    errors = [mse(pseudo_random_bake(MESH, 3, rays, 3).coefficients, reference) for rays in (8, 32, 128)]
    # variance falls as 1 / rays; of 252 vertices with 9 coefficients its estimate is off by a few percent
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.2) and errors[1] / errors[2] == pytest.approx(4, rel=0.2)
    plain = mse(bake_transfer(MESH, 3, 32, replicates=1).coefficients, reference)
    assert errors[1] > 4 * plain


def test_vertices_without_a_normal_get_zero() -> None:
    mesh = MESH._replace(normals=MESH.normals.copy())
    mesh.normals[3] = 0
    for found in (pseudo_random_bake(mesh, 3, 4, 0), peer_bake("trimesh", mesh, 3, 4)(0)):
        assert not found.coefficients[3].any() and found.coefficients[4].any()
    bare = mesh._replace(normals=0 * mesh.normals)
    assert not pseudo_random_bake(bare, 3, 4, 0).coefficients.any()


def test_best_counts_join_the_usual_ones_once() -> None:
    settings, _ = settings_of(task(plain_counts=(24, 16, 24)), ["plain"])
    assert [int(setting.setting) for setting in settings] == sorted({*methods.PLAIN_RAYS, 24})


def test_what_is_missing_is_named_with_what_to_do(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.setattr(runtimes, "NUMPY_RUNTIME", tmp_path / "none.py")
    runtimes._numpy_runtime.cache_clear()
    monkeypatch.setitem(traced.TRACERS, "open3d", lambda: __import__("no_such_library"))
    settings, skipped = settings_of(task(), ["single-stage", "open3d", "numpy", "closed-form"])
    assert [setting.method for setting in settings] == ["closed-form"]
    assert "--model" in skipped["single-stage"] and "gash-jax[peers]" in skipped["open3d"]
    assert "checkout" in skipped["numpy"]
    runtimes._numpy_runtime.cache_clear()


def test_a_new_method_is_one_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    run = {"9": lambda seed: Outcome(np.zeros((len(MESH.vertices), 9), np.float32), 0.0, 9.0)}
    monkeypatch.setitem(METHODS, "guided", Method("guided bake", lambda asked: run))
    (setting,), skipped = settings_of(task(), ["guided"])
    assert (setting.method, setting.setting, skipped) == ("guided", "9", {})


def test_light_that_bounces_is_for_bakes() -> None:
    settings, skipped = settings_of(task(bounces=1, albedo=0.5), ["plain", "closed-form", "local", "error"])
    assert {setting.method for setting in settings} == {"plain", "closed-form"}
    assert skipped == dict.fromkeys(("local", "error"), "knows no light that bounces")
    found = next(setting for setting in settings if setting.setting == "8").run(2).coefficients
    truth = bake_transfer(MESH, 3, 8, bounces=1, albedo=0.5, replicates=1, seed=2).coefficients
    np.testing.assert_array_equal(found, truth)


def _frames() -> list[Any]:
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    return [MESH, transform(MESH, turn, np.zeros(3), 1.0)]


@pytest.mark.slow
def test_frames_of_an_animation_stand_one_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, values in FEW.items():
        monkeypatch.setattr(methods, name, values)
    frames = _frames()
    settings, skipped = settings_of(task(frames=frames))
    assert {setting.method for setting in settings} == {
        name for name, method in METHODS.items() if method.moving != "no" and name not in skipped
    }
    assert set(skipped) == {"single-stage", "one-object"}
    by_name = {(setting.method, setting.setting): setting.run(1).coefficients for setting in settings}
    assert all(found.shape == (2 * len(MESH.vertices), 9) for found in by_name.values())
    plain = [bake_transfer(frame, 3, 8, replicates=1, seed=1).coefficients for frame in frames]
    np.testing.assert_array_equal(by_name["plain", "8"], np.concatenate(plain))
    fresh, count = by_name["local", "local"], len(MESH.vertices)
    for setting in ("local, held", "local, one program"):
        kept = by_name["kept", setting]
        np.testing.assert_allclose(kept[:count], fresh[:count], atol=1e-4)
        # of a mesh that only turned a fresh graph is the kept one, but for surfels at equal distances
        assert mse(kept[count:], fresh[count:]) < 1e-7


def test_the_reference_of_frames_is_theirs_joined() -> None:
    one = Reference(np.ones((2, 4), np.float32), np.zeros((2, 4), np.float32), {4: 1.0, 8: 0.5}, 64)
    both = joined_reference([one, one._replace(coefficients=2 * one.coefficients, curve={4: 3.0, 8: 0.1})])
    assert both.coefficients[:, 0].tolist() == [1, 1, 2, 2] and both.curve == {4: 2.0, 8: 0.3}


def test_models_of_one_object_give_the_bands_that_are_measured_and_refuse_another_object() -> None:
    moving = blendshape_animation(MESH, 0, 6, 2)
    config: Any = from_dict(DEFORMING["momo-prt"].config, {"name": "momo-prt", "bands": 4, "rank": 2})
    baked = np.random.default_rng(0).normal(size=(6, len(MESH.vertices), 16)).astype(np.float16)
    fit = DEFORMING["momo-prt"].fit
    assert fit is not None
    models = {"cat": DeformingModel(config, fit(config, TrainingPoses(moving, [baked])), MESH, {})}
    frames = list(posed_meshes(moving))[:2]
    found = one_object(frames, models, 3)["cat"](0).coefficients
    truth = [np.asarray(models["cat"](frame.vertices))[:, :9] for frame in frames]
    np.testing.assert_array_equal(found, np.concatenate(truth))
    with pytest.raises(Unavailable, match="cat: .*this model is of one mesh"):
        one_object([bumpy_sphere(4)], models, 3)
    with pytest.raises(Unavailable, match="gash train deform"):
        one_object(frames, {}, 3)
