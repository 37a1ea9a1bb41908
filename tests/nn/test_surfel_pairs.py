"""What is known of a pair of vertex and surfel: by hand, in float64, and a frame that rounding does not choose."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.graph.surfel_graph import surfel_graph
from gash_jax.nn import surfel_pairs
from gash_jax.nn.surfel_pairs import ASIDE, EVEN, FAINT, FARTHEST, ROUNDING, look
from tests.helpers.bumpy import bumpy_mesh, random_rotation, surfel_parts


def _square(center: Any, side: float, axes: np.ndarray | None = None) -> np.ndarray:
    """The record of a square of this side, whose normal is the last of the axes."""
    turn = np.eye(3) if axes is None else axes
    spread = turn @ np.diag([side**2 / 12, side**2 / 12, 0]) @ turn.T
    adjugate = turn @ np.diag([0, 0, side**4 / 144]) @ turn.T
    six = ((0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2))
    size = np.sqrt(np.trace(spread))
    return np.array([*center, *turn[:, 2] * side**2, side**2, size, *adjugate[six], *spread[six]], np.float32)


def _part(surfels: np.ndarray, corner: Any = (1.0, 0, 0), weight: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """One vertex at the origin that looks up, with lists (v, n, 20) of surfels."""
    count = len(surfels)
    up = np.tile(np.array([0, 0, 1], np.float32), (count, 1))
    near = np.tile(np.array([*corner, 0, 0, 1], np.float32), (count, 8))
    share = np.ones(surfels.shape[:2], np.float32) if weight is None else weight
    part = {"position": np.zeros_like(up), "normal": up, "near": near, "cover": np.zeros_like(up)}
    return part | {"surfel": surfels, "weight": share}


def test_pairs_by_hand() -> None:
    """A unit square 2 above, one at 45 degrees seen from its edge, half of it counted, and one below."""
    edge_on = np.stack([[0, 1, 0], [1, 0, 1], [1, 0, -1]], 1) / np.array([1, np.sqrt(2), np.sqrt(2)])
    surfels = np.stack([_square([0, 0, 2], 1), _square([1, 0, 1], 1, edge_on), _square([0, 0, -2], 1)])[None]
    seen = look(_part(surfels, weight=np.array([[1, 0.5, 1]], np.float32)))
    # a = min(1, 4 pi / 12) = 1, w = 1 / (1 + 4); edge-on 3 % of the area are left: w = 0.03 / 2.03
    np.testing.assert_allclose(seen.above[0], [0.2, 0.5 * 0.03 / 2.03 * np.sqrt(0.5), 0], rtol=1e-3, atol=1e-7)
    # r = 0 / 2 and, of a square at 45 degrees, sqrt(1/12 / 2) / sqrt 2
    reach = [0, np.sqrt(1 / 24) / np.sqrt(2), 0]
    np.testing.assert_allclose(np.asarray(seen.features[10])[0], reach, atol=1e-6)
    np.testing.assert_allclose(seen.partly[0, 1], 0.5 * 0.03 / 2.03 * (np.sqrt(0.5) + reach[1]), rtol=1e-3)
    assert float(seen.partly[0, 2]) == 0
    # it shows its back from below: area vector and line of sight have one direction
    np.testing.assert_allclose(np.asarray(seen.features[9])[0, :2], [-1, 0], atol=1e-5)
    np.testing.assert_allclose(seen.frames[0, :, 2], [0, 0, 1], atol=1e-7)
    np.testing.assert_allclose([seen.rise[0], seen.edge[0]], [0, 1], atol=1e-6)
    np.testing.assert_array_equal(np.stack(seen.cover), 0)


def test_weights_of_pairs_are_the_formula_in_float64() -> None:
    for part in surfel_parts(surfel_graph(bumpy_mesh(120))):
        if not len(part["normal"]):
            continue
        seen, p = look(part), {name: array.astype(np.float64) for name, array in part.items()}
        offset = p["surfel"][..., :3] - p["position"][:, None]
        d = np.linalg.norm(offset, axis=-1)
        u = offset / d[..., None]
        area = p["surfel"][..., 6]
        floor = (0.03 * area / (4 * np.pi)) ** 2
        a = np.minimum(4 * np.pi * np.sqrt(np.maximum(_form(p["surfel"][..., 8:], u), 0) + floor), area)
        w = p["weight"] * a / (a + d**2)
        normal = np.broadcast_to(p["normal"][:, None], u.shape)
        height = np.sum(normal * u, -1)
        np.testing.assert_allclose(seen.above, w * np.maximum(height, 0), atol=2e-5)
        reach = np.minimum(np.sqrt(np.maximum(_form(p["surfel"][..., 14:], normal), 0)) / d, FARTHEST)
        partly = w * np.clip(height + reach, 0, 1)
        np.testing.assert_allclose(seen.partly, partly, atol=2e-4)
        frames = np.asarray(seen.frames, np.float64)
        identity = np.tile(np.eye(3), (len(frames), 1, 1))
        np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), identity, atol=1e-5)
        assert np.all(np.linalg.det(frames) > 0)
        # the first axis looks where most is hidden, and less so aside of the first corner
        weight = w * np.maximum(height - ROUNDING / d, 0) + 1e-3 * partly
        most = _tangential(np.einsum("vn,vni->vi", weight, u), p["normal"])
        corner = _tangential(p["near"][:, :3], p["normal"])
        corner /= np.linalg.norm(corner, axis=1, keepdims=True)
        corner = np.cos(ASIDE) * corner + np.sin(ASIDE) * np.cross(p["normal"], corner)
        missing = EVEN * weight.sum(1, keepdims=True) + FAINT - np.linalg.norm(most, axis=1, keepdims=True)
        most += np.maximum(missing, 0) * corner
        # where little of the sums is left, so much less of their direction is known
        length = np.linalg.norm(most, axis=1, keepdims=True)
        left = length / (weight.sum(1, keepdims=True) + FAINT)
        np.testing.assert_allclose(left * frames[..., 0], left * most / length, atol=5e-4)


def _tangential(x: np.ndarray, normal: np.ndarray) -> np.ndarray:
    return x - np.sum(x * normal, 1, keepdims=True) * normal


def _form(six: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.einsum("vni,vnij,vnj->vn", v, _symmetric(six), v)


def _symmetric(six: np.ndarray) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = np.moveaxis(six[..., :6], -1, 0)
    return np.stack([np.stack(row, -1) for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))], -2)


def _bowls(count: int, noise: float, lean: float = 0.0) -> dict[str, np.ndarray]:
    """Vertices in the middle of a bowl of eight even sides, each moved by rounding of its own, one side larger."""
    angles, rng = np.arange(8) * np.pi / 4, np.random.default_rng(0)
    rows = []
    for angle in angles:
        inward = np.array([-np.cos(angle), -np.sin(angle), 0])
        axes = np.stack([[-np.sin(angle), np.cos(angle), 0], [0, 0, 1], inward], 1)
        rows.append(_square([np.cos(angle), np.sin(angle), 0.5], 0.7 * (1 + (lean if angle == np.pi / 2 else 0)), axes))
    surfels = np.tile(np.stack(rows)[None], (count, 1, 1))
    surfels[..., :3] += rng.normal(0, noise, (*surfels.shape[:2], 3)).astype(np.float32)
    return _part(surfels)


def test_in_the_middle_of_an_even_bowl_rounding_does_not_turn_the_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    part = _bowls(50, 1e-6)
    first = np.asarray(look(part).frames)[..., 0]
    # the direction of the first near corner, turned aside
    aside = [np.cos(ASIDE), np.sin(ASIDE), 0]
    np.testing.assert_allclose(first, np.tile(aside, (50, 1)), atol=1e-3)
    # a vertex that leaves the middle turns towards what hides more, little by little
    leans = np.linspace(0, 3, 400)
    turned = np.stack([np.asarray(look(_bowls(1, 0, lean)).frames)[0, :, 0] for lean in leans])
    steps = np.linalg.norm(np.diff(turned, axis=0), axis=1)
    assert steps.max() < 0.15 and turned[0] @ aside > 0.999 and turned[-1, 1] > 0.999
    # without the rule rounding chooses
    monkeypatch.setattr(surfel_pairs, "EVEN", 0.0)
    assert np.asarray(look(part).frames)[..., 0].std(axis=0).max() > 0.3


def test_frames_turn_with_what_is_seen_even_in_a_bowl() -> None:
    part, rotation = _bowls(4, 1e-3), random_rotation(3).astype(np.float32)
    turned = {name: array.copy() for name, array in part.items()}
    part["cover"] = np.array([0.1, 0.2, 0.3], np.float32) * np.arange(4, dtype=np.float32)[:, None]
    for name in ("position", "normal", "cover"):
        turned[name] = part[name] @ rotation.T
    turned["near"] = (part["near"].reshape(4, 8, 2, 3) @ rotation.T).reshape(4, 48)
    surfels = part["surfel"].copy()
    for start in (0, 3):
        surfels[..., start : start + 3] = part["surfel"][..., start : start + 3] @ rotation.T
    for start in (8, 14):
        matrix = rotation @ _symmetric(part["surfel"][..., start:]) @ rotation.T
        surfels[..., start : start + 6] = matrix[..., (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
    one, two = look(part), look({**turned, "surfel": surfels})
    np.testing.assert_allclose(two.frames, rotation @ np.asarray(one.frames), atol=1e-4)
    for a, b in zip([*one.features, *one.near, *one.cover], [*two.features, *two.near, *two.cover], strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3)


def test_a_surfel_weighs_about_as_much_as_its_parts() -> None:
    """One square 3 above and its four quarters; and the quarters of one close by, of which it is only an estimate."""

    def total(height: float, quarters: bool) -> float:
        middles = [(x, y, height) for x in (-0.25, 0.25) for y in (-0.25, 0.25)]
        rows = [_square(middle, 0.5) for middle in middles] if quarters else [_square((0, 0, height), 1)]
        return float(jnp.sum(look(_part(np.stack(rows)[None])).above))

    assert total(3, True) == pytest.approx(total(3, False), rel=0.1)
    assert abs(total(0.3, True) / total(0.3, False) - 1) > 0.1


def test_under_jit_and_in_gradients() -> None:
    part = _bowls(3, 1e-3)
    part["surfel"][1, 2, :3], part["surfel"][2], part["near"][2] = 0, 0, 0  # one at the vertex; nothing to see

    def everything(part: Any) -> list[jax.Array]:
        return jax.tree.leaves(look(part))

    for a, b in zip(everything(part), jax.jit(everything)(part), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-5)
    gradient = jax.jit(jax.grad(lambda p: sum(jnp.sum(jnp.square(leaf)) for leaf in everything(p))))(part)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))
    assert float(jnp.abs(gradient["position"]).max()) > 0
    both = {name: np.stack([array, array[::-1]]) for name, array in part.items()}
    for a, b in zip(jax.tree.leaves(jax.vmap(look)(both)), everything(part), strict=True):
        np.testing.assert_allclose(a[0], b, atol=1e-5)
