"""The script that measures geometry images runs, and what it measures is what it says."""

from pathlib import Path

import numpy as np
import pytest

from docs import animation_tables
from experiments.geometry_images import run
from gash_jax.geometry.geometry_image import geometry_image
from gash_jax.geometry.parameterisation import parameterise
from gash_jax.shapes.primitives import plane


def test_a_plane_loses_nothing() -> None:
    mesh = plane(1.0, 4)
    square = parameterise(mesh, "harmonic")
    linear = mesh.vertices @ np.array([[1.0], [2], [3]], np.float32)
    found = run.size_figures(square, mesh, linear, 17)
    assert found["positions_most"] < 1e-6 and found["transfer_relrmse"] < 1e-6 and found["fitted_relrmse"] < 1e-6
    assert found["below_a_texel"] == 0 and found["size"] == 17
    assert run.size_figures(square, mesh, linear, 5)["below_a_texel"] == 1  # faces of half a texel
    report = run.map_figures(square, 1.0)
    assert report["stretch"] == pytest.approx(1, abs=1e-6) and report["smallest_area"] == pytest.approx(
        1 / 32, rel=1e-5
    )
    assert (geometry_image(square, 5).face >= 0).all()


def test_the_whole_script_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "SIZES", (16, 24))
    monkeypatch.setattr(run, "EVENNESSES", (0.0, 0.75))
    monkeypatch.setattr(run, "generated_body", lambda size: run.prepare_mesh(*_ball())[0])
    result = run.main(None, tmp_path / "results.json", quick=True)
    assert [row["method"] for row in result["rows"]] == ["harmonic", "stretch"]
    assert {path.name for path in tmp_path.iterdir()} == {"results.json", "round_trip.png", "reconstructions.png"}
    for row in result["rows"]:
        errors = [found["positions_rms"] for found in row["sizes"]]
        assert 0 < errors[1] < errors[0]
    for table in (animation_tables.maps_table, animation_tables.round_trip_table, animation_tables.evenness_table):
        assert table(result).count("\n|") >= 2


def _ball() -> tuple[np.ndarray, np.ndarray]:
    from gash_jax.shapes.primitives import bumpy_sphere

    mesh = bumpy_sphere(4)
    return mesh.vertices, mesh.faces
