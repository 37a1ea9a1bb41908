"""Comparisons of light that bounces: half a sphere, Mitsuba's rule of what is black, differences by hand."""

import numpy as np
import pytest

from experiments.interreflection.against_mitsuba import apart, baked_black, black_behind
from experiments.interreflection.run import direct_transfer, quarter_sky
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.metrics import calibration
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.rays import Hits
from tests.helpers.closed_forms import LIFT
from tests.helpers.radiosity import AXIS, PLATES, rectangles, slanted_cavity
from tests.helpers.transfer_formulas import Y00, polygon_transfer


def test_the_rim_of_half_a_sphere_sees_a_quarter_of_the_sky() -> None:
    """Within the error bars of a bake; known bad: the boundary integral, which runs through the points themselves."""
    mesh = slanted_cavity(np.pi / 2)
    exact, rim = direct_transfer(mesh), slice(-64, None)
    assert quarter_sky(mesh.normals[-1].astype(np.float64))[0] == pytest.approx(Y00 / 2)
    baked = bake_transfer(mesh, rays=256)
    assert baked.standard_error is not None
    score, covered = calibration((baked.coefficients - exact)[rim], baked.standard_error[rim])
    assert score < 1.25 and covered > 0.92
    assert 0.8 < calibration(baked.coefficients - exact, baked.standard_error)[0] < 1.25
    normals = mesh.normals[rim].astype(np.float64)
    integral = polygon_transfer(mesh.vertices[rim] + LIFT * normals, normals, mesh.vertices[rim].astype(np.float64))
    assert calibration(baked.coefficients[rim] - integral, baked.standard_error[rim])[0] > 2
    assert np.abs(mesh.normals[rim] @ AXIS).max() < 1e-6


def test_hits_whose_interpolated_normal_faces_away_go_to_the_black_face() -> None:
    """A triangle in z = 0 with normals z, z and -z: from above, a point near the third corner faces away."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    normals = np.array([[0, 0, 1], [0, 0, 1], [0, 0, -1]], np.float32)
    mesh = Mesh(corners, normals, np.array([[0, 1, 2]], np.int32))
    found = Hits(np.array([0, 0, -1]), np.array([0.2, 0.1, 0]), np.array([0.2, 0.8, 0]), np.array([1.0, 1, 1e37]))
    down = np.tile(np.array([0, 0, -1], np.float32), (3, 1))
    answer = black_behind(mesh, lambda origins, directions: found)(down, down)
    assert isinstance(answer, Hits)
    assert answer.face.tolist() == [0, 1, -1]
    up = black_behind(mesh, lambda origins, directions: found)(down, -down)
    assert isinstance(up, Hits) and up.face.tolist() == [1, 0, -1]


def test_where_normals_are_those_of_the_faces_the_rules_agree() -> None:
    """Two facing plates: the very bake, rays and all."""
    mesh = rectangles(PLATES, 4)
    first, bounced = baked_black(mesh, 1)
    baked = bake_transfer(mesh, rays=256, replicates=4, albedo=0.6, bounces=3, seed=1)
    np.testing.assert_array_equal(bounced.astype(np.float32), baked.coefficients)
    np.testing.assert_allclose(first, bake_transfer(mesh, rays=256, replicates=4, seed=1).coefficients, atol=1e-6)


def test_differences_by_hand() -> None:
    """Ours 2, theirs 1 everywhere: half; noise that the two runs do not share takes nothing from it."""
    ours = [np.full((4, 9), 2.0)] * 2
    theirs = [np.full((4, 9), 1.0)] * 2
    assert apart(ours, theirs) == pytest.approx(
        dict.fromkeys(("difference", "low", "high", "constant", "with_noise"), 0.5)
    )
    rng = np.random.default_rng(0)
    noisy = [np.full((100_000, 9), 1.0) + rng.normal(size=(100_000, 9)) for _ in range(2)]
    found = apart([np.full((100_000, 9), 2.0)] * 2, noisy)
    assert found["low"] < found["difference"] < found["high"] and found["difference"] == pytest.approx(0.5, abs=0.01)
    assert found["with_noise"] == pytest.approx(np.sqrt(2) / 2, abs=0.01)
