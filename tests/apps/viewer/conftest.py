"""A browser, and files to look at: results for a bumpy ball, lights, an animation."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from gash_jax.apps.cli import gash
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


def run(*arguments: object) -> None:
    gash.main([str(argument) for argument in arguments], standalone_mode=False)


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
    found = np.stack([np.asarray(bake_transfer(mesh, bands=2, rays=16).coefficients) for mesh in meshes])
    path = folder / "moving.npz"
    np.savez(path, coefficients=found.astype(np.float16), vertices=np.stack(stretched), faces=rest.faces)
    return Frames(path, meshes, found.astype(np.float16).astype(np.float32))
