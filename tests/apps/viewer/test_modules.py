"""The page's mathematics, run by node, against the library's."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gash_jax.algebra.closed_forms import clamped_cosine, hemisphere, unshadowed_transfer
from gash_jax.algebra.gaunt import multiplier
from gash_jax.algebra.sh import band_index, evaluate_sh, hann_window, lanczos_window
from gash_jax.apps.viewer.components import Series, expanded, in_components
from gash_jax.formats.exr import open_exr
from gash_jax.formats.hdr import open_hdr, write_hdr
from gash_jax.light.brdf import ggx, phong
from gash_jax.light.environment import project_map, rotate_light
from gash_jax.light.studio import studio_light
from gash_jax.light.windows import light_window
from tests.apps.viewer.conftest import write_exr
from tests.helpers.bumpy import random_rotation

SOURCES = Path(__file__).parents[3] / "viewer" / "src"
RNG = np.random.default_rng(7)


def node(module: str, expression: str, *inputs: Any) -> Any:
    """The value of an expression in which `m` is the module and `a` the inputs, or skip the test."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("needs node: apt-get install nodejs")
    script = f"""
      import * as m from {json.dumps((SOURCES / module).as_uri())};
      import {{ readFileSync }} from "node:fs";
      const a = JSON.parse(readFileSync(0, "utf8"));
      const plain = (v) => ArrayBuffer.isView(v) ? Array.from(v) : v;
      console.log(JSON.stringify({expression}, (_, v) => plain(v)));"""
    given = json.dumps([value.tolist() if isinstance(value, np.ndarray) else value for value in inputs])
    done = subprocess.run([program, "--input-type=module", "-e", script], input=given, text=True, capture_output=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def node_of_packages(module: str, expression: str, *inputs: Any) -> Any:
    """As `node`, of a module that imports three.js, or skip the test."""
    if not (SOURCES.parent / "node_modules" / "three").is_dir():
        pytest.skip("needs the packages of viewer/package.json: npm ci in viewer/")
    return node(module, expression, *inputs)


def test_harmonics_are_those_of_the_library() -> None:
    directions = RNG.normal(size=(5, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = node("sh.js", "a[0].map(([x, y, z]) => m.basis(x, y, z, 10, new Float64Array(100)))", directions)
    np.testing.assert_allclose(found, evaluate_sh(directions.astype(np.float32), 10), atol=2e-5)


def test_turned_light_is_that_of_the_library() -> None:
    light, turn = RNG.normal(size=(36, 3)).astype(np.float32), random_rotation(3)
    found = node("sh.js", "m.rotateLight(Float64Array.from(a[0].flat()), a[1].flat())", light, turn)
    np.testing.assert_allclose(np.reshape(found, (36, 3)), rotate_light(light, turn), atol=1e-5)


def test_products_are_those_of_the_library() -> None:
    light = RNG.normal(size=(16, 3)).astype(np.float32)
    found = node("sh.js", "m.multiplier(Float64Array.from(a[0].flat()))", light)
    np.testing.assert_allclose(np.reshape(found, (49, 16, 3)), multiplier(light), atol=1e-5)


@pytest.mark.parametrize("width", [2.0, 3.5])
def test_windows_are_those_of_the_library(width: float) -> None:
    found = node("windows.js", "['hann', 'lanczos', 'none'].map((kind) => m.windowFactors(kind, a[0], 5))", width)
    np.testing.assert_allclose(found, [hann_window(5, width), lanczos_window(5, width), np.ones(25)], atol=1e-12)


@pytest.mark.parametrize("kind", ["radiance", "irradiance"])
@pytest.mark.parametrize("name", ["a sun", "a studio", "colours", "even"])
def test_the_least_windows_are_those_of_the_library(name: str, kind: str) -> None:
    bands = {"a sun": 3, "a studio": 6, "colours": 4, "even": 4}[name]
    image = np.ones((16, 32, 3), np.float32)
    if name == "a studio":
        image = studio_light(16)
    elif name != "even":
        image *= 0 if name == "a sun" else 0.05
        image[4, 9], image[11, 20] = (400.0, 300.0, 0.0), (0.0, 2.0, 90.0)
    light = project_map(image, bands)
    found = node("windows.js", "m.leastWindow(Float64Array.from(a[0].flat()), a[1])", light, kind)
    np.testing.assert_allclose(found, light_window(light, kind), atol=2e-4)
    if name == "a sun" and kind == "radiance":
        assert found[4] < 0.5  # so that something was searched for


@pytest.mark.parametrize("bands", [3, 10])
def test_a_map_becomes_the_light_of_the_library(bands: int, tmp_path: Path) -> None:
    image = studio_light(12) * RNG.uniform(0.5, 1.5, size=(12, 24, 1)).astype(np.float32)
    write_hdr(tmp_path / "map.hdr", image)
    data = list((tmp_path / "map.hdr").read_bytes())
    picture = node("hdr.js", "m.readHdr(Uint8Array.from(a[0]))", data)
    radiance = open_hdr(tmp_path / "map.hdr").radiance
    np.testing.assert_array_equal(np.reshape(picture["pixels"], (12, 24, 3)).astype(np.float32), radiance)
    found = node("sh.js", "m.projectMap({ width: 24, height: 12, pixels: a[0].flat(2) }, a[1])", radiance, bands)
    np.testing.assert_allclose(np.reshape(found, (-1, 3)), project_map(radiance, bands), atol=1e-5)


def test_old_run_lengths_are_read_as_in_the_library(tmp_path: Path) -> None:
    # 4 x 2 pixels: flat, and one that is repeated three times
    lines = bytes([9, 8, 7, 128, 3, 2, 2, 129, 5, 5, 5, 130, 1, 2, 3, 127]) + bytes([40, 30, 20, 128, 1, 1, 1, 3])
    (tmp_path / "old.hdr").write_bytes(b"#?RADIANCE\nEXPOSURE=2\nPRIMARIES=0 0 0 0 0 0 0 0\n\n-Y 2 +X 4\n" + lines)
    picture = node("hdr.js", "m.readHdr(Uint8Array.from(a[0]))", list((tmp_path / "old.hdr").read_bytes()))
    wanted = open_hdr(tmp_path / "old.hdr").radiance
    np.testing.assert_allclose(np.reshape(picture["pixels"], (2, 4, 3)), wanted, rtol=1e-6)


def test_frames_are_rebuilt_from_components_as_by_numpy() -> None:
    frames = np.cumsum(RNG.normal(size=(30, 50, 3)), axis=0).astype(np.float32)
    found = in_components({"x": Series(frames, 1.0)}, 20 * 2 * 150)
    assert found is not None and found["x"].error.rms > 0.01  # it is no copy of the frames
    one = found["x"]
    parts = {"mean": one.mean, "components": one.components, "weights": one.weights}
    given = {f"x_{key}": {"shape": list(part.shape), "data": part.ravel().tolist()} for key, part in parts.items()}
    made = """(() => {
      const kinds = { x_mean: Float32Array, x_components: Int16Array, x_weights: Float32Array };
      for (const name in kinds) a[0][name].data = kinds[name].from(a[0][name].data);
      const series = m.seriesOf(a[0], "x", () => 2);
      return [series.frames, series.inner, [0, 7, 29, 99].map(series.at)];
    })()"""
    count, inner, rebuilt = node("frames.js", made, given)
    assert (count, inner) == (30, [50, 3])
    # sums of single precision in another order: 2^-23 of the largest term for each component
    wanted = expanded(one)[[0, 7, 29, 29]].reshape(4, -1)
    terms = np.abs(one.weights).max() * 32767
    np.testing.assert_allclose(rebuilt, wanted, atol=len(one.components) * terms * 2.0**-23)


def test_looks_at_a_few_frames_from_first_to_last() -> None:
    found = node("frames.js", "[1, 3, 500].map(m.someOf)")
    assert found[0] == [0] and found[1] == [0, 1, 2] and len(found[2]) == 32
    assert found[2][0] == 0 and found[2][-1] == 499


def test_normals_and_closed_form_of_every_frame_are_those_of_the_library() -> None:
    normals = RNG.normal(size=(2, 6, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    normals[1, 2] = 0
    made = """(() => {
      const facing = { frames: 2, inner: [6, 3], kind: "f4", at: (i) => Float32Array.from(a[0][i].flat()) };
      const mesh = { facing, count: 6 };
      const closed = m.closedForm(mesh, 3, true);
      return [0, 1].map((i) => [closed.coefficients.at(i), closed.gloss.series.at(i)]);
    })()"""
    found = node("shapes.js", made, 0.998 * normals)  # rounding has taken some of their length
    for number, (matte, gloss) in enumerate(found):
        used = normals[number].astype(np.float32)
        np.testing.assert_allclose(np.reshape(matte, (6, 9)), unshadowed_transfer(used, 3), atol=1e-6)
        factors = np.array([hemisphere(int(band)) for band in band_index(5)])
        wanted = np.asarray(evaluate_sh(used, 5)) * factors * np.any(used, axis=1, keepdims=True)
        np.testing.assert_allclose(np.reshape(gloss, (6, 25)), wanted, atol=1e-5)


@pytest.mark.parametrize("kind", ["half", "float", "grey"])
@pytest.mark.parametrize("packed", ["NO_COMPRESSION", "ZIP_COMPRESSION", "PIZ_COMPRESSION"])
def test_an_exr_map_has_the_pixels_of_the_library(packed: str, kind: str, tmp_path: Path) -> None:
    image = (studio_light(12) * RNG.uniform(0.5, 1.5, size=(12, 24, 1))).astype(np.float32)
    image[3, 5, :1] = -1e-3  # a little below zero, which is read as 0
    write_exr(tmp_path / "map.exr", image, packed, kind)
    found = node_of_packages("exr.js", "m.readExr(Uint8Array.from(a[0]))", list((tmp_path / "map.exr").read_bytes()))
    wanted = open_exr(tmp_path / "map.exr").radiance
    assert (found["width"], found["height"]) == (24, 12)
    np.testing.assert_array_equal(np.reshape(found["pixels"], (12, 24, 3)).astype(np.float32), wanted)


@pytest.mark.parametrize("length", [4, 30, 100, 300, -40])
def test_an_exr_map_that_is_cut_off_is_refused_at_once(length: int, tmp_path: Path) -> None:
    write_exr(tmp_path / "map.exr", studio_light(12), "ZIP_COMPRESSION", "half")
    data = list((tmp_path / "map.exr").read_bytes()[:length])
    made = "(() => { try { return m.readExr(Uint8Array.from(a[0])); } catch (error) { return error.message; } })()"
    assert re.search("end or break early|cut off|no OpenEXR", node_of_packages("exr.js", made, data))


def test_kernels_and_lobes_are_those_of_the_library() -> None:
    found = node("lobes.js", "[0, 1, 2, 3, 4, 5, 6, 7].map((l) => [m.clampedCosine(l), m.hemisphere(l)])")
    np.testing.assert_allclose(found, [[clamped_cosine(b), hemisphere(b)] for b in range(8)], atol=1e-12)
    found = node("lobes.js", "[m.phong(6.5, 10), m.ggx(0.3, 10), m.ggx(0, 10)]")
    np.testing.assert_allclose(found, [phong(6.5).factors, ggx(0.3).factors, ggx(0.0).factors], atol=1e-5)


def test_half_floats_are_those_of_numpy() -> None:
    numbers = np.array([0, 1, -2.5, 6e-8, 3e-5, 65504, 1e-3, np.pi], np.float32)
    bits = numbers.astype(np.float16).view(np.uint16)
    assert node("half.js", "a[0].map(m.toHalf)", numbers.astype(float)) == bits.tolist()
    found = node("half.js", "a[0].map(m.fromHalf)", bits)
    np.testing.assert_array_equal(found, numbers.astype(np.float16).astype(float))


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_of_numpy_are_read(save: Any, tmp_path: Path) -> None:
    arrays = {"a": RNG.normal(size=(3, 2)).astype(np.float32), "b": np.arange(4, dtype=np.int64).astype(np.int32)}
    save(tmp_path / "some.npz", **arrays, metadata=np.array(json.dumps({"bands": 3, "word": "é"})))
    found = node("npz.js", "await m.readNpz(Uint8Array.from(a[0]))", list((tmp_path / "some.npz").read_bytes()))
    assert found["metadata"] == {"bands": 3, "word": "é"} and found["arrays"]["a"]["shape"] == [3, 2]
    for name, array in arrays.items():
        np.testing.assert_array_equal(np.reshape(found["arrays"][name]["data"], array.shape), array)
