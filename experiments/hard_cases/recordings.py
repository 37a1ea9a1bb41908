"""What is hard about files of animations: frames that are broken, one alone, more than fit into memory."""

import tempfile
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from experiments.hard_cases.directions import SILENT
from gash_jax.apps.cli import gash
from gash_jax.files.npz import Rows, read_npz, write_npz_rows
from gash_jax.formats.animations import load_animation
from gash_jax.formats.meshes import read_mesh
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.sequence import moving_scene
from gash_jax.shapes.primitives import icosphere, plane
from gash_jax.train.config import DataConfig
from gash_jax.train.deforming_run import split_animation
from gash_jax.train.truth import bake_truth

BANDS, RAYS = 3, 64


@contextmanager
def temporary_file(name: str) -> Iterator[Path]:
    """A path in a folder that goes away; an error that names the path says the name alone."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        try:
            yield path
        except ValueError as error:
            raise ValueError(str(error).replace(str(path), name)) from None


def _grown() -> np.ndarray:
    """Four frames of a ball that grows."""
    return icosphere(1).vertices * np.linspace(1, 2, 4, dtype=np.float32)[:, None, None]


def single_frame() -> tuple[float, str]:
    """`gash animate` of one frame against the bake of its mesh."""
    ball = icosphere(2)
    with temporary_file("one.npz") as path:
        np.savez(path, verts=ball.vertices[None], faces=ball.faces)
        output, options = path.with_name("baked.npz"), ["--bands", str(BANDS), "--rays", str(RAYS), "--quiet"]
        gash.main(["animate", str(path), "-o", str(output), *options], standalone_mode=False)
        found = read_npz(output, "transfer", ("coefficients",))[0]["coefficients"]
        mesh = load_animation(path).mesh
    expected = bake_transfer(mesh, BANDS, RAYS, replicates=1, seed=0).coefficients
    return float(np.abs(found.astype(np.float64) - expected).max()), SILENT


def long_recording(part: str) -> tuple[float, str]:
    """Heap that a recording of 187 MiB takes: opened, over a report of its first frame; read, over a frame."""
    mesh, count = plane(1.0, 100), 1600
    frame = mesh.vertices.nbytes
    told = f"{SILENT}; {count} frames of {frame / 2**10:.0f} KiB, uncompressed"
    with temporary_file("long.npz") as path:
        rows = Rows((mesh.vertices for _ in range(count)), (count, *mesh.vertices.shape), "<f4")
        write_npz_rows(path, {"verts": rows}, {"faces": mesh.faces}, {})
        if part == "opened":
            return _peak(lambda: load_animation(path)) / _peak(lambda: read_mesh((mesh.vertices, mesh.faces))), told
        animation = load_animation(path)
        return _peak(lambda: sum(len(positions) for positions in animation.frames())) / frame, told


def _peak(work: Callable[[], object]) -> int:
    """The most bytes of heap that Python and NumPy held meanwhile."""
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def _read(verts: np.ndarray, faces: np.ndarray, read: Callable[[Path], object] = load_animation) -> object:
    with temporary_file("moves.npz") as path:
        np.savez(path, verts=verts, faces=faces)
        return read(path)


def frame_not_finite() -> object:
    """A vertex of the third frame that is no number."""
    verts = _grown()
    verts[2, 7, 1] = np.nan
    return _read(verts, icosphere(1).faces)


def faces_that_change() -> object:
    """Faces for each frame."""
    return _read(_grown(), np.stack([icosphere(1).faces] * 4))


def one_frame_to_train() -> object:
    """A model of a single frame."""
    return _read(_grown()[:1], icosphere(1).faces, lambda path: split_animation(DataConfig(animation=str(path))))


def shrunk_to_a_point() -> object:
    """A frame all of whose vertices are in one point."""
    verts = _grown()
    verts[2] = 0
    return _read(verts, icosphere(1).faces, lambda path: bake_truth(moving_scene(load_animation(path)), BANDS, RAYS))
