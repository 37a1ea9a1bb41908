"""On the host the network finds of every vertex what it finds under JAX, however its vertices are grouped."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import jax
import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.surfel_graph import NEAR, SurfelGraph, surfel_graph, with_surfels
from gash_jax.graph.surfel_lists import WIDTHS
from gash_jax.nn.corner_kernel import CORNERS
from gash_jax.nn.surfel_encode import encode_on_host
from gash_jax.nn.surfel_kernel import MOST
from gash_jax.nn.surfel_net import SurfelNet
from tests.helpers.bumpy import bumpy_mesh, random_rotation
from tests.helpers.surfel_cases import bumpy_case
from tests.helpers.surfel_nets import SMALL_SURFELS, bumpy_graph, joined_part, surfel_variables

Part = dict[str, Any]
# of the largest value that there is of its kind: 100 ulp, for sums of up to 256 pairs in another order, and of those
# that make a frame a tenth (`EVEN`) may be left
CLOSE = 100 * float(np.finfo(np.float32).eps)


@cache
def _graph() -> SurfelGraph:
    return bumpy_graph()


@cache
def _encode() -> Any:
    module = SurfelNet(**SMALL_SURFELS)
    return jax.jit(lambda part: module.apply(surfel_variables(), part, method="encode"))


def _found(part: Part, records: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
    records = _graph().records if records is None else records
    return encode_on_host(surfel_variables()["params"], part, records)


def _some(part: Part, start: int, stop: int) -> Part:
    return {name: array[start:stop] for name, array in part.items()}


def _check(part: Part, records: np.ndarray | None = None) -> None:
    """That both find the same."""
    records = _graph().records if records is None else records
    expected = [np.asarray(array) for array in _encode()(with_surfels(part, records))]
    for mine, array in zip(_found(part, records), expected, strict=True):
        assert mine.dtype == np.float32 and mine.shape == array.shape and np.isfinite(mine).all()
        np.testing.assert_allclose(mine, array, rtol=0, atol=CLOSE * max(float(np.abs(array).max(initial=0)), 1.0))


@pytest.mark.parametrize("width", WIDTHS)
def test_it_finds_what_jax_finds(width: int) -> None:
    """Lists of each width: full ones, what is in those of the mesh, and empty ones."""
    rng, count, records = np.random.default_rng(width), 40, _graph().records
    part = _some(joined_part(_graph()), 0, count)
    table = rng.integers(0, len(records), (count, width)).astype(np.int32)
    weight = np.where(rng.random((count, width)) < 0.3, 1, rng.random((count, width))).astype(np.float32)
    length = rng.integers(0, width + 1, count)
    length[:3] = 0, 1, width
    _check(part | {"table": table, "weight": np.where(np.arange(width) < length[:, None], weight, 0)})


def _bodies() -> list[Mesh]:
    tall = bumpy_mesh(200, 4)
    tall = tall._replace(vertices=tall.vertices * np.array([1, 20, 0.01], np.float32))
    turned = bumpy_mesh(300, 5)
    rotation = random_rotation(3).astype(np.float32)
    return [bumpy_mesh(150, 7), tall, turned._replace(vertices=turned.vertices @ rotation.T)]


@pytest.mark.parametrize("number", range(len(_bodies())))
def test_on_whole_meshes_it_finds_what_jax_finds(number: int) -> None:
    graph = surfel_graph(_bodies()[number])
    _check(joined_part(graph), graph.records)
    for part in graph.parts:
        assert _found(part, graph.records)[0].shape == (len(part["normal"]), 34)


def test_lists_with_what_is_below_the_horizon() -> None:
    case = bumpy_case()
    part = joined_part(_graph())
    (moving,) = [found for found in case.lists() if len(found.vertices)][-1:]
    count = min(len(moving.vertices), len(part["normal"]))
    assert count and moving.table.shape[1] <= MOST
    own = _some(part, 0, count) | {"table": moving.table[:count], "weight": moving.weight[:count]}
    _check(own, case.records)


def _degenerate() -> Part:
    """Vertices of which something is missing, by number."""
    part = {name: array.copy() for name, array in _some(joined_part(_graph()), 0, 12).items()}
    near = part["near"].reshape(-1, CORNERS, 6)
    part["position"][0] = _graph().records[part["table"][0, 0], :3]  # on a surfel
    near[1] = 0  # no corners
    part["normal"][2] = 0
    part["weight"][3] = 0
    part["weight"][4], near[4], part["normal"][4] = 0, 0, [0, 0, -1]  # nothing that gives a direction
    part["weight"][5], near[5] = 0, 0
    part["normal"][6], near[6, 0, :3] = [0, 1, 0], [0, 0.1, 0]  # the first corner in the direction of the normal
    part["table"][7] = len(_graph().records) - 1  # surfels of no area
    part["weight"][8, :5] = 0  # within the list
    part["normal"][9] = [0, 0, -1]
    part["cover"][10] = [3, -2, 1]
    return part


@pytest.mark.parametrize("vertex", range(12))
def test_where_something_is_missing_it_finds_what_jax_finds(vertex: int) -> None:
    part = _degenerate()
    _check(_some(part, vertex, vertex + 1))


def test_a_width_that_is_no_multiple_of_a_block_and_arrays_of_any_kind() -> None:
    part = joined_part(_graph())
    odd = part | {name: part[name][:, :21] for name in ("table", "weight")}
    assert np.any(odd["weight"][:, -1] > 0)
    _check(odd)
    frozen = {name: jax.numpy.asarray(array) for name, array in odd.items()}
    for mine, other in zip(_found(odd), _found(frozen), strict=True):
        np.testing.assert_array_equal(mine, other)


def test_without_vertices() -> None:
    pooled, frames, seen = _found(_some(joined_part(_graph()), 0, 0))
    assert (pooled.shape, frames.shape, seen.shape) == ((0, 34), (0, 3, 3), (0,))


@pytest.mark.parametrize("size", [1, 7, 64])
def test_neither_groups_nor_threads_change_anything(size: int) -> None:
    part, count = joined_part(_graph()), len(_graph().slot)
    whole = _found(part)
    with ThreadPoolExecutor(4) as pool:
        pieces = list(pool.map(lambda start: _found(_some(part, start, start + size)), range(0, count, size)))
    for together, arrays in zip(whole, zip(*pieces, strict=True), strict=True):
        np.testing.assert_array_equal(np.concatenate(arrays), together)


def test_every_weight_of_the_layers_counts() -> None:
    """The comparison above sees each of them: a changed one changes what is found by more than it lets pass."""
    part, params = joined_part(_graph()), surfel_variables()["params"]
    first = _found(part)[0]
    for layer in ("surfel", "near"):
        for name, array in params[layer].items():
            for place in np.ndindex(array.shape):
                changed = array.copy()
                changed[place] += 0.1
                other = params | {layer: params[layer] | {name: changed}}
                found = encode_on_host(other, part, _graph().records)[0]
                assert np.abs(found - first).max() > 20 * CLOSE, (layer, name, place)


def test_it_refuses_what_it_is_not_made_for() -> None:
    assert CORNERS == NEAR and MOST >= WIDTHS[-1]
    part, params = joined_part(_graph()), surfel_variables()["params"]
    wide = part | {name: np.zeros((len(part["normal"]), MOST + 1), part[name].dtype) for name in ("table", "weight")}
    for wrong in (wide, part | {"near": part["near"][:, :42]}):
        with pytest.raises(ValueError, match="takes up to 256 and 8"):
            _found(wrong)
    layer = params["surfel"] | {"kernel": np.zeros((17, 8), np.float32)}
    with pytest.raises(ValueError, match="a layer of 17 features"):
        encode_on_host(params | {"surfel": layer}, part, _graph().records)
