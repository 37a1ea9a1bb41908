"""Light that bounces: closed forms, radiosity, what a face's back brings, error bars, memory, and the two tracers."""

from typing import Any

import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, concatenate, subdivide_midpoint
from gash_jax.measure.metrics import calibration
from gash_jax.prt import bounces, tracing
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bounces import checked_albedo
from gash_jax.shapes.primitives import bumpy_sphere, icosphere, patch, spherical_bowl
from tests.helpers.radiosity import GROOVE, PLATES, cavity_gain, radiosity, rectangles, slanted_cavity
from tests.helpers.transfer_formulas import Y00, cavity_ao

BOWL = spherical_bowl(np.radians(60), 8)
X, Y, Z = np.eye(3)


def _shaded(transfer: Any) -> np.ndarray:
    """Under a constant light of radiance 1."""
    return transfer.coefficients[:, 0] / Y00


# ---- closed forms ----------------------------------------------------------------------------------------------------


def test_the_gain_in_a_cavity_by_hand() -> None:
    """f = .5, albedo .6: .5, .65, .695, .7085, .71255 -> 5/7."""
    found = [0.5 + cavity_gain(np.pi / 2, 0.6, n, 1)[0] / Y00 for n in (0, 1, 2, 3, 4, 200)]
    np.testing.assert_allclose(found, [0.5, 0.65, 0.695, 0.7085, 0.71255, 5 / 7], rtol=1e-6)


@pytest.mark.parametrize(("degrees", "albedo", "bounce"), [(40, 0.9, 8), (60, 0.5, 2), (100, 1.0, 4), (130, 0.7, 1)])
def test_a_cavity_with_a_slanted_opening(degrees: float, albedo: float, bounce: int) -> None:
    """Every coefficient on the average over the vertices; each vertex within its own noise."""
    half = np.radians(degrees)
    mesh = slanted_cavity(half)
    plain = bake_transfer(mesh, rays=256, seed=1).coefficients
    gain = bake_transfer(mesh, rays=256, seed=1, bounces=bounce, albedo=albedo).coefficients - plain
    exact = cavity_gain(half, albedo, bounce)
    np.testing.assert_allclose(gain.mean(0), exact, atol=0.005 * Y00)
    assert np.abs(gain - exact).max() < 0.02
    assert abs(gain[:, 0].mean() + plain[:, 0].mean() - exact[0] - Y00 * cavity_ao(half)) < 0.0014


def test_error_bars_in_a_cavity() -> None:
    """As for direct light (`test_calibration`): rms error over rms standard error, and coverage of the intervals."""
    half, errors, claimed = np.radians(60), [], []
    mesh = slanted_cavity(half)
    exact = cavity_gain(half, 0.8, 3)
    direct = np.mean([bake_transfer(mesh, rays=1024, seed=s).coefficients for s in range(90, 94)], axis=0)
    for seed in range(4):
        found = bake_transfer(mesh, rays=128, seed=seed, bounces=3, albedo=0.8)
        assert found.standard_error is not None
        errors.append(found.coefficients - direct - exact)
        claimed.append(found.standard_error)
    score, covered = calibration(np.concatenate(errors), np.concatenate(claimed))
    assert 0.8 < score < 1.25 and 0.92 < covered < 0.99


@pytest.mark.parametrize("pair", [GROOVE, PLATES], ids=["groove", "plates"])
def test_rectangles_against_radiosity(pair: Any) -> None:
    """Two surfaces of different albedo, nine coefficients, within 1 %."""
    mesh = rectangles(pair, 8)
    exact = radiosity(pair, 8, (0.9, 0.5), 4)
    albedo = np.repeat([0.9, 0.5], len(mesh.vertices) // 2)
    baked = bake_transfer(mesh, rays=4096, bounces=4, albedo=albedo).coefficients
    known = np.isfinite(exact).all(axis=1)  # the vertices on the common edge are not
    assert known.sum() >= len(mesh.vertices) - 18

    def error(found: np.ndarray, truth: np.ndarray) -> float:
        return float(np.linalg.norm((found - truth)[known]) / np.linalg.norm(truth[known]))

    assert error(baked, exact) < 0.01
    for wrong in (radiosity(pair, 8, (0.9, 0.5), 1), radiosity(pair, 8, (0.5, 0.9), 4)):
        assert error(baked, wrong) > 0.015


def test_no_vertex_is_brighter_than_without_any_shadow() -> None:
    """The plain estimate is a mean of what is 1 or less, at albedo 1 too, whatever the mesh."""
    for mesh in (BOWL, bumpy_sphere(6), concatenate([bumpy_sphere(4), BOWL])):
        for rays in (1, 7, 64):
            shaded = _shaded(bake_transfer(mesh, 1, rays, replicates=1, bounces=12, albedo=1.0))
            assert shaded.max() <= 1 + 1e-6 and shaded.min() >= 0


# ---- fronts and backs ------------------------------------------------------------------------------------------------


def _corridor(wall: Mesh) -> Mesh:
    """A floor of 2 x 2 and, half a unit away, a wall of height 1."""
    floor = patch(np.array([0.0, 0, -1]), 2 * Z, 2 * X, 4)
    return concatenate([floor, wall])


def _wall(faces_the_floor: bool, resolution: int = 4) -> Mesh:
    right, up = (2 * Z, Y) if faces_the_floor else (Y, 2 * Z)
    return patch(np.array([2.5, 0.0, -1.0]), right, up, resolution)


def test_no_light_through_the_back_of_a_wall() -> None:
    """Facing away, a sheet blocks the sky and sends nothing; facing the floor it sends what it receives."""
    away, towards = _corridor(_wall(False)), _corridor(_wall(True))
    np.testing.assert_allclose(away.normals[-1], X, atol=1e-6)
    np.testing.assert_allclose(towards.normals[-1], -X, atol=1e-6)
    direct = bake_transfer(away, rays=64)
    dark = bake_transfer(away, rays=64, bounces=3, albedo=1.0)
    np.testing.assert_array_equal(dark.coefficients[:25], direct.coefficients[:25])
    lit = bake_transfer(towards, rays=64, bounces=3, albedo=1.0).coefficients[:25, 0]
    assert np.all(lit >= direct.coefficients[:25, 0]) and (lit - direct.coefficients[:25, 0]).max() > 0.01


def test_the_winding_does_not_decide_what_is_a_back() -> None:
    """Normals do: faces wound the other way give the same bake, normals turned around another one."""
    towards = _corridor(_wall(True))
    expected = bake_transfer(towards, rays=64, bounces=2, albedo=0.9).coefficients
    wound = towards._replace(faces=towards.faces[:, [0, 2, 1]])
    np.testing.assert_allclose(bake_transfer(wound, rays=64, bounces=2, albedo=0.9).coefficients, expected, atol=1e-5)
    turned = _corridor(Mesh(_wall(True).vertices, -_wall(True).normals, _wall(True).faces))
    dark = bake_transfer(turned, rays=64, bounces=2, albedo=0.9).coefficients[:25]
    assert np.all(dark[:, 0] <= expected[:25, 0]) and np.any(dark[:, 0] < expected[:25, 0] - 1e-3)


def test_a_sheet_with_two_sides_sends_light_to_both() -> None:
    """Two coincident sheets with opposite normals: each side what its own vertices receive. A hit tells them apart
    only by the side it comes from, so they stand a hair apart."""
    front, back = _wall(True), _wall(False)
    apart = back._replace(vertices=back.vertices + np.array([1e-3, 0, 0], np.float32))
    both = bake_transfer(_corridor(concatenate([front, apart])), rays=64, bounces=1, albedo=1.0).coefficients[:25]
    one = bake_transfer(_corridor(front), rays=64, bounces=1, albedo=1.0).coefficients[:25]
    np.testing.assert_allclose(both, one, atol=3e-3)


# ---- laws ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("replicates", [1, 4])
def test_black_surfaces_send_nothing_and_no_bounce_is_a_direct_bake(replicates: int) -> None:
    options: dict[str, Any] = {"rays": 32, "replicates": replicates, "seed": 3}
    direct = bake_transfer(BOWL, **options)
    mores: list[dict[str, Any]] = [{"bounces": 0}, {"bounces": 0, "albedo": [0.1, 0.2, 0.3]}]
    for more in [*mores, {"bounces": 3, "albedo": 0}]:
        found = bake_transfer(BOWL, **options, **more)
        np.testing.assert_array_equal(found.coefficients, direct.coefficients)
        if replicates > 1:
            np.testing.assert_array_equal(found.standard_error, direct.standard_error)
    black = bake_transfer(BOWL, **options, bounces=2, albedo=np.zeros((len(BOWL.vertices), 3)))
    np.testing.assert_array_equal(black.coefficients, np.repeat(direct.coefficients[..., None], 3, axis=2))


def test_colours_are_three_grey_bakes() -> None:
    options: dict[str, Any] = {"rays": 32, "bounces": 3}
    colour = np.array([0.9, 0.5, 0.0])
    found = bake_transfer(BOWL, **options, albedo=colour)
    assert found.coefficients.shape == (257, 9, 3) and found.standard_error is not None
    for channel, albedo in enumerate(colour):
        grey = bake_transfer(BOWL, **options, albedo=albedo)
        np.testing.assert_allclose(found.coefficients[..., channel], grey.coefficients, atol=1e-6)
        assert grey.standard_error is not None
        np.testing.assert_allclose(found.standard_error[..., channel], grey.standard_error, atol=1e-6)
    per_vertex = np.broadcast_to(colour, (257, 3))
    np.testing.assert_array_equal(bake_transfer(BOWL, **options, albedo=per_vertex).coefficients, found.coefficients)


def test_bounces_add_up_to_the_next() -> None:
    """t^n - t^(n-1) shrinks by the albedo at least, and never to below 0 under constant light."""
    baked = [_shaded(bake_transfer(BOWL, 1, 64, bounces=n, albedo=0.5, replicates=1)) for n in range(5)]
    steps = np.diff(baked, axis=0)
    assert np.all(steps >= 0) and np.all(steps[1:].max(axis=1) <= 0.5 * steps[:-1].max(axis=1) + 1e-6)


def test_the_mesh_may_be_scaled_and_the_light_comes_from_anywhere_on_it() -> None:
    """What a hit interpolates does not depend on units; and faces cut into four send the same."""
    fine = subdivide_midpoint(BOWL)
    tiny = fine._replace(vertices=fine.vertices * np.float32(1e-5))
    options: dict[str, Any] = {"rays": 256, "bounces": 2, "albedo": 0.8}
    found = bake_transfer(fine, **options)
    np.testing.assert_allclose(bake_transfer(tiny, **options).coefficients, found.coefficients, atol=2e-3)
    coarse = bake_transfer(BOWL, **options)
    assert abs(found.coefficients[: len(BOWL.vertices), 0].mean() - coarse.coefficients[:, 0].mean()) < 2e-3


# ---- memory, rows, tracers -------------------------------------------------------------------------------------------


def test_what_is_not_kept_is_traced_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit the same, whatever part of the hits fits into memory."""
    monkeypatch.setattr(tracing, "RAYS_PER_CHUNK", 64 * 32)
    options: dict[str, Any] = {"rays": 32, "bounces": 2, "albedo": 0.8}
    whole = bake_transfer(BOWL, **options)
    assert whole.metadata["bounced"]["rays_traced_again"] == 0
    assert 8 * 257 * 32 * 0.5 < whole.metadata["bounced"]["hits_bytes"] < 8 * 257 * 34 + 8 * 4 * 257
    for most in (0, whole.metadata["bounced"]["hits_bytes"] // 2):
        monkeypatch.setattr(bounces, "MOST_KEPT", most)
        found = bake_transfer(BOWL, **options)
        np.testing.assert_array_equal(found.coefficients, whole.coefficients)
        again = found.metadata["bounced"]["rays_traced_again"]
        assert 0 < again <= 2 * 257 * 32 and found.metadata["bounced"]["hits_bytes"] <= most
    assert again < 2 * 257 * 32


@pytest.mark.parametrize("cores", [1, 4])
def test_rows_of_a_bounced_bake_are_that_slice_of_the_whole(monkeypatch: pytest.MonkeyPatch, cores: int) -> None:
    normals = BOWL.normals.copy()
    normals[50:70] = 0
    mesh = BOWL._replace(normals=normals)
    monkeypatch.setattr(tracing, "RAYS_PER_CHUNK", 64 * 32)
    options: dict[str, Any] = {"rays": 32, "bounces": 2, "albedo": [0.9, 0.5, 0.2], "seed": 4}
    whole = bake_transfer(mesh, **options)
    monkeypatch.setattr(tracing, "available_cores", lambda: cores)
    for first, last in ((0, 1), (49, 71), (50, 60), (60, 257)):
        part = bake_transfer(mesh, **options, rows=slice(first, last))
        np.testing.assert_array_equal(part.coefficients, whole.coefficients[first:last])
        np.testing.assert_array_equal(part.standard_error, whole.standard_error[first:last])  # type: ignore[index]


def test_the_brute_force_finds_the_same_light() -> None:
    """But for rays that graze an edge, which may fall either way."""
    mesh = spherical_bowl(np.radians(60), 4)
    options: dict[str, Any] = {"rays": 32, "bounces": 3, "albedo": 0.8}
    ours = bake_transfer(mesh, **options).coefficients
    theirs = bake_transfer(mesh, **options, backend="jax").coefficients
    assert np.mean(np.abs(ours - theirs).max(axis=1) < 1e-4) > 0.9 and np.abs(ours - theirs).max() < 0.02


def test_progress_counts_every_pass() -> None:
    seen: list[tuple[int, int]] = []
    bake_transfer(BOWL, rays=16, bounces=2, albedo=0.5, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (3 * 257, 3 * 257) and [done for done, _ in seen] == sorted(done for done, _ in seen)


# ---- hard cases ------------------------------------------------------------------------------------------------------


def test_a_mesh_without_any_normal_receives_and_sends_nothing() -> None:
    blind = BOWL._replace(normals=0 * BOWL.normals)
    for albedo, shape in ((0.5, (257, 9)), ([0.5, 0.5, 0.5], (257, 9, 3))):
        found = bake_transfer(blind, rays=16, bounces=2, albedo=albedo)
        assert found.coefficients.shape == shape and not found.coefficients.any()


def test_isolated_vertices_change_nothing() -> None:
    loose = Mesh(
        np.concatenate([BOWL.vertices, np.full((1, 3), 1e30, np.float32)]),
        np.concatenate([BOWL.normals, np.zeros((1, 3), np.float32)]),
        BOWL.faces,
    )
    options: dict[str, Any] = {"rays": 16, "bounces": 2, "albedo": 0.5}
    found, expected = bake_transfer(loose, **options), bake_transfer(BOWL, **options)
    np.testing.assert_array_equal(found.coefficients[:-1], expected.coefficients)
    assert not found.coefficients[-1].any()


def test_one_ray_and_a_body_that_sees_only_the_sky() -> None:
    assert bake_transfer(BOWL, rays=1, bounces=2, albedo=0.5).standard_error is None
    ball = icosphere(2)
    direct, bounced = (bake_transfer(ball, rays=64, bounces=n, albedo=0.9) for n in (0, 3))
    np.testing.assert_array_equal(bounced.coefficients, direct.coefficients)


@pytest.mark.parametrize(
    ("albedo", "reason"),
    [
        (None, "needs an albedo"),
        (1.01, r"1 of 1 albedos are not from 0 to 1 \(first: 1.01\)"),
        ([0.5, -0.1, 2], r"2 of 3 albedos are not from 0 to 1 \(first: -0.1\)"),
        (np.nan, r"first: nan"),
        ([0.5, 0.5], r"albedo has shape \(2,\): give a number, \(3,\), \(257,\) or \(257, 3\)"),
        ("grey", "give numbers from 0 to 1"),
    ],
)
def test_albedos_that_are_none_are_refused(albedo: Any, reason: str) -> None:
    with pytest.raises(ValueError, match=reason) as caught:
        bake_transfer(BOWL, rays=16, bounces=1, albedo=albedo)
    assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="bounces is -1: use a whole number from 0 to 256"):
        bake_transfer(BOWL, bounces=-1, albedo=0.5)


def test_albedo_by_hand() -> None:
    assert checked_albedo(0.5, 2).tolist() == [[0.5], [0.5]]
    assert checked_albedo([0, 0.5, 1], 2).tolist() == [[0, 0.5, 1]] * 2
    assert checked_albedo([0, 1], 2).tolist() == [[0], [1]]
    assert checked_albedo([[0, 0, 1], [1, 0, 0]], 2).tolist() == [[0, 0, 1], [1, 0, 0]]
    assert checked_albedo([0, 0.5, 1], 3).shape == (3, 3)  # three numbers are a colour
