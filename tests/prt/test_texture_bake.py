"""A texture holds what a bake of its points holds, its seams agree, and what cannot be baked is refused in one line."""

from typing import Any

import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.apps.pictures.render import render
from gash_jax.geometry.bilinear import lookup
from gash_jax.geometry.mesh import MeshError
from gash_jax.geometry.seams import seam_jumps, seam_rows
from gash_jax.geometry.texels import find_texels
from gash_jax.light.environment import project_light
from gash_jax.light.shading import shade, shade_texture
from gash_jax.light.studio import studio_light
from gash_jax.prt import texture_bake
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.texture_bake import bake_texture
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.textured import SQUARE, SQUARE_UV, dented_sheet, split_square

ROUNDING = 2.0**-11  # of float16, relative


def _two_charts(uv: np.ndarray) -> np.ndarray:
    """The upper and the lower half of a chart, a little apart and the second turned a quarter: seams where they met."""
    upper = uv[..., 1].mean(axis=1) < 0.5
    half = uv * [0.9, 0.45] + [0.05, 0.02]
    turned = np.stack([half[..., 0], 1.0 - half[..., 1] + (0.45 - 1.0) + 0.5], axis=-1)
    return np.where(upper[:, None, None], half, turned).astype(np.float32)


def _points(mesh: Any, uv: np.ndarray, size: int) -> tuple[Any, np.ndarray, np.ndarray]:
    found = find_texels(uv, size)
    weights = found.barycentric.astype(np.float64)
    points, normals = (
        np.einsum("ti,tij->tj", weights, a[mesh.faces[found.face]]) for a in (mesh.vertices, mesh.normals)
    )
    return found, points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_texels_are_points_with_normals() -> None:
    mesh, uv = dented_sheet()
    texture = bake_texture(mesh, 2, 32, size=10, uv=uv, seed=3)
    found, points, normals = _points(mesh, uv, 10)
    expected = bake_transfer(mesh, 2, 32, points=points, normals=normals, seed=3)
    assert expected.standard_error is not None and texture.standard_error is not None
    flat = texture.texture.reshape(100, 4)[found.texel]
    np.testing.assert_array_equal(flat, expected.coefficients.astype(np.float16))
    error = texture.standard_error.reshape(100, 4)[found.texel]
    np.testing.assert_array_equal(error, expected.standard_error.astype(np.float16))
    assert texture.metadata["rays_total"] == 32 * len(points) and texture.bands == 2
    assert texture.metadata["texture"]["texels_on_faces"] == found.inside.sum()
    np.testing.assert_array_equal(texture.faces, mesh.faces)


def test_a_plane_has_the_closed_form_everywhere() -> None:
    texture = bake_texture(SQUARE, rays=16, size=5, uv=SQUARE_UV)
    expected = np.asarray(unshadowed_transfer(SQUARE.normals[:1], 3))[0]
    np.testing.assert_allclose(texture.texture.reshape(-1, 9), np.tile(expected, (25, 1)), atol=ROUNDING)
    assert (texture.coverage == 2).all()


def test_both_sides_of_seams_agree_and_what_was_not_baked_repeats_its_neighbour() -> None:
    mesh, one_chart = dented_sheet()
    uv, size = _two_charts(one_chart), 40
    texture = bake_texture(mesh, rays=64, size=size, uv=uv)
    rows = seam_rows(mesh, uv, size)
    flat = texture.texture.reshape(-1, 9).astype(np.float64)
    jump = np.abs(seam_jumps(flat, rows)).max()
    assert len(rows.texels) > size and jump < 2.5 * ROUNDING * np.abs(flat).max()
    assert texture.metadata["texture"]["largest_seam_jump"] == pytest.approx(jump, rel=1e-3)
    empty = np.argwhere(texture.coverage == 0)
    baked = np.argwhere(texture.coverage > 0)
    assert 0 < len(empty) < size**2
    for row, column in empty[:: len(empty) // 20]:
        apart = np.linalg.norm(baked - [row, column], axis=1)
        nearest = baked[apart == apart.min()]
        assert any(np.array_equal(texture.texture[row, column], texture.texture[tuple(place)]) for place in nearest)


def test_without_the_seams_they_do_not_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, one_chart = dented_sheet()
    uv = _two_charts(one_chart)
    monkeypatch.setattr(texture_bake, "equal_on_seams", lambda values, rows, inside: values)
    texture = bake_texture(mesh, rays=64, size=40, uv=uv)
    assert texture.metadata["texture"]["largest_seam_jump"] > 0.02


def test_texels_are_baked_in_groups_with_random_numbers_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, uv = dented_sheet()
    whole = bake_texture(mesh, rays=64, size=12, uv=uv)
    monkeypatch.setattr(texture_bake, "_NUMBERS", 9 * 4 * 50)
    seen: list[tuple[int, int]] = []
    parts = bake_texture(mesh, rays=64, size=12, uv=uv, progress=lambda done, total: seen.append((done, total)))
    count = int(np.count_nonzero(whole.coverage))
    assert seen[-1] == (count, count) and [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert parts.metadata["rays_total"] == whole.metadata["rays_total"]
    baked = np.flatnonzero(whole.coverage)
    assert whole.standard_error is not None
    ours, theirs, error = (
        a.reshape(144, 9)[baked].astype(np.float64) for a in (parts.texture, whole.texture, whole.standard_error)
    )
    np.testing.assert_array_equal(ours[:50], theirs[:50])
    assert not np.array_equal(ours[50:], theirs[50:])
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 2 * np.sqrt(2) * np.sqrt(np.mean(error**2))


def test_bounces_off_colours() -> None:
    mesh, uv = dented_sheet()
    options: dict[str, Any] = {"bounces": 2, "albedo": np.array([0.9, 0.5, 0.1]), "seed": 1}
    texture = bake_texture(mesh, 2, 32, size=8, uv=uv, **options)
    found, points, normals = _points(mesh, uv, 8)
    expected = bake_transfer(mesh, 2, 32, points=points, normals=normals, **options)
    assert texture.texture.shape == (8, 8, 4, 3) and texture.metadata["parameters"]["bounces"] == 2
    np.testing.assert_array_equal(
        texture.texture.reshape(64, 4, 3)[found.texel], expected.coefficients.astype(np.float16)
    )


@pytest.mark.parametrize("size", [1, 2])
def test_the_smallest_textures(size: int) -> None:
    texture = bake_texture(*dented_sheet()[:1], rays=16, size=size, uv=dented_sheet()[1])
    assert texture.texture.shape == (size, size, 9) and (texture.coverage > 0).all()


def test_one_ray_has_no_error_bars_and_occluders_cast_shadows() -> None:
    free = bake_texture(SQUARE, rays=1, size=2, uv=SQUARE_UV)
    assert free.standard_error is None
    lid = (SQUARE.vertices * 4 - [1.5, 1.5, -0.5], SQUARE.faces)
    shadowed = bake_texture(SQUARE, rays=64, size=2, uv=SQUARE_UV, occluders=[lid])
    assert shadowed.texture[..., 0].max() < 0.5 * free.texture[..., 0].max()


@pytest.mark.parametrize(
    ("mesh", "options", "words"),
    [
        (SQUARE, {"uv": np.concatenate([SQUARE_UV[:1], SQUARE_UV[:1]])}, "overlap"),
        (SQUARE, {"uv": "own"}, "no texture coordinates of its own"),
        (SQUARE, {"uv": "ours"}, "'own', 'atlas'"),
        (SQUARE, {"uv": SQUARE_UV * 3}, "several tiles"),
        (SQUARE, {"uv": SQUARE_UV, "size": 0}, "size"),
        (SQUARE, {"uv": SQUARE_UV, "size": 4097}, "size"),
        (SQUARE, {"uv": SQUARE_UV, "rays": 0}, "rays"),
        (SQUARE, {"uv": SQUARE_UV, "bands": 11}, "bands"),
        (SQUARE, {"uv": SQUARE_UV, "bounces": 1, "albedo": 2.0}, "albedo"),
    ],
)
def test_what_is_refused(mesh: Any, options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words) as refusal:
        bake_texture(mesh, **{"rays": 16, "size": 8, **options})
    assert "\n" not in str(refusal.value)


def test_sheets_with_every_face_twice_are_baked_once() -> None:
    twice = SQUARE._replace(faces=np.concatenate([SQUARE.faces, SQUARE.faces[:, [1, 2, 0]]]))
    texture = bake_texture(twice, rays=16, size=8, uv=np.concatenate([SQUARE_UV, SQUARE_UV[:, [1, 2, 0]]]))
    assert texture.metadata["texture"]["texels_on_two_faces"] == 0
    with pytest.raises(MeshError, match="overlap"):  # the same faces at other places of the surface
        far = SQUARE._replace(vertices=SQUARE.vertices + np.float32(2))
        both = np.concatenate([SQUARE.vertices, far.vertices]), np.concatenate([SQUARE.faces, far.faces + 4])
        bake_texture(both, rays=16, size=8, uv=np.concatenate([SQUARE_UV, SQUARE_UV]))


def test_an_atlas_where_a_mesh_has_none() -> None:
    pytest.importorskip("xatlas", reason="needs the extra textures")
    texture = bake_texture(bumpy_sphere(4), rays=16, size=64)
    told = texture.metadata["texture"]
    assert told["uv"] == "atlas" and told["points_on_seams"] > 0 and told["points_on_seams_mixed"] == 0
    assert told["largest_seam_jump"] < 2.5 * ROUNDING * np.abs(texture.texture).max()


def test_shading_texels_is_shading_points_and_pictures_look_up(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, uv = dented_sheet()
    texture, light = bake_texture(mesh, rays=64, size=24, uv=uv), project_light(studio_light(32))
    image = shade_texture(texture, light, np.array([0.5, 0.6, 0.7]))
    texels = texture.texture.reshape(-1, 9).astype(np.float32)
    np.testing.assert_allclose(image.reshape(-1, 3), shade(texels, light, np.array([0.5, 0.6, 0.7])), rtol=1e-5)
    # looking up radiance is shading what is looked up
    places = np.random.default_rng(0).random((30, 2))
    radiance = lookup(shade_texture(texture, light), places)
    found = shade(lookup(texture.texture.astype(np.float32), places).astype(np.float32), light)
    np.testing.assert_allclose(radiance, found, atol=1e-5)
    monkeypatch.setattr("gash_jax.light.shading._TEXELS", 100)
    np.testing.assert_allclose(shade_texture(texture, light, np.array([0.5, 0.6, 0.7])), image, atol=1e-6)


def test_pictures_of_a_texture_and_of_vertices_agree_where_both_are_exact() -> None:
    texture, light = bake_texture(SQUARE, rays=16, size=4, uv=split_square()), project_light(studio_light(32))
    vertices = bake_transfer(SQUARE, rays=16)
    ours, theirs = (render(lit, light, exposure=1.0, size=32).astype(int) for lit in (texture, vertices))
    assert np.abs(ours - theirs).max() <= 1 and len(np.unique(theirs)) > 3
    with pytest.raises(ValueError, match="diffuse"):
        from gash_jax.light.brdf import phong

        render(texture, light, lobe=phong(10))
    with pytest.raises(ValueError, match="one colour"):
        render(texture, light, albedo=np.ones((4, 3)))
