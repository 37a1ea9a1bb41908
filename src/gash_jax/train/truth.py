"""Ground truth of deforming meshes: every frame baked, kept in the cache in files of 16 frames.

A file holds the coefficients of its frames in float16, (t, v, k), and of a glossy bake their visibility, uncompressed,
so that they can be read frame by frame without being loaded, and the seconds that they took. Its name is the hash of
everything that determines them: positions and normals of its frames, faces, rows, rays, bands, gloss, the seeds, the
source of the bake. So a bake that was interrupted
goes on where it stopped, frames that two runs share are baked once, several machines may bake parts of one animation
into one cache, and a file that was damaged is baked again: it also holds the hash of its arrays.

Frame i is baked with seed i, so that the noise of the rays is independent from frame to frame.
"""

import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.files.atomic import FileError
from gash_jax.files.caches import cache_folder, source_hash
from gash_jax.files.npz import open_npz, read_npz, write_npz
from gash_jax.files.shards import Shard, check_merge, fault_of
from gash_jax.geometry.mesh import Mesh, MeshError
from gash_jax.prt.sequence import MovingScene, bake_frame, posed_meshes

FRAMES = 16  # in a file
BAKE_ROOMS = ("algebra", "geometry", "prt")
Progress = Callable[[int, int], None]


class Truth(NamedTuple):
    """Coefficients of all frames of a scene, in files."""

    scene: MovingScene
    bands: int
    rays: int
    files: tuple[Path, ...]
    cpu_seconds: float  # a frame, of all cores together, when it was baked
    wall_seconds: float

    def __len__(self) -> int:
        return len(self.scene.animation)

    def shards(self, name: str = "coefficients") -> list[Float[np.ndarray, "t v _"]]:
        """That array of every file, float16; large ones stay in their files until they are used."""
        return [open_npz(path, "baked frames")[name] for path in self.files]

    def coefficients(self) -> Float[np.ndarray, "t v k"]:
        """The coefficients of all frames, float16, in memory."""
        return np.concatenate(self.shards())


def bake_truth(
    scene: MovingScene, bands: int, rays: int, progress: Progress | None = None, glossy: bool = False
) -> Truth:
    """Bake the frames of a scene that are not there yet; the ground truth of all of them."""
    files, seconds = _bake_files(scene, bands, rays, glossy, _firsts(scene), progress)
    cpu, wall = (seconds / max(len(scene.animation), 1)).tolist()
    return Truth(scene, bands, rays, tuple(files), cpu, wall)


def bake_shard(
    scene: MovingScene, bands: int, rays: int, shard: Shard, progress: Progress | None = None, glossy: bool = False
) -> int:
    """Bake those files of frames that are a shard's and not there yet; how many frames are the shard's."""
    firsts = shard.of(_firsts(scene))
    _bake_files(scene, bands, rays, glossy, firsts, progress)
    return sum(_last(scene, first) - first for first in firsts)


def check_truth(scene: MovingScene, bands: int, rays: int, shards: int, glossy: bool = False) -> None:
    """Raise FileError unless all frames are in the cache and whole: which of so many shards to run again."""
    faults = []
    for first in _firsts(scene):
        last = _last(scene, first)
        path = _file_of(scene, list(posed_meshes(scene.animation, first, last)), bands, rays, glossy, first)
        faults.append(fault_of(f"the file of frames {first} to {last - 1}", path, _seconds_of(path) is not None))
    check_merge(faults, shards)


def _firsts(scene: MovingScene) -> Sequence[int]:
    """The first frame of every file."""
    return range(0, len(scene.animation), FRAMES)


def _last(scene: MovingScene, first: int) -> int:
    """The frame after the last one of a file."""
    return min(first + FRAMES, len(scene.animation))


def _bake_files(
    scene: MovingScene, bands: int, rays: int, glossy: bool, firsts: Sequence[int], progress: Progress | None
) -> tuple[list[Path], Float[np.ndarray, "2"]]:
    """Bake files of frames that are not there yet; all of `firsts`, and the CPU and wall seconds that they took."""
    files, seconds, done = [], np.zeros(2), 0
    count = sum(_last(scene, first) - first for first in firsts)
    for first in firsts:
        last = _last(scene, first)
        meshes = list(posed_meshes(scene.animation, first, last))
        path = _file_of(scene, meshes, bands, rays, glossy, first)
        taken = _seconds_of(path)
        if taken is None:

            def baked(frames: int, before: int = done) -> None:
                if progress:
                    progress(before + frames, count)

            _bake_file(path, scene, meshes, bands, rays, glossy, first, baked)
            taken = _seconds_of(path)
            if taken is None:
                raise FileError(f"{path} was changed while it was written: bake again")
        seconds += taken
        files.append(path)
        done += last - first
        if progress:
            progress(done, count)
    return files, seconds


def _file_of(scene: MovingScene, meshes: list[Mesh], bands: int, rays: int, glossy: bool, first: int) -> Path:
    """Where some frames are kept."""
    digest = hashlib.sha256(np.ascontiguousarray(scene.animation.mesh.faces).tobytes())
    for mesh in meshes:
        digest.update(mesh.vertices.tobytes() + mesh.normals.tobytes())
    rows = scene.rows
    digest.update(repr((rows.start, rows.stop, bands, rays, glossy, first, source_hash(BAKE_ROOMS))).encode())
    return cache_folder() / "frames" / f"{digest.hexdigest()[:24]}.npz"


def _seconds_of(path: Path) -> Float[np.ndarray, "2"] | None:
    """CPU and wall seconds that a file's frames took; None where it is not there, or is not what was written."""
    try:
        arrays, metadata = read_npz(path, "baked frames", ("coefficients",))
        whole = metadata["sha256"] == _hash_of(arrays)
        return np.array([metadata["cpu_seconds"], metadata["wall_seconds"]], float) if whole else None
    except (FileError, LookupError, TypeError, ValueError):
        return None


def _bake_file(
    path: Path,
    scene: MovingScene,
    meshes: list[Mesh],
    bands: int,
    rays: int,
    glossy: bool,
    first: int,
    baked: Callable[[int], None],
) -> None:
    """Bake some frames and keep them. Raises MeshError for one that cannot be baked, as a mesh shrunk to a point."""
    started, frames = (time.process_time(), time.perf_counter()), []
    for number, mesh in enumerate(meshes):
        try:
            found = bake_frame(mesh, scene.rows, bands, rays, first + number, glossy)
        except MeshError as error:
            raise MeshError(f"frame {first + number}: {error}") from None
        frames.append({name: array.astype(np.float16) for name, array in found.items()})
        baked(number + 1)
    arrays = {name: np.stack([frame[name] for frame in frames]) for name in frames[0]}
    write_frames(path, arrays, time.process_time() - started[0], time.perf_counter() - started[1])


def write_frames(path: Path, arrays: Mapping[str, Float[np.ndarray, "t v _"]], cpu: float, wall: float) -> None:
    """A file of baked frames: `coefficients`, and perhaps `visibility`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_npz(path, arrays, {"sha256": _hash_of(arrays), "cpu_seconds": cpu, "wall_seconds": wall})


def _hash_of(arrays: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(arrays[name].tobytes())
    return digest.hexdigest()
