"""Containers as pytrees: what JAX sees of a transfer and a light, and metadata that nobody can change."""

import copy
import json
import pickle
from dataclasses import FrozenInstanceError
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.files.containers import Container, array_names, read_only
from gash_jax.light.environment import Light, light_metadata
from gash_jax.prt.transfer import Transfer, make_metadata

V, F = 6, 8


def _transfer(seed: int, bands: int = 2, **changes: Any) -> Transfer:
    rng = np.random.default_rng(seed)
    values = {
        "coefficients": rng.normal(size=(V, bands**2)).astype(np.float32),
        "standard_error": rng.random((V, bands**2), np.float32),
        "vertices": rng.random((V, 3), np.float32),
        "normals": rng.random((V, 3), np.float32),
        "faces": rng.integers(0, V, (F, 3)).astype(np.int32),
        "metadata": make_metadata(bands, "bake", {"seed": seed}, seconds={"total": 1.0}, rounds=[{"rays": 8}]),
    }
    return Transfer(**{**values, **changes})


def _light(seed: int, bands: int = 2) -> Light:
    radiance = np.random.default_rng(seed).normal(size=(bands**2, 3)).astype(np.float32)
    return Light(radiance, light_metadata(bands, source=f"{seed}.hdr", map=[64, 128]))


@pytest.mark.parametrize("make", [_transfer, _light])
def test_one_trace_for_two_that_differ_in_values_and_metadata(make: Any) -> None:
    traces = []

    @jax.jit
    def total(container: Container) -> jax.Array:
        traces.append(container.bands)
        return jnp.sum(jnp.asarray(container.coefficients)) + container.bands  # type: ignore[attr-defined]

    for seed in (0, 1):
        expected = float(np.sum(make(seed).coefficients)) + 2
        assert float(total(make(seed))) == pytest.approx(expected, abs=1e-5)
    assert traces == [2]
    total(make(2, bands=3))
    assert traces == [2, 3]


@pytest.mark.parametrize("make", [_transfer, _light])
def test_tree_map_of_two(make: Any) -> None:
    one, other = make(0), make(1)
    mean = jax.tree.map(lambda a, b: (a + b) / 2, one, other)
    assert type(mean) is type(one) and mean.bands == 2 and mean.metadata == {}
    np.testing.assert_array_equal(mean.coefficients, (one.coefficients + other.coefficients) / 2)
    assert one.metadata != {} and jax.tree.structure(one) == jax.tree.structure(other)
    with pytest.raises(ValueError):
        jax.tree.map(np.add, one, make(2, bands=3))
    with pytest.raises(TypeError, match="read-only"):
        mean.metadata["x"] = 1


@pytest.mark.parametrize("make", [_transfer, _light])
def test_leaves_are_the_arrays_and_bands_the_one_static_part(make: Any) -> None:
    container = make(0)
    arrays = [getattr(container, name) for name in array_names(type(container))]
    assert [id(leaf) for leaf in jax.tree.leaves(container)] == [id(a) for a in arrays if a is not None]
    named = {jax.tree_util.keystr(path): leaf for path, leaf in jax.tree_util.tree_leaves_with_path(container)}
    np.testing.assert_array_equal(named[".coefficients"], container.coefficients)
    children, treedef = jax.tree.flatten(container)
    again = jax.tree.unflatten(treedef, children)
    assert again.bands == 2 and again.coefficients is container.coefficients
    assert treedef.node_data() == (type(container), 2)


@pytest.mark.parametrize("make", [_transfer, _light])
def test_vmap_in_and_out(make: Any) -> None:
    """A stack of two in, a stack of two out; axes may be given as a container of numbers."""
    pair = [make(0), make(1)]
    stack = jax.tree.map(lambda *leaves: np.stack(leaves), *pair)
    assert stack.bands == 2 and stack.coefficients.shape == (2, *pair[0].coefficients.shape)
    twice = jax.vmap(lambda c: jax.tree.map(lambda leaf: 2 * leaf, c))(stack)
    assert type(twice) is type(stack) and twice.bands == 2
    np.testing.assert_array_equal(twice.coefficients[1], 2 * pair[1].coefficients)
    axes = jax.tree.map(lambda _: 0, stack)
    sums = jax.vmap(lambda c: jnp.sum(c.coefficients), in_axes=(axes,))(stack)
    np.testing.assert_allclose(sums, [p.coefficients.sum() for p in pair], atol=1e-5)


def test_gradient_with_respect_to_a_light() -> None:
    light = _light(0)
    gradient = jax.grad(lambda c: jnp.sum(jnp.asarray(c.coefficients) ** 2))(light)
    assert isinstance(gradient, Light) and gradient.metadata == {}
    np.testing.assert_allclose(gradient.coefficients, 2 * light.coefficients, rtol=1e-6)


def test_metadata_cannot_be_changed_at_any_depth_nor_from_outside() -> None:
    entries = {"seconds": {"total": 1.0}, "rounds": [{"rays": 8}]}
    transfer = _transfer(0, metadata=entries)
    metadata: Any = transfer.metadata
    changes = [
        lambda: metadata.update(x=1),
        lambda: metadata.pop("seconds"),
        lambda: metadata.__setitem__("x", 1),
        lambda: metadata["seconds"].__setitem__("read", 2.0),
        lambda: metadata["seconds"].clear(),
        lambda: metadata["rounds"].append({}),
        lambda: metadata["rounds"].__delitem__(0),
        lambda: metadata["rounds"][0].setdefault("x", 1),
    ]
    for change in changes:
        with pytest.raises(TypeError, match="read-only"):
            change()
    entries["seconds"]["total"] = 9.0  # type: ignore[index]
    assert transfer.metadata == {"seconds": {"total": 1.0}, "rounds": [{"rays": 8}]}
    with pytest.raises(FrozenInstanceError):
        transfer.metadata = {}  # type: ignore[misc]


def test_a_copy_with_changes_is_checked_and_frozen_again() -> None:
    transfer = _transfer(0)
    more = {"coefficients": np.zeros((V, 9), np.float32), "standard_error": None}
    changed = transfer._replace(metadata={**transfer.metadata, "health": {"faces": 8}}, **more)
    assert changed.bands == 3 and transfer.bands == 2 and "health" not in transfer.metadata
    with pytest.raises(TypeError, match="read-only"):
        changed.metadata["health"]["faces"] = 1
    with pytest.raises(ValueError, match="7 coefficients are no square of bands"):
        transfer._replace(coefficients=np.zeros((V, 7), np.float32), standard_error=None)


def test_metadata_is_ordinary_to_json_pickle_and_copies() -> None:
    transfer = _transfer(0)
    assert json.loads(json.dumps(transfer.metadata)) == transfer.metadata
    assert transfer.metadata["rounds"] == [{"rays": 8}]
    for again in (pickle.loads(pickle.dumps(transfer)), copy.deepcopy(transfer)):
        assert again.metadata == transfer.metadata and again.bands == transfer.bands
        np.testing.assert_array_equal(again.coefficients, transfer.coefficients)
        with pytest.raises(TypeError, match="read-only"):
            again.metadata["seconds"]["total"] = 0
    assert read_only({"a": (1, {"b": 2})}) == {"a": [1, {"b": 2}]}


def test_containers_are_made_under_jit() -> None:
    """By the constructor, with traced arrays of a response to three colours."""

    @jax.jit
    def coloured(transfer: Transfer, colour: jax.Array) -> Transfer:
        return transfer._replace(
            coefficients=jnp.asarray(transfer.coefficients)[..., None] * colour[None, None], standard_error=None
        )

    found = coloured(_transfer(0), jnp.array([1.0, 2.0, 3.0]))
    assert found.coefficients.shape == (V, 4, 3) and found.bands == 2 and found.standard_error is None
