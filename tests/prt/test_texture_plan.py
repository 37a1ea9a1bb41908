"""Plans of textures against the bakes that follow."""

from pathlib import Path

import pytest

from gash_jax.prt.texture import save_texture
from gash_jax.prt.texture_bake import bake_texture
from gash_jax.prt.texture_plan import plan_texture
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.textured import SQUARE, SQUARE_UV


@pytest.mark.parametrize("rays", [8, 16])  # of 8 rays there is no standard error
def test_texels_rays_and_bytes_are_those_of_the_bake(rays: int, tmp_path: Path) -> None:
    plan = plan_texture(SQUARE, 40, rays, bands=2, uv=SQUARE_UV)
    save_texture(tmp_path / "t.npz", baked := bake_texture(SQUARE, 2, rays, size=40, uv=SQUARE_UV))
    size = (tmp_path / "t.npz").stat().st_size
    assert plan.bytes <= size <= plan.bytes + 8192
    assert plan.rays_total == baked.metadata["rays_total"] == rays * plan.texels
    assert plan.texels == (baked.coverage > 0).sum() == 1600 and plan.seconds > 0


def test_an_atlas_is_planned_as_it_is_baked() -> None:
    pytest.importorskip("xatlas", reason="needs xatlas: pip install xatlas")
    plan = plan_texture(bumpy_sphere(4), 64, 16)
    baked = bake_texture(bumpy_sphere(4), rays=16, size=64)
    assert plan.uv == "atlas" and plan.texels == (baked.coverage > 0).sum()
