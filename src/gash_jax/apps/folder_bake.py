"""Many meshes baked into one folder: FOLDER/NAME.npz for every NAME.ply, a piece of work each (`files.shards`).

A mesh that cannot be baked does not keep the others from it: it is named at the end. A piece is known by the hash of
the mesh's file, of all other files that the bake reads, of the options, and of the source of the bake.
"""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from gash_jax.apps.mesh_bake import BakeSettings, bake_mesh
from gash_jax.apps.printing import say
from gash_jax.apps.shard_options import Work, by_jobs
from gash_jax.files.atomic import FileError
from gash_jax.files.caches import source_hash
from gash_jax.files.shards import Shard, check_merge, fault_of, read_record, write_record
from gash_jax.measure.reference import BAKE_ROOMS


def bake_folder(meshes: Sequence[Path], folder: Path, chosen: BakeSettings, work: Work, quiet: bool) -> None:
    """Bake the meshes that are not in the folder yet, or those of a shard, or check that all of them are there.

    Raises FileError for two meshes of one name, what is no folder, and meshes that could not be baked.
    """
    pieces = _pieces(meshes, folder)
    left = by_jobs(work, quiet)
    if left is None:
        return
    if left.merge:
        check_merge([_fault(mesh, path, chosen) for mesh, path in pieces], left.merge)
        say(f"{len(pieces)} bakes in {folder} are there and whole", quiet)
        return
    folder.mkdir(parents=True, exist_ok=True)
    own = (left.shard or Shard()).of(pieces)
    failures = []
    for number, (mesh, path) in enumerate(own, start=1):
        try:
            if not _fault(mesh, path, chosen):
                say(f"{path} is there ({number} of {len(own)})", quiet)
                continue
            say(f"{mesh} ({number} of {len(own)})", quiet)
            bake_mesh(mesh, path, chosen, quiet)
            write_record(folder, path.stem, _key(mesh, chosen), path, {})
        except (ValueError, OSError) as error:
            failures.append(str(error) if str(mesh) in str(error) else f"{mesh}: {error}")
    if failures:
        raise FileError(f"{len(failures)} of {len(own)} meshes failed, the others are kept: " + "; ".join(failures))


def _pieces(meshes: Sequence[Path], folder: Path) -> list[tuple[Path, Path]]:
    """Meshes and their files, by name: machines may list a folder in different orders."""
    if folder.exists() and not folder.is_dir():
        raise FileError(f"{folder} is a file: several meshes are baked into a folder, name one that need not exist")
    if folder.suffix == ".npz":
        raise FileError(f"{folder} names a file: several meshes are baked into a folder, such as -o {folder.stem}")
    names: dict[str, Path] = {}
    for mesh in meshes:
        if (other := names.setdefault(mesh.stem, mesh)) != mesh:
            raise FileError(f"{other} and {mesh} would both be {folder / mesh.stem}.npz: bake them into two folders")
    return [(names[name], folder / f"{name}.npz") for name in sorted(names)]


def _fault(mesh: Path, path: Path, chosen: BakeSettings) -> str:
    whole = read_record(path.parent, path.stem, _key(mesh, chosen), path) is not None
    return fault_of(str(path), path, whole, "damaged or of another bake")


def _key(mesh: Path, chosen: BakeSettings) -> str:
    """Hash of everything that determines the bake of a mesh. Raises FileError where a file is not there."""
    digest = hashlib.sha256(source_hash(BAKE_ROOMS).encode())
    for path in chosen.inputs(mesh):
        if path.is_file():
            digest.update(hashlib.sha256(path.read_bytes()).digest())
        elif path == chosen.light_path:  # a light by name
            digest.update(str(path).encode())
        else:
            raise FileError(f"no such file: {path}")
    files = (mesh.suffix.lower(), len(chosen.occluders), chosen.points_path is not None)
    unnamed = chosen._replace(light_path=None, points_path=None, occluders=())
    digest.update(repr((unnamed, files)).encode())
    return digest.hexdigest()
