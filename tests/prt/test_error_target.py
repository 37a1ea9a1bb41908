"""Bakes to an error: the target is met, fewer rays are spent, and the bookkeeping is right."""

import json
from pathlib import Path

import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.measure.metrics import calibration, equivalent_rays, mse, plain_bake_curve, relrmse
from gash_jax.prt import error_target
from gash_jax.prt.allocation import PILOT, VARIANCE
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.error_target import KAPPA, MISSED, State, bake_to_error, double_rays, kappa, trace_points
from gash_jax.prt.tracing import Rows
from gash_jax.shapes.primitives import bumpy_sphere, icosphere, sphere_above_plane, spherical_bowl
from gash_jax.shapes.procedural import make_shape

MESHES = {
    "bumpy sphere": lambda: bumpy_sphere(16),
    "bowl": lambda: spherical_bowl(np.radians(60), 10),
    "generated 3": lambda: make_shape(7, 3, (1000, 1500))[1],
    "generated 5": lambda: make_shape(7, 5, (1000, 1500))[1],
}


@pytest.mark.parametrize("name", MESHES)
def test_target_is_met_with_fewer_rays_than_the_plain_bake_needs(name: str) -> None:
    mesh = MESHES[name]()
    reference = bake_transfer(mesh, rays=8192, seed=9).coefficients
    curve = plain_bake_curve(mesh, reference, 8192)
    active = np.any(mesh.normals != 0, axis=1).sum()
    for error in (0.1, 0.05, 0.02):
        baked = bake_to_error(mesh, error, seed=3)
        found = relrmse(baked.coefficients, reference)
        assert found is not None and found <= 1.2 * error
        equivalent = equivalent_rays(mse(baked.coefficients, reference), curve)
        assert isinstance(equivalent, float)
        assert baked.metadata["rays_total"] / active <= 1.1 * equivalent
        assert baked.metadata["estimated_error"] <= error


def test_error_bars_of_a_lattice_are_calibrated_on_irregular_shapes() -> None:
    errors, claimed = [], []
    for index in range(4):
        mesh = make_shape(8, index, (800, 1200))[1]
        reference = bake_transfer(mesh, rays=16384, seed=9).coefficients
        baked = bake_to_error(mesh, 0.03, seed=1)
        assert baked.standard_error is not None
        active = np.any(mesh.normals != 0, axis=1)
        partly = active & (np.abs(reference[:, 0] / 0.2820948 - 0.5) < 0.498)
        errors.append((baked.coefficients - reference)[partly])
        claimed.append(baked.standard_error[partly])
    score, coverage = calibration(np.concatenate(errors), np.concatenate(claimed))
    assert 0.8 <= score <= 1.3 and 0.9 <= coverage <= 0.99


def test_constants_are_those_that_were_measured() -> None:
    path = Path(__file__).parents[2] / "experiments" / "lattice_error" / "results.json"
    rows = json.loads(path.read_text())["rows"]
    assert [row["rays"] for row in rows] == [PILOT << level for level in range(len(KAPPA))]
    np.testing.assert_allclose(KAPPA, [row["kappa"] for row in rows], atol=0.011)
    np.testing.assert_allclose(VARIANCE, [row["variance"] for row in rows], rtol=0.01)
    missed = [row["missed"] for row in rows]
    assert min(missed) < MISSED < max(missed)


def test_kappa_by_hand() -> None:
    found = kappa(np.array([8, 16, 64, 1 << 20]))
    np.testing.assert_allclose(found, [KAPPA[0], KAPPA[1], KAPPA[3], KAPPA[-1]])


@pytest.mark.parametrize("bands", [1, 3])
def test_doubling_in_steps_traces_the_same_rays_as_all_at_once(bands: int) -> None:
    """The law of the rounds: 8 + 8 + 16 + 32 + 64 rays are the first 128 points of the lattice, quarter by quarter."""
    rng = np.random.default_rng(0)
    frames = np.linalg.qr(rng.normal(size=(40, 3, 3)))[0].astype(np.float32)
    rows = Rows(np.zeros((40, 3), np.float32), frames, rng.random((40, 1, 2), np.float32))

    def visible(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        return directions[:, 0] + 0.3 * directions[:, 1] < 0.2

    plain = np.zeros(40, np.float32)  # no blending, so that steps add up exactly
    quarters, share = trace_points(rows, plain, 0, PILOT, bands, visible)
    state = State(np.full(40, PILOT), share, quarters)
    for _ in range(4):
        state.share[:] = 0
        double_rays(state, np.ones(40, bool), rows, bands, visible)
    whole, _ = trace_points(rows, plain, 0, 128, bands, visible)
    np.testing.assert_array_equal(state.rays, 128)
    np.testing.assert_allclose(state.quarters, whole, atol=2e-6)


def test_vertices_of_several_levels_are_doubled_once() -> None:
    rows = Rows(
        np.zeros((3, 3), np.float32), np.tile(np.eye(3, dtype=np.float32), (3, 1, 1)), np.zeros((3, 1, 2), np.float32)
    )
    state = State(np.array([8, 16, 8]), np.ones(3, np.float32), np.zeros((3, 4, 1), np.float32))
    double_rays(state, np.array([True, True, False]), rows, 1, lambda origins, directions: directions[:, 2] > 0)
    np.testing.assert_array_equal(state.rays, [16, 32, 8])


def test_what_sees_everything_is_the_formula_and_is_left_alone() -> None:
    mesh = icosphere(2)
    baked = bake_to_error(mesh, 0.02)
    np.testing.assert_allclose(baked.coefficients, np.asarray(unshadowed_transfer(mesh.normals, 3)), atol=5e-7)
    assert baked.metadata["modelled"] == {"all_rays_free": 1.0, "no_ray_free": 0.0}
    assert baked.metadata["rays_total"] <= 32 * len(mesh.vertices)


def test_rays_go_where_the_shadow_is() -> None:
    """Under a sphere low above a wide plane the far probes stop early."""
    mesh = sphere_above_plane(1.0, 1.2, 8, 6)
    baked = bake_to_error(mesh, 0.02)
    rounds = baked.metadata["rounds"]
    assert rounds[0]["vertices"] > rounds[-1]["vertices"] > 0
    assert sum(entry["rays"] for entry in rounds) == baked.metadata["rays_total"]


def test_result_depends_on_the_seed_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = bumpy_sphere(8)
    first = bake_to_error(mesh, 0.05, seed=4)
    monkeypatch.setattr(error_target, "ROWS_AT_ONCE", 1 << 8)
    again = bake_to_error(mesh, 0.05, seed=4)
    np.testing.assert_allclose(first.coefficients, again.coefficients, atol=1e-6)
    assert np.any(first.coefficients != bake_to_error(mesh, 0.05, seed=5).coefficients)


def test_limits() -> None:
    mesh = bumpy_sphere(4)
    for error in (0.0, 1e-4, 1.5, float("nan")):
        with pytest.raises(ValueError, match="error must be from 0.001 to 1"):
            bake_to_error(mesh, error)
    with pytest.raises(ValueError, match="bands"):
        bake_to_error(mesh, 0.1, bands=11)


def test_a_limit_on_rays_ends_the_bake_and_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(error_target, "MOST_RAYS", 32)
    baked = bake_to_error(bumpy_sphere(8), 0.005)
    assert baked.metadata["estimated_error"] > 0.005
    assert baked.metadata["rays_total"] <= 32 * len(baked.vertices)


def test_no_usable_normal_and_progress() -> None:
    mesh = icosphere(1)
    dark = bake_to_error(mesh._replace(normals=np.zeros_like(mesh.normals)), 0.1)
    assert not dark.coefficients.any() and dark.metadata["rays_total"] == 0
    seen: list[tuple[int, int]] = []
    baked = bake_to_error(bumpy_sphere(8), 0.02, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (baked.metadata["rays_total"], baked.metadata["rays_total"])
    assert all(done <= total for done, total in seen)


def test_a_closed_room_costs_the_pilot_rays() -> None:
    """No ray is free, so no error is relative to anything: zero after the first round."""
    room = icosphere(2)
    dark = bake_to_error(room._replace(normals=-room.normals), 0.02)
    assert not dark.coefficients.any()
    assert dark.metadata["rays_total"] == PILOT * len(room.vertices)
    assert dark.metadata["modelled"]["no_ray_free"] == 1.0
