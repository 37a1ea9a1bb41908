import jax
import jax.numpy as jnp
import numpy as np
import pytest
from kingdon import Algebra
from scipy.spatial.transform import Rotation

from gash_jax.algebra import cga, motors

pytestmark = pytest.mark.optimised

HALF_UNIT = 2.0**-24
MOTOR_BLADES = [
    *(cga.SCALAR, cga.E12, cga.E13, cga.E23),
    *(cga.E1P, cga.E2P, cga.E3P, cga.E123P, cga.E1M, cga.E2M, cga.E3M, cga.E123M),
]


def _unit(*shape, seed=0):
    x = np.random.default_rng(seed).normal(size=(*shape, 3))
    return (x / np.linalg.norm(x, axis=-1, keepdims=True)).astype(np.float32)


def _points(*shape, radius=1.0, seed=1):
    """Points of length up to the radius."""
    length = np.random.default_rng(seed).random((*shape, 1))
    return (_unit(*shape, seed=seed + 100) * length * radius).astype(np.float32)


def _motors(count, radius=1.0, seed=2):
    return motors.motor(_points(count, radius=radius, seed=seed), _unit(count, seed=seed + 50))


def _matrix(quaternion):
    return Rotation.from_quat(quaternion).as_matrix()


def _exact_motion(m, x):
    """The motion of float32 motors on points, in float64, by quaternions from scipy."""
    m = np.asarray(m, np.float64)
    xyzw = np.stack([-m[:, cga.E23], m[:, cga.E13], -m[:, cga.E12], m[:, cga.SCALAR]], axis=-1)
    scale = np.sum(xyzw**2, axis=-1, keepdims=True)
    w = np.stack([m[:, cga.E1M], m[:, cga.E2M], m[:, cga.E3M], m[:, cga.E123M]], axis=-1)
    # t = -2 d ~r on vectors and pseudoscalar, written with cross products
    r, s = xyzw[:, :3], xyzw[:, 3:]
    t = -2 * (s * w[:, :3] - w[:, 3:] * r - np.cross(w[:, :3], r)) / scale
    return np.einsum("nij,nj->ni", _matrix(xyzw), x.astype(np.float64)) + t


def test_golden_point():
    """Convention: X = x + x^2 e_inf/2 + e_o."""
    point = motors.embed_point(np.array([1.0, -2.0, 3.0]))
    expected = 7.0 * cga.e_inf() + cga.e_o()
    expected[[cga.E1, cga.E2, cga.E3]] = 1.0, -2.0, 3.0
    np.testing.assert_array_equal(point, expected)


def test_golden_rotor():
    """Convention: R = n' e_y = n'_y + n'_x e12 - n'_z e23, so the rotor of e_x turns y to x."""
    root = np.sqrt(0.5)
    for normal, blade, value in (([1.0, 0, 0], cga.E12, root), ([0, 0, 1.0], cga.E23, -root)):
        expected = np.zeros(32)
        expected[cga.SCALAR], expected[blade] = root, value
        np.testing.assert_allclose(motors.rotor_from_normal(np.array(normal)), expected, atol=1e-7)
    np.testing.assert_array_equal(motors.rotor_from_normal(np.array([0.0, 1.0, 0.0])), np.eye(32)[cga.SCALAR])
    np.testing.assert_array_equal(motors.rotor_from_normal(np.array([0.0, -1.0, 0.0])), np.eye(32)[cga.E12])
    np.testing.assert_array_equal(motors.rotor_from_normal(np.zeros(3)), np.eye(32)[cga.SCALAR])


def test_golden_translator():
    """Convention: T = 1 - t e_inf/2."""
    t = np.zeros(32, np.float32)
    t[[cga.E1, cga.E2, cga.E3]] = 2.0, 4.0, -6.0
    expected = np.eye(32)[cga.SCALAR] - 0.5 * np.asarray(cga.geometric_product(t, cga.e_inf()))
    np.testing.assert_array_equal(motors.translator(np.array([2.0, 4.0, -6.0])), expected)
    assert expected[cga.E1P] == expected[cga.E1M] == -1.0


@pytest.mark.parametrize("lead", [(), (7, 9)])
def test_points_round_trip_and_are_null(lead):
    x, y = _points(*lead, radius=3.0), _points(*lead, radius=3.0, seed=9)
    point, other = motors.embed_point(x), motors.embed_point(y)
    assert point.shape == (*lead, 32)
    np.testing.assert_allclose(motors.extract_point(point), x, atol=1e-5)
    np.testing.assert_allclose(motors.extract_point(-2.5 * point), x, atol=1e-5)
    np.testing.assert_allclose(cga.geometric_product(point, point)[..., 1:], np.zeros((*lead, 31)), atol=1e-5)
    distance = np.sum((x - y) ** 2, axis=-1)
    np.testing.assert_allclose(-2 * cga.inner_product(point, other)[..., 0], distance, atol=2e-5)


@pytest.mark.parametrize("radius", [0.1, 1.0, 10.0, 100.0, 1000.0, 4000.0])
def test_stated_error_of_embedding(radius):
    """extract(embed(x)) below 2 u (r + r^3), -2 X.Y below 2 u (1 + r^2)^2, and neither bound is idle."""
    x, y = _points(20000, radius=radius), _points(20000, radius=radius, seed=4)
    y[:10000] = x[:10000]
    point, other = motors.embed_point(x), motors.embed_point(y)
    error = np.linalg.norm(np.asarray(motors.extract_point(point), np.float64) - x, axis=-1).max()
    assert error < 2 * HALF_UNIT * (radius + radius**3)
    squared = -2.0 * np.asarray(cga.inner_product(point, other), np.float64)[:, 0]
    error = np.abs(squared - np.sum((x.astype(np.float64) - y) ** 2, axis=-1)).max()
    bound = 2 * HALF_UNIT * (1 + radius**2) ** 2
    assert bound / 20 < error < bound


@pytest.mark.parametrize("distance", [4100.0, 5000.0, 1e5])
def test_points_from_4096_on_lose_their_weight(distance):
    point = motors.embed_point(np.array([distance, 0.0, 0.0]))
    assert (point[cga.EM] - point[cga.EP]) in (0.0, 2.0)


@pytest.mark.parametrize("radius", [1.0, 10.0, 100.0, 1000.0])
def test_stated_error_of_moving_points(radius):
    """The sandwich stays below 40 u r (1 + r^2) and does reach an eighth of it; the extracted motion below 16 u r."""
    count = 20000
    m = motors.motor(_unit(count, seed=5) * np.float32(radius), _unit(count, seed=6))
    x = _unit(count, seed=7) * np.float32(radius)
    exact = _exact_motion(m, x)
    error = np.linalg.norm(np.asarray(motors.apply_motor(m, x)) - exact, axis=-1).max()
    assert error < 16 * HALF_UNIT * radius
    if radius <= 100.0:  # beyond, the sandwich may even divide by zero
        sandwich = motors.extract_point(cga.sandwich(m, motors.embed_point(x)))
        error = np.linalg.norm(np.asarray(sandwich) - exact, axis=-1).max()
        bound = 40 * HALF_UNIT * radius * (1 + radius**2)
        assert bound / 8 < error < bound


def _normals_near_the_pole():
    angle = np.repeat(10.0 ** np.array([-44.0, -38, -30, -20, -10, -7, -4, -3.5, -3, -2, -1]), 8)
    azimuth = np.tile(np.arange(8) / 8 * 2 * np.pi + 0.1, 11)
    normals = np.stack([np.sin(angle) * np.cos(azimuth), -np.cos(angle), np.sin(angle) * np.sin(azimuth)], axis=-1)
    return normals.astype(np.float32)


@pytest.mark.parametrize("normals", [_unit(500), _normals_near_the_pole(), np.eye(3), -np.eye(3)])
def test_rotors_turn_e_y_to_the_normal(normals):
    rotor = np.asarray(motors.rotor_from_normal(normals), np.float64)
    np.testing.assert_allclose(np.sum(rotor**2, axis=-1), 1.0, atol=4e-7)
    e_y = np.eye(32, dtype=np.float32)[cga.E2]
    turned = np.asarray(cga.sandwich(rotor, e_y))
    np.testing.assert_allclose(turned[:, [cga.E1, cga.E2, cga.E3]], normals, atol=6e-7)
    np.testing.assert_allclose(motors.rotor_to_matrix(rotor)[:, :, 1], normals, atol=6e-7)
    half_way = (normals + [0, 1, 0]).astype(np.float64)
    # R = n' e_y, where n' is well defined in float64
    far = np.linalg.norm(half_way, axis=-1) > 1e-2
    half_way = half_way[far] / np.linalg.norm(half_way[far], axis=-1, keepdims=True)
    np.testing.assert_allclose(rotor[far][:, [cga.E12, cga.SCALAR]], half_way[:, :2], atol=1e-5)
    np.testing.assert_allclose(rotor[far][:, cga.E23], -half_way[:, 2], atol=1e-5)
    assert (rotor[:, cga.E13] == 0).all()


def test_rotor_near_the_pole_keeps_its_direction():
    """Where 1 + n_y cancels to 0 in float32 the formula of sums would give a scalar part of 0 or worse."""
    normal = np.array([3e-4, -1.0, 4e-4], np.float32)
    rotor = motors.rotor_from_normal(normal)
    np.testing.assert_allclose(rotor[jnp.array([cga.SCALAR, cga.E12, cga.E23])], [2.5e-4, 0.6, -0.8], rtol=1e-6)


def test_gradients_of_rotors_and_motors_are_finite_everywhere():
    normals = np.concatenate([_unit(20), _normals_near_the_pole(), np.eye(3), -np.eye(3), np.zeros((1, 3))])
    normals = jnp.asarray(normals, jnp.float32)
    jacobian = jax.jit(jax.vmap(jax.jacobian(motors.rotor_from_normal)))(normals)
    assert np.isfinite(jacobian).all()
    np.testing.assert_array_equal(jax.jacobian(motors.rotor_from_normal)(jnp.array([0.0, -1.0, 0.0])), 0.0)
    gradient = jax.jit(jax.grad(lambda p, n: jnp.sum(motors.apply_motor(motors.motor(p, n), p)), (0, 1)))
    for scale in (1e-30, 1.0, 1e15):
        assert all(np.isfinite(g).all() for g in gradient(scale * normals[:20], normals[:20]))


def test_motor_is_translator_times_rotor():
    p, n = _points(6, radius=5.0), _unit(6)
    product = cga.geometric_product(motors.translator(p), motors.rotor_from_normal(n))
    m = np.asarray(motors.motor(p, n))
    np.testing.assert_allclose(m, product, atol=1e-6)
    # 7 independent components: of the rotor's three bivectors e13 is empty
    assert sorted(np.flatnonzero((m != 0).any(axis=0))) == sorted(set(MOTOR_BLADES) - {cga.E13})


def test_motor_agrees_with_kingdon():
    algebra = Algebra(4, 1)
    e1, e2, e3, plus, minus = (algebra.multivector({1 << bit: 1.0}) for bit in range(5))
    p, n = np.array([0.3, -0.7, 1.1]), np.array([0.48, -0.6, 0.64])
    half = n + [0, 1, 0]
    half = half / np.linalg.norm(half)
    translator = 1 - (p[0] * e1 + p[1] * e2 + p[2] * e3) * (minus + plus) / 2
    expected = translator * ((half[0] * e1 + half[1] * e2 + half[2] * e3) * e2)
    result = np.zeros(32)
    for key, value in zip(expected.keys(), expected.values(), strict=True):
        result[key] = value
    np.testing.assert_allclose(motors.motor(p, n), result, atol=1e-7)


def test_motors_are_even_and_unit():
    m = _motors(50, radius=3.0)
    odd = np.array(cga.BLADE_GRADES) % 2 == 1
    assert (np.asarray(m)[:, odd] == 0).all()
    np.testing.assert_allclose(cga.geometric_product(m, cga.reverse(m)), np.eye(32)[np.zeros(50, int)], atol=1e-5)
    np.testing.assert_allclose(motors.compose(m, motors.inverse(m)), np.eye(32)[np.zeros(50, int)], atol=2e-6)


def test_sandwich_moves_points_as_the_extracted_motion_does():
    m, x = _motors(50), _points(50, seed=8)
    moved = motors.extract_point(cga.sandwich(m, motors.embed_point(x)))
    np.testing.assert_allclose(moved, motors.apply_motor(m, x), atol=3e-6)
    np.testing.assert_allclose(moved, _exact_motion(m, x), atol=3e-6)
    np.testing.assert_allclose(motors.apply_motor(-m, x), motors.apply_motor(m, x), atol=0)


def test_sandwich_preserves_distances():
    m, point, other = _motors(50), motors.embed_point(_points(50, seed=8)), motors.embed_point(_points(50, seed=9))
    before = cga.inner_product(point, other)
    after = cga.inner_product(cga.sandwich(m, point), cga.sandwich(m, other))
    np.testing.assert_allclose(after, before, atol=1e-5)


def test_motion_by_hand():
    m = motors.motor(np.array([10.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    rotation, translation = motors.motor_to_rigid(m)
    np.testing.assert_allclose(rotation, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=2e-7)
    np.testing.assert_allclose(translation, [10, 0, 0], atol=2e-6)
    np.testing.assert_allclose(motors.apply_motor(m, np.array([1.0, 2.0, 3.0])), [12, -1, 3], atol=3e-6)


def test_composition_is_that_of_motions_and_the_geometric_product():
    first, second, x = _motors(20, seed=10), _motors(20, seed=11), _points(20, seed=12)
    m = motors.compose(second, first)
    np.testing.assert_allclose(m, cga.geometric_product(second, first), atol=2e-6)
    chained = motors.apply_motor(second, motors.apply_motor(first, x))
    np.testing.assert_allclose(motors.apply_motor(m, x), chained, atol=2e-6)
    back = motors.apply_motor(motors.inverse(first), motors.apply_motor(first, x))
    np.testing.assert_allclose(back, x, atol=2e-6)


def test_composition_far_away_keeps_what_the_dense_product_loses():
    far = np.array([3000.0, -2000.0, 1000.0])
    first, second = motors.motor(far, _unit(seed=13)), motors.motor(-far, _unit(seed=14))
    unit = np.eye(32, dtype=np.float32)
    rotor = cga.geometric_product(motors.rotor_from_normal(_unit(seed=14)), motors.rotor_from_normal(_unit(seed=13)))
    blades = np.array([cga.SCALAR, cga.E12, cga.E13, cga.E23])
    rotor = np.asarray(rotor)[blades]
    np.testing.assert_allclose(np.asarray(motors.compose(second, first))[blades], rotor, atol=2e-7)
    dense = np.asarray(cga.geometric_product(second, first))
    assert np.abs(dense[blades] - rotor).max() > 1e-2
    np.testing.assert_array_equal(motors.compose(first, unit[cga.SCALAR]), first)


def _drift(m):
    """Largest deviation of M ~M from 1, in float64."""
    m = np.asarray(m, np.float64)
    with jax.enable_x64(True):
        product = cga.geometric_product(m, cga.reverse(m))
    return np.abs(np.asarray(product) - np.eye(32)[cga.SCALAR]).max()


def test_long_compositions_drift_and_renormalize_removes_it():
    centre = np.array([0.5, 0.8, -0.3])  # a turn about this point goes round and stays near
    turn = motors.rotor_from_normal(_unit(1, seed=3)[0])
    step = motors.compose(motors.translator(centre), motors.compose(turn, motors.translator(-centre)))

    def run(after):
        return jax.jit(lambda m: jax.lax.fori_loop(0, 9999, lambda _, m: after(motors.compose(step, m)), m))(step)

    plain, kept = run(lambda m: m), run(motors.renormalize)
    assert 1e-4 < _drift(plain) < 1e-2
    assert _drift(kept) < 1e-6
    assert _drift(motors.renormalize(plain)) < 1e-6
    # The direction itself is that of 10000 steps: each adds a rounding error of the angle.
    rotation, translation = motors.motor_to_rigid(kept)
    np.testing.assert_allclose(rotation @ centre + translation, centre, atol=2e-3)
    angle = 10000 * Rotation.from_matrix(motors.rotor_to_matrix(step)).as_rotvec()
    np.testing.assert_allclose(rotation, Rotation.from_rotvec(angle).as_matrix(), atol=2e-3)


def test_renormalize_by_hand():
    m = np.array(_motors(4, radius=2.0))
    np.testing.assert_allclose(motors.renormalize(3.0 * m), m, atol=1e-6)
    # A translation's scalar part, orthogonal to every motor, disappears.
    bent = m.copy()
    bent[:, [cga.E1P, cga.E1M]] += 0.2 * -m[:, [cga.E23]]
    bent[:, [cga.E2P, cga.E2M]] += 0.2 * m[:, [cga.E13]]
    bent[:, [cga.E3P, cga.E3M]] += 0.2 * -m[:, [cga.E12]]
    bent[:, [cga.E123P, cga.E123M]] += 0.2 * m[:, [cga.SCALAR]]
    np.testing.assert_allclose(motors.renormalize(bent), m, atol=1e-6)


@pytest.mark.parametrize("lead", [(), (7, 9)])
def test_matrices_and_rotors_agree_with_scipy(lead):
    quaternion = np.random.default_rng(3).normal(size=(*lead, 4))
    matrix = _matrix(quaternion.reshape(-1, 4)).reshape(*lead, 3, 3)
    rotor = motors.matrix_to_rotor(matrix)
    assert rotor.shape == (*lead, 32) and (np.asarray(rotor)[..., cga.SCALAR] >= 0).all()
    np.testing.assert_allclose(motors.rotor_to_matrix(rotor), matrix, atol=1e-6)
    x, y, z, w = np.moveaxis(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True), -1, 0)
    expected = np.stack([w, -z, y, -x], axis=-1) * np.where(w < 0, -1, 1)[..., None]
    blades = np.array([cga.SCALAR, cga.E12, cga.E13, cga.E23])
    np.testing.assert_allclose(np.asarray(rotor)[..., blades], expected, atol=1e-6)


@pytest.mark.parametrize("short_of", [0.0, 1e-7, 1e-4, 1e-2])
def test_half_turns_lose_no_accuracy(short_of):
    axes = np.concatenate([np.eye(3), -np.eye(3), _unit(50).astype(np.float64)])
    axes = axes / np.linalg.norm(axes, axis=-1, keepdims=True)
    matrix = Rotation.from_rotvec(axes * (np.pi - short_of)).as_matrix()
    rotor = motors.matrix_to_rotor(matrix)
    np.testing.assert_allclose(np.sum(np.asarray(rotor) ** 2, axis=-1), 1.0, atol=4e-7)
    np.testing.assert_allclose(motors.rotor_to_matrix(rotor), matrix, atol=1e-6)


def test_shapes_broadcast():
    m, x = _motors(7, seed=20).reshape(7, 1, 32), _points(9)
    moved = motors.apply_motor(m, x)
    assert moved.shape == (7, 9, 3)
    np.testing.assert_allclose(moved[3, 4], motors.apply_motor(m[3, 0], x[4]), atol=1e-7)
    assert motors.compose(m, _motors(9)).shape == (7, 9, 32)


def test_transforms():
    p, n, x = _points(5), _unit(5), _points(5, seed=8)
    n[0] = 0.0, -1.0, 0.0

    def whole(p, n, x):
        m = motors.renormalize(motors.compose(motors.motor(p, n), motors.translator(x)))
        rotor = motors.matrix_to_rotor(motors.motor_to_rigid(m)[0])
        return motors.apply_motor(motors.compose(motors.inverse(m), rotor), x)

    compiled = jax.jit(whole)
    loop = np.stack([compiled(*row) for row in zip(p, n, x, strict=True)])
    np.testing.assert_allclose(compiled(p, n, x), loop, atol=2e-6)
    np.testing.assert_allclose(jax.jit(jax.vmap(whole))(p, n, x), loop, atol=2e-6)
    m = motors.motor(p, n)
    gradient = jax.jit(jax.grad(lambda m: jnp.sum(motors.renormalize(motors.compose(m, m)) ** 3)))(m)
    assert np.isfinite(gradient).all() and np.abs(gradient).max() > 0.1
    gradient = jax.jit(jax.grad(lambda r: jnp.sum(motors.matrix_to_rotor(r) ** 3)))(motors.rotor_to_matrix(m))
    assert np.isfinite(gradient).all() and np.abs(gradient).max() > 0.1
