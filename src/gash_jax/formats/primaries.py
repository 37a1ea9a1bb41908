"""Linear RGB of any primaries as linear Rec. 709, the colours of everything else here.

The chromaticities (x, y) of red, green, blue and white fix the matrix from RGB to XYZ up to brightness (SMPTE RP 177).
White stays white: if the two whites differ, XYZ is adapted between them by Bradford's cone responses (Lam 1985; ICC.1).
Colours outside Rec. 709 come out with a negative part, which a sum over directions keeps correct; nothing is clipped.
"""

import numpy as np
from jaxtyping import Float

REC_709 = np.array([0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329])
SAME = 1e-3  # difference in x or y up to which primaries are those of Rec. 709, written with fewer digits
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
_ROWS = 64  # converted at once


def to_rec_709(chromaticities: Float[np.ndarray, "8"]) -> Float[np.ndarray, "3 3"] | None:
    """Matrix from linear RGB of the given primaries and white (red, green, blue, white; x and y of each).

    None if they are those of Rec. 709. Raises ValueError for numbers that make no colour space.
    """
    if np.abs(chromaticities - REC_709).max() <= SAME:
        return None
    (source, white), (target, wanted) = _to_xyz(chromaticities), _to_xyz(REC_709)
    adapted = np.linalg.inv(_BRADFORD) @ np.diag((_BRADFORD @ wanted) / (_BRADFORD @ white)) @ _BRADFORD
    matrix = np.linalg.solve(target, adapted @ source)
    if not np.abs(matrix).max() < 1e3:
        raise ValueError("no colour space")
    return matrix


def xyz_to_rec_709() -> Float[np.ndarray, "3 3"]:
    """Matrix from CIE XYZ to linear Rec. 709; luminance Y = 1 with the chromaticity of white gives (1, 1, 1)."""
    return np.linalg.inv(_to_xyz(REC_709)[0])


def in_rec_709(
    image: Float[np.ndarray, "h w 3"], chromaticities: Float[np.ndarray, "8"]
) -> tuple[Float[np.ndarray, "h w 3"], tuple[str, ...]]:
    """The image in Rec. 709 (written over, in float64 on the way), and a note where it had other colours."""
    named = " ".join(f"{number:.5g}" for number in chromaticities)
    try:
        matrix = to_rec_709(chromaticities)
    except (ValueError, np.linalg.LinAlgError):
        return image, (f"the file's primaries ({named}) are no colour space: read as Rec. 709",)
    if matrix is None:
        return image, ()
    for start in range(0, len(image), _ROWS):
        rows = slice(start, start + _ROWS)
        image[rows] = image[rows].astype(np.float64) @ matrix.T
    return image, (f"colours converted to Rec. 709 from the file's primaries ({named}), white adapted by Bradford",)


def _to_xyz(chromaticities: Float[np.ndarray, "8"]) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Matrix from RGB to XYZ, and the XYZ of white, whose Y is 1."""
    x, y = chromaticities.reshape(4, 2).T
    if not np.isfinite(chromaticities).all() or y[3] <= 0:
        raise ValueError("no colour space")
    colours = np.stack([x, y, 1 - x - y])
    white = colours[:, 3] / y[3]
    if abs(np.linalg.det(colours[:, :3])) < 1e-4:
        raise ValueError("no colour space")
    return colours[:, :3] * np.linalg.solve(colours[:, :3], white), white
