"""The network that averages few-ray estimates: by hand, what it must leave alone, what it must not see, transforms."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.nn.reconstruction import Around, Pass, Reconstruction, Seen, by_band, edge_features, reference_noise
from tests.helpers.bumpy import random_rotation

COUNT, EDGES, BANDS = 30, 5, 3


def _problem(seed: int = 0, k: int = 9) -> tuple[dict[str, Any], Seen, jax.Array]:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(3, COUNT))
    mesh = {
        "places": rng.uniform(-1, 1, (3, COUNT)).astype(np.float32),
        "normals": (normals / np.linalg.norm(normals, axis=0)).astype(np.float32),
    }
    table = rng.integers(COUNT, size=(EDGES, COUNT))
    mesh["found"] = rng.random((EDGES, COUNT)) < 0.8
    rays = rng.choice([8.0, 16.0, 64.0], COUNT).astype(np.float32)
    share = rng.random(COUNT).astype(np.float32)
    residual = (0.1 * rng.normal(size=(k, COUNT))).astype(np.float32)
    mesh, residual, rays, share, table = jax.tree.map(jnp.asarray, (mesh, residual, rays, share, table))
    return mesh, Seen(residual, reference_noise(rays, share, 6), rays, share), table


def _around(mesh: dict[str, Any], table: jax.Array) -> Around:
    places, normals, found = mesh["places"], mesh["normals"], mesh["found"]
    return Around(edge_features(places, normals, places[:, table], normals[:, table], found), found)


def _variables(module: Reconstruction, *arguments: Any) -> Any:
    """Random weights that are not small."""
    variables = module.init(jax.random.key(0), *arguments)
    keys = iter(jax.random.split(jax.random.key(1), 99))
    return jax.tree.map(lambda leaf: 0.4 * jax.random.normal(next(keys), leaf.shape), variables)


def _apply(module: Any, variables: Any, *arguments: Any) -> Any:
    return module.apply(variables, *arguments)


def _run(mesh: dict[str, Any], seen: Seen, table: jax.Array) -> tuple[np.ndarray, np.ndarray]:
    module = Reconstruction()
    around = _around(mesh, table)
    variables = _variables(module, seen, table, around)
    residual, variance = jax.jit(partial(_apply, module))(variables, seen, table, around)
    return np.asarray(residual), np.asarray(variance)


def test_edge_features_by_hand() -> None:
    """Two vertices at a right angle, one edge of length 2 along x, one entry that is no edge."""
    places, normals = np.array([[0.0], [0], [0]]), np.array([[0.0], [1], [0]])
    near = np.array([[[2.0], [5.0]], [[0], [0]], [[0], [0]]])
    near_normals = np.array([[[1.0], [0.0]], [[0], [1]], [[0], [0]]])
    found = np.array([[True], [False]])
    arrays = map(jnp.asarray, (places, normals, near, near_normals, found))
    features = np.asarray(edge_features(*arrays))[:, 0, 0]
    np.testing.assert_allclose(features, [0, 0, 1, 1, 0.3 * np.log(2) + 1], atol=1e-6)


def test_noise_by_hand_and_its_law() -> None:
    rays, share = jnp.array([8.0, 32.0]), jnp.array([0.5, 0.5])
    noise = np.asarray(reference_noise(rays, share, 2))
    np.testing.assert_allclose(noise[:, 0], 0.06 * (0.25 + 0.005) * 8**-1.5, rtol=1e-5)
    assert noise.shape == (2, 2) and 7.5 < noise[0, 0] / noise[0, 1] < 8.5


def test_by_band_is_the_mean_over_the_coefficients_of_a_band() -> None:
    values = jnp.arange(9.0)[:, None]
    np.testing.assert_allclose(np.asarray(by_band(values, 3))[:, 0], [0, 2, 6])


def test_a_pass_whose_logits_are_0_is_the_mean_of_vertex_and_neighbours() -> None:
    mesh, seen, table = _problem()
    module, around = Pass(4, BANDS), _around(mesh, table)
    near = jax.tree.map(lambda values: values[..., table], seen)
    variables = module.init(jax.random.key(0), seen, near, around)
    zeros = jax.tree.map(jnp.zeros_like, variables)
    passed, _ = _apply(module, zeros, seen, near, around)
    found = mesh["found"]
    sums = seen.residual + jnp.where(found, seen.residual[:, table], 0).sum(axis=1)
    np.testing.assert_allclose(passed.residual, sums / (1 + found.sum(axis=0))[None], atol=1e-6)
    squares = seen.noise[:BANDS] + jnp.where(found, seen.noise[:BANDS][:, table], 0).sum(axis=1)
    np.testing.assert_allclose(passed.noise, squares / (1 + found.sum(axis=0))[None] ** 2, rtol=1e-4)


def test_equal_residuals_stay_and_vertices_without_edges_too() -> None:
    mesh, seen, table = _problem()
    same = seen._replace(residual=jnp.repeat(seen.residual[:, :1], COUNT, axis=1))
    np.testing.assert_allclose(_run(mesh, same, table)[0], same.residual, atol=1e-6)
    mesh["found"] = jnp.zeros_like(mesh["found"])
    np.testing.assert_allclose(_run(mesh, seen, table)[0], seen.residual, atol=1e-7)


def test_it_turns_with_the_mesh() -> None:
    mesh, seen, table = _problem()
    turn = random_rotation(3).astype(np.float32)
    turned = {**mesh, "places": turn @ mesh["places"] + 0.1, "normals": turn @ mesh["normals"]}
    moved = seen._replace(residual=rotate_coefficients(seen.residual.T, turn).T)
    residual, variance = _run(mesh, seen, table)
    other, said = _run(turned, moved, table)
    np.testing.assert_allclose(other, np.asarray(rotate_coefficients(residual.T, turn)).T, atol=2e-5)
    np.testing.assert_allclose(said, variance, rtol=1e-3)


def test_entries_that_are_no_edge_are_not_seen() -> None:
    mesh, seen, table = _problem()
    other = jnp.where(mesh["found"], table, 0)
    for first, second in zip(_run(mesh, seen, table), _run(mesh, seen, other), strict=True):
        np.testing.assert_allclose(first, second, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("k", [9, 36, 64])
def test_any_number_of_bands(k: int) -> None:
    """Three bands look alike however many there are; beyond six a band gets the weights of the sixth."""
    mesh, seen, table = _problem(k=k)
    residual, variance = _run(mesh, seen, table)
    assert residual.shape == seen.residual.shape and len(variance) == min(np.sqrt(k), 6)
    assert (variance > 0).all()
    few = _run(mesh, seen._replace(residual=seen.residual[:9]), table)[0]
    np.testing.assert_allclose(residual[:9], few, atol=1e-6)


def test_transforms() -> None:
    mesh, seen, table = _problem()
    module, around = Reconstruction(), _around(mesh, table)
    variables = _variables(module, seen, table, around)

    def error(residual: Any, variables: Any) -> Any:
        found, variance = _apply(module, variables, seen._replace(residual=residual), table, around)
        return jnp.sum(found**2) + jnp.sum(jnp.log(variance))

    assert np.isfinite(jax.grad(error)(jnp.zeros_like(seen.residual), variables)).all()
    gradient = jax.grad(error, argnums=1)(jnp.asarray(seen.residual), variables)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))
    both = jnp.stack([seen.residual, 2 * seen.residual])
    mapped = jax.vmap(lambda r: _apply(module, variables, seen._replace(residual=r), table, around)[0])(both)
    np.testing.assert_allclose(mapped[0], _run(mesh, seen, table)[0], atol=1e-6)


def test_expected_error_does_not_move_the_passes() -> None:
    mesh, seen, table = _problem()
    module, around = Reconstruction(), _around(mesh, table)
    variables = _variables(module, seen, table, around)
    gradient = jax.grad(lambda v: jnp.sum(_apply(module, v, seen, table, around)[1]))(variables)["params"]
    assert all(not np.any(leaf) for name in ("first", "second") for leaf in jax.tree.leaves(gradient[name]))
    assert any(np.any(leaf) for leaf in jax.tree.leaves(gradient["error"]))
