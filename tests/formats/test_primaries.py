"""Colours of other primaries in Rec. 709: against published matrices, white stays white, nonsense is said."""

import numpy as np
import pytest

from gash_jax.formats.primaries import REC_709, in_rec_709, to_rec_709

D65, D60 = (0.3127, 0.329), (0.32168, 0.33767)
REC_2020 = np.array([0.708, 0.292, 0.17, 0.797, 0.131, 0.046, *D65])
DISPLAY_P3 = np.array([0.68, 0.32, 0.265, 0.69, 0.15, 0.06, *D65])
AP0 = np.array([0.7347, 0.2653, 0, 1, 0.0001, -0.077, *D60])
AP1 = np.array([0.713, 0.293, 0.165, 0.83, 0.128, 0.044, *D60])


@pytest.mark.parametrize(
    ("chromaticities", "published"),
    [
        # ITU-R BT.2087; the colour science of ACES, D60 to D65 by Bradford
        (REC_2020, [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]),
        (DISPLAY_P3, [[1.2249, -0.2249, 0.0], [-0.0421, 1.0421, 0.0], [-0.0196, -0.0786, 1.0983]]),
        (AP0, [[2.5217, -1.1341, -0.3876], [-0.2765, 1.3727, -0.0962], [-0.0154, -0.1530, 1.1684]]),
        (AP1, [[1.7051, -0.6218, -0.0833], [-0.1303, 1.1408, -0.0105], [-0.0240, -0.1290, 1.1530]]),
    ],
    ids=["rec 2020", "display p3", "aces ap0", "aces ap1"],
)
def test_against_published_matrices(chromaticities: np.ndarray, published: list) -> None:
    matrix = to_rec_709(chromaticities)
    assert matrix is not None
    np.testing.assert_allclose(matrix, published, atol=2e-4)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-12)  # white stays white


def test_the_case_by_hand() -> None:
    image, notes = in_rec_709(np.full((2, 3, 3), [1, 0.5, 0.25], np.float32), AP0)
    np.testing.assert_allclose(image, np.broadcast_to([1.86, 0.386, 0.2], (2, 3, 3)), atol=3e-3)
    assert image.dtype == np.float32
    assert notes == (
        "colours converted to Rec. 709 from the file's primaries (0.7347 0.2653 0 1 0.0001 -0.077 0.32168 0.33767), "
        "white adapted by Bradford",
    )


def test_the_conversion_is_linear_and_undone_by_its_inverse() -> None:
    image = np.random.default_rng(0).random((70, 5, 3)).astype(np.float32)
    matrix = to_rec_709(REC_2020)
    assert matrix is not None
    found, _ = in_rec_709(image.copy(), REC_2020)
    np.testing.assert_allclose(found, image @ matrix.T, atol=1e-6)
    np.testing.assert_allclose(found @ np.linalg.inv(matrix).T, image, atol=1e-6)
    assert found.min() < 0  # colours outside Rec. 709 are kept, not clipped


@pytest.mark.parametrize("off", [0.0, 5e-4])
def test_rec_709_is_left_alone(off: float) -> None:
    image = np.ones((2, 2, 3), np.float32)
    found, notes = in_rec_709(image, REC_709 + off)
    assert found is image and notes == () and (found == 1).all()


@pytest.mark.parametrize(
    "nonsense",
    [
        np.zeros(8),
        np.full(8, np.nan),
        np.full(8, 0.3),
        np.array([0.64, 0.33, 0.64, 0.33, 0.15, 0.06, *D65]),
        np.array([0.1, 0.1, 0.2, 0.2, 0.3, 0.3, *D65]),
        np.array([0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3, 0.0]),
        np.array([0.64, 0.33, 0.3, 0.6, 0.15, 0.06, np.inf, 0.3]),
    ],
)
def test_what_is_no_colour_space_is_said_and_not_applied(nonsense: np.ndarray) -> None:
    image = np.full((2, 2, 3), 0.5, np.float32)
    found, notes = in_rec_709(image, nonsense)
    assert (found == 0.5).all() and len(notes) == 1 and "are no colour space: read as Rec. 709" in notes[0]
