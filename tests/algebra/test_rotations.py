"""A rotation in any form is one matrix; what is none is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gash_jax.algebra import cga, motors
from gash_jax.algebra.rotations import rotation_matrix, with_rotation

QUARTER = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # about +y: -z to -x, x to -z
ROOT = np.sqrt(0.5)


def _forms(rotation: Rotation) -> dict[str, np.ndarray]:
    """One rotation as matrix, quaternion, rotor and motor, in float32."""
    matrix = rotation.as_matrix().astype(np.float32)
    rotor = motors.matrix_to_rotor(matrix)
    motor = motors.compose(motors.translator(np.array([3.0, -200.0, 0.5])), rotor)
    quaternion = rotation.as_quat(scalar_first=True).astype(np.float32)
    return {"matrix": matrix, "quaternion": quaternion, "rotor": np.asarray(rotor), "motor": np.asarray(motor)}


def test_a_quarter_turn_by_hand() -> None:
    """R = cos 45 + e13 sin 45 turns z to x: the quaternion (w, x, y, z) = (cos 45, 0, sin 45, 0)."""
    rotor = np.zeros(32)
    rotor[[cga.SCALAR, cga.E13]] = ROOT
    for form in (QUARTER, np.array([ROOT, 0, ROOT, 0]), [ROOT, 0, ROOT, 0], rotor):
        np.testing.assert_allclose(rotation_matrix(form), QUARTER, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_every_form_is_the_matrix_of_scipy(seed: int) -> None:
    rotation = Rotation.random(rng=np.random.default_rng(seed))
    for name, form in _forms(rotation).items():
        found = rotation_matrix(form)
        assert isinstance(found, np.ndarray) and found.dtype == np.float64
        np.testing.assert_allclose(found, rotation.as_matrix(), atol=4e-7, err_msg=name)
        if name != "matrix":  # a float32 matrix stays as it is; of the others a float64 rotation is made
            np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-14)
            np.testing.assert_array_equal(rotation_matrix(-form), found)


@pytest.mark.parametrize("angle", [1e-8, 1e-30, np.pi, np.pi - 1e-8])
def test_tiny_and_half_turns(angle: float) -> None:
    axis = np.array([0.6, 0.0, 0.8])
    quaternion = np.array([np.cos(angle / 2), *(np.sin(angle / 2) * axis)])
    expected = Rotation.from_rotvec(angle * axis).as_matrix()
    np.testing.assert_allclose(rotation_matrix(quaternion), expected, atol=1e-15)
    # the angle is not lost beside 1: it stands in the antisymmetric part
    skew = expected - expected.T
    np.testing.assert_allclose((lambda m: m - m.T)(rotation_matrix(quaternion)), skew, rtol=1e-7, atol=1e-15)


def test_products_of_rotors_are_products_of_matrices() -> None:
    one, two = (np.asarray(_forms(Rotation.random(rng=np.random.default_rng(s)))["rotor"]) for s in (3, 4))
    np.testing.assert_allclose(
        rotation_matrix(motors.compose(one, two)), rotation_matrix(one) @ rotation_matrix(two), atol=1e-6
    )


def _multivector(**blades: float) -> np.ndarray:
    m = np.zeros(32)
    for name, value in blades.items():
        m[getattr(cga, name)] = value
    return m


REFUSED: dict[str, tuple[object, str]] = {
    "shape": (np.eye(4), r"use a rotation matrix \(3, 3\), a unit quaternion \(w, x, y, z\), or a rotor or motor"),
    "batch": (np.tile(np.eye(3), (2, 1, 1)), "rotation matrix"),
    "degrees": (90.0, "rotation matrix"),
    "words": ("y", "rotation matrix"),
    "truth values": (np.eye(3) > 0, "rotation matrix"),
    "improper matrix": (np.diag([1.0, 1, -1]), "proper rotation matrix"),
    "scaled matrix": (2 * np.eye(3), "proper rotation matrix"),
    "long quaternion": (np.array([1.0, 0, 1, 0]), "quaternion of length 1.414: divide it by its length"),
    "no quaternion": (np.zeros(4), "quaternion of length 0"),
    "nan quaternion": (np.full(4, np.nan), "quaternion of length nan"),
    "long rotor": (_multivector(SCALAR=2.0), "rotor of length 2"),
    "infinite rotor": (_multivector(SCALAR=np.inf), "no rotor or motor|length inf"),
    "vector": (_multivector(E1=1.0), "no rotor or motor"),
    "point": (np.asarray(motors.embed_point(np.ones(3))), "no rotor or motor"),
    "dilation": (_multivector(SCALAR=np.cosh(0.1)) + np.eye(32)[cga.EP | cga.EM] * np.sinh(0.1), "no rotor or motor"),
    "half a translator": (_multivector(SCALAR=1.0, E1P=0.5), "no rotor or motor"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_rotation_is_refused_in_one_line(name: str) -> None:
    rotation, message = REFUSED[name]
    with pytest.raises(ValueError, match=message) as caught:
        rotation_matrix(rotation)
    assert "\n" not in str(caught.value)


def test_three_typed_digits_are_a_unit_quaternion() -> None:
    np.testing.assert_allclose(rotation_matrix([0.707, 0, 0.707, 0]), QUARTER, atol=1e-12)


def test_transforms() -> None:
    """Under jit and vmap the same matrix, and gradients that are finite; the length of a quaternion has none."""
    forms = _forms(Rotation.random(rng=np.random.default_rng(7)))
    for form in forms.values():
        expected = rotation_matrix(form)
        np.testing.assert_allclose(jax.jit(rotation_matrix)(form), expected, atol=4e-7)
        both = jax.vmap(rotation_matrix)(jnp.stack([form, form]))
        np.testing.assert_allclose(both[1], expected, atol=4e-7)
        gradient = jax.grad(lambda form: jnp.sum(jnp.asarray(rotation_matrix(form)) ** 3))(jnp.asarray(form))
        assert np.isfinite(gradient).all() and np.abs(gradient).max() > 0
    quaternion = jnp.asarray(forms["quaternion"])
    gradient = jax.grad(lambda q: jnp.sum(jnp.asarray(rotation_matrix(q)) ** 3))(quaternion)
    assert abs(float(gradient @ quaternion)) < 1e-5
    with pytest.raises(ValueError, match="rotation matrix"):
        jax.jit(rotation_matrix)(jnp.eye(4))


def test_metadata_holds_the_whole_rotation() -> None:
    twice = with_rotation(with_rotation({"source": "a.hdr"}, QUARTER), QUARTER)
    assert twice["source"] == "a.hdr"
    np.testing.assert_allclose(np.array(twice["rotation"]), np.diag([-1.0, 1, -1]), atol=1e-12)
