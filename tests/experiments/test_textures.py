"""The scripts that hold textures beside vertices run, and look up what they say."""

from pathlib import Path

import numpy as np
import pytest

from docs.texture_tables import texture_table
from experiments.textures import pictures, run, scenes
from gash_jax.geometry.mesh import face_areas, subdivide_midpoint


def test_places_are_the_same_on_the_faces_of_subdivided_meshes() -> None:
    mesh = scenes.table_on_a_floor()
    places = run.places_on(mesh, 300)
    expected = run.at_places(mesh.vertices, mesh.faces, places)
    for _ in range(2):
        mesh, places = subdivide_midpoint(mesh), run.in_children(places)
        np.testing.assert_allclose(run.at_places(mesh.vertices, mesh.faces, places), expected, atol=1e-6)
        assert places.barycentric.min() >= -1e-12


def test_places_are_drawn_by_area() -> None:
    mesh = scenes.table_on_a_floor()
    floor = run.places_on(mesh, 20000).face < 2
    assert np.mean(floor) == pytest.approx(
        face_areas(mesh.vertices, mesh.faces)[:2].sum() / face_areas(*mesh[::2]).sum(), abs=0.02
    )


def test_both_scripts_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("xatlas", reason="needs the extra textures")
    monkeypatch.setattr(run, "scenes", lambda folder: {"table": scenes.table_on_a_floor()})
    result = run.main(None, tmp_path / "textures.json", quick=True)
    assert {path.name for path in tmp_path.iterdir()} == {"textures.json", "textures.png"}
    errors = [row["radiance"] for row in result["rows"] if row["way"] == "vertices"]
    assert len(errors) == 2 and errors[1] < errors[0]
    assert "| table |" in texture_table(result)
    pictures.main(None, tmp_path / "picture.png", quick=True)
    assert (tmp_path / "picture.png").exists()
