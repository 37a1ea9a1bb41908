"""A model is a JAX function of its parameters and of its graph's arrays, whatever its family; files come back."""

from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.files.atomic import FileError
from gash_jax.files.npz import read_npz, write_npz
from gash_jax.models.families import FAMILIES, build_model, model_config, model_graph
from gash_jax.models.model import Model, load_model, save_model, shipped_models
from tests.helpers.bumpy import bumpy_mesh, random_variables

MESH = bumpy_mesh(40)
SMALL: dict[str, dict[str, Any]] = {
    "mlp": {"channels": 8, "layers": 1},
    "gnn": {"channels": 8, "layers": 1, "heads": 2, "neighbours": 4},
    "teacher": {"channels": 8, "layers": 1, "heads": 2, "neighbours": 4},
    "two-stage": {
        **{"channels": 8, "layers": 1, "heads": 2, "neighbours": 4},
        **{"visibility_channels": 8, "visibility_layers": 1},
    },
    "rings": {"channels": 8, "layers": 1, "heads": 2, "neighbours": 8},
    "versor": {"channels": 4, "layers": 1, "neighbours": 8},
    "local": {"channels": 8, "layers": 1},
}


@cache
def _model(name: str) -> tuple[Model, Any]:
    config = model_config(name, **SMALL[name])
    graph = model_graph(config, MESH)
    return Model(config, random_variables(build_model(config), graph, spread=0.1)["params"]), graph


def test_every_family_is_here() -> None:
    assert set(SMALL) == set(FAMILIES)


@pytest.mark.parametrize("name", SMALL)
def test_a_model_is_a_jax_function(name: str) -> None:
    model, graph = _model(name)
    plain = np.asarray(model(graph))
    np.testing.assert_allclose(jax.jit(model)(graph), plain, atol=1e-5)
    # vmap over parameters equals a loop
    other = jax.tree.map(lambda leaf: leaf * np.float32(1.1), model.params)
    both = jax.tree.map(lambda *leaves: jnp.stack(leaves), model.params, other)
    found = jax.vmap(lambda params: model.with_error(graph, params)[0])(both)
    np.testing.assert_allclose(found[0], plain, atol=1e-5)
    np.testing.assert_allclose(found[1], model.with_error(graph, other)[0], atol=1e-5)
    assert np.abs(np.asarray(found[1]) - plain).max() > 1e-4

    def loss(params: Any) -> jax.Array:
        return jnp.sum(model.with_error(graph, params)[0] ** 2)

    gradient = jax.jit(jax.grad(loss))(model.params)
    sizes = [float(jnp.abs(leaf).max()) for leaf in jax.tree.leaves(gradient)]
    assert np.isfinite(sizes).all() and max(sizes) > 0
    # by finite differences, along the gradient itself
    norm = float(jnp.sqrt(sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(gradient))))
    step = 1e-2 / norm
    ahead, behind = (
        float(loss(jax.tree.map(lambda p, g, s=sign: p + s * step * g, model.params, gradient))) for sign in (1, -1)
    )
    assert (ahead - behind) / (2 * step) == pytest.approx(norm**2, rel=2e-2)


def test_the_error_head_has_kept_its_old_names(tmp_path: Path) -> None:
    """The first model files called it by other names."""
    model, graph = _model("local")
    save_model(tmp_path / "new.npz", model.config, model.params)
    arrays, metadata = read_npz(tmp_path / "new.npz", "model", ())
    names = {"error_hidden": "doubt", "error_head": "error"}
    old = {
        "/".join([names.get(name.split("/")[0], name.split("/")[0]), *name.split("/")[1:]]): array
        for name, array in arrays.items()
    }
    assert "doubt/kernel" in old
    write_npz(tmp_path / "old.npz", old, metadata)
    np.testing.assert_array_equal(load_model(tmp_path / "old.npz")(graph), model(graph))


@pytest.mark.parametrize("name", shipped_models())
def test_shipped_models_load(name: str) -> None:
    model = load_model(name)
    assert model.config.name == name and model.predict(MESH).coefficients.shape == (40, 9)


def _damaged(kind: str, arrays: dict[str, np.ndarray], name: str) -> dict[str, np.ndarray]:
    damaged = {key: array.copy() for key, array in arrays.items()}
    if kind == "nan":
        damaged[name].flat[0] = np.nan
    elif kind == "narrow":
        damaged[name] = damaged[name][..., :-1]
    elif kind == "missing":
        del damaged[name]
    elif kind == "unknown":
        damaged["extra/kernel"] = np.zeros((2, 2), np.float32)
    elif kind == "integers":
        damaged[name] = damaged[name].astype(np.int32)
    return damaged


@pytest.mark.parametrize("family", ["local", "two-stage"])
def test_model_files_are_checked_whole(family: str, tmp_path: Path) -> None:
    model, _ = _model(family)
    path = tmp_path / "model.npz"
    save_model(path, model.config, model.params)
    arrays, metadata = read_npz(path, "model", ())
    load_model(path)
    messages = {"nan": "not finite", "narrow": "has shape", "missing": "has no array", "unknown": "'extra/kernel'"}
    for kind, message in (messages | {"integers": "holds int32"}).items():
        for name in (min(arrays), max(arrays)):
            write_npz(path, _damaged(kind, arrays, name), metadata)
            with pytest.raises(FileError, match=message) as refused:
                load_model(path)
            assert "\n" not in str(refused.value) and str(path) in str(refused.value)
