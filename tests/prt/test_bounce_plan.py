"""Plans of bakes with bounces against what then happens."""

from pathlib import Path

import numpy as np
import pytest

from gash_jax.prt import bounce_plan
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bounce_plan import plan_bounces
from gash_jax.prt.transfer import save_transfer
from gash_jax.shapes.primitives import spherical_bowl

BOWL = spherical_bowl(np.radians(60), 8)


@pytest.mark.parametrize("coloured", [False, True])
def test_rays_hits_and_bytes_are_those_of_the_bake(
    coloured: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bounce_plan, "SAMPLE", 100)
    plan = plan_bounces(BOWL, 2, 32, coloured=coloured)
    baked = bake_transfer(BOWL, rays=32, bounces=2, albedo=(0.5, 0.5, 0.5) if coloured else 0.5)
    save_transfer(tmp_path / "t.npz", baked)
    size = (tmp_path / "t.npz").stat().st_size
    assert plan.bytes <= size <= plan.bytes + 8192
    assert (plan.rays_total, plan.sampled_vertices) == (32 * 257, 100)
    arrays = 4 * 257 * 4 * 9 * (7 if coloured else 3)
    assert plan.memory == pytest.approx(arrays + baked.metadata["bounced"]["hits_bytes"], rel=0.05)
    assert plan.reflected_rays == pytest.approx(0.75, abs=0.1) and plan.seconds > 0


@pytest.mark.parametrize("bands", [2, 4])
def test_glossy_bakes_take_as_many_rays_again_and_their_matrices(bands: int, tmp_path: Path) -> None:
    plain, plan = (plan_bounces(BOWL, 2, 32, bands=bands, glossy=glossy) for glossy in (False, True))
    baked = bake_transfer(BOWL, bands, 32, bounces=2, albedo=0.5, glossy=True)
    save_transfer(tmp_path / "t.npz", baked)
    size = (tmp_path / "t.npz").stat().st_size
    assert plan.bytes <= size <= plan.bytes + 8192
    assert plan.bytes - plain.bytes == 2 * bands**4 * 257
    assert (plan.rays_total, plan.rays_per_vertex) == (baked.metadata["rays_total"], 64)
    assert plan.memory - plain.memory == 22 * bands**4 * 257 and plan.seconds > 0


def test_matrices_of_coloured_light_are_refused_before_anything_is_traced() -> None:
    with pytest.raises(ValueError, match="give a grey albedo"):
        plan_bounces(BOWL, 1, 16, coloured=True, glossy=True)


def test_what_does_not_fit_into_memory_is_traced_again(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = plan_bounces(BOWL, 2, 32)
    hits = whole.memory - 4 * 257 * 4 * 9 * 3
    monkeypatch.setattr(bounce_plan, "MOST_KEPT", hits // 2)
    half = plan_bounces(BOWL, 2, 32)
    assert half.memory == whole.memory - hits + hits // 2
    assert half.rays_total == pytest.approx(2 * 32 * 257, rel=0.01)  # half of the rays, for each of two bounces


def test_a_mesh_without_normals_needs_nothing() -> None:
    plan = plan_bounces(BOWL._replace(normals=0 * BOWL.normals), 2)
    assert (plan.rays_total, plan.reflected_rays, plan.sampled_vertices) == (0, 0.0, 0)
    with pytest.raises(ValueError, match="bounces is 0: use a whole number from 1 to 256"):
        plan_bounces(BOWL, 0)
