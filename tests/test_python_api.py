"""The public API, as the README shows it."""

from pathlib import Path

import numpy as np

import gash_jax
from gash_jax.formats.hdr import write_hdr
from gash_jax.formats.meshes import save_mesh
from gash_jax.light.studio import studio_light
from gash_jax.shapes.primitives import bumpy_sphere


def test_the_whole_way(tmp_path: Path) -> None:
    save_mesh(tmp_path / "bunny.ply", bumpy_sphere(12))
    write_hdr(tmp_path / "studio.hdr", studio_light(32))

    mesh = gash_jax.load_mesh(tmp_path / "bunny.ply")
    transfer = gash_jax.bake_transfer(mesh, bands=3, rays=256)
    model = gash_jax.load_model("local")
    graph = model.graph(mesh)
    coefficients = model(graph)
    light = gash_jax.load_light(tmp_path / "studio.hdr", bands=3)
    radiance = gash_jax.shade(coefficients, light)

    count = len(mesh.vertices)
    assert transfer.coefficients.shape == coefficients.shape == (count, 9)
    assert radiance.shape == (count, 3)
    baked = np.asarray(gash_jax.shade(transfer.coefficients, light))
    assert np.isfinite(np.asarray(radiance)).all() and 0.1 < baked.mean() < 2.0
    # shadows of a generated mesh of another kind: the shipped weights beat the closed form
    formula = np.asarray(gash_jax.unshadowed_transfer(mesh.normals, 3))
    errors = [np.mean((np.asarray(c) - transfer.coefficients) ** 2) for c in (coefficients, formula)]
    assert errors[0] < 0.7 * errors[1]


def test_every_public_name_exists_and_says_what_it_is() -> None:
    for name in gash_jax.__all__:
        assert getattr(gash_jax, name).__doc__, name
    assert set(gash_jax.__all__) <= set(dir(gash_jax))
    assert gash_jax.__version__
