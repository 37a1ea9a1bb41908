"""The even half of R(4,1): its products are those of the whole algebra, by an oracle, by laws and by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from gash_jax.algebra import cga, even
from gash_jax.algebra.motors import motor

PSEUDOSCALAR = 31
PLACE = {int(blade): place for place, blade in enumerate(even.EVEN)}


def _random(*shape: int, seed: int = 0) -> jax.Array:
    return jnp.asarray(np.random.default_rng(seed).normal(size=shape), jnp.float32)


def _whole(x: np.ndarray | jax.Array) -> np.ndarray:
    """(..., 16, c) as (..., c, 32)."""
    whole = np.zeros((*x.shape[:-2], x.shape[-1], 32), np.float32)
    whole[..., even.EVEN] = np.swapaxes(np.asarray(x), -1, -2)
    return whole


def _even(x: np.ndarray | jax.Array) -> np.ndarray:
    return np.swapaxes(np.asarray(x)[..., even.EVEN], -1, -2)


def _unit_blade(blade: int) -> jax.Array:
    return jnp.zeros((16, 1)).at[PLACE[blade], 0].set(1.0)


def _random_motors(count: int) -> np.ndarray:
    normals = np.random.default_rng(1).normal(size=(count, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(motor(np.asarray(_random(count, 3, seed=2)), normals))


def test_every_even_blade_is_there_once_and_the_odd_ones_are_they_times_the_pseudoscalar() -> None:
    assert sorted(even.EVEN) == [blade for blade in range(32) if cga.BLADE_GRADES[blade] % 2 == 0]
    assert [cga.BLADE_GRADES[even.EVEN[place]] for place in even.BIVECTORS] == [2] * 10
    a, b, i = _whole(_random(5, 16, 1)), _whole(_random(5, 16, 1, seed=1)), np.eye(32, dtype=np.float32)[PSEUDOSCALAR]
    left = cga.geometric_product(cga.geometric_product(a, i), b)
    np.testing.assert_allclose(left, cga.geometric_product(cga.geometric_product(a, b), i), atol=1e-5)


def test_the_product_is_that_of_the_whole_algebra() -> None:
    a, b = _random(7, 3, 16, 2), _random(7, 3, 16, 2, seed=1)
    product = np.asarray(cga.geometric_product(_whole(a), _whole(b)))
    np.testing.assert_array_equal(np.delete(product, even.EVEN, axis=-1), 0)
    np.testing.assert_allclose(even.even_product(a, b), _even(product), atol=1e-5)
    table = np.einsum("...ic,...jc,ijk->...kc", a, b, even.even_product_table())
    np.testing.assert_allclose(table, _even(product), atol=1e-5)


def test_products_by_hand() -> None:
    """e12 e23 = e1 e2 e2 e3 = e13, and e-'s square is -1: e1- e1- = -e1 e1 e- e- = 1."""
    np.testing.assert_array_equal(even.even_product(_unit_blade(cga.E12), _unit_blade(cga.E23)), _unit_blade(cga.E13))
    one = even.even_product(_unit_blade(cga.E1M), _unit_blade(cga.E1M))
    np.testing.assert_array_equal(one, _unit_blade(cga.SCALAR))


def test_what_a_motor_does_is_the_sandwich() -> None:
    motors, x = _random_motors(6), _random(6, 16, 3)
    squares = np.asarray(even.motor_squares(jnp.asarray(motors[:, even.MOTOR_8])))
    found = np.einsum("nq,qij,njc->nic", squares, even.motor_action_table(), x)
    np.testing.assert_allclose(found, _even(cga.sandwich(motors[:, None], _whole(x))), atol=1e-5)
    assert np.count_nonzero(even.motor_action_table()) == 480


def test_what_a_rotor_does_is_the_sandwich_with_its_exponential() -> None:
    bivectors, x = _random(4, 10, seed=3), _random(4, 16, 3)
    halves = np.zeros((4, 32))
    halves[:, even.EVEN[even.BIVECTORS]] = np.asarray(bivectors) / 2
    rotor = term = np.tile(np.eye(32)[0], (4, 1))
    for k in range(1, 25):
        term = np.einsum("ni,nj,ij,ijk->nk", term, halves, cga.cayley_signs(), _xor()) / k
        rotor = rotor + term
    rotor = rotor.astype(np.float32)
    np.testing.assert_allclose(cga.geometric_product(rotor, cga.reverse(rotor)), np.eye(32)[[0] * 4], atol=1e-5)
    found = np.einsum("nij,njc->nic", even.rotor_actions(bivectors), x)
    expected = _even(cga.sandwich(rotor[:, None], _whole(x)))
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("length", [1, 5, 15])
def test_the_exponential_of_long_bivectors_is_that_of_scipy(length: float) -> None:
    bivectors = np.random.default_rng(0).normal(size=(100, 10))
    bivectors = (bivectors * length / np.linalg.norm(bivectors, axis=1, keepdims=True)).astype(np.float32)
    table = even.even_product_table()
    halves = ((table - table.swapaxes(0, 1)).swapaxes(1, 2))[even.BIVECTORS] / 2
    expected = np.stack([expm(np.einsum("b,bij->ij", each.astype(float), halves)) for each in bivectors])
    error = np.abs(np.asarray(even.rotor_actions(bivectors)) - expected).max(axis=(1, 2))
    assert np.max(error / np.abs(expected).max(axis=(1, 2))) < 1e-5


def _xor() -> np.ndarray:
    found = np.zeros((32, 32, 32))
    left, right = np.indices((32, 32))
    found[left, right, left ^ right] = 1
    return found


def test_a_quarter_turn_by_hand() -> None:
    """The rotor exp(-pi/4 e12) turns e1 to e2, so e1 I = e23+- to e2 I = -e13+-, and e13 to e23; it leaves e12."""
    quarter = jnp.zeros(10).at[even.BIVECTORS.tolist().index(PLACE[cga.E12])].set(-np.pi / 2)
    action = np.asarray(even.rotor_actions(quarter))
    both = cga.EP | cga.EM
    for blade, image, sign in (
        (cga.E23 | both, cga.E13 | both, -1),
        (cga.E13, cga.E23, 1),
        (cga.E12, cga.E12, 1),
        (cga.SCALAR, cga.SCALAR, 1),
    ):
        np.testing.assert_allclose(action @ _unit_blade(blade), sign * _unit_blade(image), atol=5e-6)


@pytest.mark.parametrize("by", ["rotor", "motor"])
def test_the_action_on_a_product_is_the_product_of_the_actions(by: str) -> None:
    a, b = _random(5, 16, 2), _random(5, 16, 2, seed=1)
    if by == "rotor":
        actions = even.rotor_actions(0.5 * _random(5, 10, seed=4))
    else:
        squares = even.motor_squares(jnp.asarray(_random_motors(5)[:, even.MOTOR_8]))
        actions = jnp.einsum("nq,qij->nij", squares, jnp.asarray(even.motor_action_table(), jnp.float32))
    moved_a, moved_b, moved = (actions @ each for each in (a, b, even.even_product(a, b)))
    np.testing.assert_allclose(even.even_product(moved_a, moved_b), moved, atol=2e-5 * float(jnp.abs(moved).max()))
    assert float(jnp.abs(moved - even.even_product(a, b)).max()) > 0.1  # they do something


def test_transforms() -> None:
    a, b, bivectors = _random(4, 16, 2), _random(4, 16, 2, seed=1), _random(4, 10, seed=2)
    plain = even.even_product(a, b)
    np.testing.assert_allclose(jax.jit(even.even_product)(a, b), plain, atol=1e-5)
    np.testing.assert_allclose(jax.vmap(even.even_product)(a, b), plain, atol=1e-5)
    # linear in each factor: the derivative along another factor is the product with that one
    other = _random(4, 16, 2, seed=5)
    tangent = jax.jvp(lambda b: even.even_product(a, b), (b,), (other,))[1]
    np.testing.assert_allclose(tangent, even.even_product(a, other), atol=1e-5)
    actions = even.rotor_actions(bivectors)
    np.testing.assert_allclose(jax.vmap(even.rotor_actions)(bivectors), actions, atol=1e-4)
    gradient = jax.jit(jax.grad(lambda b: jnp.sum(even.rotor_actions(b) ** 2)))(jnp.zeros((2, 10)))
    assert np.isfinite(gradient).all()  # of the rotor 1, whose exponent is 0
    slope = jax.jvp(even.rotor_actions, (jnp.zeros(10),), (bivectors[0],))[1]
    step = (even.rotor_actions(1e-2 * bivectors[0]) - even.rotor_actions(-1e-2 * bivectors[0])) / 2e-2
    np.testing.assert_allclose(slope, step, atol=1e-3)
