"""Transfer in a texture on the page: looked up as `gash render` looks it up, switched, subtracted, pointed at."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gash_jax
from gash_jax.apps.pictures.montage import signed_colors
from gash_jax.apps.pictures.views import cast_view, look_up_view, to_srgb
from gash_jax.files.atomic import FileError
from gash_jax.light.environment import load_light
from gash_jax.light.shading import shade_texture
from gash_jax.prt.texture import TransferTexture, load_texture, save_texture
from gash_jax.shapes.primitives import bumpy_sphere
from tests.apps.viewer.conftest import run
from tests.apps.viewer.test_events import drop
from tests.apps.viewer.test_pictures import EXPOSURE, SIZE, close, inside, said
from tests.helpers.browser import Opened

TEXELS = 96


def unfolded(faces: np.ndarray) -> np.ndarray:
    """Every face in a square of its own: many seams, no two faces together."""
    side = int(np.ceil(np.sqrt(len(faces))))
    row, column = np.divmod(np.arange(len(faces)), side)
    corners = np.array([[0.15, 0.15], [0.85, 0.15], [0.15, 0.85]])
    return ((np.stack([column, row], 1)[:, None] + corners) / side).astype(np.float32)


@pytest.fixture(scope="module")
def textures(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two textures of one coarse ball: of many rays and grey, of few rays with coloured bounces; the page of both."""
    made, ball = tmp_path_factory.mktemp("textures"), bumpy_sphere(3)
    uv = unfolded(ball.faces)
    many = gash_jax.bake_texture(ball, rays=64, size=TEXELS, uv=uv)
    few = gash_jax.bake_texture(ball, rays=16, size=TEXELS, uv=uv, bounces=1, albedo=(0.9, 0.5, 0.2))
    save_texture(made / "many.npz", many)
    save_texture(made / "few.npz", few)
    run(
        "view",
        made / "many.npz",
        made / "few.npz",
        "--light",
        folder / "lopsided.hdr",
        "-o",
        made / "t.html",
        "--quiet",
    )
    return made


@pytest.fixture(scope="module")
def opened(browser: Any, textures: Path) -> Any:
    page = Opened(browser, textures / "t.html", said(""))
    yield page
    page.close()


def drawn(texture: TransferTexture, image: np.ndarray, view: str = "front") -> np.ndarray:
    return to_srgb(*look_up_view(cast_view(texture.mesh, view, SIZE), texture.uv, image), EXPOSURE)


@pytest.mark.parametrize(("name", "method", "view"), [("many", 0, "front"), ("few", 1, "side")])
def test_textures_are_drawn_as_render_draws_them(
    opened: Opened, textures: Path, folder: Path, name: str, method: int, view: str
) -> None:
    texture, light = load_texture(textures / f"{name}.npz"), load_light(folder / "lopsided.hdr")
    opened.say(said(f"method={method}&view={view}"))
    wanted = gash_jax.render(texture, light, exposure=EXPOSURE, camera=view, size=SIZE)
    assert close(opened.picture(), wanted, inside(texture.mesh, view)) >= 0.99
    # and a texture that is upside down would be seen
    other = drawn(texture, shade_texture(texture, light)[::-1], view)
    assert close(opened.picture(), other, inside(texture.mesh, view)) < 0.5


def test_differences_and_coefficients_of_textures(opened: Opened, textures: Path, folder: Path) -> None:
    many, few = (load_texture(textures / f"{name}.npz") for name in ("many", "few"))
    light, mesh = load_light(folder / "lopsided.hdr"), many.mesh
    where, hit = inside(mesh, "front"), cast_view(mesh, "front", SIZE)
    wrong = (shade_texture(few, light) - shade_texture(many, light)).mean(-1, keepdims=True) * EXPOSURE
    image, covered = look_up_view(hit, many.uv, wrong)
    opened.say(said("method=1&against=0&show=difference"))
    wanted = signed_colors(image[..., 0] / np.maximum(covered, 1e-6), 0.3)
    assert close(opened.picture(), wanted, where) >= 0.99
    values = many.texture[..., 3:4].astype(np.float32)
    image, covered = look_up_view(hit, many.uv, values)
    opened.say(said("method=0&show=coefficient&coefficient=3"))
    wanted = signed_colors(image[..., 0] / np.maximum(covered, 1e-6), float(np.abs(values).max()))
    assert close(opened.picture(), wanted, where) >= 0.99
    opened.say(said("method=0&show=standard_error"))
    assert "root mean square" in opened.page.locator("#legend").text_content()


def test_there_is_no_closed_form_of_texels_and_vertices_keep_their_numbers(opened: Opened, textures: Path) -> None:
    mesh = load_texture(textures / "many.npz").mesh
    opened.say(said(""))
    assert opened.page.locator("#method option").all_text_contents() == [
        "bake, 64 rays a texel",
        "bake, 16 rays a texel, 1 bounce",
    ]
    opened.page.mouse.move(100, 120)
    opened.settle()
    words = opened.page.locator("#readout").text_content()
    vertex = int(words.split("vertex ")[1].split(" at ")[0])
    place = [float(number) for number in words.split(" at ")[1].split(",")]
    np.testing.assert_allclose(place, mesh.vertices[vertex], atol=6e-3)


def test_a_dropped_texture_becomes_one_more_result_or_another_object(
    opened: Opened, textures: Path, folder: Path
) -> None:
    opened.say(said(""))
    assert drop(opened, textures / "few.npz") == ""
    assert opened.page.locator("#method option").count() == 3
    assert drop(opened, folder / "few.npz") == ""  # transfer at vertices, with its closed form
    assert opened.page.locator("#method option").count() == 2
    assert drop(opened, textures / "many.npz") == ""
    assert opened.page.locator("#method option").count() == 1


def test_what_does_not_go_together_is_refused(textures: Path, folder: Path, tmp_path: Path) -> None:
    many, target = textures / "many.npz", tmp_path / "x.html"
    with pytest.raises(ValueError, match="one file holds a texture"):
        run("view", many, folder / "few.npz", "-o", target, "--quiet")
    moved = load_texture(many)
    save_texture(tmp_path / "other.npz", moved._replace(uv=moved.uv[::-1]))
    with pytest.raises(ValueError, match="other sizes, coordinates or bands"):
        run("view", many, tmp_path / "other.npz", "-o", target, "--quiet")
    np.savez(tmp_path / "motion.npz", vertices=np.zeros((2, 3, 3), np.float32), faces=np.array([[0, 1, 2]]))
    with pytest.raises(FileError, match="run gash animate"):
        run("view", tmp_path / "motion.npz", "-o", target, "--quiet")
    with pytest.raises(FileError, match="no such file: absent.hdr"):
        run("view", many, "--light", "absent.hdr", "-o", target, "--quiet")
    run("view", many, "--light", "sun-sky:elevation=30", "-o", target, "--quiet")
    assert 'data-name="sun-sky:elevation=30"' in target.read_text()
    page = gash_jax.view({"one": load_texture(many), "other": load_texture(many)})
    assert page.html.count('data-kind="transfer"') == 2
