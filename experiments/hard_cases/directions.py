"""What directions, motors, rotations and lights do at the edges: each function measures one number.

Truth is float64 NumPy or a formula. Every function returns (measured, what the user is told); most of these cases pass
unnoticed, so there is nothing to tell.
"""

import functools
from typing import cast

import jax
import jax.numpy as jnp
import numpy as np

from gash_jax.algebra import cga, motors
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.directions import orthonormal_frame, spherical_fibonacci
from gash_jax.algebra.sh import band_index, evaluate_sh, hann_window, lanczos_window
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.graph.mesh_graph import rings_graph
from gash_jax.light.environment import Light, project_map
from gash_jax.light.layouts import pixel_directions, pixel_solid_angles
from gash_jax.light.shading import shade
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import bumpy_sphere, patch

SILENT = "nothing"
DOWN = np.array([0.0, -1.0, 0.0], np.float32)
COMPOSITIONS = 10_000
WINDOWS = {"none": None, "Hann": hann_window, "Lanczos": lanczos_window}


def around(pole: np.ndarray) -> np.ndarray:
    """Unit vectors at 1e-40 to 1e-1 from a pole, all around it, and the pole itself, float32."""
    tilt, azimuth = np.logspace(-40, -1, 79)[:, None], 2 * np.pi * (np.arange(64) + 0.3) / 64
    across, along = np.roll(np.abs(pole), 1), np.roll(np.abs(pole), 2)
    sideways = np.cos(azimuth)[:, None] * across + np.sin(azimuth)[:, None] * along
    near = np.sqrt(1 - tilt[..., None] ** 2) * pole + tilt[..., None] * sideways
    return np.concatenate([pole[None], near.reshape(-1, 3)]).astype(np.float32)


def rotor_at_pole() -> tuple[float, str]:
    """Where the rotors of normals at and near -e_y take e_y, against the normals."""
    normals = around(DOWN)
    turned = np.asarray(motors.rotor_to_matrix(motors.rotor_from_normal(normals)), np.float64)[..., 1]
    return float(np.abs(turned - normals).max()), SILENT


def motor_at_pole() -> tuple[float, str]:
    """M ~M - 1 of motors at and near -e_y, a unit from the origin."""
    normals = around(DOWN)
    positions = spherical_fibonacci(len(normals)).astype(np.float32)
    m = motors.motor(positions, normals)
    unit = np.asarray(cga.geometric_product(m, cga.reverse(m)), np.float64)
    return float(np.abs(unit - np.eye(32)[0]).max()), SILENT


def frame_at_poles() -> tuple[float, str]:
    """How far the bake's frames at and near -e_y and -e_z are from rotations that end in the normal."""
    normals = np.concatenate([around(DOWN), around(np.array([0.0, 0.0, -1.0], np.float32))])
    frames = np.asarray(orthonormal_frame(normals), np.float64)
    skew = np.swapaxes(frames, 1, 2) @ frames - np.eye(3)
    handed = np.linalg.det(frames) - 1
    return max(float(np.abs(a).max()) for a in (skew, handed, frames[..., 2] - normals)), SILENT


def graph_of_a_ceiling() -> tuple[float, str]:
    """Nodes and edges of a mesh whose normals are all -e_y: motors against position and normal; nan if not finite."""
    ceiling = patch(np.zeros(3), np.eye(3)[0], np.eye(3)[2], 8)
    graph = rings_graph(ceiling)
    nodes = cast(dict[str, np.ndarray], graph.nodes)
    finite = all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((nodes, graph.edges)))
    rotation, moved = (np.asarray(a, np.float64) for a in motors.motor_to_rigid(nodes["motor"]))
    error = max(np.abs(rotation[..., 1] - DOWN).max(), np.abs(moved - nodes["position"]).max())
    return float(error) if finite else float("nan"), SILENT


@functools.partial(jax.jit, static_argnames="renormalize")
def _composed(step: jax.Array, renormalize: bool) -> jax.Array:
    def one(_: int, m: jax.Array) -> jax.Array:
        m = motors.compose(step, m)
        return motors.renormalize(m) if renormalize else m

    return jax.lax.fori_loop(1, COMPOSITIONS, one, step)


def _turn_about_a_point() -> jax.Array:
    """A motor whose powers stay near the origin: its translation is across its axis, so it is no screw."""
    return motors.motor(np.array([0.072, 0.1, 0.16], np.float32), np.array([0.36, 0.48, 0.8], np.float32))


def drift(renormalize: bool) -> tuple[float, str]:
    """M ~M - 1 after 1e4 compositions of one motor in float32."""
    m = _composed(_turn_about_a_point(), renormalize)
    unit = np.asarray(cga.geometric_product(m, cga.reverse(m)), np.float64)
    return float(np.abs(unit - np.eye(32)[0]).max()), "nothing; `renormalize` is there to call"


def displacement(renormalize: bool) -> tuple[float, str]:
    """Where the motor composed 1e4 times takes points of the unit ball, against float64 powers of the same motion."""
    step = _turn_about_a_point()
    rotation, translation = (np.asarray(a, np.float64) for a in motors.motor_to_rigid(step))
    u, _, v = np.linalg.svd(rotation)  # the float32 matrix is a rotation up to rounding; its powers must be one
    motion = np.block([[u @ v, translation[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
    exact = np.linalg.matrix_power(motion, COMPOSITIONS)
    points = spherical_fibonacci(100)
    got = motors.apply_motor(_composed(step, renormalize), points.astype(np.float32))
    error = np.asarray(got, np.float64) - points @ exact[:3, :3].T - exact[:3, 3]
    return float(np.abs(error).max()), "nothing; `renormalize` is there to call"


def rotor_of_half_turns() -> tuple[float, str]:
    """Rotation matrices of 180 degrees about 500 axes, to rotors and back."""
    axes = spherical_fibonacci(500)
    turns = 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)
    back = motors.rotor_to_matrix(motors.matrix_to_rotor(turns.astype(np.float32)))
    return float(np.abs(np.asarray(back, np.float64) - turns).max()), SILENT


def rotation_of_half_turns(bands: int) -> tuple[float, str]:
    """Coefficients turned by 180 degrees about 50 axes, against the basis at the turned directions."""
    axes = spherical_fibonacci(50)
    turns = 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)
    directions = spherical_fibonacci(50)[::-1]
    turned = np.einsum("nij,nj->ni", turns, directions).astype(np.float32)
    got = rotate_coefficients(evaluate_sh(directions.astype(np.float32), bands), turns.astype(np.float32))
    return float(jnp.abs(got - evaluate_sh(turned, bands)).max()), SILENT


def bright_pixel(height: int = 64, row: int = 20, column: int = 77) -> tuple[np.ndarray, np.ndarray, float]:
    """A map with 1e4 in one pixel, that pixel's direction, and its flux."""
    image = np.zeros((height, 2 * height, 3), np.float32)
    image[row, column] = 1e4
    flux = 1e4 * pixel_solid_angles(height, 2 * height)[row]
    return image, pixel_directions(height, 2 * height)[row, column], float(flux)


def energy_of_a_bright_pixel() -> tuple[float, str]:
    """Energy in every band of the projected light against flux² (2l + 1) / 4 pi (addition theorem)."""
    image, _, flux = bright_pixel()
    light = project_map(image, 10).astype(np.float64)
    energy = np.bincount(band_index(10), light[:, 0] ** 2)
    exact = flux**2 * (2 * np.arange(10) + 1) / (4 * np.pi)
    return float(np.abs(energy / exact - 1).max()) if np.isfinite(light).all() else float("nan"), SILENT


@functools.cache
def _shadowed(bands: int) -> np.ndarray:
    return bake_transfer(bumpy_sphere(12), bands, 256).coefficients


def ringing(bands: int, window: str, shadows: bool) -> tuple[float, str]:
    """Most negative radiance under the bright pixel, as a part of the greatest, on a sphere or a bumpy sphere."""
    light = Light(project_map(bright_pixel()[0], bands), {})
    taper = WINDOWS[window]
    sphere = np.asarray(unshadowed_transfer(spherical_fibonacci(2000).astype(np.float32), bands))
    radiance = np.asarray(
        shade(_shadowed(bands) if shadows else sphere, light, window=None if taper is None else taper(bands, bands))
    )
    low, high = float(radiance.min()), float(radiance.max())
    return max(0.0, -low / high), "nothing: it stays in the numbers, pictures clip it"
