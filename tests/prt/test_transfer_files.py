"""Transfer files are checked whole: what does not fit together is refused in one line that names it."""

from pathlib import Path

import numpy as np
import pytest

from gash_jax.files.atomic import FileError
from gash_jax.files.npz import write_npz
from gash_jax.prt.transfer import load_transfer, make_metadata
from tests.geometry.mesh_files import CUBE, CUBE_FACES
from tests.helpers.shared_data import shared_case

ROWS = np.ones((8, 9), np.float32)
ARRAYS = {"coefficients": ROWS, "standard_error": ROWS, "vertices": CUBE, "normals": CUBE, "faces": CUBE_FACES}


def _loaded(tmp_path: Path, **changes):
    arrays = {name: array for name, array in {**ARRAYS, **changes}.items() if array is not None}
    write_npz(tmp_path / "t.npz", arrays, make_metadata(3, "bake", {}))
    return load_transfer(tmp_path / "t.npz")


def test_whole_files_are_read(tmp_path: Path) -> None:
    transfer = _loaded(tmp_path)
    assert transfer.bands == 3 and transfer.predicted_error is None and transfer.faces.dtype == np.int32
    assert _loaded(tmp_path, standard_error=None, predicted_error=ROWS).standard_error is None
    np.testing.assert_array_equal(transfer.faces, CUBE_FACES)


BEYOND, BELOW = CUBE_FACES.copy(), CUBE_FACES.copy()
BEYOND[3, 1], BELOW[5, 2] = 8, -1
SPOILT = ROWS.copy()
SPOILT[4, 4] = np.nan


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"faces": BEYOND}, "faces name vertices that do not exist"),
        ({"faces": BELOW}, "faces name vertices that do not exist"),
        ({"faces": CUBE_FACES[:, :2]}, r"'faces' has shape \(12, 2\)"),
        ({"faces": CUBE_FACES.astype(float)}, "'faces' holds float64, not integers"),
        ({"coefficients": ROWS[:, :7], "standard_error": ROWS[:, :7]}, "7 coefficients are no square of bands"),
        ({"coefficients": ROWS[:, :0], "standard_error": None}, "0 coefficients are no square"),
        ({"coefficients": np.ones((8, 121), np.float32), "standard_error": None}, "121 coefficients are no square"),
        ({"coefficients": ROWS[:7]}, r"not \(7, 9\)|not \(7, k\)|not \(7, 3\)"),
        ({"standard_error": ROWS[:, :4]}, r"'standard_error' has shape \(8, 4\), not \(8, 9\)"),
        ({"predicted_error": ROWS[:, 0]}, r"'predicted_error' has shape \(8,\), not \(8, 9\)"),
        ({"coefficients": ROWS.astype(int)}, "'coefficients' holds int64, not floats"),
        ({"normals": CUBE[:5]}, r"'normals' has shape \(5, 3\), not \(8, 3\)"),
        ({"coefficients": SPOILT}, "values in 'coefficients' that are not finite"),
        ({"standard_error": SPOILT}, "values in 'standard_error' that are not finite"),
        ({"vertices": np.full_like(CUBE, np.inf)}, "values in 'vertices' that are not finite"),
        ({"vertices": None}, "no array 'vertices'"),
    ],
)
def test_files_whose_arrays_do_not_fit_are_refused(tmp_path: Path, changes: dict, words: str) -> None:
    with pytest.raises(FileError, match=words) as error:
        _loaded(tmp_path, **changes)
    assert "\n" not in str(error.value) and "t.npz" in str(error.value)


def test_files_of_another_kind_are_refused(tmp_path: Path) -> None:
    write_npz(tmp_path / "t.npz", ARRAYS, {"format": "gash-light"})
    with pytest.raises(FileError, match="not a transfer file"):
        load_transfer(tmp_path / "t.npz")


@pytest.mark.parametrize("name", ["faces_out_of_range", "seven_coefficients"])
def test_the_cases_that_were_read(name: str) -> None:
    with pytest.raises(FileError, match="not a whole transfer file"):
        load_transfer(shared_case(f"transfer_{name}.npz"))
