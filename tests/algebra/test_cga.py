import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from kingdon import Algebra

from gash_jax.algebra import cga

pytestmark = pytest.mark.optimised

PRODUCTS = {"*": cga.geometric_product, "^": cga.outer_product, "|": cga.inner_product}
GRADES = np.array(cga.BLADE_GRADES)


def _blade(index, value=1.0):
    blade = np.zeros(32, np.float32)
    blade[index] = value
    return blade


def _random(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=(*shape, 32)).astype(np.float32)


def _integers(*shape, seed=0):
    """Multivectors whose products are exact in float32."""
    return np.random.default_rng(seed).integers(-4, 5, size=(*shape, 32)).astype(np.float32)


@functools.cache
def _kingdon():
    return Algebra(4, 1)


def _to_kingdon(a):
    return _kingdon().multivector(list(a.astype(np.float64).T), keys=tuple(range(32)))


def _from_kingdon(x, count):
    result = np.zeros((count, 32))
    for key, value in zip(x.keys(), x.values(), strict=True):
        result[:, key] = value
    return result


def test_golden_blade_order():
    """Convention: index = bitmask, bit 0 e1, 1 e2, 2 e3, 3 e+, 4 e-."""
    assert cga.METRIC == (1, 1, 1, 1, -1)
    assert (cga.E1, cga.E2, cga.E3, cga.EP, cga.EM) == (1, 2, 4, 8, 16)
    assert cga.BLADE_NAMES[:8] == ("1", "e1", "e2", "e12", "e3", "e13", "e23", "e123")
    named = {"E12": 3, "E13": 5, "E23": 6, "E123": 7, "E1P": 9, "E2P": 10, "E3P": 12, "E123P": 15}
    named |= {"E1M": 17, "E2M": 18, "E3M": 20, "E123M": 23}
    for name, index in named.items():
        assert getattr(cga, name) == index
        assert cga.BLADE_NAMES[index] == name.lower().replace("p", "+").replace("m", "-")
    assert cga.BLADE_NAMES[31] == "e123+-"
    assert np.bincount(GRADES).tolist() == [1, 5, 10, 10, 5, 1]


def test_golden_null_vectors():
    """Convention: e_inf = e- + e+, e_o = (e- - e+)/2, e_o . e_inf = -1."""
    e_inf, e_o = cga.e_inf(), cga.e_o()
    np.testing.assert_array_equal(e_inf, _blade(cga.EP) + _blade(cga.EM))
    np.testing.assert_array_equal(e_o, (_blade(cga.EM) - _blade(cga.EP)) / 2)
    np.testing.assert_array_equal(cga.geometric_product(e_inf, e_inf), np.zeros(32))
    np.testing.assert_array_equal(cga.geometric_product(e_o, e_o), np.zeros(32))
    np.testing.assert_array_equal(cga.inner_product(e_o, e_inf), _blade(cga.SCALAR, -1.0))


def test_signs_by_hand():
    signs = cga.cayley_signs()
    assert signs.shape == (32, 32) and signs.dtype == np.float64 and not signs.flags.writeable
    assert set(np.unique(signs)) == {-1.0, 1.0}
    for left, right, sign in (
        (cga.E1, cga.E1, 1),
        (cga.EM, cga.EM, -1),
        (cga.E1, cga.E2, 1),
        (cga.E2, cga.E1, -1),
        (cga.E12, cga.E12, -1),
        (cga.E1M, cga.E1M, 1),
        (cga.E12, cga.E1, -1),
        (cga.E12, cga.E2, 1),
        (cga.E123, cga.E123, -1),
        (cga.E23, cga.E1, 1),
        (cga.E123M, cga.EM, -1),
    ):
        assert signs[left, right] == sign, (cga.BLADE_NAMES[left], cga.BLADE_NAMES[right])


@pytest.mark.parametrize("operation", PRODUCTS)
def test_products_agree_with_kingdon(operation):
    a, b = _integers(4, seed=1), _integers(4, seed=2)
    x, y = _to_kingdon(a), _to_kingdon(b)
    expected = {"*": lambda: x * y, "^": lambda: x ^ y, "|": lambda: x | y}[operation]()
    np.testing.assert_array_equal(PRODUCTS[operation](a, b), _from_kingdon(expected, 4))


def test_reverse_and_sandwich_agree_with_kingdon():
    a, b = _integers(4, seed=3), _integers(4, seed=4)
    x, y = _to_kingdon(a), _to_kingdon(b)
    np.testing.assert_array_equal(cga.reverse(a), _from_kingdon(~x, 4))
    np.testing.assert_array_equal(cga.sandwich(a, b), _from_kingdon(x * y * ~x, 4))


def test_a_wrong_metric_does_not_pass_for_the_right_one(monkeypatch):
    """The comparison sees the square of a single generator: 16 x 16 blade pairs share it."""
    right = cga.cayley_signs()
    monkeypatch.setattr(cga, "METRIC", (1, 1, 1, 1, 1))
    wrong = np.array([[cga._sign(i, j) for j in range(32)] for i in range(32)])
    assert (wrong != right).sum() == 256


def test_associative_and_distributive():
    a, b, c = (_integers(7, seed=seed) for seed in (5, 6, 7))
    product = cga.geometric_product
    np.testing.assert_array_equal(product(product(a, b), c), product(a, product(b, c)))
    np.testing.assert_array_equal(product(a, b + c), product(a, b) + product(a, c))
    np.testing.assert_array_equal(
        cga.outer_product(cga.outer_product(a, b), c), cga.outer_product(a, cga.outer_product(b, c))
    )


def test_vectors_split_into_inner_and_outer_product():
    a, b = (np.asarray(cga.grade_projection(_integers(5, seed=seed), 1)) for seed in (8, 9))
    inner, outer = np.asarray(cga.inner_product(a, b)), np.asarray(cga.outer_product(a, b))
    np.testing.assert_array_equal(cga.geometric_product(a, b), inner + outer)
    np.testing.assert_array_equal(
        inner[:, 0], np.sum(a * b * [0, 1, 1, 0, 1, 0, 0, 0, 1, *[0] * 7, -1, *[0] * 15], axis=1)
    )
    np.testing.assert_array_equal(cga.outer_product(b, a), -outer)


def test_inner_and_outer_products_keep_their_grades():
    a, b = _integers(seed=10), _integers(seed=11)
    for r in range(6):
        for s in range(6):
            left, right = np.asarray(cga.grade_projection(a, r)), np.asarray(cga.grade_projection(b, s))
            whole = cga.geometric_product(left, right)
            kept = np.asarray(cga.grade_projection(whole, r + s)) if r + s <= 5 else np.zeros(32)
            np.testing.assert_array_equal(cga.outer_product(left, right), kept)
            np.testing.assert_array_equal(cga.inner_product(left, right), cga.grade_projection(whole, abs(r - s)))


def test_reverse_by_hand_and_as_antiautomorphism():
    signs = np.asarray(cga.reverse(np.ones(32, np.float32)))
    np.testing.assert_array_equal(signs, np.array([1, 1, -1, -1, 1, 1])[GRADES])
    a, b = _integers(3, seed=12), _integers(3, seed=13)
    reversed_product = cga.geometric_product(cga.reverse(b), cga.reverse(a))
    np.testing.assert_array_equal(cga.reverse(cga.geometric_product(a, b)), reversed_product)


def test_grades_sum_to_the_whole():
    a = _random(7, 9)
    parts = [np.asarray(cga.grade_projection(a, grade)) for grade in range(6)]
    np.testing.assert_array_equal(sum(parts), a)
    for grade, part in enumerate(parts):
        assert (part[..., GRADES != grade] == 0).all() and (part[..., GRADES == grade] != 0).all()


@pytest.mark.parametrize("grade", [-1, 6])
def test_grades_outside_the_algebra_are_refused(grade):
    with pytest.raises(ValueError, match="use 0 to 5"):
        cga.grade_projection(_random(), grade)


@pytest.mark.parametrize("left,right", [((), ()), ((7, 9), ()), ((), (7, 9)), ((7, 1), (9,)), ((0,), (0,))])
def test_leading_shapes_broadcast(left, right):
    a, b = _integers(*left, seed=14), _integers(*right, seed=15)
    shape = np.broadcast_shapes(left, right)
    result = cga.geometric_product(a, b)
    assert result.shape == (*shape, 32) and result.dtype == jnp.float32
    rows = zip(
        np.broadcast_to(a, (*shape, 32)).reshape(-1, 32), np.broadcast_to(b, (*shape, 32)).reshape(-1, 32), strict=True
    )
    dense = np.zeros((32, 32, 32))
    i, j = np.indices((32, 32))
    dense[i, j, i ^ j] = cga.cayley_signs()
    expected = [np.einsum("i,j,ijk->k", x, y, dense) for x, y in rows]
    np.testing.assert_array_equal(np.asarray(result).reshape(-1, 32), np.reshape(expected, (-1, 32)))


def _table(kind):
    """Dense float64 table of a product: e_i e_j has the coefficient table[i, j, k] of e_k."""
    i, j = np.indices((32, 32))
    grades = GRADES[i], GRADES[j], GRADES[i ^ j]
    kept = {"*": True, "^": grades[2] == grades[0] + grades[1], "|": grades[2] == abs(grades[0] - grades[1])}[kind]
    table = np.zeros((32, 32, 32))
    table[i, j, i ^ j] = np.where(kept, cga.cayley_signs(), 0.0)
    return table


def _dense(a, b, kind="*"):
    """The products of two (n, 32) arrays in float64 and, of each, the sum of the magnitudes of its terms."""
    a, b, table = a.astype(np.float64), b.astype(np.float64), _table(kind)

    def product(a, b, table):
        return np.einsum("njk,nj->nk", np.einsum("ni,ijk->njk", a, table, optimize=True), b, optimize=True)

    return product(a, b, table), product(abs(a), abs(b), abs(table))


@pytest.mark.parametrize("kind", PRODUCTS)
@pytest.mark.parametrize("count", [cga._BLOCK - 1, cga._BLOCK, cga._BLOCK + 1, 2 * cga._BLOCK + cga._TILE + 1])
def test_blocked_products_agree_with_the_dense_table(kind, count):
    a, b = _random(count, seed=20), _random(count, seed=21)
    result = PRODUCTS[kind](a, b)
    exact, magnitude = _dense(a, b, kind)
    assert result.shape == (count, 32) and result.dtype == jnp.float32
    # 32 terms: at most one rounding of each term and 31 of the sum
    assert (np.abs(result - exact) <= 32 * 2.0**-24 * magnitude).all()


def test_blocked_products_in_float64():
    count = cga._BLOCK + 7
    with jax.enable_x64(True):
        a, b = _random(count, seed=22).astype(np.float64), _random(count, seed=23).astype(np.float64)
        result = np.asarray(cga.geometric_product(a, b))
    exact, magnitude = _dense(a, b)
    assert result.dtype == np.float64
    assert (np.abs(result - exact) <= 64 * 2.0**-53 * magnitude).all()


@pytest.mark.parametrize("left,right", [((3, 701), (701,)), ((2101, 1), (2,)), ((), (2003,)), ((2003,), (1,))])
def test_leading_shapes_broadcast_across_blocks(left, right):
    a, b = _integers(*left, seed=24), _integers(*right, seed=25)
    shape = (*np.broadcast_shapes(left, right), 32)
    left_rows, right_rows = (np.broadcast_to(x, shape).reshape(-1, 32) for x in (a, b))
    result = cga.geometric_product(a, b)
    assert result.shape == shape
    np.testing.assert_array_equal(np.asarray(result).reshape(-1, 32), _dense(left_rows, right_rows)[0])


def test_transforms_across_blocks():
    a, b = _integers(2, cga._BLOCK + 3, seed=26), _integers(2, cga._BLOCK + 3, seed=27)
    expected = _dense(a.reshape(-1, 32), b.reshape(-1, 32))[0].reshape(a.shape)
    np.testing.assert_array_equal(cga.geometric_product(a, b), expected)
    np.testing.assert_array_equal(jax.jit(cga.geometric_product)(a, b), expected)
    np.testing.assert_array_equal(jax.vmap(cga.geometric_product)(a, b), expected)
    tangent = jax.jvp(lambda x: cga.geometric_product(x, b), (a,), (a,))[1]
    np.testing.assert_array_equal(tangent, expected)


def test_gradients_across_blocks():
    """The cotangent c of a b gives a the coefficients sum_jk table[i, j, k] b_j c_k, and b likewise."""
    a, b, c = (_integers(cga._BLOCK + 3, seed=seed) for seed in (28, 29, 30))
    gradient = jax.jit(lambda a, b, c: jax.vjp(cga.geometric_product, a, b)[1](c))
    of_a, of_b = gradient(a, b, c)
    last = slice(cga._BLOCK - 2, None)
    np.testing.assert_array_equal(of_a[last], np.einsum("ijk,nj,nk->ni", _table("*"), b[last], c[last], optimize=True))
    np.testing.assert_array_equal(of_b[last], np.einsum("ijk,ni,nk->nj", _table("*"), a[last], c[last], optimize=True))
    assert np.isfinite(of_a).all() and np.isfinite(of_b).all()


def test_transforms():
    a, b = _random(3, seed=16), _random(3, seed=17)
    eager = cga.geometric_product(a, b)
    loop = np.stack([cga.geometric_product(*row) for row in zip(a, b, strict=True)])
    np.testing.assert_allclose(eager, loop, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(jax.jit(cga.geometric_product)(a, b), loop, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(jax.vmap(cga.geometric_product)(a, b), loop, rtol=1e-5, atol=1e-5)
    # The product is bilinear: its derivative along c is the product with c.
    tangent = jax.jvp(lambda x: cga.geometric_product(x, b), (a,), (_random(3, seed=18),))[1]
    np.testing.assert_allclose(tangent, cga.geometric_product(_random(3, seed=18), b), rtol=1e-5, atol=1e-5)
    gradient = jax.grad(lambda x: jnp.sum(cga.geometric_product(x, b)))(jnp.asarray(a))
    assert np.isfinite(gradient).all()
