"""The end of the networks over motors: turned out of the vertex's frame, added to the closed form, 0 without normal."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.motors import motor, rotor_from_normal, rotor_to_matrix
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.models.families import build_model, config_from_file, model_config, model_graph
from gash_jax.nn.output import FRAMES, world_coefficients
from tests.helpers.bumpy import bumpy_mesh, network_inputs

NORMALS = np.array([[0, 1, 0], [1, 0, 0], [0.6, 0, -0.8], [0, -1, 0], [0, 0, 0], [2e-4, -1, 0]], np.float32)
NORMALS[5] /= np.linalg.norm(NORMALS[5])
NODES = {"motor": motor(np.full((6, 3), 0.3, np.float32), NORMALS), "normal": jnp.asarray(NORMALS)}
SAID = jnp.asarray(np.random.default_rng(0).normal(size=(6, 9)), jnp.float32)
WITHOUT = 4  # the vertex without a normal


def test_without_settings_what_is_said_is_the_transfer() -> None:
    """To the last bit: the models that were trained before there were these settings predict what they did."""
    for frame in ("mixed", "world"):
        found = np.asarray(world_coefficients(SAID, NODES, frame, False))
        np.testing.assert_array_equal(np.delete(found, WITHOUT, 0), np.delete(np.asarray(SAID), WITHOUT, 0))
        assert not found[WITHOUT].any()


def test_the_vertex_frame_is_turned_out_by_the_rotor() -> None:
    found = world_coefficients(SAID, NODES, "vertex", False)
    expected = np.array(rotate_coefficients(SAID, rotor_to_matrix(rotor_from_normal(NORMALS))))
    expected[WITHOUT] = 0
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_lobe_about_the_vertex_axis_by_hand() -> None:
    """Band 1 is (y, z, x) of a direction: +y of the vertex's frame is the normal, +x turns with the rotor."""
    up, aside = (np.zeros((6, 9), np.float32) for _ in range(2))
    up[:, 1], aside[:, 3] = 1, 1
    turned = np.asarray(world_coefficients(jnp.asarray(up), NODES, "vertex", False))[:, [3, 1, 2]]
    np.testing.assert_allclose(turned, NORMALS, atol=1e-6)
    # from +y to +x: a quarter turn about z takes +x to -y; the pole's half turn about z takes +x to -x
    turned = np.asarray(world_coefficients(jnp.asarray(aside), NODES, "vertex", False))[:, [3, 1, 2]]
    np.testing.assert_allclose(turned[[0, 1, 3]], [[1, 0, 0], [0, -1, 0], [-1, 0, 0]], atol=1e-6)


@pytest.mark.parametrize("frame", FRAMES)
def test_a_residual_of_zero_is_the_closed_form(frame: str) -> None:
    found = world_coefficients(jnp.zeros((6, 9)), NODES, frame, True)
    np.testing.assert_array_equal(found, unshadowed_transfer(NORMALS))
    some = world_coefficients(SAID, NODES, frame, True) - world_coefficients(SAID, NODES, frame, False)
    np.testing.assert_allclose(some, unshadowed_transfer(NORMALS), atol=1e-6)


@pytest.mark.parametrize("frame", FRAMES)
def test_gradients_are_finite_at_the_pole_and_without_normal(frame: str) -> None:
    def loss(said: Any, normals: Any) -> jax.Array:
        nodes = {"motor": motor(jnp.zeros((6, 3)), normals), "normal": normals}
        return jnp.sum(world_coefficients(said, nodes, frame, True) ** 2)

    of_said, of_normals = jax.jit(jax.grad(loss, argnums=(0, 1)))(SAID, jnp.asarray(NORMALS))
    assert np.isfinite(of_said).all() and np.isfinite(of_normals).all()
    assert not np.asarray(of_said)[WITHOUT].any() and np.abs(np.asarray(of_said)[3]).max() > 0


def test_a_rotation_keeps_the_mean_square_error() -> None:
    other = SAID[::-1]
    usable = np.any(NORMALS != 0, axis=1)
    world = [np.asarray(world_coefficients(c, NODES, "vertex", False))[usable] for c in (SAID, other)]
    local = np.asarray(SAID - other)[usable]
    assert np.mean((world[0] - world[1]) ** 2) == pytest.approx(np.mean(local**2), rel=1e-5)


def test_jit_and_vmap_change_nothing() -> None:
    def end(said: Any, motors: Any, normals: Any) -> Any:
        return world_coefficients(said, {"motor": motors, "normal": normals}, "vertex", True)

    plain = end(SAID, NODES["motor"], NODES["normal"])
    np.testing.assert_allclose(jax.jit(end)(SAID, NODES["motor"], NODES["normal"]), plain, atol=1e-6)
    one_each = jax.vmap(end)(SAID[:, None], NODES["motor"][:, None], NODES["normal"][:, None])
    np.testing.assert_allclose(one_each[:, 0], plain, atol=1e-6)


@pytest.mark.parametrize("name", ["mlp", "gnn", "teacher", "two-stage"])
def test_families_take_the_settings_and_old_files_have_the_first_reading(name: str) -> None:
    config: Any = model_config(name)
    old = {key: value for key, value in config.to_dict().items() if key not in ("frame", "residual")}
    assert config_from_file(old) == config and (config.frame, config.residual) == ("mixed", False)
    module: Any = build_model(model_config(name, frame="vertex", residual=True))
    end = module.coefficient if name == "two-stage" else module
    assert (end.frame, end.residual) == ("vertex", True)
    with pytest.raises(ValueError, match="one of mixed, world, vertex"):
        model_config(name, frame="camera")


@pytest.mark.parametrize("name", ["mlp", "teacher"])
def test_a_fresh_network_starts_at_zero_or_at_the_closed_form(name: str) -> None:
    small: dict[str, Any] = {"channels": 8, "layers": 1, **({"heads": 2} if name == "teacher" else {})}
    mesh = bumpy_mesh(30)
    for residual in (False, True):
        config = model_config(name, frame="vertex", residual=residual, **small)
        module: Any = build_model(config)
        said, _ = jax.jit(module.init_with_output)(jax.random.key(0), network_inputs(model_graph(config, mesh)))
        expected = np.asarray(unshadowed_transfer(mesh.normals, 3)) if residual else np.zeros((30, 9))
        np.testing.assert_allclose(said, expected, atol=1e-7)
