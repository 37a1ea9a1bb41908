"""Plans against what then happens."""

import numpy as np
import pytest

from gash_jax.light.environment import project_map
from gash_jax.light.studio import studio_light
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.error_target import bake_to_error
from gash_jax.prt.light_bands import LEFT_OUT
from gash_jax.prt.plan import plan_bake, transfer_bytes
from gash_jax.prt.transfer import save_transfer
from gash_jax.shapes.primitives import bumpy_sphere, icosphere
from gash_jax.shapes.procedural import make_shape


@pytest.mark.parametrize("index", [0, 1, 2])
@pytest.mark.parametrize("error", [0.05, 0.02])
def test_predicted_rays_are_those_spent(index: int, error: float) -> None:
    """Within a third: the needle's rays depend most on the neighbours that the sample lacks."""
    mesh = make_shape(11, index, (3000, 4000))[1]
    plan = plan_bake(mesh, error)
    spent = bake_to_error(mesh, error).metadata
    assert plan.sampled_vertices == 2000
    assert plan.rays_total == pytest.approx(spent["rays_total"], rel=1 / 3)
    free = bake_transfer(mesh, 1, 1024).coefficients[:, 0] / 0.28209479
    assert plan.blocked_rays == pytest.approx(1 - free.mean(), abs=0.01)
    assert 0 < plan.occluded_share <= np.mean(free < 0.9999) + 0.03  # rays can miss a shadow, never invent one


def test_predicted_bytes_are_those_written(tmp_path) -> None:
    mesh = bumpy_sphere(16)
    save_transfer(tmp_path / "t.npz", bake_to_error(mesh, 0.1, bands=4))
    size = (tmp_path / "t.npz").stat().st_size
    assert transfer_bytes(mesh, 4) <= size <= transfer_bytes(mesh, 4) + 8192


def test_light_decides_the_bands() -> None:
    light = np.asarray(project_map(studio_light(), 10))
    plan = plan_bake(bumpy_sphere(8), 0.1, light=light, bands=7)
    assert plan.radiance_left_out is not None and 0 < plan.radiance_left_out <= LEFT_OUT
    assert plan.bands > 3
    asked = plan_bake(bumpy_sphere(8), 0.1, bands=7)
    assert (asked.bands, asked.radiance_left_out) == (7, None)


def test_convex_body_needs_no_more_than_the_pilot_rays() -> None:
    plan = plan_bake(icosphere(3), 0.05)
    assert plan.occluded_share == 0.0 and plan.blocked_rays == 0.0
    assert plan.rays_per_vertex <= 16
    blind = icosphere(1)
    blind = blind._replace(normals=np.zeros_like(blind.normals))
    assert plan_bake(blind).rays_total == 0
    assert plan_bake(blind, light=np.ones((9, 3), np.float32))[:2] == (1, 0.0)


def test_error_out_of_range() -> None:
    with pytest.raises(ValueError, match="error must be"):
        plan_bake(icosphere(0), 2.0)
