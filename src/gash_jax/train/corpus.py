"""The procedural corpus: shapes from a seed, their baked labels, cached by content, split by shape.

An item is one shape with its transfer and its hemisphere visibility, and with `bounces` what each bounce adds off white
surfaces and the noise of the labels (`prt.bounce_series`). Its cache name is the hash of everything that
determines it (generator parameters, ray count, bands, the source text of the rooms that made it), so a change of
the generator or of the bake makes new labels, and a killed build continues where it stopped; several machines may
build parts of one corpus in one cache. An item holds the hash of its arrays. Shapes are split by index, never by
vertex.
"""

import hashlib
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from gash_jax.files.atomic import FileError
from gash_jax.files.caches import cache_folder, source_hash
from gash_jax.files.cores import available_cores
from gash_jax.files.npz import arrays_hash, check_arrays, read_npz, write_npz
from gash_jax.files.shards import check_merge, fault_of
from gash_jax.geometry.mesh import Mesh
from gash_jax.models.examples import Item
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bounce_series import bake_series
from gash_jax.prt.hemisphere import hemisphere_visibility
from gash_jax.shapes.procedural import make_shape
from gash_jax.train.config import DataConfig

SHAPES = {"vertices": ("v", 3), "normals": ("v", 3), "faces": ("f", 3), "coefficients": ("v", "k")}
# what items with bounces hold besides
BOUNCED = {"bounced": ("v", "n", "k"), "noise": ("v", "b")}
LABEL_ROOMS = ("algebra", "geometry", "shapes", "prt")


def item_path(data: DataConfig, bands: int, index: int, bounces: int = 0) -> Path:
    """Where the item lives in the cache."""
    kinds, number = _kinds_and_number(data, index)
    shape = (data.seed, kinds, data.min_vertices, data.max_vertices, number)
    parts = (*shape, data.rays, bands, bounces, source_hash(LABEL_ROOMS))
    name = hashlib.sha256(repr(parts).encode()).hexdigest()[:24]
    return cache_folder() / "corpus" / f"{name}.npz"


def _kinds_and_number(data: DataConfig, index: int) -> tuple[str, int]:
    """Which kinds a shape is of, and its number among them: broken shapes come after all others."""
    whole = data.validation_shapes + data.shapes
    return (data.kinds, index) if index < whole else ("broken", index - whole)


def build_item(data: DataConfig, bands: int, index: int, bounces: int = 0) -> Path:
    """Make, bake and cache one item; returns its path at once if it is there already."""
    path = item_path(data, bands, index, bounces)
    if path.exists():
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    kinds, number = _kinds_and_number(data, index)
    kind, mesh = make_shape(data.seed, number, (data.min_vertices, data.max_vertices), kinds)
    arrays = {**mesh._asdict(), **baked_labels(mesh, bands, data.rays, bounces, number)}
    parts = {"kind": kind, "index": number, "seed": data.seed, "rays": data.rays}
    write_npz(path, arrays, {**parts, "sha256": arrays_hash(arrays)})
    return path


def baked_labels(mesh: Mesh, bands: int, rays: int, bounces: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Labels of a mesh by name: of a plain bake, or with bounces of the terms of a series."""
    seen = hemisphere_visibility(mesh)
    if not bounces:
        labels = bake_transfer(mesh, bands, rays, replicates=1, seed=seed).coefficients
        return {"coefficients": labels, "visibility": seen}
    series = bake_series(mesh, bands, rays, bounces, seed=seed)
    assert series.spread is not None
    bounced = np.ascontiguousarray(np.moveaxis(series.terms[1:], 0, 1))
    return {"coefficients": series.terms[0], "visibility": seen, "bounced": bounced, "noise": series.spread}


def load_item(path: Path) -> Item:
    """Read an item from the cache. Raises FileError where it is not whole."""
    arrays, metadata = read_npz(path, "corpus item", ())
    shapes = SHAPES | (BOUNCED if BOUNCED.keys() & arrays.keys() else {})
    sizes = check_arrays(path, "corpus item", arrays, shapes, integers=("faces",))
    count, faces, seen = sizes["v"], arrays["faces"], arrays.get("visibility")
    inside = not faces.size or (faces.min() >= 0 and faces.max() < count)
    seen_by_all = seen is not None and seen.dtype == bool and seen.ndim == 2 and len(seen) == count
    changed = "sha256" in metadata and metadata["sha256"] != arrays_hash(arrays)  # items of before have no hash
    if changed or not inside or not seen_by_all or not isinstance(metadata.get("kind"), str):
        raise FileError(f"{path} is not a whole corpus item: write it again")
    mesh = Mesh(arrays["vertices"], arrays["normals"], arrays["faces"])
    labels = arrays["coefficients"], arrays["visibility"].astype(np.float32)
    return Item(metadata["kind"], mesh, *labels, *(arrays.get(name) for name in BOUNCED))


def _load_or_rebuild(data: DataConfig, bands: int, index: int, bounces: int) -> Item:
    path = build_item(data, bands, index, bounces)
    try:
        return load_item(path)
    except FileError:  # a cache file damaged from outside is only a cache file
        path.unlink()
        return load_item(build_item(data, bands, index, bounces))


def build_corpus(
    data: DataConfig,
    bands: int,
    indices: Int[np.ndarray, "n"],
    progress: Callable[[int, int], None] | None = None,
    *,
    bounces: int = 0,
) -> list[Item]:
    """Items in the order of `indices`; missing ones are made in parallel processes."""
    missing = [int(i) for i in indices if not item_path(data, bands, int(i), bounces).exists()]
    done = len(indices) - len(missing)
    if progress:
        progress(done, len(indices))
    workers = min(available_cores(), len(missing) // 8)  # a process costs about as much as eight shapes
    if workers > 1:
        with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
            futures = [pool.submit(build_item, data, bands, index, bounces) for index in missing]
            try:
                for future in as_completed(futures):
                    future.result()
                    done += 1
                    if progress:
                        progress(done, len(indices))
            finally:
                pool.shutdown(cancel_futures=True)  # who is interrupted waits for what was begun, not for all the rest
    else:
        for index in missing:
            build_item(data, bands, index, bounces)
            done += 1
            if progress:
                progress(done, len(indices))
    return [_load_or_rebuild(data, bands, int(index), bounces) for index in indices]


def check_corpus(data: DataConfig, bands: int, indices: Int[np.ndarray, "n"], shards: int, *, bounces: int = 0) -> None:
    """Raise FileError unless all items are in the cache and whole: which of so many shards to run again."""
    check_merge([_fault(item_path(data, bands, int(index), bounces), int(index)) for index in indices], shards)


def _fault(path: Path, index: int) -> str:
    try:
        load_item(path)
    except FileError:
        return fault_of(f"shape {index}", path, whole=False)
    return ""


class Split(NamedTuple):
    """Shape indices; a smaller corpus validates on the same shapes as a larger one."""

    training: Int[np.ndarray, "n"]
    validation: Int[np.ndarray, "m"]
    broken: Int[np.ndarray, "b"]


def split_indices(data: DataConfig) -> Split:
    """Which shapes of a corpus are for what."""
    whole = data.validation_shapes + data.shapes
    validation = np.arange(data.validation_shapes)
    return Split(np.arange(data.shapes) + data.validation_shapes, validation, np.arange(data.broken_shapes) + whole)
