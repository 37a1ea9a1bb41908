"""The page under real events: mouse, touch, keys, lists, sliders, dropped files; what it says and where it fits."""

import re
from base64 import b64encode
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gash_jax.algebra.rotations import rotation_matrix
from gash_jax.apps.pictures.views import cast_view, shade_view, toward_camera
from gash_jax.formats.hdr import write_hdr
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.brdf import phong
from gash_jax.light.environment import load_light, rotate_light, save_light
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.prt.transfer import Transfer, load_transfer
from tests.apps.viewer.conftest import Frames, long_animation, lopsided, run, write_exr
from tests.apps.viewer.test_pictures import EXPOSURE, SIZE, close, drawn, inside, said
from tests.helpers.browser import Opened
from tests.helpers.shared_data import shared_file

DROP = """([name, data]) => {
  const files = new DataTransfer();
  files.items.add(new File([Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0))], name));
  document.body.dispatchEvent(new DragEvent('drop', { dataTransfer: files, bubbles: true, cancelable: true }));
}"""


@pytest.fixture(scope="module")
def opened(browser: Any, folder: Path) -> Any:
    page = Opened(browser, folder / "page.html", said(""))
    yield page
    page.close()


def drag(opened: Opened, right: int, up: int, key: str | None = None) -> None:
    mouse, keyboard = opened.page.mouse, opened.page.keyboard
    if key:
        keyboard.down(key)
    mouse.move(120, 130)
    mouse.down()
    mouse.move(120 + right, 130 - up, steps=3)
    mouse.up()
    if key:
        keyboard.up(key)
    opened.settle()


def drop(opened: Opened, path: Path) -> str:
    """Drop a file onto the page; what the page says."""
    opened.page.evaluate(DROP, [path.name, b64encode(path.read_bytes()).decode()])
    opened.page.wait_for_timeout(500)
    return opened.page.locator("#message").text_content()


def drop_light(opened: Opened, path: Path) -> int:
    """Drop a map; its number among the lights, once it is there: a busy machine takes longer than to say nothing."""
    before = opened.page.locator("#light option").count()
    assert drop(opened, path) == ""
    opened.page.wait_for_function("n => document.querySelectorAll('#light option').length > n", arg=before)
    return before


def test_dragging_turns_the_view_and_with_shift_the_light(opened: Opened, folder: Path) -> None:
    transfer, light = load_transfer(folder / "glossy.npz"), load_light(folder / "lopsided.hdr")
    opened.say(said(""))
    drag(opened, 64, 0)  # half of the shorter side is 180 degrees
    azimuth, elevation = map(float, opened.address()["view"].split(","))
    assert azimuth == pytest.approx(-45) and elevation == pytest.approx(8)
    opened.say(said(""))
    before = opened.picture()
    drag(opened, 40, 25, "Shift")
    address = opened.address()
    assert address["view"] == "0,8"
    quaternion = np.array([float(number) for number in address["rotate"].split(",")])
    turn = np.asarray(rotation_matrix(quaternion / np.linalg.norm(quaternion)))
    wanted = drawn(transfer.mesh, shade(transfer, rotate_light(light, turn)))
    found, where = opened.picture(), inside(transfer.mesh, "front")
    assert close(found, wanted, where) >= 0.99 and close(before, wanted, where) < 0.5
    # what came from the viewer's side, +z, comes from the right and from above
    assert turn[0, 2] > 0.3 and turn[1, 2] > 0.15


def test_keys_and_lists_change_what_is_shown(opened: Opened) -> None:
    opened.say(said("").replace("panel=off", "panel=on"))
    opened.page.keyboard.press("3")
    assert opened.address()["view"] == "180,8"
    opened.page.keyboard.press("ArrowRight")
    opened.page.keyboard.press("m")
    address = opened.address()
    assert address["method"] == "1" and address["view"] == "175,8"
    opened.page.locator("#method").select_option(label="bake, 64 rays a vertex", force=True)
    opened.page.locator("#show").select_option("standard_error", force=True)
    assert "root mean square" in opened.page.locator("#legend").text_content()
    address = opened.address()
    assert address["method"] == "0" and address["show"] == "standard_error"
    picture = opened.picture()
    opened.page.keyboard.press("w")
    assert np.any(picture != opened.picture())
    opened.page.keyboard.press("?")
    assert opened.page.locator("#about").is_visible()
    opened.page.keyboard.press("Escape")
    for name, hidden in (("#phong-row", True), ("#against-row", True)):
        assert opened.page.locator(name).is_hidden() == hidden


def test_the_pointer_reads_radiance_and_vertex(opened: Opened, folder: Path) -> None:
    transfer, light = load_transfer(folder / "glossy.npz"), load_light(folder / "lopsided.hdr")
    opened.say(said(""))
    opened.page.mouse.move(100, 120)
    opened.settle()
    text = opened.page.locator("#readout").text_content()
    hit = cast_view(transfer.mesh, "front", SIZE)
    image, covered = shade_view(hit, np.asarray(shade(transfer, light)))
    numbers = [float(number) for number in re.findall(r"-?\d[\d.e-]*", text)]
    np.testing.assert_allclose(numbers[:3], image[120, 100] / covered[120, 100], rtol=0.01, atol=2e-3)
    assert int(numbers[3]) in hit.corners[240:242, 200:202]
    np.testing.assert_allclose(numbers[4:7], transfer.vertices[int(numbers[3])], rtol=6e-3, atol=1e-6)


def test_a_map_that_is_dropped_lights_the_object(opened: Opened, folder: Path, tmp_path: Path) -> None:
    transfer = load_transfer(folder / "glossy.npz")
    write_hdr(tmp_path / "own.hdr", 2 * studio_light(24)[:, ::-1])
    opened.say(said(""))
    number = drop_light(opened, tmp_path / "own.hdr")
    opened.say(said(f"light={number}"))
    wanted = drawn(transfer.mesh, shade(transfer, load_light(tmp_path / "own.hdr")))
    assert close(opened.picture(), wanted, inside(transfer.mesh, "front")) >= 0.99
    save_light(tmp_path / "coarse.npz", load_light(folder / "studio.hdr", 2))
    words = "error: coarse.npz cannot be shown: it holds 2 bands, 3 are needed: project its map again with as many"
    assert drop(opened, tmp_path / "coarse.npz") == words


def test_an_exr_map_that_is_dropped_lights_the_object_as_gash_light_would(
    opened: Opened, folder: Path, tmp_path: Path
) -> None:
    transfer = load_transfer(folder / "glossy.npz")
    write_exr(tmp_path / "own.exr", lopsided()[:, ::-1], "PIZ_COMPRESSION", "float")
    opened.say(said(""))
    number = drop_light(opened, tmp_path / "own.exr")
    opened.say(said(f"light={number}"))
    wanted = drawn(transfer.mesh, shade(transfer, load_light(tmp_path / "own.exr")))
    where = inside(transfer.mesh, "front")
    assert close(opened.picture(), wanted, where) >= 0.99
    mirrored = drawn(transfer.mesh, shade(transfer, load_light(folder / "lopsided.hdr")))
    assert close(opened.picture(), mirrored, where) < 0.5


def test_the_map_that_others_publish_is_read_from_exr(browser: Any, folder: Path) -> None:
    path, transfer = shared_file("hdr/grace_latlong.exr"), load_transfer(folder / "glossy.npz")
    opened = Opened(browser, folder / "page.html", said(""))
    opened.say(said(f"light={drop_light(opened, path)}", 0.5))
    wanted = drawn(transfer.mesh, shade(transfer, load_light(path)), exposure=0.5)
    assert close(opened.picture(), wanted, inside(transfer.mesh, "front")) >= 0.99
    opened.close()


def test_an_animation_that_is_dropped_moves_shines_and_has_its_closed_form(
    browser: Any, folder: Path, tmp_path: Path
) -> None:
    opened = Opened(browser, folder / "page.html", said(""))
    assert drop(opened, long_animation(tmp_path / "long.npz")) == ""
    given, light = np.load(tmp_path / "long.npz"), load_light(folder / "lopsided.hdr")
    assert opened.page.locator("#method option").all_text_contents() == ["long.npz", "closed form, no shadows"]
    assert opened.page.locator("#frame-number").text_content() == "1 of 60"
    mesh = Mesh(given["vertices"][17], given["normals"][17].astype(np.float32), given["faces"])
    opened.say(said("frame=17&material=phong:6"))
    transfer = Transfer(given["coefficients"][17].astype(np.float32), None, *mesh, {})
    transfer = transfer._replace(visibility=given["visibility"][17].astype(np.float32))
    radiance = shade(transfer, light, view=toward_camera(mesh, "front"), lobe=phong(6.0))
    assert close(opened.picture(), drawn(mesh, radiance), inside(mesh, "front")) >= 0.99
    np.savez(tmp_path / "odd.npz", **{**given, "visibility": given["visibility"][:, :, :9]})
    assert "what it holds for gloss does not fit" in drop(opened, tmp_path / "odd.npz")
    opened.close()


@pytest.mark.parametrize(
    ("words", "options"),
    [
        ("primaries of its own", {"chromaticities": (0.7, 0.3, 0.2, 0.7, 0.1, 0.05, 0.31, 0.33)}),
        ("shows a part of its pixels", {"displayWindow": ((0, 0), (31, 15))}),
        ("twice as wide as high", {}),
        ("no plain R, G, B or Y", {}),
        ("its pixels end or break early", {}),
        ("it is no OpenEXR picture", {}),
        ("radiance that is negative", {}),
        ("radiance that is not finite", {}),
    ],
)
def test_an_exr_map_that_is_no_good_is_refused_in_one_line(
    opened: Opened, tmp_path: Path, words: str, options: dict[str, Any]
) -> None:
    path, image = tmp_path / "bad.exr", lopsided()
    if "negative" in words:
        image = -image
    elif "finite" in words:
        image[3, 4] = np.inf
    write_exr(path, image[:30] if "twice" in words else image, "ZIP_COMPRESSION", "float", **options)
    if "plain" in words:
        path.write_bytes(path.read_bytes().replace(b"R\0\2", b"Q\0\2", 1))
    elif "early" in words:
        path.write_bytes(path.read_bytes()[:-900])
    elif "no OpenEXR" in words:
        path.write_bytes(b"P6 nothing")
    opened.say(said(""))
    count = opened.page.locator("#light option").count()
    message = drop(opened, path)
    assert message.startswith("error: bad.exr cannot be shown: ") and words in message and "\n" not in message
    assert opened.page.locator("#light option").count() == count


def test_a_transfer_that_is_dropped_is_one_more_result(opened: Opened, folder: Path) -> None:
    opened.say(said(""))
    assert drop(opened, folder / "bounced.npz") == ""
    names = opened.page.locator("#method option").all_text_contents()
    assert names[3:] == ["bounced.npz", "closed form, no shadows"] and opened.address()["method"] == "3"
    bounced, light = load_transfer(folder / "bounced.npz"), load_light(folder / "lopsided.hdr")
    opened.say(said("method=3"))
    assert close(opened.picture(), drawn(bounced.mesh, shade(bounced, light)), inside(bounced.mesh, "front")) >= 0.99


@pytest.mark.parametrize(
    ("name", "damage", "words"),
    [
        ("studio.hdr", lambda data: data[:1000], "its pixels"),
        ("studio.hdr", lambda data: data.replace(b"-Y 32", b"-Y 33"), "twice as wide as high"),
        ("studio.hdr", lambda data: b"P6 nothing", "no Radiance picture"),
        ("studio.hdr", lambda data: data.replace(b"FORMAT", b"PRIMARIES=0.7 0.3\nFORMAT", 1), "PRIMARIES of its own"),
        ("few.npz", lambda data: data[: len(data) // 2], "only a part of one"),
        ("few.npz", lambda data: data.replace(b"(812, 9)", b"(812, 8)"), "does not fit"),
        ("few.npz", lambda data: data.replace(b"faces.npy", b"races.npy"), "it is no light"),
    ],
)
def test_a_file_that_is_no_good_is_refused_in_one_line(
    opened: Opened, folder: Path, tmp_path: Path, name: str, damage: Any, words: str
) -> None:
    opened.say(said(""))
    before = opened.picture()
    (tmp_path / name).write_bytes(damage((folder / name).read_bytes()))
    message = drop(opened, tmp_path / name)
    assert message.startswith(f"error: {name} cannot be shown: ") and words in message and "\n" not in message
    opened.page.evaluate("document.getElementById('message').hidden = true")
    np.testing.assert_array_equal(opened.picture(), before)


def test_two_fingers_zoom(browser: Any, folder: Path) -> None:
    opened = Opened(browser, folder / "page.html", said(""), has_touch=True, is_mobile=True)
    touch, before = opened.context.new_cdp_session(opened.page), opened.picture()
    for kind, apart in (("touchStart", 20), ("touchMove", 30), ("touchMove", 40), ("touchEnd", 0)):
        points = [{"x": 128 + side * apart, "y": 128, "id": i} for i, side in enumerate((-1, 1))] if apart else []
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    after = opened.picture()
    opened.close()
    twice = before[64:192, 64:192].repeat(2, 0).repeat(2, 1).astype(int)
    assert np.median(np.abs(after - twice)) <= 4 < np.median(np.abs(before[96:160, 96:160] - twice[96:160, 96:160]))


def test_frames_slide_step_and_play(browser: Any, frames: Frames, folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "moving.html"
    run("view", frames.path, "--light", folder / "studio.hdr", "-o", path, "--quiet")
    opened = Opened(browser, path, viewport={"width": 700, "height": 700})
    page, number = opened.page, opened.page.locator("#frame-number")
    assert number.text_content() == "1 of 3"
    page.locator("#frame").focus()
    page.keyboard.press("End")
    assert number.text_content() == "3 of 3" and opened.address()["frame"] == "2"
    page.locator("#picture").focus()
    page.keyboard.press(".")
    assert number.text_content() == "1 of 3"
    page.locator("#fps").fill("4")
    page.locator("#play").click()
    page.wait_for_function("document.getElementById('frame-number').value !== '1 of 3'")
    page.locator("#play").click()
    rest = number.text_content()
    page.wait_for_timeout(600)
    assert number.text_content() == rest and page.locator("#play").get_attribute("aria-label") == "Play"
    opened.close()


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_a_phone_shows_all_of_it_in_readable_colours(browser: Any, folder: Path, scheme: str) -> None:
    opened = Opened(browser, folder / "page.html", viewport={"width": 360, "height": 640}, color_scheme=scheme)
    page = opened.page
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    assert page.evaluate("document.getElementById('panel').scrollWidth") <= 360
    picture = page.locator("#picture").bounding_box()
    assert picture["width"] == 360 and picture["height"] > 300
    assert page.evaluate("document.documentElement.dataset.theme") == scheme
    page.locator("#save").scroll_into_view_if_needed()
    with page.expect_download() as download:
        page.locator("#save").click()
    assert download.value.suggested_filename == "gash.png"
    for selector in ("#panel", "#notes", "#band", "#method", "#drag-view"):
        assert contrast(*colours(page, selector)) >= 4.5, selector
    page.locator("#theme").click()
    assert page.evaluate("document.documentElement.dataset.theme") != scheme
    opened.close()


def colours(page: Any, selector: str) -> tuple[list[float], list[float]]:
    """Red, green and blue of the text and of what is behind it."""
    found = page.evaluate(
        """selector => {
          const ink = document.querySelector(selector);
          let behind = ink;
          while (getComputedStyle(behind).backgroundColor === 'rgba(0, 0, 0, 0)') behind = behind.parentElement;
          return [getComputedStyle(ink).color, getComputedStyle(behind).backgroundColor];
        }""",
        selector,
    )
    ink, behind = ([float(number) for number in re.findall(r"[\d.]+", color)[:3]] for color in found)
    return ink, behind


def contrast(ink: list[float], behind: list[float]) -> float:
    """Contrast ratio of WCAG 2."""
    shares = np.array([ink, behind]) / 255
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    low, high = sorted((linear @ [0.2126, 0.7152, 0.0722]).tolist())
    return (high + 0.05) / (low + 0.05)


def test_contrast_is_that_of_the_standard() -> None:
    assert contrast([0, 0, 0], [255, 255, 255]) == pytest.approx(21)
    assert contrast([255, 0, 0], [255, 255, 255]) == pytest.approx(4.0, abs=0.01)


def test_the_page_starts_as_it_was_left(browser: Any, folder: Path) -> None:
    opened = Opened(browser, folder / "page.html", said("method=2&rotate=70&window=hann:2.5"))
    kept = opened.address()
    words = "&".join(f"{key}={value}" for key, value in kept.items())
    before = opened.picture()
    again = Opened(browser, folder / "page.html", words)
    assert (np.abs(again.picture().astype(int) - before).max(-1) <= 2).mean() >= 0.999
    assert float(kept["exposure"]) == pytest.approx(EXPOSURE, rel=1e-3)
    opened.close()
    again.close()
