"""What the page draws, in a real browser, is what `gash_jax.render` and `gash render` draw."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jaxtyping import Bool, UInt8

import gash_jax
from gash_jax.algebra.closed_forms import hemisphere, unshadowed_transfer
from gash_jax.algebra.sh import band_index, evaluate_sh, hann_window, lanczos_window
from gash_jax.apps.pictures.montage import signed_colors
from gash_jax.apps.pictures.views import cast_view, exposure_for, shade_view, to_srgb, toward_camera
from gash_jax.apps.viewer import page as pages
from gash_jax.apps.viewer.components import expanded
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.brdf import ggx, phong
from gash_jax.light.environment import load_light, rotate_light
from gash_jax.light.shading import shade
from gash_jax.prt.transfer import Transfer, load_transfer
from tests.apps.viewer.conftest import Frames, held, kept_components, long_animation, run
from tests.helpers.browser import Opened

SIZE, EXPOSURE = 256, 0.7
KEPT = ("coefficients", "vertices", "normals", "visibility")
START = "panel=off&method=0&light=0&show=light&rotate=0&window=none&material=matte&background=ground&wire=0&view=front"
SEVENTY = [np.cos(np.radians(35)), 0, np.sin(np.radians(35)), 0]  # degrees about +y
ASKEW = [0.8, 0.36, -0.48, 0.0]  # about no axis of the world


@pytest.fixture(scope="module")
def opened(browser: Any, folder: Path) -> Any:
    page = Opened(browser, folder / "page.html", said(""))
    yield page
    page.close()


def said(words: str, exposure: float = EXPOSURE) -> str:
    """An address: the start, changed by some words."""
    given = f"{START}&exposure={exposure}&{words}".strip("&")
    return "&".join(f"{key}={value}" for key, value in dict(word.split("=") for word in given.split("&")).items())


def inside(mesh: Mesh, view: str) -> Bool[np.ndarray, "h w"]:
    """Pixels that the mesh covers whole, and their neighbours too: one pixel inside its edges."""
    covered = (cast_view(mesh, view, SIZE).weights.sum(-1) > 0.5).reshape(SIZE, 2, SIZE, 2).all((1, 3))
    turns = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    return np.all([np.roll(covered, turn, (0, 1)) for turn in turns], axis=0)


def drawn(mesh: Mesh, radiance: Any, view: str = "front", exposure: float = EXPOSURE) -> UInt8[np.ndarray, "h w 3"]:
    return to_srgb(*shade_view(cast_view(mesh, view, SIZE), np.asarray(radiance)), exposure)


def close(found: np.ndarray, wanted: np.ndarray, where: np.ndarray) -> float:
    """Share of the pixels there that differ by at most two levels."""
    assert found.shape == wanted.shape and where.sum() > 10_000
    return float((np.abs(found.astype(int) - wanted).max(-1) <= 2)[where].mean())


@pytest.mark.parametrize(
    ("words", "method", "view", "options"),
    [
        ("", 0, "front", {}),
        ("", 1, "side", {}),
        ("", 2, "top", {}),
        ("rotate=70", 0, "below", {"turn": SEVENTY}),
        ("rotate=0.8,0.36,-0.48,0", 0, "back", {"turn": ASKEW}),
        ("window=hann:2.5", 0, "front", {"window": hann_window(3, 2.5)}),
        ("window=lanczos:3", 2, "front", {"window": lanczos_window(3, 3)}),
        ("window=radiance&rotate=70", 1, "front", {"window": "radiance", "turn": SEVENTY}),
        ("material=phong:6", 0, "front", {"lobe": phong(6.0)}),
        ("material=ggx:0.45&rotate=70", 0, "side", {"lobe": ggx(0.45), "turn": SEVENTY}),
    ],
)
def test_the_page_draws_what_render_draws(
    opened: Opened, folder: Path, words: str, method: int, view: str, options: dict[str, Any]
) -> None:
    transfer = load_transfer(folder / ("glossy.npz", "few.npz", "bounced.npz")[method])
    light = rotate_light(load_light(folder / "lopsided.hdr"), options.pop("turn", np.eye(3)))
    if "lobe" in options:
        options["view"] = toward_camera(transfer.mesh, view)
    radiance = shade(transfer, light, **options)
    opened.say(said(f"{words}&method={method}&view={view}".strip("&")))
    assert close(opened.picture(), drawn(transfer.mesh, radiance, view), inside(transfer.mesh, view)) >= 0.99
    if words == "" and method < 2:  # and `render` is what it says it is
        light = load_light(folder / "lopsided.hdr")
        image = gash_jax.render(transfer, light, exposure=EXPOSURE, camera=view, size=SIZE)
        np.testing.assert_array_equal(image, drawn(transfer.mesh, radiance, view))


def test_gloss_with_bounced_light_is_drawn_from_matrices(browser: Any, folder: Path, tmp_path: Path) -> None:
    bake = ("bake", folder / "ball.ply", "-o", tmp_path / "m.npz", "--glossy", "--rays", 16, "--bands", 2)
    run(*bake, "--bounces", 1, "--albedo", 0.8, "--quiet")
    run("view", tmp_path / "m.npz", "--light", folder / "lopsided.hdr", "-o", tmp_path / "m.html", "--quiet")
    opened = Opened(browser, tmp_path / "m.html", said("material=ggx:0.6"))
    transfer, light = load_transfer(tmp_path / "m.npz"), load_light(folder / "lopsided.hdr", 2)
    assert transfer.matrices is not None
    radiance = shade(transfer, light, view=toward_camera(transfer.mesh, "front"), lobe=ggx(0.6))
    assert close(opened.picture(), drawn(transfer.mesh, radiance), inside(transfer.mesh, "front")) >= 0.99
    opened.close()


def test_a_wrong_picture_would_be_noticed(opened: Opened, folder: Path) -> None:
    transfer, light = load_transfer(folder / "glossy.npz"), load_light(folder / "lopsided.hdr")
    where = inside(transfer.mesh, "front")
    opened.say(said(""))
    found = opened.picture()
    turned = rotate_light(light, [np.cos(0.05), 0, np.sin(0.05), 0])  # 6 degrees
    assert close(found, drawn(transfer.mesh, shade(transfer, turned)), where) < 0.9
    assert close(found, drawn(transfer.mesh, shade(transfer, light), exposure=1.03 * EXPOSURE), where) < 0.9
    assert close(found, drawn(transfer.mesh, shade(load_transfer(folder / "few.npz"), light)), where) < 0.9


def test_the_closed_form_comes_by_itself_matte_and_glossy(opened: Opened, folder: Path) -> None:
    transfer, light = load_transfer(folder / "glossy.npz"), load_light(folder / "lopsided.hdr")
    where = inside(transfer.mesh, "front")
    opened.say(said("method=3"))
    assert opened.page.locator("#method option").all_text_contents()[3] == "closed form, no shadows"
    open_sky = unshadowed_transfer(transfer.normals, 3)
    assert close(opened.picture(), drawn(transfer.mesh, shade(open_sky, light)), where) >= 0.99
    factors = np.array([hemisphere(int(band)) for band in band_index(5)])
    seen = np.asarray(evaluate_sh(transfer.normals, 5)) * factors
    glossy = transfer._replace(visibility=seen.astype(np.float32))
    radiance = shade(glossy, light, view=toward_camera(transfer.mesh, "front"), lobe=phong(6.0))
    opened.say(said("method=3&material=phong:6"))
    assert close(opened.picture(), drawn(transfer.mesh, radiance), where) >= 0.99


def test_differences_have_the_colours_of_our_pictures(opened: Opened, folder: Path) -> None:
    light = load_light(folder / "lopsided.hdr")
    one, other = load_transfer(folder / "few.npz"), load_transfer(folder / "glossy.npz")
    wrong = np.asarray(shade(one, light) - shade(other, light)).mean(1, keepdims=True) * 5
    image, covered = shade_view(cast_view(one.mesh, "front", SIZE), wrong)
    wanted = signed_colors(image[..., 0] / np.maximum(covered, 1e-6), 0.3)
    opened.say(said("method=1&against=0&show=difference", 5))
    assert close(opened.picture(), wanted, inside(one.mesh, "front")) >= 0.99
    assert "-0.3 too dark" in opened.page.locator("#legend").text_content()


@pytest.mark.parametrize("k", [0, 2, 7])
def test_single_coefficients_have_the_colours_of_our_pictures(opened: Opened, folder: Path, k: int) -> None:
    bounced = load_transfer(folder / "bounced.npz")
    values = np.asarray(bounced.coefficients).mean(2)[:, k : k + 1]
    image, covered = shade_view(cast_view(bounced.mesh, "front", SIZE), values)
    wanted = signed_colors(image[..., 0] / np.maximum(covered, 1e-6), float(np.abs(values).max()))
    opened.say(said(f"method=2&show=coefficient&coefficient={k}"))
    assert close(opened.picture(), wanted, inside(bounced.mesh, "front")) >= 0.99


def test_single_coefficients_of_the_closed_form_have_their_colours_too(opened: Opened, folder: Path) -> None:
    mesh = load_transfer(folder / "glossy.npz").mesh
    values = np.asarray(unshadowed_transfer(mesh.normals, 3))[:, 2:3]
    image, covered = shade_view(cast_view(mesh, "front", SIZE), values)
    wanted = signed_colors(image[..., 0] / np.maximum(covered, 1e-6), float(np.abs(values).max()))
    opened.say(said("method=3&show=coefficient&coefficient=2"))
    assert close(opened.picture(), wanted, inside(mesh, "front")) >= 0.99


def test_the_exposure_is_chosen_as_render_chooses_it(opened: Opened, folder: Path) -> None:
    transfer, light = load_transfer(folder / "glossy.npz"), load_light(folder / "lopsided.hdr")
    wanted = exposure_for([shade_view(cast_view(transfer.mesh, "front", SIZE), np.asarray(shade(transfer, light)))])
    opened.say(said("light=0"))
    opened.page.keyboard.press("0")
    assert float(opened.address()["exposure"]) == pytest.approx(wanted, rel=0.01)


@pytest.fixture(scope="module")
def moving(browser: Any, frames: Frames, folder: Path) -> Any:
    path = frames.path.with_suffix(".html")
    run("view", frames.path, "--light", folder / "lopsided.hdr", "-o", path, "--quiet")
    page = Opened(browser, path, said(""))
    yield page
    page.close()


def test_frames_are_drawn_as_render_draws_them(moving: Opened, frames: Frames, folder: Path) -> None:
    light = load_light(folder / "lopsided.hdr", 2)
    for number, (mesh, coefficients) in enumerate(zip(frames.meshes, frames.coefficients, strict=True)):
        transfer = Transfer(coefficients, None, *mesh, {})
        moving.say(said(f"frame={number}&view=side"))
        wanted = gash_jax.render(transfer, light, camera="side", size=SIZE, exposure=EXPOSURE)
        assert close(moving.picture(), wanted, inside(mesh, "side")) >= 0.99


def test_frames_have_their_closed_form_and_the_difference_to_it(moving: Opened, frames: Frames, folder: Path) -> None:
    light, last = load_light(folder / "lopsided.hdr", 2), len(frames.meshes) - 1
    mesh, baked = frames.meshes[last], frames.coefficients[last]
    assert moving.page.locator("#method option").all_text_contents() == ["transfer", "closed form, no shadows"]
    closed = np.asarray(unshadowed_transfer(mesh.normals, 2))
    moving.say(said(f"frame={last}&method=1"))
    assert close(moving.picture(), drawn(mesh, shade(closed, light)), inside(mesh, "front")) >= 0.99
    first = np.asarray(unshadowed_transfer(frames.meshes[0].normals, 2))
    assert close(moving.picture(), drawn(mesh, shade(first, light)), inside(mesh, "front")) < 0.9  # of this frame
    wrong = np.asarray(shade(baked, light) - shade(closed, light)).mean(1, keepdims=True) * 2
    image, covered = shade_view(cast_view(mesh, "front", SIZE), wrong)
    wanted = signed_colors(image[..., 0] / np.maximum(covered, 1e-6), 0.3)
    moving.say(said(f"frame={last}&method=0&against=1&show=difference", 2))
    assert close(moving.picture(), wanted, inside(mesh, "front")) >= 0.99


def test_frames_shine(moving: Opened, frames: Frames, folder: Path) -> None:
    light, last = load_light(folder / "lopsided.hdr", 2), len(frames.meshes) - 1
    mesh = frames.meshes[last]
    transfer = Transfer(frames.coefficients[last], None, *mesh, {})._replace(visibility=frames.visibility[last])
    where, view = inside(mesh, "front"), toward_camera(mesh, "front")
    for words, lobe in (("phong:6", phong(6.0)), ("ggx:0.5", ggx(0.5))):
        moving.say(said(f"frame={last}&material={words}"))
        radiance = shade(transfer, light, view=view, lobe=lobe)
        assert close(moving.picture(), drawn(mesh, radiance), where) >= 0.99
    factors = np.array([hemisphere(int(band)) for band in band_index(3)])
    open_sky = transfer._replace(visibility=(np.asarray(evaluate_sh(mesh.normals, 3)) * factors).astype(np.float32))
    moving.say(said(f"frame={last}&material=phong:6&method=1"))
    radiance = shade(open_sky, light, view=view, lobe=phong(6.0))
    assert close(moving.picture(), drawn(mesh, radiance), where) >= 0.99


def test_frames_in_components_are_drawn_as_numpy_rebuilds_them(
    browser: Any, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pages, "LARGEST", 2_000_000)
    given, path = np.load(long_animation(tmp_path / "long.npz")), tmp_path / "long.html"
    run("view", tmp_path / "long.npz", "--light", folder / "lopsided.hdr", "-o", path, "--quiet")
    arrays = held(path.read_text())[0][2]
    rebuilt = {name: expanded(kept_components(arrays, name))[41] for name in KEPT}
    normals = rebuilt["normals"] / np.linalg.norm(rebuilt["normals"], axis=1, keepdims=True)
    mesh = Mesh(rebuilt["vertices"], normals.astype(np.float32), given["faces"])
    light = load_light(folder / "lopsided.hdr")
    opened = Opened(browser, path, said("frame=41"))
    where, found = inside(mesh, "front"), opened.picture()
    assert close(found, drawn(mesh, shade(rebuilt["coefficients"], light)), where) >= 0.99
    assert close(found, drawn(mesh, shade(rebuilt["coefficients"] * 1.03, light)), where) < 0.9
    opened.say(said("frame=41&method=1"))
    assert close(opened.picture(), drawn(mesh, shade(unshadowed_transfer(mesh.normals, 3), light)), where) >= 0.99
    opened.say(said("frame=41&material=phong:6"))
    transfer = Transfer(rebuilt["coefficients"], None, *mesh, {})._replace(visibility=rebuilt["visibility"])
    radiance = shade(transfer, light, view=toward_camera(mesh, "front"), lobe=phong(6.0))
    assert close(opened.picture(), drawn(mesh, radiance), where) >= 0.99
    # in the lists beside it the page says what was done
    assert "rebuilt from principal components" in opened.page.locator("#notes").text_content()
    opened.close()
