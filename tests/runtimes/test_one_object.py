"""Models of one object by the NumPy runtime: it says what the package says, and writes it."""

from pathlib import Path

import numpy as np
import pytest

from gash_jax.algebra.numerics import safe_normalize
from gash_jax.models.deforming_model import load_deforming_model, save_deforming_model
from gash_jax.prt.transfer import load_transfer
from runtimes import gash_numpy
from tests.helpers.one_object import random_model
from tests.helpers.small_networks import MESHES


def assert_equal(found: np.ndarray, truth: np.ndarray) -> None:
    """Within 1e-5 of the largest."""
    assert (np.abs(found - truth) / np.abs(truth).max()).max() <= 1e-5


@pytest.mark.parametrize("name", ["momo-prt", "deform"])
def test_the_transfer_of_a_model_of_one_object(name: str, tmp_path: Path) -> None:
    mesh = MESHES["odd"]
    own = random_model(name, mesh)
    save_deforming_model(tmp_path / "m.npz", own.config, own.arrays, mesh, name="toy")
    np.savez(tmp_path / "mesh.npz", **mesh._asdict())
    assert gash_numpy.main([str(tmp_path / file) for file in ("m.npz", "mesh.npz", "out.npz")]) == 0
    found, model = load_transfer(tmp_path / "out.npz"), load_deforming_model(tmp_path / "m.npz")
    assert_equal(found.coefficients, np.asarray(model.coefficients(mesh)))
    assert found.bands == 3 and found.metadata["parameters"]["weights"] == "toy"
    other = MESHES["generated"]
    with pytest.raises(ValueError, match="the model is of one object with"):
        gash_numpy.predict_transfer(gash_numpy.load_deforming(str(tmp_path / "m.npz")), *other)


def test_patches_whose_anchors_collapsed_have_no_axes() -> None:
    """They read 0 of all points; what float32 cannot tell from 0 counts as 0, what it can does not."""
    mesh = MESHES["odd"]
    model = random_model("deform", mesh)
    read = gash_numpy.Model(model.config.to_dict(), {k: v.astype(np.float32) for k, v in model.arrays.items()})
    collapsed = mesh.vertices.copy()
    collapsed[model.arrays["anchors"][0].astype(int)] = [1, 2, 3]
    for positions in (collapsed, np.zeros_like(collapsed), np.float32(1e-20) * mesh.vertices, mesh.vertices[::-1]):
        pose = model.pose(positions)
        assert_equal(
            gash_numpy.predict_pose(read, pose.vertices, mesh.normals),
            np.asarray(model.coefficients(pose._replace(normals=mesh.normals))),
        )
        axes = gash_numpy.patch_axes(read.arrays, pose.vertices)[1]
        assert axes[0].any() == (positions is not collapsed and positions.any())
    vectors = np.array([[3e-30, 4e-30, 0], [0, 0, 0], [1e-39, 0, 0], [0, -1e37, 0]], np.float32)
    np.testing.assert_allclose(gash_numpy.unit_vectors(vectors), safe_normalize(vectors), atol=1e-6)
