"""Error bars against the truth, on every closed-form scene: what is claimed is what is found.

The probes of a scene are baked under many seeds, so that a share of 90 to 99 % can be told. Where the count of free
rays is nearly fixed by symmetry (an azimuth of exactly 90 degrees, a disk about the normal) t_00 is off by less than
a ray: there the floor is a bound, not an estimate, and only its safe side is checked.
"""

import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.measure.metrics import calibration
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.error_bars import standard_error_floor
from tests.helpers.calibration import FREE, LESS_THAN_A_RAY, scene_errors
from tests.helpers.closed_forms import ClosedFormScene, closed_form_scenes

SCENES = {scene.name: scene for scene in closed_form_scenes()}
SAMPLES = 720


def _errors(scene: ClosedFormScene, rays: int) -> tuple[np.ndarray, np.ndarray]:
    return scene_errors(scene, lambda mesh, bands, seed: bake_transfer(mesh, bands, rays, seed=seed), SAMPLES)


@pytest.mark.parametrize("name", [name for name in SCENES if name not in FREE])
def test_error_bars_are_calibrated(name: str) -> None:
    error, claimed = _errors(SCENES[name], 256)
    score, coverage = calibration(error, claimed)
    if name in LESS_THAN_A_RAY:
        assert score <= 1.3 and coverage >= 0.9
        assert np.abs(error).max() < 0.2821 * 4 / 256  # each of the four replicates is off by less than a ray
    else:
        assert 0.8 <= score <= 1.3
        assert 0.9 <= coverage <= 0.99


@pytest.mark.parametrize("name", FREE)
def test_unoccluded_scenes_are_exact_and_keep_the_floor(name: str) -> None:
    scene = SCENES[name]
    baked = bake_transfer(scene.mesh, 3, 64)
    active = np.any(scene.mesh.normals != 0, axis=1)
    np.testing.assert_allclose(baked.coefficients, np.asarray(unshadowed_transfer(scene.mesh.normals, 3)), atol=5e-7)
    assert baked.standard_error is not None
    floor = standard_error_floor(3, 64, np.ones(active.sum(), np.float32))
    np.testing.assert_array_equal(baked.standard_error[active], floor)


def test_calibration_notices_error_bars_that_are_wrong() -> None:
    """The checker on known-bad input: bars half and twice as long, and errors that share one bias."""
    error, claimed = _errors(SCENES["groove 75"], 256)
    assert calibration(error, claimed / 2)[0] > 1.3 and calibration(error, claimed / 2)[1] < 0.9
    assert calibration(error, claimed * 2)[0] < 0.8 and calibration(error, claimed * 2)[1] > 0.99
    assert calibration(error + 3 * claimed.mean(), claimed)[0] > 1.3


def test_floor_by_hand() -> None:
    """100 rays, one band up: half a ray of weight sqrt(1/4pi), sqrt(3/4pi); a fifth of it where rays differ."""
    floor = standard_error_floor(2, 100, np.array([1.0, 0.5, 0.0], np.float32))
    full = [0.0014105, 0.0024430, 0.0024430, 0.0024430]
    np.testing.assert_allclose(floor[[0, 2]], [full, full], rtol=1e-4)
    np.testing.assert_allclose(floor[1], [full[0], *(0.2 * np.array(full[1:]))], rtol=1e-4)
