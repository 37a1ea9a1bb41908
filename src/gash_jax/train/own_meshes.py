"""A user's own meshes as training data: every mesh of a folder, baked, and kept in the cache by its content."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gash_jax.files.atomic import FileError
from gash_jax.files.caches import cache_folder, source_hash
from gash_jax.files.npz import write_npz
from gash_jax.files.settings import ConfigError
from gash_jax.formats.mesh_files import READERS
from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.models.examples import Item
from gash_jax.train.corpus import LABEL_ROOMS, baked_labels, load_item


def folder_items(
    folder: str | Path, rays: int, bands: int, progress: Callable[[int, int], None] | None = None, *, bounces: int = 0
) -> list[Item]:
    """The meshes of a folder with their labels, in order of their names. Raises ConfigError where there is none."""
    folder = Path(folder)
    if not folder.is_dir():
        raise ConfigError(f"no such folder of meshes: {folder}")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in READERS)
    if not paths:
        raise ConfigError(f"{folder} holds no mesh: readable are {' '.join(READERS)}")
    items = []
    for step, path in enumerate(paths):
        items.append(labelled_mesh(path.stem, load_mesh(path), rays, bands, bounces))
        if progress:
            progress(step + 1, len(paths))
    return items


def labelled_mesh(name: str, mesh: Mesh, rays: int, bands: int, bounces: int = 0) -> Item:
    """A mesh with its labels, those of the corpus (`baked_labels`), from the cache if they were there."""
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in mesh))
    digest.update(repr((rays, bands, bounces, source_hash(LABEL_ROOMS))).encode())
    path = cache_folder() / "meshes" / f"{digest.hexdigest()[:24]}.npz"
    try:
        return load_item(path)._replace(kind=name)
    except FileError:  # not there yet, or damaged: it is only a cache
        pass
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {**mesh._asdict(), **baked_labels(mesh, bands, rays, bounces)}
    write_npz(path, arrays, {"kind": name, "rays": rays})
    return load_item(path)
