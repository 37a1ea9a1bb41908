"""Reference bakes and their cache."""

from pathlib import Path

import numpy as np
import pytest

from gash_jax.files.npz import read_npz, write_npz
from gash_jax.measure.reference import make_reference
from gash_jax.shapes.primitives import bumpy_sphere

MESH = bumpy_sphere(4)


@pytest.mark.parametrize("kind", ["nan", "short", "bare", "curve"])
def test_a_damaged_reference_is_made_again(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path))
    truth = make_reference(MESH, 2, 64)
    (path,) = (tmp_path / "references").iterdir()
    arrays, metadata = read_npz(path, "reference", ())
    if kind == "nan":
        arrays["coefficients"][3, 0] = np.nan
    elif kind == "short":
        arrays["standard_error"] = arrays["standard_error"][:, :1]
    elif kind == "bare":
        del metadata["curve"]
    else:
        metadata["curve"] = {"four": None}
    write_npz(path, arrays, metadata)
    again = make_reference(MESH, 2, 64)
    np.testing.assert_array_equal(again.coefficients, truth.coefficients)
    assert again.curve == truth.curve
    np.testing.assert_array_equal(make_reference(MESH, 2, 64).standard_error, truth.standard_error)
