"""The surfel network by the NumPy runtime: lists, bands, bounces and expected errors as in the package."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh
from gash_jax.graph import surfel_lists
from gash_jax.graph.surfel_cover import surfel_cover
from gash_jax.graph.surfel_graph import normalised, plan_surfels
from gash_jax.models.families import model_config
from gash_jax.models.model import load_model, save_model
from runtimes import gash_numpy
from tests.helpers.small_networks import MESHES, NETS, written
from tests.helpers.split import split_mesh

SPLIT = {**MESHES, "split": split_mesh(MESHES["generated"])[0]}
SURFEL_NETS = [name for name, config in NETS.items() if config.name == "local"]
# knows all that there is, and says 3 bands
KNOWING = model_config("local", channels=8, known_bands=6, known_bounces=2)


def _assert_equal(found: np.ndarray, truth: np.ndarray) -> None:
    """Within 1e-5 of the largest."""
    assert (np.abs(found - truth) / np.abs(truth).max()).max() <= 1e-5


@pytest.mark.parametrize("mesh", SPLIT.values(), ids=SPLIT)
@pytest.mark.parametrize("net", SURFEL_NETS)
def test_surfels_predicts_its_error_as_the_package_does(net: str, mesh: Mesh, tmp_path: Path) -> None:
    path = written(NETS[net], tmp_path / "model.npz")
    model, told = load_model(path), gash_numpy.load_model(str(path))
    coefficients, error = gash_numpy.predict_with_error(told, *mesh)
    np.testing.assert_array_equal(coefficients, gash_numpy.predict(told, *mesh))
    truth = np.asarray(model.with_error(model.graph(mesh))[1])
    assert error.dtype == np.float32 and error.shape == truth.shape and error.max() > 0
    _assert_equal(error, truth)
    assert not error[~np.any(mesh.normals, axis=1)].any()


@pytest.mark.parametrize("bands", [1, 3, 6])
@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_bands_and_bounces_equal_the_package(mesh: Mesh, bands: int, tmp_path: Path) -> None:
    path = written(KNOWING, tmp_path / "model.npz")
    model, told = load_model(path, bands), gash_numpy.load_model(str(path), bands)
    assert told.config == model.config.to_dict()
    _assert_equal(gash_numpy.predict(told, *mesh), model.predict(mesh).coefficients)
    seen = []
    for bounces in (0, 1, 2):
        truth = model.predict(mesh, bounces=bounces, albedo=0.6 if bounces else None)
        assert truth.predicted_error is not None
        found = gash_numpy.predict_with_error(told, *mesh, bounces=bounces, albedo=0.6)
        for mine, theirs in zip(found, (truth.coefficients, truth.predicted_error), strict=True):
            assert mine.dtype == np.float32 and mine.shape == theirs.shape
            _assert_equal(mine, theirs)
        seen.append(found[0])
    assert min(np.abs(a - b).max() for a, b in zip(seen, seen[1:], strict=False)) > 1e-2


def test_more_than_it_knows_is_refused(tmp_path: Path) -> None:
    path = str(written(NETS["local"], tmp_path / "m.npz"))
    with pytest.raises(ValueError, match="bands=4: model local knows 3"):
        gash_numpy.load_model(path, 4)
    with pytest.raises(ValueError, match="bounces=1: model local knows none"):
        gash_numpy.predict_with_error(gash_numpy.load_model(path), *MESHES["odd"], bounces=1, albedo=0.5)
    with pytest.raises(ValueError, match="bands=2: model mlp knows 3"):
        gash_numpy.load_model(str(written(NETS["mlp"], tmp_path / "m.npz")), 2)


@pytest.mark.parametrize("mesh", SPLIT.values(), ids=SPLIT)
def test_surfels_are_those_of_the_package(mesh: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surfel_lists, "CALL", 2048)
    positions = normalised(mesh)[0]
    plan, records = plan_surfels(mesh, positions)
    first = gash_numpy.first_of_repeated(positions, mesh.normals)
    np.testing.assert_array_equal(first, plan.first)
    faces = gash_numpy.outward_faces(mesh.vertices, mesh.normals, first[mesh.faces])
    area = gash_numpy.face_areas(mesh.vertices, faces) / gash_numpy.surface_radius(mesh.vertices, mesh.faces) ** 2
    axes = gash_numpy.surface_axes(positions, faces, area)
    tree = gash_numpy.build_tree(positions, faces, area, axes)
    np.testing.assert_array_equal(faces, plan.faces)
    for mine, theirs in zip(tree, plan.tree, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_array_equal(gash_numpy.surfel_records(tree, positions, faces), records)
    np.testing.assert_array_equal(gash_numpy.corner_table(faces, len(positions)), plan.corners)
    filled = [part for part in plan.lists if len(part.vertices)]
    assert len(filled) > 2
    covers = surfel_cover(plan.close, plan.tree, plan.faces, positions, mesh.normals)
    for vertices, *theirs in filled:
        mine = gash_numpy.list_surfels(tree, records, positions[vertices], mesh.normals[vertices])
        assert mine[0].shape[1] <= theirs[0].shape[1]
        seen_from = list(zip(positions[vertices], mesh.normals[vertices], strict=True))
        _assert_same_lists(mine[:2], theirs, seen_from, records)
        covered = gash_numpy.cover(tree, faces, positions, vertices, mesh.normals[vertices], mine[2])
        np.testing.assert_allclose(covered, covers[vertices], rtol=1e-4, atol=1e-6)
    assert covers.any()


def _assert_same_lists(mine: Any, theirs: Any, seen_from: list[tuple[np.ndarray, np.ndarray]], records: Any) -> None:
    """The same surfels with the same weights, in any order; `seen_from`: position and normal of each vertex.

    Whether what just touches the horizon is in a list is up to rounding, as it counts nothing.
    """
    for *rows, (place, normal) in zip(*mine, *theirs, seen_from, strict=True):
        a, b = (dict(zip(table[weight > 0], weight[weight > 0], strict=True)) for table, weight in (rows[:2], rows[2:]))
        assert all(a[node] == b[node] for node in a.keys() & b.keys())
        for node in a.keys() ^ b.keys():
            record = records[node].astype(np.float64)
            xx, yy, zz, xy, xz, yz = record[14:]
            spread = normal @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ normal
            assert abs((record[:3] - place) @ normal + np.sqrt(max(spread, 0))) < 1e-5


def test_lists_that_are_too_long_keep_the_most_important(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surfel_lists, "WIDTHS", (16, 32))
    monkeypatch.setattr(gash_numpy, "LONGEST", 32)
    mesh = MESHES["generated"]
    positions = normalised(mesh)[0]
    plan, records = plan_surfels(mesh, positions)
    vertices, *theirs = plan.lists[-1]
    tree: Any = plan.tree
    mine = gash_numpy.list_surfels(tree, records, positions[vertices], mesh.normals[vertices])
    assert mine[0].shape[1] == 32 and (mine[1] > 0).all(axis=1).mean() > 0.5
    seen_from = list(zip(positions[vertices], mesh.normals[vertices], strict=True))
    _assert_same_lists(mine[:2], theirs, seen_from, records)


def test_the_bound_goes_into_the_transfer_file(tmp_path: Path) -> None:
    model = load_model(written(NETS["local"], tmp_path / "m.npz"))
    save_model(tmp_path / "m.npz", model.config, model.params, bound=1.5)
    arrays = gash_numpy.predict_transfer(gash_numpy.load_model(str(tmp_path / "m.npz")), *MESHES["odd"])
    truth = load_model(tmp_path / "m.npz").predict(MESHES["odd"])
    assert json.loads(str(arrays["metadata"]))["bound"] == truth.metadata["bound"] == 1.5
