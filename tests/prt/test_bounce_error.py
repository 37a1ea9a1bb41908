"""Light that bounces, to an error: the error holds, bounces that add nothing are left out, the most is a limit."""

from typing import Any

import numpy as np
import pytest

from gash_jax.geometry.mesh import concatenate
from gash_jax.measure.metrics import relrmse
from gash_jax.models.guided import bake_to_error
from gash_jax.prt import bounce_error
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bounce_error import bake_bounces_to_error
from gash_jax.shapes.primitives import bumpy_sphere, icosphere, patch, spherical_bowl

BOWL = spherical_bowl(np.radians(60), 8)
BUMPY = bumpy_sphere(8)


@pytest.mark.parametrize(
    ("mesh", "albedo"), [(BOWL, 0.5), (BOWL, 0.9), (BUMPY, [0.9, 0.5, 0.1])], ids=["grey", "bright", "rgb"]
)
@pytest.mark.parametrize("error", [0.1, 0.03])
def test_the_error_holds_against_all_bounces(mesh: Any, albedo: Any, error: float) -> None:
    reference = bake_transfer(mesh, rays=8192, bounces=24, albedo=albedo, seed=91).coefficients
    found = [bake_bounces_to_error(mesh, error, bounces=24, albedo=albedo, seed=seed) for seed in range(3)]
    true = [relrmse(each.coefficients, reference) or 0.0 for each in found]
    told = found[0].metadata
    assert np.sqrt(np.mean(np.square(true))) < 1.1 * error and told["estimated_error"] <= error
    assert found[0].coefficients.shape == reference.shape and found[0].standard_error is not None
    assert 1 <= told["counted_bounces"] < 24 and 0 < told["light_left_out"] <= 0.3 * error
    assert told["rays_total"] == sum(each["rays"] for each in told["rounds"])
    assert told["parameters"]["bounces"] == 24 and told["parameters"]["error"] == error


def test_what_is_left_out_is_what_further_bounces_add() -> None:
    """In a cavity: bounce n adds albedo times the share that the wall sees of itself, times what bounce n - 1 adds."""
    found = bake_bounces_to_error(BOWL, 0.05, bounces=100, albedo=0.8)
    counted = found.metadata["counted_bounces"]
    options: dict[str, Any] = {"rays": 4096, "albedo": 0.8, "seed": 91}
    some, all_ = (bake_transfer(BOWL, bounces=bounces, **options).coefficients for bounces in (counted, 60))
    assert found.metadata["light_left_out"] == pytest.approx(relrmse(some, all_), rel=0.25)


def test_the_most_is_a_limit_and_what_is_beyond_it_no_error() -> None:
    found = bake_bounces_to_error(BOWL, 0.05, bounces=2, albedo=0.9)
    assert (found.metadata["counted_bounces"], found.metadata["light_left_out"]) == (2, 0.0)
    two = bake_transfer(BOWL, rays=8192, bounces=2, albedo=0.9, seed=91).coefficients
    error = relrmse(found.coefficients, two)
    assert error is not None and error < 0.055


def test_brighter_walls_need_more_bounces_and_smaller_errors_more_rays() -> None:
    counted = [
        bake_bounces_to_error(BOWL, 0.1, bounces=50, albedo=a).metadata["counted_bounces"] for a in (0.2, 0.5, 0.9)
    ]
    assert counted == sorted(counted) and counted[0] < counted[-1] < 50
    rays = [bake_bounces_to_error(BOWL, error, bounces=2, albedo=0.5).metadata["rays_total"] for error in (0.2, 0.02)]
    assert rays[0] < rays[1]


def test_the_remainder_by_hand() -> None:
    """8 + 4 + 2 + 1 + 1/2 ...: after 2 another 2; after the first bounce the largest albedo says how much."""
    assert bounce_error._remainder([8.0, 4.0, 2.0], 0.9) == pytest.approx(2)
    assert bounce_error._remainder([8.0, 4.0], 0.75) == pytest.approx(12)
    assert bounce_error._remainder([8.0, 0.0], 0.75) == bounce_error._remainder([0.0, 0.0], 1.0) == 0
    assert bounce_error._remainder([8.0, 1.0, 1.0], 0.9) == bounce_error._remainder([8.0, 1.0], 1.0) == np.inf


def test_a_small_bright_cavity_beside_much_open_ground() -> None:
    """Its first bounce is little beside the light of the sky, and far from the last that counts."""
    far = BOWL._replace(vertices=BOWL.vertices + np.array([0, 40, 0], np.float32))
    ground = patch(np.array([-10.0, 0, -10]), np.array([0, 0, 20.0]), np.array([20.0, 0, 0]), 30)
    both = concatenate([far, ground])
    found = bake_bounces_to_error(both, 0.01, bounces=40, albedo=0.9)
    reference = bake_transfer(both, rays=4096, bounces=40, albedo=0.9, seed=91).coefficients
    error = relrmse(found.coefficients, reference)
    assert error is not None and error < 0.012 and found.metadata["counted_bounces"] > 3


def test_nothing_to_bounce_off_and_no_light() -> None:
    convex = bake_bounces_to_error(icosphere(2), 0.05, bounces=4, albedo=0.5)
    assert (convex.metadata["counted_bounces"], convex.metadata["light_left_out"]) == (1, 0.0)
    ball = icosphere(2)
    inside = ball._replace(normals=-ball.normals, faces=ball.faces[:, ::-1])
    dark = bake_bounces_to_error(inside, 0.05, bounces=4, albedo=0.5)
    assert not dark.coefficients.any() and dark.metadata["estimated_error"] == 0
    bare = bake_bounces_to_error(ball._replace(normals=0 * ball.normals), 0.05, bounces=4, albedo=0.5)
    assert not bare.coefficients.any() and bare.metadata["rays_total"] == 0


def test_receivers_and_occluders_and_the_common_way_in() -> None:
    points = BOWL.vertices[:5] * np.float32(0.9)
    scene: dict[str, Any] = {"points": points, "normals": BOWL.normals[:5], "occluders": [BUMPY]}
    found = bake_to_error(BOWL, 0.1, bounces=3, albedo=0.5, **scene)
    assert found.coefficients.shape == (5, 9) and found.metadata["parameters"]["occluders"] == 1
    for wrong, reason in (
        ({"bounces": 3}, "needs an albedo"),
        ({"albedo": 0.5}, "bounces is 0: use"),
        ({"bounces": 3, "albedo": 2}, "albedos"),
    ):
        with pytest.raises(ValueError, match=reason):
            bake_to_error(BOWL, 0.1, **wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="error must be"):
        bake_to_error(BOWL, 0, bounces=1, albedo=0.5)


def test_a_limit_on_rays_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounce_error, "MOST_RAYS", 64)
    found = bake_bounces_to_error(BOWL, 0.001, bounces=1, albedo=0.5)
    assert found.metadata["estimated_error"] > 0.001 and found.metadata["parameters"]["replicates"] == 4
