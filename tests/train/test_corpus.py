"""The corpus: cached by content, resumable, split by shape."""

from pathlib import Path

import numpy as np
import pytest

from gash_jax.files.atomic import FileError
from gash_jax.files.npz import read_npz, write_npz
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bounce_series import bake_series
from gash_jax.shapes.procedural import make_shape
from gash_jax.train.config import DataConfig
from gash_jax.train.corpus import build_corpus, build_item, check_corpus, item_path, load_item, split_indices

SMALL = DataConfig(shapes=2, validation_shapes=1, rays=16, min_vertices=200, max_vertices=400)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path))


def test_items_are_made_once_and_read_back() -> None:
    training, validation, broken = split_indices(SMALL)
    assert validation.tolist() == [0] and training.tolist() == [1, 2] and not len(broken)
    seen: list[tuple[int, int]] = []
    indices = np.concatenate([training, validation])
    items = build_corpus(SMALL, 3, indices, lambda done, total: seen.append((done, total)))
    assert seen[0] == (0, 3) and seen[-1] == (3, 3)
    stamps = [item_path(SMALL, 3, i).stat().st_mtime_ns for i in range(3)]
    again = build_corpus(SMALL, 3, indices)
    assert stamps == [item_path(SMALL, 3, i).stat().st_mtime_ns for i in range(3)]
    for first, second in zip(items, again, strict=True):
        np.testing.assert_array_equal(first.coefficients, second.coefficients)
        assert first.visibility.shape == (len(first.mesh.vertices), 25)
        assert np.isfinite(first.coefficients).all() and 0.0 < first.visibility.mean() <= 1.0


def test_the_cache_name_depends_on_what_determines_the_labels() -> None:
    names = {
        item_path(SMALL, 3, 0),
        item_path(SMALL, 3, 1),
        item_path(SMALL, 4, 0),
        item_path(DataConfig(**{**vars(SMALL), "rays": 32}), 3, 0),
        item_path(DataConfig(**{**vars(SMALL), "seed": 1}), 3, 0),
    }
    assert len(names) == 5


def test_broken_shapes_come_after_all_others_and_do_not_depend_on_how_many_there_are() -> None:
    two, four = (DataConfig(**{**vars(SMALL), "shapes": count, "broken_shapes": 2}) for count in (2, 4))
    assert split_indices(two).broken.tolist() == [3, 4] and split_indices(four).broken.tolist() == [5, 6]
    assert [item_path(two, 3, i) for i in (3, 4)] == [item_path(four, 3, i) for i in (5, 6)]
    assert item_path(two, 3, 3) not in {item_path(four, 3, i) for i in range(5)}
    items = build_corpus(two, 3, split_indices(two).broken)
    assert [item.kind for item in items] == [make_shape(0, i, (200, 400), "broken")[0] for i in (0, 1)]


def test_a_damaged_cache_file_is_made_again() -> None:
    path = build_item(SMALL, 3, 0)
    truth = load_item(path).coefficients
    path.write_bytes(path.read_bytes()[:100])
    np.testing.assert_array_equal(build_corpus(SMALL, 3, np.array([0]))[0].coefficients, truth)


@pytest.mark.parametrize("kind", ["nan", "short", "outside", "floats", "nameless"])
def test_a_cache_file_whose_arrays_do_not_fit_is_made_again(kind: str) -> None:
    path = build_item(SMALL, 3, 0)
    truth = load_item(path)
    arrays, metadata = read_npz(path, "corpus item", ())
    if kind == "nan":
        arrays["coefficients"][3, 0] = np.nan
    elif kind == "short":
        arrays["visibility"] = arrays["visibility"][:-1]
    elif kind == "outside":
        arrays["faces"][0, 0] = len(truth.coefficients)
    elif kind == "floats":
        arrays["faces"] = arrays["faces"].astype(np.float32)
    write_npz(path, arrays, {} if kind == "nameless" else metadata)
    with pytest.raises(FileError, match="corpus item|not finite"):
        load_item(path)
    (again,) = build_corpus(SMALL, 3, np.array([0]))
    np.testing.assert_array_equal(again.coefficients, truth.coefficients)
    assert again.kind == truth.kind


def test_a_killed_build_goes_on_where_it_stopped() -> None:
    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build_corpus(SMALL, 3, np.arange(3), stop)
    stamps = {i: item_path(SMALL, 3, i).stat().st_mtime_ns for i in range(2)}
    assert not item_path(SMALL, 3, 2).exists()
    seen: list[tuple[int, int]] = []
    assert len(build_corpus(SMALL, 3, np.arange(3), lambda done, total: seen.append((done, total)))) == 3
    assert seen == [(2, 3), (3, 3)]
    assert stamps == {i: item_path(SMALL, 3, i).stat().st_mtime_ns for i in range(2)}


def test_items_with_bounces_come_back_as_they_were_baked() -> None:
    data = DataConfig(**{**vars(SMALL), "kinds": "all"})
    assert len({item_path(d, 3, 0, bounces) for d in (SMALL, data) for bounces in (0, 1, 2)}) == 6
    (item,) = build_corpus(data, 3, np.array([1]), bounces=2)
    kind, mesh = make_shape(data.seed, 1, (200, 400), kinds="all")
    series = bake_series(mesh, 3, 16, 2, seed=1)
    assert item.kind == kind and item.bounced is not None and item.bounced.shape == (len(mesh.vertices), 2, 9)
    np.testing.assert_array_equal(item.coefficients, series.terms[0])
    np.testing.assert_array_equal(item.bounced[:, 1], series.terms[2])
    np.testing.assert_array_equal(item.noise, series.spread)
    assert item.visibility.shape == (len(mesh.vertices), 25)
    check_corpus(data, 3, np.array([1]), 1, bounces=2)
    with pytest.raises(FileError):
        check_corpus(data, 3, np.array([1]), 1, bounces=1)


def test_items_without_bounces_are_plain_bakes() -> None:
    item = load_item(build_item(SMALL, 3, 1))
    plain = bake_transfer(item.mesh, 3, 16, replicates=1, seed=1).coefficients
    np.testing.assert_array_equal(item.coefficients, plain)
    assert item.bounced is None and item.noise is None


def test_a_file_with_half_of_the_bounced_labels_is_refused() -> None:
    path = build_item(SMALL, 3, 0, 1)
    arrays, metadata = read_npz(path, "corpus item", ())
    del arrays["noise"], metadata["sha256"]
    write_npz(path, arrays, metadata)
    with pytest.raises(FileError, match="noise"):
        load_item(path)
