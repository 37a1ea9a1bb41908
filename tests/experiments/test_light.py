"""The experiments on windows and fewer numbers, run small, and what their tables say of that."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from docs.light_tables import fewer_numbers_table, kept_table, map_sizes_table, shaded_table
from experiments.fewer_numbers import run as fewer_numbers
from experiments.maps import CODE, lights
from experiments.windows import pictures
from experiments.windows import run as windows


def test_windows_run_small(tmp_path: Path) -> None:
    result = windows.main(output=tmp_path / "w.json", meshes=None, maps=None, quick=True)
    assert (tmp_path / "w.json").is_file()
    kept = {(row["light"], row["window"]): row for row in result["kept"]}
    for light in CODE:
        assert kept[light, "radiance"]["radiance"] >= -1e-6 and kept[light, "irradiance"]["irradiance"] >= -1e-6
        assert kept[light, "none"]["radiance"] < -0.1 and kept[light, "none"]["l=1"] == 1
    shaded = {(row["light"], row["window"]): row for row in result["shaded"]}
    assert all(shaded[light, "radiance"]["negative"] <= shaded[light, "none"]["negative"] for light in CODE)
    assert kept_table(result).count("\n| ") == len(CODE) and "`radiance`" in shaded_table(result)


def test_windows_are_drawn(tmp_path: Path) -> None:
    pictures.main(output=tmp_path / "w.png", meshes=None, maps=None, quick=True)
    with Image.open(tmp_path / "w.png") as picture:
        pixels = np.asarray(picture)
    assert (pixels == pictures.MAGENTA).all(axis=-1).sum() > 20  # an unwindowed sun


def test_fewer_numbers_run_small(tmp_path: Path) -> None:
    result = fewer_numbers.main(output=tmp_path / "f.json", meshes=None, maps=None, quick=True)
    median = {(row["what"], row["way"], row["light"]): row["median"] for row in result["rows"]}
    for light in CODE:
        four, two = (median["transfer", way, light] for way in ("4 floats", "4 floats, two bands"))
        assert median["transfer", "9 of 16 bits", light] < 1e-3 < four < two
    assert "| transfer: 4 of 8 bits | 4 |" in fewer_numbers_table(result)


def test_a_summary_by_hand() -> None:
    rows = [
        {"what": "a", "way": "b", "bytes": 1, "light": "c", "mesh": mesh, "relrmse": error}
        for mesh, error in (("x", 0.1), ("y", 0.4), ("z", 0.2))
    ]
    entry = {"what": "a", "way": "b", "bytes": 1, "light": "c", "meshes": 3, "median": 0.2, "worst": 0.4, "mesh": "y"}
    assert fewer_numbers.summary(rows) == [entry]


def test_the_table_of_sizes() -> None:
    machine = {"processor": "p", "cores": 2}
    row = {"height": 4, "file_mib": 0.1, "seconds": 1.25, "peak_mib": 300.4}
    assert "| 8 x 4 | 0.1 | 1.2 | 300 |" in map_sizes_table({"rows": [row], "machine": machine, "commit": "c"})


def test_a_folder_without_maps_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no .hdr map"):
        lights(tmp_path, 3)
