"""Shapes of parameters against those that a network makes, and their cache."""

from pathlib import Path

import jax
import numpy as np
import pytest
from flax.traverse_util import flatten_dict

from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.models.parameter_shapes import parameter_shapes, traced_shapes
from tests.helpers.bumpy import bumpy_mesh, random_variables

SMALL = {
    "mlp": model_config("mlp", channels=8, layers=1),
    "gnn": model_config("gnn", channels=8, layers=1, heads=2, neighbours=4),
    "teacher": model_config("teacher", channels=8, layers=1, heads=2, neighbours=4),
    "rings": model_config("rings", channels=8, layers=1, heads=2, neighbours=8, bands=4),
    "versor": model_config("versor", channels=4, layers=1, neighbours=8, bands=4),
    "local": model_config("local", channels=8, layers=1),
}


@pytest.mark.parametrize("name", SMALL)
def test_they_are_those_of_the_network_on_any_mesh(name: str) -> None:
    config = SMALL[name]
    params = random_variables(build_model(config), model_graph(config, bumpy_mesh(40)))["params"]
    leaves: dict[str, np.ndarray] = flatten_dict(params, sep="/")  # type: ignore[assignment]
    assert traced_shapes(config) == {key: leaf.shape for key, leaf in leaves.items()}


def test_they_are_traced_once_and_the_cache_is_only_a_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path))
    shapes = parameter_shapes(SMALL["mlp"])
    (kept,) = (tmp_path / "shapes").iterdir()
    whole = kept.read_text()
    with monkeypatch.context() as patched:
        patched.setattr(jax, "eval_shape", None)  # whoever traces now fails
        assert parameter_shapes(SMALL["mlp"]) == shapes
    for text in ("", "[1, 2]", '{"a": 1}'):
        kept.write_text(text)
        assert parameter_shapes(SMALL["mlp"]) == shapes and kept.read_text() == whole
    monkeypatch.setenv("GASH_CACHE", str(kept))  # a file: nothing can be written below it
    assert parameter_shapes(SMALL["mlp"]) == shapes
