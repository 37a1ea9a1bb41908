"""What other programs compute, written from their published sources; `light.engines` names the files.

`BASES` evaluate a basis at their directions (n, 3); `COORDINATES` give their directions of ours; `IRRADIANCE` evaluates
the numbers of programs that hold irradiance over pi; `MAP_U` is the column, 0 to 1, at which they look for a direction.
"""

from collections.abc import Callable

import numpy as np

Array = np.ndarray


def ramamoorthi(n: Array) -> Array:
    """three.js, SphericalHarmonics3.getAt; without a sign."""
    x, y, z = n.T
    first = [0.282095 + 0 * x, 0.488603 * y, 0.488603 * z, 0.488603 * x]
    second = [1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * z]
    return np.stack([*first, *second, 0.546274 * (x * x - y * y)], axis=1)


def sloan(n: Array) -> Array:
    """Four bands of DirectXMath, sh_eval_basis_3, and of Dr.Jit, sh_eval_3: the same generated polynomials."""
    x, y, z = n.T
    s1, c1 = y, x
    s2, c2 = x * s1 + y * c1, x * c1 - y * s1
    s3, c3 = x * s2 + y * c2, x * c2 - y * s2
    one, two = -1.092548430592079200 * z, 1.445305721320277100 * z
    three = -2.285228997322328800 * z * z + 0.457045799464465770
    return np.stack(
        [
            *(0.282094791773878140 + 0 * x, -0.488602511902919920 * s1, 0.488602511902919920 * z),
            *(-0.488602511902919920 * c1, 0.546274215296039590 * s2, one * s1),
            *(0.946174695757560080 * z * z - 0.315391565252520050, one * c1, 0.546274215296039590 * c2),
            *(-0.590043589926643520 * s3, two * s2, three * s1, z * (1.865881662950577 * z * z - 1.1195289977703462)),
            *(three * c1, two * c2, -0.590043589926643520 * c3),
        ],
        axis=1,
    )


def splats(n: Array) -> Array:
    """gaussian-splatting, utils/sh_utils.py, eval_sh, degree 3."""
    x, y, z = n.T
    xx, yy, zz = x * x, y * y, z * z
    c1, c2 = 0.4886025119029199, 1.0925484305920792
    ones = [0.28209479177387814 + 0 * x, -c1 * y, c1 * z, -c1 * x]
    twos = [c2 * x * y, -c2 * y * z, 0.31539156525252005 * (2 * zz - xx - yy), -c2 * x * z]
    threes = [-0.5900435899266435 * y * (3 * xx - yy), 2.890611442640554 * x * y * z]
    threes += [-0.4570457994644658 * y * (4 * zz - xx - yy), 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy)]
    threes += [-0.4570457994644658 * x * (4 * zz - xx - yy), 1.445305721320277 * z * (xx - yy)]
    threes += [-0.5900435899266435 * x * (xx - 3 * yy)]
    return np.stack([*ones, *twos, 0.5462742152960396 * (xx - yy), *threes], axis=1)


def unreal(n: Array) -> Array:
    """SHMath.h, TSHVector<3>::SHBasisFunction."""
    x, y, z = n.T
    first = [0.282095 + 0 * x, -0.488603 * y, 0.488603 * z, -0.488603 * x]
    second = [1.092548 * x * y, -1.092548 * y * z, 0.315392 * (3 * z * z - 1), -1.092548 * x * z]
    return np.stack([*first, *second, 0.546274 * (x * x - y * y)], axis=1)


def e3nn(n: Array) -> Array:
    """e3nn, _spherical_harmonics(lmax=2) in "component" normalisation, over sqrt(4 pi) for "integral"."""
    x, y, z = n.T
    ones = [np.sqrt(3) * x, np.sqrt(3) * y, np.sqrt(3) * z]
    middle = np.sqrt(5) * (y * y - (x * x + z * z) / 2)
    twos = [np.sqrt(15) * x * z, np.sqrt(15) * x * y, middle, np.sqrt(15) * y * z, np.sqrt(15) / 2 * (z * z - x * x)]
    return np.stack([1 + 0 * x, *ones, *twos], axis=1) / np.sqrt(4 * np.pi)


def _legendre(m: int, band: int, x: Array) -> Array:
    """PIFu, prt_util.py, AssociatedLegendre: with the sign (-1)^m."""
    value = np.ones_like(x)
    for i in range(m):
        value = -value * (2 * i + 1) * np.sqrt((1 + x) * (1 - x))
    previous, after = value, x * (2 * m + 1) * value
    if band == m:
        return value
    for i in range(m + 2, band + 1):
        previous, after = after, (x * (2 * i - 1) * after - (i + m - 1) * previous) / (i - m)
    return after


def pifu_samples(theta: Array, phi: Array) -> tuple[Array, Array]:
    """prt_util.py: directions of sampleSphericalDirections, and getSHCoeffs(2, phi, theta)."""
    directions = np.stack([-np.sin(theta) * np.cos(phi), -np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    columns = []
    for band in range(3):
        for m in range(-band, band + 1):
            size = abs(m)
            ratio = np.prod(np.arange(band - size + 1, band + size + 1, dtype=float))
            scale = np.sqrt((2 * band + 1) / (4 * np.pi) / ratio) * (np.sqrt(2) if m else 1.0)
            angle = np.cos(m * phi) if m >= 0 else np.sin(-m * phi)
            columns.append(scale * angle * _legendre(size, band, np.cos(theta)))
    return directions, np.stack(columns, axis=1)


def pifu(n: Array) -> Array:
    """The basis that belongs to a direction, by the azimuth that PIFu has for it."""
    return pifu_samples(np.arccos(np.clip(n[:, 2], -1, 1)), np.arctan2(-n[:, 1], -n[:, 0]))[1]


def shade_sh9(constants: dict[str, Array], n: Array) -> Array:
    """UnityCG.cginc, ShadeSH9 in linear space, (n, 3)."""
    x, y, z = n.T
    normal, quadratic = np.stack([x, y, z, 1 + 0 * x], axis=1), np.stack([x * y, y * z, z * z, z * x], axis=1)
    rest = (x * x - y * y)[:, None] * constants["unity_SHC"][:3]
    linear = [normal @ constants[f"unity_SHA{c}"] + quadratic @ constants[f"unity_SHB{c}"] for c in "rgb"]
    return np.stack(linear, axis=1) + rest


def unity(numbers: Array, n: Array) -> Array:
    """HDRP, SphericalHarmonics.cs, the evaluation that PremultiplyCoefficients names."""
    c, (x, y, z) = numbers, n.T[:, :, None]
    linear = c[0] - c[6] + c[1] * y + c[2] * z + c[3] * x
    return linear + c[4] * x * y + c[5] * y * z + c[6] * 3 * z * z + c[7] * x * z + c[8] * (x * x - y * y)


def filament(numbers: Array, n: Array) -> Array:
    """surface_light_indirect.fs, Irradiance_SphericalHarmonics, without its maximum with 0."""
    s, (x, y, z) = numbers, n.T[:, :, None]
    linear = s[0] + s[1] * y + s[2] * z + s[3] * x
    return linear + s[4] * y * x + s[5] * y * z + s[6] * (3 * z * z - 1) + s[7] * z * x + s[8] * (x * x - y * y)


BASES: dict[str, Callable[[Array], Array]] = {
    **{"three": ramamoorthi, "d3dx": sloan, "unreal": unreal, "blender": unreal, "splats": splats, "e3nn": e3nn},
    **{"mitsuba": sloan, "pifu": pifu},
}
IRRADIANCE: dict[str, Callable[[Array, Array], Array]] = {"unity": unity, "unity-gltf": unity, "filament": filament}
_SAME: Callable[[Array], Array] = lambda d: d  # noqa: E731
COORDINATES: dict[str, Callable[[Array], Array]] = {
    **dict.fromkeys(("three", "filament", "d3dx", "splats", "e3nn", "mitsuba", "pifu"), _SAME),
    "unity": lambda d: d * [1, 1, -1],
    "unity-gltf": lambda d: d * [-1, 1, 1],
    "unreal": lambda d: d[:, [0, 2, 1]],
    "blender": lambda d: np.stack([d[:, 0], -d[:, 2], d[:, 1]], axis=1),
}
_PANORAMIC: Callable[[Array], Array] = lambda v: 0.5 - np.arctan2(v[:, 2], v[:, 0]) / (2 * np.pi)  # noqa: E731
MAP_U: dict[str, Callable[[Array], Array]] = {
    "three": lambda v: np.arctan2(v[:, 2], v[:, 0]) / (2 * np.pi) + 0.5,
    "unity": _PANORAMIC,
    "unity-gltf": _PANORAMIC,
    "filament": lambda v: (np.arctan2(-v[:, 0], v[:, 2]) / np.pi + 1) / 2,
    "unreal": lambda v: (1 + np.arctan2(v[:, 0], -v[:, 1]) / np.pi) / 2,
    "blender": lambda v: (np.arctan2(v[:, 1], v[:, 0]) - np.pi) / (-2 * np.pi),
    "mitsuba": lambda v: np.arctan2(v[:, 0], -v[:, 2]) / (2 * np.pi),
}
