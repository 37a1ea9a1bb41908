"""Formats that trimesh reads for us: its order of vertices, one line where it cannot."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from trimesh.exchange.load import mesh_loaders

from gash_jax.formats import others
from gash_jax.formats.meshes import READERS, read_mesh
from gash_jax.geometry.mesh import MeshError
from tests.geometry.mesh_files import CUBE, CUBE_FACES, tempting_mesh


def _loader(vertices, faces):
    return lambda file_obj, **options: {"vertices": vertices, "faces": faces}


def test_vertices_come_in_the_order_of_trimesh_and_the_report_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    vertices, faces = tempting_mesh()
    monkeypatch.setitem(mesh_loaders, "3mf", _loader(vertices, faces))
    (tmp_path / "a.3MF").write_bytes(b"anything")
    mesh, report = read_mesh(tmp_path / "a.3MF")
    np.testing.assert_array_equal(mesh.vertices, vertices)
    np.testing.assert_array_equal(mesh.faces, faces)
    assert report.lines()[0] == ".3mf is read by trimesh: vertices in its order, normals computed"
    assert report.normals == "computed"


@pytest.mark.parametrize("suffix", others.OTHERS)
def test_a_missing_package_is_named(suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = trimesh.exceptions.ExceptionWrapper(ModuleNotFoundError("No module named 'it'"))
    monkeypatch.setitem(mesh_loaders, suffix[1:], missing)
    with pytest.raises(MeshError, match=f"which needs {others.OTHERS[suffix]}: pip install"):
        others.read_other(b"anything", suffix)


@pytest.mark.parametrize(
    "error", [ValueError, KeyError, ZeroDivisionError, AttributeError, AssertionError, StopIteration]
)
def test_whatever_trimesh_raises_is_one_line(error: type[Exception], monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(file_obj, **options):
        raise error("inside")

    monkeypatch.setitem(mesh_loaders, "dae", fail)
    with pytest.raises(MeshError, match=r"^trimesh cannot read this \.dae file: it is damaged"):
        others.read_other(b"anything", ".dae")


def test_points_without_faces_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(mesh_loaders, "xaml", lambda file_obj, **options: {"vertices": CUBE})
    (tmp_path / "a.xaml").write_bytes(b"anything")
    with pytest.raises(MeshError, match=r"a\.xaml: .*(no faces|no vertices|cannot read)"):
        read_mesh(tmp_path / "a.xaml")


def test_no_format_has_two_readers() -> None:
    assert not set(others.OTHERS) & set(READERS)
    known = set(mesh_loaders)
    assert {suffix[1:] for suffix in others.OTHERS} <= known


def test_trimesh_is_not_imported_for_our_own_formats() -> None:
    code = "import sys, gash_jax.formats.meshes; sys.exit('trimesh' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_a_real_3mf_file_of_two_cubes(tmp_path: Path) -> None:
    pytest.importorskip("lxml", reason="trimesh needs lxml for .3mf")
    one = trimesh.Trimesh(CUBE, CUBE_FACES, process=False)
    two = trimesh.Trimesh(CUBE + [3, 0, 0], CUBE_FACES, process=False)
    written = trimesh.Scene([one, two]).export(file_type="3mf")
    assert isinstance(written, bytes)
    (tmp_path / "two.3mf").write_bytes(written)
    mesh, report = read_mesh(tmp_path / "two.3mf")
    np.testing.assert_allclose(mesh.vertices, np.concatenate([CUBE, CUBE + [3, 0, 0]]), atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, np.concatenate([CUBE_FACES, CUBE_FACES + 8]))
    assert report.parts == 2
    data = (tmp_path / "two.3mf").read_bytes()
    for length in range(0, len(data), 97):
        with pytest.raises(MeshError):
            others.read_other(data[:length], ".3mf")
