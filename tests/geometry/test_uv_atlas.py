import sys

import numpy as np
import pytest

from gash_jax.geometry.mesh import MeshError
from gash_jax.geometry.seams import apart_rows, seam_rows
from gash_jax.geometry.texels import find_texels
from gash_jax.geometry.texture_coordinates import checked_coordinates
from gash_jax.geometry.uv_atlas import atlas_coordinates
from gash_jax.shapes.primitives import bumpy_sphere


def test_without_xatlas_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xatlas", None)
    with pytest.raises(MeshError, match="pip install xatlas"):
        atlas_coordinates(bumpy_sphere(4), 64)


def test_charts_lie_apart_and_do_not_overlap() -> None:
    pytest.importorskip("xatlas", reason="needs the extra textures")
    mesh, size = bumpy_sphere(8), 128
    uv = checked_coordinates(atlas_coordinates(mesh, size), len(mesh.faces))
    found, rows = find_texels(uv, size), seam_rows(mesh, uv, size)
    chart = np.full(size**2, -1)
    chart[found.texel] = rows.chart_of[found.face]
    assert found.doubled == 0 and len(rows.texels) > 0
    assert len(apart_rows(rows, chart).texels) == len(rows.texels)
