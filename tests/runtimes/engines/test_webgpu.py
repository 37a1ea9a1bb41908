"""prt.wgsl in a real browser: its compiler takes it, and its numbers equal those of `gash_jax.shade`."""

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gash_jax
from gash_jax.light.environment import load_light
from gash_jax.prt.transfer import load_transfer
from gash_jax.prt.vertex_attributes import vertex_attributes
from tests.helpers.browser import chromium
from tests.helpers.localhost import page_of
from tests.runtimes.engines.conftest import TURN, matrix

HERE = Path(__file__).parent
CODE = (Path(__file__).parents[3] / "runtimes" / "engines" / "prt.wgsl").read_text()
# without a graphics card WebGPU runs on the same software renderer as WebGL
WEBGPU = ("--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader", "--enable-features=Vulkan")
FORMATS = {"float": "float32x4", "short": "snorm16x4", "byte": "snorm8x4"}
LEVELS = {"float": 0, "short": 32767, "byte": 127}
ALBEDO = np.array([0.5, 1.0, 2.0])


@pytest.fixture(scope="module")
def page() -> Iterator[Any]:
    html = '<!doctype html><meta charset="utf-8"><script src="/here/webgpu_page.js"></script>'
    with chromium(*WEBGPU) as browser, page_of(browser, {"here": HERE}, html) as opened:
        if opened.evaluate("code => compile(code)", CODE) is None:
            pytest.skip("needs WebGPU, which this chromium has no adapter for")
        yield opened


def shaded(
    page: Any, coefficients: np.ndarray, light: np.ndarray, store: str, code: str = CODE, fragment: str = "linear"
) -> np.ndarray:
    attributes, extras, _ = vertex_attributes(coefficients, "sh", store, 0)
    interleaved = np.concatenate([attribute.values for attribute in attributes], axis=1)
    count = coefficients.shape[1]
    width = 4 * -(-count // 4)
    lit = np.zeros((3, width))
    lit[:, :count] = light[:count].T
    parts = [
        np.resize(part, 48) * (np.arange(48) < len(part)) for part in (lit.ravel(), extras["scale"], extras["offset"])
    ]
    uniforms = np.concatenate([np.eye(4).ravel(), ALBEDO, [0.0], *parts])
    said = {
        **{"code": code, "stage": f"{'coloured' if coefficients.ndim == 3 else 'grey'}{count}", "fragment": fragment},
        **{"format": FORMATS[store], "uniforms": uniforms.tolist(), "count": len(coefficients)},
        **{"attributes": len(attributes), "stored": base64.b64encode(interleaved.tobytes()).decode()},
    }
    return np.array(page.evaluate("said => shadeVertices(said)", said))


def inputs(made: Path, name: str, bands: int) -> tuple[np.ndarray, np.ndarray]:
    transfer = np.asarray(load_transfer(made / f"{name}.npz").coefficients)[:, : bands * bands]
    return transfer, np.asarray(load_light(made / "light.npz", 4).coefficients)


def test_it_compiles_and_what_is_broken_does_not(page: Any) -> None:
    assert page.evaluate("code => compile(code)", CODE) == []
    for right, wrong in (
        ("dot(red, gash.light[i])", "dot(red, gash.lights[i])"),
        ("var sum = vec3f(0.0)", "var sum = 0.0"),
    ):
        assert CODE.count(right) == 1
        assert len(page.evaluate("code => compile(code)", CODE.replace(right, wrong))) == 1


@pytest.mark.parametrize(
    ("name", "bands", "store"),
    [
        *[(name, bands, "float") for name in ("grey", "coloured") for bands in (3, 4)],
        *[("grey", 4, "short"), ("grey", 3, "byte"), ("coloured", 3, "short")],
    ],
)
def test_numbers_are_those_of_the_library(name: str, bands: int, store: str, made: Path, page: Any) -> None:
    """In the frame of an object that has turned: its light, turned back."""
    transfer, light = inputs(made, name, bands)
    seen = np.asarray(gash_jax.rotate_light(light, matrix(TURN).T))
    found = shaded(page, transfer, seen, store)
    # each coefficient is rounded by half a level of 1 at most
    rounding = np.abs(seen).sum() * 0.5 * ALBEDO.max() / LEVELS[store] if LEVELS[store] else 0.0
    np.testing.assert_allclose(found, gash_jax.shade(transfer, seen, albedo=ALBEDO), atol=rounding + 2e-5)
    assert found.std() > 0.5


def test_swapped_coefficients_are_noticed(made: Path, page: Any) -> None:
    transfer, light = inputs(made, "grey", 3)
    wanted = np.asarray(gash_jax.shade(transfer, light, albedo=ALBEDO))
    wrong = CODE.replace("array<vec4f, 12>(v.s0, v.s1, v.s2, o", "array<vec4f, 12>(v.s1, v.s0, v.s2, o")
    assert np.abs(shaded(page, transfer, light, "float", wrong) - wanted).max() > 0.1
    assert np.abs(shaded(page, transfer, light[[0, 3, 2, 1, *range(4, 16)]], "float") - wanted).max() > 0.1


def test_colours_of_the_screen(made: Path, page: Any) -> None:
    """IEC 61966-2-1."""
    transfer, light = inputs(made, "grey", 3)
    linear = np.clip(shaded(page, transfer, light, "float"), 0, 1)
    wanted = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-8) ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(shaded(page, transfer, light, "float", fragment="srgb"), wanted, atol=1e-4)
