"""three.js with gash_three.js and the GLSL shaders, in a real browser: numbers equal those of `gash_jax.shade`."""

import base64
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import gash_jax
from gash_jax.algebra.sh import evaluate_sh
from gash_jax.apps.pictures.views import to_srgb
from gash_jax.formats.gltf_document import open_document
from gash_jax.light.environment import load_light
from gash_jax.prt.transfer import load_transfer
from tests.geometry.mesh_files import Gltf
from tests.helpers.browser import chromium
from tests.helpers.localhost import page_of
from tests.helpers.node import node_modules
from tests.runtimes.engines.conftest import BALL, TURN, convert, matrix

HERE = Path(__file__).parent
ENGINES = Path(__file__).parents[3] / "runtimes" / "engines"
HTML = """<!doctype html><meta charset="utf-8"><body>
<script type="importmap">{"imports": {
  "three": "/three/build/three.module.js", "three/addons/": "/three/examples/jsm/"}}</script>
<script type="module" src="/here/three_page.js"></script>"""


@pytest.fixture(scope="module")
def page(made: Path) -> Iterator[Any]:
    folders = {"three": node_modules() / "node_modules" / "three", "here": HERE, "engines": ENGINES, "made": made}
    with chromium() as browser, page_of(browser, folders, HTML) as opened:
        opened.wait_for_selector("body[data-ready]", state="attached")
        yield opened


def shaded(page: Any, asset: str, light: np.ndarray, **said: Any) -> np.ndarray:
    said |= {"asset": f"/made/{asset}", "light": np.asarray(light).tolist()}
    return np.array(page.evaluate("said => shadeAsset(said)", said))


def inputs(made: Path, name: str, bands: int) -> tuple[np.ndarray, np.ndarray]:
    """Transfer and light as `shade` takes them."""
    transfer = np.asarray(load_transfer(made / f"{name}.npz").coefficients)[:, : bands * bands]
    return transfer, np.asarray(load_light(made / "light.npz", 4).coefficients)


@pytest.mark.parametrize(
    ("name", "bands", "store", "levels"),
    [
        *[("grey", bands, "float", 0) for bands in (3, 4)],
        *[("coloured", bands, "float", 0) for bands in (3, 4)],
        *[("grey", 3, "short", 32767), ("grey", 4, "byte", 127), ("coloured", 3, "byte", 127)],
    ],
)
@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0, 1.0), TURN], ids=["at rest", "turned"])
def test_numbers_are_those_of_the_library(
    name: str, bands: int, store: str, levels: int, turn: tuple[float, ...], made: Path, page: Any
) -> None:
    """The light is cut to the coefficients of the transfer; an object that turned sees it turned back."""
    asset = f"{name}-{bands}-{store}.glb"
    convert(made / f"{name}.npz", "-o", made / asset, "--bands", bands, "--store", store)
    transfer, light = inputs(made, name, bands)
    found = shaded(page, asset, light, turn=turn, albedo=[0.5, 1.0, 2.0])
    seen = gash_jax.rotate_light(light, matrix(turn).T)
    wanted = np.asarray(gash_jax.shade(transfer, seen, albedo=np.array([0.5, 1.0, 2.0])))
    # each coefficient is rounded by half a level of 1 at most, and meets light of its size
    rounding = np.abs(light).sum() * 2.0 * 0.5 / levels if levels else 0.0
    assert np.abs(found - wanted).max() <= rounding + 2e-5
    assert found.std() > 0.5 and (levels == 0 or np.abs(found - wanted).max() > 1e-6)


def test_swapped_coefficients_are_noticed(made: Path, page: Any) -> None:
    convert(made / "grey.npz", "-o", made / "known.glb", "--bands", 3)
    transfer, light = inputs(made, "grey", 3)
    wanted = np.asarray(gash_jax.shade(transfer, light))
    right = shaded(page, "known.glb", light)
    wrong = shaded(page, "known.glb", light, edit=["STORED(_sh0, _sh1", "STORED(_sh1, _sh0"])
    assert np.abs(right - wanted).max() < 2e-5 < 0.1 < np.abs(wrong - wanted).max()
    swapped = light.copy()
    swapped[[1, 3]] = swapped[[3, 1]]
    assert np.abs(shaded(page, "known.glb", swapped) - wanted).max() > 0.1


def test_scale_and_offset_are_applied(made: Path, page: Any) -> None:
    convert(made / "grey.npz", "-o", made / "short.glb", "--bands", 3, "--store", "short")
    content = (made / "short.glb").read_bytes()
    (mesh,) = open_document(content, made).json["meshes"]
    scale = mesh["extras"]["gash"]["scale"]
    assert max(abs(s - 1) for s in scale[:9]) > 1e-4
    transfer, light = inputs(made, "grey", 3)
    wrong = shaded(page, "short.glb", light, edit=["* gashScale[place]", ""])
    assert np.abs(wrong - np.asarray(gash_jax.shade(transfer, light))).max() > 1e-3


def test_a_node_that_is_turned_at_rest_was_baked_so(made: Path, page: Any) -> None:
    """The light is turned by what moved since, not by how the file places its nodes."""
    file = Gltf()
    primitive = file.primitive(BALL.vertices, BALL.faces, BALL.normals)
    accessor = file.document["accessors"][primitive["attributes"]["POSITION"]]
    accessor |= {"min": BALL.vertices.min(axis=0).tolist(), "max": BALL.vertices.max(axis=0).tolist()}
    file.document |= {"meshes": [{"primitives": [primitive]}], "scenes": [{"nodes": [0]}], "scene": 0}
    file.document["nodes"] = [{"mesh": 0, "rotation": [0.0, 0.6, 0.0, 0.8], "scale": [2.0, 2.0, 2.0]}]
    (made / "scene.glb").write_bytes(file.glb())
    mesh = gash_jax.load_mesh(made / "scene.glb")
    transfer, light = inputs(made, "grey", 3)
    np.savez(made / "placed.npz", **{**np.load(made / "grey.npz"), "vertices": mesh.vertices, "normals": mesh.normals})
    convert(made / "placed.npz", "-o", made / "placed.glb", "--mesh", made / "scene.glb", "--bands", 3)
    for turn in ((0.0, 0.0, 0.0, 1.0), TURN):
        seen = gash_jax.rotate_light(light, matrix(turn).T)
        found = shaded(page, "placed.glb", light, turn=turn)
        np.testing.assert_allclose(found, gash_jax.shade(transfer, seen), atol=2e-5)


def test_lights_are_turned_as_by_the_library(page: Any) -> None:
    light = np.random.default_rng(3).normal(size=(16, 3))
    for count in (9, 16):
        said = [light[:count].tolist(), matrix(TURN).tolist()]
        found = page.evaluate("([light, rows]) => turned(light, rows)", said)
        # the object turned by R sees the light turned back
        np.testing.assert_allclose(found, gash_jax.rotate_light(light[:count], matrix(TURN).T), atol=2e-6)
    directions = np.random.default_rng(4).normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = page.evaluate("d => harmonicsAt(d)", directions.tolist())
    np.testing.assert_allclose(found, evaluate_sh(directions, 4), atol=1e-6)


def test_a_light_probe_is_read(made: Path, page: Any) -> None:
    convert(made / "nine.npz", "--to", "three", "-o", made / "probe.json")
    probe = json.loads((made / "probe.json").read_text())
    found = page.evaluate("json => probeLight(json)", probe)
    np.testing.assert_allclose(found, load_light(made / "nine.npz").coefficients, rtol=1e-6)


def test_a_picture_has_the_colours_of_the_screen(page: Any, made: Path) -> None:
    convert(made / "grey.npz", "-o", made / "screen.glb", "--bands", 3)
    _, light = inputs(made, "grey", 3)
    found = shaded(page, "screen.glb", light, srgb=True)
    linear = shaded(page, "screen.glb", light)
    wanted = to_srgb(linear[None], np.ones((1, len(linear))), 1.0)[0]
    np.testing.assert_allclose(np.rint(found * 255), wanted, atol=1)


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (("--attributes", "uv", "--bands", "3"), "transfer in texture coordinates: convert it with --attributes sh"),
        (("--to", "unity-gltf", "--bands", "3"), "transfer in the convention unity-gltf: convert it without --to"),
        (("--bands", "2"), "4 coefficients a vertex: bake with --bands 3 or 4"),
        ((), "the light has 9 coefficients of 16"),
    ],
)
def test_files_that_it_cannot_show_are_refused(extra: tuple[str, ...], message: str, made: Path, page: Any) -> None:
    convert(made / "grey.npz", "-o", made / "other.glb", *extra)
    with pytest.raises(Exception, match=message):
        shaded(page, "other.glb", load_light(made / "nine.npz").coefficients)


def picture(page: Any, asset: str, light: np.ndarray) -> np.ndarray:
    said = {"asset": f"/made/{asset}", "light": np.asarray(light).tolist()}
    data = page.evaluate("said => draw(said)", said).split(",")[1]
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))


def test_a_picture_is_drawn(made: Path, page: Any) -> None:
    """A ball that sees everything, under light of red from the right: red there, dark at the left."""
    transfer = load_transfer(made / "grey.npz")._replace(coefficients=gash_jax.unshadowed_transfer(BALL.normals, 3))
    gash_jax.save_transfer(made / "closed.npz", transfer)
    convert(made / "closed.npz", "-o", made / "closed.glb")
    light = gash_jax.directional_light([1.0, 0.0, 0.0])
    red = np.asarray(light.coefficients) * np.array([1.0, 0.0, 0.0])
    drawn = picture(page, "closed.glb", red).astype(int)
    middle = drawn[128]
    assert middle[200, 0] > 200 > 60 > middle[50, 0] and drawn[..., 1:].max() <= drawn[0, 0].max()
