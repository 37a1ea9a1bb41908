"""Rotation matrices of real spherical harmonics in float64, by a road of their own: the exponential of generators.

Turned by a rotation vector a, coefficients of band l are multiplied by D_l = exp(a . G), with G = -i J the generators
of turns about x, y and z. In the complex basis with Condon and Shortley's sign, J_z is diagonal and J_x + i J_y the
ladder sqrt((l - m)(l + m + 1)) (Edmonds 1957, section 2.3); the real basis is a unitary matrix U times the complex one.
"""

import math

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm


def generators(band: int) -> Float[np.ndarray, "3 m m"]:
    """Of turns about x, y and z, in the real basis; antisymmetric."""
    m = np.arange(-band, band + 1)
    up = np.diag(np.sqrt((band - m[:-1]) * (band + m[:-1] + 1.0)), -1)
    j = np.stack([(up + up.T) / 2, (up - up.T) / 2j, np.diag(m)])
    to_real = np.zeros((2 * band + 1, 2 * band + 1), complex)  # U: rows real m, columns complex m
    root = math.sqrt(0.5)
    to_real[band, band] = 1.0
    for k in range(1, band + 1):
        plus, minus = band + k, band - k
        to_real[plus, [minus, plus]] = root, root * (-1.0) ** k
        to_real[minus, [minus, plus]] = 1j * root, -1j * root * (-1.0) ** k
    # f = x . X = x . (U Y), so its complex coefficients are U^T x
    real = to_real.conj() @ (-1j * j) @ to_real.T
    return real.real


def exact_matrix(vector: Float[np.ndarray, "3"], bands: int) -> Float[np.ndarray, "k k"]:
    """The whole D, block-diagonal, of a rotation vector."""
    result = np.zeros((bands**2, bands**2))
    for band in range(bands):
        part = slice(band**2, (band + 1) ** 2)
        result[part, part] = expm(np.tensordot(vector, generators(band), 1))
    return result
