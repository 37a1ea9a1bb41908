"""Gloss: against quadrature of the integral that it is, by hand, at the ends of its range, transforms, refusals."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.closed_forms import hemisphere
from gash_jax.algebra.sh import band_index
from gash_jax.light.brdf import Lobe, ggx, phong
from gash_jax.light.environment import project_map
from gash_jax.light.gloss import arriving_radiance, glossy_radiance, reflected_radiance
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.prt.glossy import glossy_matrices
from gash_jax.prt.transfer import Transfer
from tests.helpers.gloss import cut_lobe, half_sphere, harmonics, mirrored, viewers


def sphere(count: int, bands: int) -> Transfer:
    """Points of the unit sphere that nothing shadows; the last has no normal."""
    n = np.random.default_rng(0).normal(size=(count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    n[-1] = 0
    high = 2 * bands - 1
    seen = harmonics(n, high) * np.array([hemisphere(int(band)) for band in band_index(high)])
    seen[-1] = 0
    normals, seen = n.astype(np.float32), seen.astype(np.float32)
    nothing = np.zeros((count, bands**2), np.float32)
    return Transfer(nothing, None, normals, normals, np.zeros((0, 3), np.int32), {}, visibility=seen)


def light_of(bands: int) -> np.ndarray:
    return project_map(studio_light(32), bands)


@pytest.mark.parametrize("angle", [0.0, 45.0, 75.0])
@pytest.mark.parametrize(("bands", "lobe"), [(1, phong(30)), (3, ggx(0.4)), (4, phong(30)), (6, phong(0))])
def test_sphere_is_the_integral_of_lobe_horizon_and_light_cut_to_its_bands(
    bands: int, lobe: Lobe, angle: float
) -> None:
    """Quadrature of K_B [n.w > 0] L_B: exact, as the product is a polynomial on the hemisphere."""
    transfer, light = sphere(6, bands), light_of(bands)
    normals = transfer.normals.astype(np.float64)
    toward = viewers(normals, angle)
    found = np.asarray(shade(transfer, light, view=toward, lobe=lobe))
    expected = np.zeros_like(found)
    for vertex, axis in enumerate(mirrored(normals, toward)[:-1]):
        w, area = half_sphere(normals[vertex])
        kernel = cut_lobe(w @ axis, np.asarray(lobe.factors)[:bands])
        expected[vertex] = (area * kernel) @ (harmonics(w, bands) @ light)
    np.testing.assert_allclose(found, expected, atol=2e-6 * bands**2)


@pytest.mark.parametrize(("angle", "least"), [(0.0, 0.03), (75.0, 0.1)])
def test_the_prefiltered_map_is_another_thing(angle: float, least: float) -> None:
    """sum k_l L_lm Y_lm(r) knows no horizon: the two differ even where nothing is in the way."""
    transfer, light = sphere(200, 4), light_of(4)
    normals = transfer.normals[:-1].astype(np.float64)
    toward = viewers(normals, angle)
    found = np.asarray(shade(transfer, light, view=np.vstack([toward, [0, 0, 1]]), lobe=phong(30)))[:-1]
    factors = np.asarray(phong(30).factors)[band_index(4)]
    map_alone = harmonics(mirrored(normals, toward), 4) @ (factors[:, None] * light)
    assert np.sqrt(np.mean((found - map_alone) ** 2) / np.mean(found**2)) > least


def test_by_hand() -> None:
    """n = z and a viewer along z + x: the mirror direction is z - x. One band: M_00 L_0 Y_00 with M_00 = 2 pi / 4 pi.
    Light and lobe of two bands: r enters as (y, z, x)."""
    up = np.array([[0.0, 0, 1]], np.float32)
    factors = np.array([1, 0.5, 0.5, 0.5])
    matrices = np.eye(4, dtype=np.float32)[None]
    mirror = Transfer(np.zeros((1, 4), np.float32), None, up, up, np.zeros((0, 3), np.int32), {}, matrices=matrices)
    light = np.array([[1.0, 2, 3], [10, 0, 0], [0, 10, 0], [0, 0, 10]], np.float32)
    found = np.asarray(shade(mirror, light, view=np.array([[1.0, 0, 1]]), lobe=Lobe(factors)))
    zero, one = 0.5 / np.sqrt(np.pi), 0.5 * np.sqrt(3 / (4 * np.pi))
    half = np.sqrt(0.5)
    np.testing.assert_allclose(found, [[zero, 2 * zero + 10 * one * half, 3 * zero - 10 * one * half]], atol=1e-6)
    open_sky = sphere(2, 1)
    constant = np.array([[2 * np.sqrt(np.pi), 0, 0]])
    found = np.asarray(shade(open_sky, constant, view=np.array([0.0, 9, 0]), lobe=phong(5)))
    np.testing.assert_allclose(found, [[0.5, 0, 0], [0, 0, 0]], atol=1e-6)


def test_a_camera_is_its_directions_and_matrices_are_their_visibility() -> None:
    transfer, light, lobe = sphere(9, 3), light_of(4), phong(12)
    assert transfer.visibility is not None
    eye = np.array([1.0, 2, 6], np.float32)
    toward = 3 * (eye - transfer.vertices)  # of any length
    found = shade(transfer, light, view=eye, lobe=lobe)
    np.testing.assert_allclose(found, shade(transfer, light, view=toward, lobe=lobe), atol=1e-6)
    held = transfer._replace(visibility=None, matrices=np.asarray(glossy_matrices(transfer), np.float16))
    np.testing.assert_allclose(shade(held, light, view=eye, lobe=lobe), found, atol=2e-3)
    half = transfer._replace(visibility=transfer.visibility.astype(np.float16))
    np.testing.assert_allclose(shade(half, light, view=eye, lobe=lobe), found, atol=2e-3)
    both = held._replace(visibility=transfer.visibility * 0)
    np.testing.assert_array_equal(shade(both, light, view=eye, lobe=lobe), shade(held, light, view=eye, lobe=lobe))
    wanted = np.einsum("vij,jc->vic", glossy_matrices(transfer), light[:9])
    np.testing.assert_allclose(arriving_radiance(transfer, jnp.asarray(light[:9])), wanted, atol=1e-5)


def test_albedo_and_window_act_as_for_diffuse_light() -> None:
    transfer, light, view = sphere(4, 2), light_of(2), np.array([0.0, 0, 5])
    gloss = {"view": view, "lobe": phong(3)}
    plain, window = np.asarray(shade(transfer, light, **gloss)), np.array([1, 0.5, 0.5, 0.5], np.float32)
    gold = np.array([1.0, 0.8, 0.3], np.float32)
    np.testing.assert_allclose(shade(transfer, light, gold, **gloss), plain * gold, atol=1e-6)
    damped = shade(transfer, light * window[:, None], **gloss)
    np.testing.assert_allclose(shade(transfer, light, window=window, **gloss), damped, atol=1e-6)


@pytest.mark.parametrize("exponent", [0, 1e4])
def test_hard_ends(exponent: float) -> None:
    """Black light is black, no normal is black, a viewer at the vertex, below it or at the horizon is no trouble."""
    transfer, light = sphere(5, 4), light_of(4)
    assert not np.any(shade(transfer, 0 * light, view=np.zeros(3), lobe=phong(exponent)))
    normals = transfer.normals.astype(np.float64)
    views = [viewers(normals, angle) for angle in (0, 90, 180)]
    for view in (*views, np.zeros((5, 3)), transfer.vertices[0]):
        found = np.asarray(shade(transfer, light, view=view, lobe=phong(exponent)))
        assert np.isfinite(found).all() and not np.any(found[-1])


def test_transforms() -> None:
    transfer, light, eye = sphere(4, 2), jnp.asarray(light_of(2)), jnp.array([1.0, 2, 5])

    def seen(transfer: Transfer, light: Any, eye: Any, exponent: Any) -> Any:
        return shade(transfer, light, view=eye, lobe=phong(exponent))

    plain = seen(transfer, light, eye, 8.0)
    np.testing.assert_allclose(jax.jit(seen)(transfer, light, eye, 8.0), plain, atol=1e-6)
    eyes = jnp.stack([eye, -eye, jnp.zeros(3)])
    many = jax.vmap(lambda one: seen(transfer, light, one, 8.0))(eyes)
    np.testing.assert_allclose(many, [seen(transfer, light, one, 8.0) for one in eyes], atol=1e-6)

    def total(visibility: Any, light: Any, eye: Any, exponent: Any) -> Any:
        return seen(transfer._replace(visibility=visibility), light, eye, exponent).sum()

    arguments = (jnp.asarray(transfer.visibility), light, eye, 8.0)
    gradients = jax.grad(total, argnums=(0, 1, 2, 3))(*arguments)
    assert all(np.isfinite(g).all() and np.any(g) for g in gradients)
    step = np.array([0, 0, 0.02], np.float32)
    slope = (total(*arguments[:2], eye + step, 8.0) - total(*arguments[:2], eye - step, 8.0)) / 0.04
    assert float(gradients[2][2]) == pytest.approx(float(slope), rel=0.02, abs=1e-4)
    np.testing.assert_allclose(total(arguments[0] * 3, *arguments[1:]), 3 * total(*arguments), rtol=1e-5)  # linear


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"lobe": None}, "diffuse radiance is the same for every view: give a lobe"),
        ({"view": None}, "a lobe shines towards a viewer: give view"),
        ({"lobe": Lobe(np.ones(2))}, r"the lobe has factors \(2,\) float64: give one for each of the 3 bands"),
        ({"view": np.ones(2)}, r"view has shape \(2,\) float64: give the position of a camera"),
        ({"view": np.ones((5, 3))}, r"for each vertex \(4, 3\)"),
        ({"view": "front"}, "view has shape"),
        ({"transfer": np.zeros((4, 9))}, r"bake it with glossy=True \(gash bake --glossy\)"),
        ({"transfer": sphere(4, 3)._replace(visibility=None)}, "has no visibility to make gloss of"),
        ({"light": np.zeros((4, 3))}, "project the light again with 3 bands"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_line(changes: dict, words: str) -> None:
    arguments: dict = {"transfer": sphere(4, 3), "light": light_of(3), "view": np.ones(3), "lobe": phong(3), **changes}
    with pytest.raises(ValueError, match=words) as caught:
        shade(arguments.pop("transfer"), arguments.pop("light"), **arguments)
    assert "\n" not in str(caught.value)


def test_what_arrives_is_enough_to_shade() -> None:
    transfer, eye, lobe = sphere(9, 3), np.array([1.0, 2, 6]), ggx(0.4)
    arriving = arriving_radiance(transfer, jnp.asarray(light_of(3)))
    found = reflected_radiance(np.asarray(arriving), transfer.mesh, eye, lobe)
    np.testing.assert_allclose(found, shade(transfer, light_of(3), view=eye, lobe=lobe), atol=1e-6)
    for wrong in (arriving[:-1], arriving[..., :2], arriving[..., 0], np.full(arriving.shape, "a")):
        with pytest.raises(ValueError, match=r"give \(9, bands\^2, 3\), what arrives at each vertex"):
            reflected_radiance(wrong, transfer.mesh, eye, lobe)
    with pytest.raises(ValueError, match="8"):
        reflected_radiance(arriving[:, :8], transfer.mesh, eye, lobe)


def test_a_number_is_no_lobe() -> None:
    with pytest.raises(ValueError, match=r"lobe is 30: give a Lobe, as phong\(exponent\)"):
        glossy_radiance(sphere(4, 3), jnp.asarray(light_of(3)), np.ones(3), 30)
