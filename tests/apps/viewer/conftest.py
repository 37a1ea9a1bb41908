"""A browser, and files to look at: results for a bumpy ball, lights, animations."""

import base64
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import OpenEXR
import pytest

from gash_jax.algebra.closed_forms import hemisphere, unshadowed_transfer
from gash_jax.algebra.sh import band_index, evaluate_sh
from gash_jax.apps.cli import gash
from gash_jax.apps.viewer.components import Components, Error
from gash_jax.formats.hdr import write_hdr
from gash_jax.formats.meshes import save_mesh
from gash_jax.geometry.mesh import Mesh, angle_weighted_normals
from gash_jax.light.studio import studio_light
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.browser import chromium

FRAMES = 3


class Frames(NamedTuple):
    """An animation as `gash view` reads it."""

    path: Path
    meshes: list[Mesh]
    coefficients: np.ndarray
    visibility: np.ndarray


def held(text: str) -> list[tuple[str, str, dict[str, np.ndarray]]]:
    """Kind, name and arrays of the files in a page."""
    found = re.findall(r'<script type="application/x-npz" data-kind="(.*?)" data-name="(.*?)">(.*?)</script>', text)
    return [(kind, name, dict(np.load(io.BytesIO(base64.b64decode(data))))) for kind, name, data in found]


def kept_components(arrays: dict[str, np.ndarray], name: str) -> Components:
    """The components of that name in a file of a page."""
    mean, components, weights = (arrays[f"{name}_{part}"] for part in ("mean", "components", "weights"))
    return Components(mean, components, weights, Error(0.0, 0.0))


def run(*arguments: object) -> None:
    gash.main([str(argument) for argument in arguments], standalone_mode=False)


def write_exr(path: Path, image: np.ndarray, packed: str = "ZIP_COMPRESSION", kind: str = "half", **more: Any) -> None:
    """An .exr map: half or float, or grey halfs; `more` are attributes of its header."""
    pixels = image.astype(np.float32 if kind == "float" else np.float16)
    channels = {"Y": pixels[..., 1].copy()} if kind == "grey" else {"RGB": pixels}
    header = {"compression": getattr(OpenEXR, packed), "type": OpenEXR.scanlineimage, **more}
    OpenEXR.File(header, channels).write(str(path))


def lopsided() -> np.ndarray:
    """A map whose every direction can be told from every other: no two turns of it look the same."""
    image = studio_light(32) * np.array([1.0, 0.8, 0.6], np.float32)
    image[10:14, 40:44] += np.array([0.0, 20.0, 4.0], np.float32)
    return image


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three results for one mesh: glossy, diffuse of few rays, bounced and coloured; two maps; the page of all."""
    made = tmp_path_factory.mktemp("viewer")
    save_mesh(made / "ball.ply", bumpy_sphere(9))
    write_hdr(made / "studio.hdr", studio_light(32))
    write_hdr(made / "lopsided.hdr", lopsided())
    bake = ("bake", made / "ball.ply", "--quiet", "-o")
    run(*bake, made / "glossy.npz", "--rays", 64, "--glossy")
    run(*bake, made / "few.npz", "--rays", 16)
    run(*bake, made / "bounced.npz", "--rays", 32, "--bounces", 2, "--albedo", "0.9,0.5,0.2")
    results = [made / name for name in ("glossy.npz", "few.npz", "bounced.npz")]
    run("view", *results, "--light", made / "lopsided.hdr", "-o", made / "page.html", "--quiet")
    return made


@pytest.fixture(scope="session")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Frames:
    """A ball that grows long, every frame baked."""
    folder, rest = tmp_path_factory.mktemp("frames"), bumpy_sphere(7)
    stretched = [rest.vertices * np.array([1, 1 + 0.6 * t, 1], np.float32) for t in range(FRAMES)]
    meshes = [Mesh(v, angle_weighted_normals(v, rest.faces).astype(np.float32), rest.faces) for v in stretched]
    baked = [bake_transfer(mesh, bands=2, rays=16, glossy=True) for mesh in meshes]
    found = np.stack([np.asarray(one.coefficients) for one in baked]).astype(np.float16)
    seen = np.stack([np.asarray(one.visibility) for one in baked])
    path = folder / "moving.npz"
    np.savez(path, coefficients=found, visibility=seen, vertices=np.stack(stretched), faces=rest.faces)
    return Frames(path, meshes, found.astype(np.float32), seen.astype(np.float32))


def long_animation(path: Path, seed: int = 0, *, twice: bool = False) -> Path:
    """A ball whose bumps grow and shrink for 60 frames, closed form darkened in waves; `twice`: every frame two times.

    Made, not baked: what is tested of it is how it is kept."""
    rest, time = bumpy_sphere(7), np.linspace(0, 4, 60)
    if twice:
        time = time[::2].repeat(2)
    height = 1 + 0.3 * np.sin(time[:, None] + 3 * rest.vertices[:, 1]) + 0.1 * np.cos(3 * time[:, None])
    vertices = (height[..., None] * rest.vertices).astype(np.float32)
    normals = np.stack([angle_weighted_normals(frame.astype(float), rest.faces) for frame in vertices])
    open_share = 0.7 + 0.3 * np.sin((5 + seed) * rest.vertices[:, 0] + 2 * time[:, None])[..., None]
    coefficients = open_share * np.stack([unshadowed_transfer(frame.astype(np.float32), 3) for frame in normals])
    factors = np.array([hemisphere(int(band)) for band in band_index(5)])
    seen = open_share * np.stack([np.asarray(evaluate_sh(frame.astype(np.float32), 5)) for frame in normals]) * factors
    half = {"coefficients": coefficients, "visibility": seen, "normals": normals}
    arrays: dict[str, Any] = {name: np.asarray(array, np.float16) for name, array in half.items()}
    np.savez(path, **arrays, vertices=vertices, faces=rest.faces)
    return path
