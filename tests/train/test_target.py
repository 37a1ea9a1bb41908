"""What models are held against: radiance of baked frames is its integral, lights that do not fit are refused."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.files.settings import ConfigError
from gash_jax.formats.animations import load_animation
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.container import Light
from gash_jax.light.environment import load_light, save_light
from gash_jax.light.gloss import arriving_radiance
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.sequence import moving_scene, posed_meshes
from gash_jax.shapes.primitives import bumpy_sphere, icosphere
from gash_jax.train.config import load_config
from gash_jax.train.target import BRIGHTEST, DIMMEST, target_frames, target_light, target_shards
from gash_jax.train.truth import Truth, bake_truth
from tests.helpers.gloss import half_sphere, harmonics

BANDS = 3
STRETCHED = [np.array(axes) for axes in ((1.0, 1, 1), (1, 2, 1), (0.5, 1, 3))]  # what is convex stays convex


def glossy_truth(mesh: Mesh, folder: Path, rays: int = 16) -> Truth:
    """A glossy bake of a mesh that is stretched."""
    np.savez(folder / "moves.npz", verts=np.stack([mesh.vertices * axes for axes in STRETCHED]), faces=mesh.faces)
    return bake_truth(moving_scene(load_animation(folder / "moves.npz")), BANDS, rays, glossy=True)


def open_radiance(normals: np.ndarray, light: np.ndarray) -> np.ndarray:
    """The integral of [n.w > 0] Y_i(w) L(w) over directions, by quadrature in float64, (v, 3 k)."""
    found = []
    for normal in normals.astype(np.float64):
        w, area = half_sphere(normal)
        basis = harmonics(w, BANDS)
        found.append(basis.T @ (area[:, None] * (basis @ light)))
    return np.array(found).reshape(len(normals), -1)


@pytest.mark.parametrize(("mesh", "convex"), [(icosphere(1), True), (bumpy_sphere(4), False)], ids=["convex", "bumps"])
def test_a_convex_body_gets_its_hemispheres_in_every_frame(mesh: Mesh, convex: bool, tmp_path: Path) -> None:
    """Up to the noise of 4096 rays; the bumps, which hide light from each other, are the known bad."""
    truth, light = glossy_truth(mesh, tmp_path, 4096), target_light("studio", BANDS)
    assert light is not None
    errors = []
    for pose, found in zip(posed_meshes(truth.scene.animation), target_frames(truth, light), strict=True):
        assert found.dtype == np.float32 and found.shape == (len(mesh.vertices), 27)
        errors.append(np.abs(found - open_radiance(pose.normals, light)).max() / np.linalg.norm(light, axis=0).max())
    assert len(errors) == 3 and (max(errors) < 5e-3) == convex and (min(errors) > 0.05) == (not convex)


def test_radiance_is_what_a_glossy_bake_of_the_frame_gives(tmp_path: Path) -> None:
    truth, light = glossy_truth(bumpy_sphere(4), tmp_path), target_light("sun-sky:elevation=30", BANDS)
    assert light is not None
    frames, (shard,) = list(target_frames(truth, light)), target_shards(truth, light)
    mesh = list(posed_meshes(truth.scene.animation))[2]
    baked = bake_transfer(mesh, BANDS, 16, replicates=1, seed=2, glossy=True)
    wanted = np.asarray(arriving_radiance(baked, jnp.asarray(light)))  # (v, k, 3): colours stand together
    np.testing.assert_allclose(frames[2].reshape(wanted.shape), wanted, rtol=1e-5, atol=1e-5)
    assert shard.dtype == np.float16
    np.testing.assert_array_equal(shard, np.stack(frames).astype(np.float16))


def test_without_a_light_it_is_the_coefficients(tmp_path: Path) -> None:
    truth = glossy_truth(icosphere(1), tmp_path)
    assert target_light("", BANDS) is None
    np.testing.assert_array_equal(np.stack(list(target_frames(truth, None))), truth.coefficients())
    np.testing.assert_array_equal(np.concatenate(target_shards(truth, None)), truth.coefficients())


@pytest.mark.parametrize("length", [0, 0.5 * DIMMEST, 2 * BRIGHTEST])
def test_a_light_that_float16_does_not_hold_is_refused(length: float, tmp_path: Path) -> None:
    studio = np.asarray(load_light("studio", BANDS).coefficients)
    path = tmp_path / "light.npz"
    save_light(path, Light(studio * (length / np.linalg.norm(studio, axis=0).max())))
    with pytest.raises(ConfigError, match=r"float16 holds 0.001 to 10000: scale them, .*save_light$"):
        target_light(str(path), BANDS)
    save_light(path, Light(studio))
    np.testing.assert_array_equal(target_light(str(path), BANDS), studio)


@pytest.mark.parametrize("name", ["deform", "local"])
def test_models_that_say_transfer_alone_take_no_light(name: str) -> None:
    with pytest.raises(ConfigError, match=f"{name} says transfer.*data.light, or train momo-prt or deep-prt$"):
        load_config(name, ["data.light=studio"])
    assert load_config("deep-prt-small", ["data.light=studio"]).data.light == "studio"
