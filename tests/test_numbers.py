"""The numbers that users see: bakes and predictions of the shipped weights are those that were written down.

tests/golden/numbers.npz was written at the optimisation level of users. Another level, or another processor, rounds
otherwise: by less than 1e-6, where coefficients are up to 0.36.
"""

import os

import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh
from gash_jax.models.model import load_model, shipped_models
from tests.golden.make_numbers import BAKES, FILE, arrays

pytestmark = pytest.mark.optimised
BOUND = 1e-6


@pytest.fixture(scope="module")
def golden() -> dict[str, np.ndarray]:
    with np.load(FILE) as archive:
        return {name: archive[name] for name in archive.files}


@pytest.fixture(scope="module")
def mesh(golden: dict[str, np.ndarray]) -> Mesh:
    return Mesh(*(golden[f"mesh/{name}"] for name in Mesh._fields))


def _assert_as_written(found: dict[str, np.ndarray], golden: dict[str, np.ndarray], name: str) -> None:
    assert {f"{name}/{key}" for key in found} == {key for key in golden if key.startswith(f"{name}/")}
    for key, value in found.items():
        np.testing.assert_allclose(value, golden[f"{name}/{key}"], rtol=0, atol=BOUND, err_msg=f"{name}/{key}")


@pytest.mark.parametrize("name", shipped_models())
def test_predictions_are_as_written(name: str, mesh: Mesh, golden: dict[str, np.ndarray]) -> None:
    _assert_as_written(arrays(load_model(name).predict(mesh)), golden, f"predict/{name}")


@pytest.mark.parametrize("name", BAKES)
def test_bakes_are_as_written_and_their_bits_depend_on_no_thread(
    name: str, mesh: Mesh, golden: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = arrays(BAKES[name](mesh))
    _assert_as_written(found, golden, f"bake/{name}")
    for cores in (1, 3):
        monkeypatch.setattr(os, "sched_getaffinity", lambda pid, n=cores: set(range(n)))
        for key, value in arrays(BAKES[name](mesh)).items():
            np.testing.assert_array_equal(value, found[key], err_msg=f"{name}/{key} on {cores} cores")


def test_other_numbers_are_noticed(golden: dict[str, np.ndarray]) -> None:
    name = "predict/mlp"
    found = {"coefficients": golden[f"{name}/coefficients"].copy()}
    _assert_as_written(found, golden, name)
    found["coefficients"][7, 3] += 2 * BOUND
    with pytest.raises(AssertionError, match="Mismatched elements: 1 /"):
        _assert_as_written(found, golden, name)
    with pytest.raises(AssertionError):
        _assert_as_written({}, golden, name)


def test_a_session_of_marked_tests_compiles_as_users_do(request: pytest.FixtureRequest) -> None:
    flags = os.environ.get("XLA_FLAGS", "")
    fast = "optimization_level" in flags or "fusion_emitters" in flags
    assert not (fast and request.config.option.markexpr == "optimised")
