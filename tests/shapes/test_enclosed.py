"""Kinds that are dark inside: closed, as many vertices as asked for, the same again, and darker than the others."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import RawMesh
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.enclosed import _thickened, thinned
from gash_jax.shapes.parametric import flat_domain
from gash_jax.shapes.primitives import icosphere
from gash_jax.shapes.procedural import (
    ALL_KINDS,
    DRAWN,
    ENCLOSED,
    RECIPES,
    SHAPE_KINDS,
    Recipe,
    make_shape,
    shape_kind,
)
from gash_jax.shapes.triangles import signed_volume
from tests.helpers.recipes import assert_repeatable, closed, made
from tests.helpers.transfer_formulas import Y00


@pytest.mark.parametrize("kind", ENCLOSED)
def test_closed_of_about_unit_size_with_the_vertices_asked_for(kind: str) -> None:
    for target in (200, 700, 3000):
        for seed in range(3):
            mesh = made(ENCLOSED[kind], seed, target)
            assert closed(mesh.faces) and np.isfinite(mesh.vertices).all()
            assert 0.7 * target <= len(mesh.vertices) <= 1.3 * target
            assert 0.5 < np.abs(mesh.vertices).max() < 2.5
            if target > 200:  # so few vertices do not keep thin sheets apart
                assert signed_volume(RawMesh(mesh.vertices.astype(float), mesh.faces.astype(np.int64))) > 0


@pytest.mark.parametrize("kind", ENCLOSED)
def test_the_same_again_and_another_for_another_seed(kind: str) -> None:
    assert_repeatable(ENCLOSED[kind])


def _seen(recipe: Recipe) -> np.ndarray:
    """Of all vertices of some shapes, the share of the light of a constant sky that arrives."""
    meshes = [made(recipe, seed, 800) for seed in range(4)]
    return np.concatenate([bake_transfer(mesh, 1, 64, replicates=1).coefficients[:, 0] / Y00 for mesh in meshes])


@pytest.mark.slow
def test_they_are_dark_where_the_others_are_not() -> None:
    base = {kind: _seen(RECIPES[kind]) for kind in ("blob", "folded", "limbs", "bracket")}
    bright = np.mean([seen.mean() for seen in base.values()])
    assert bright > 0.8
    for kind in ("mouth", "skull", "housing", "machine", "layers"):
        seen = _seen(ENCLOSED[kind])
        assert seen.mean() < bright - 0.1, kind
        assert np.mean(seen < 0.1) > 0.1 > 0.05 > np.mean(base["blob"] < 0.1), kind
    # limbs near the body: hardly any place is dark, but more are in half shadow than of limbs held out
    assert np.mean(_seen(ENCLOSED["figure"]) < 0.6) > 1.5 * np.mean(base["limbs"] < 0.6)


def test_rounds_of_all_kinds() -> None:
    count = len(ALL_KINDS)
    assert ALL_KINDS == (*SHAPE_KINDS, *ENCLOSED, *DRAWN) and count == 27
    kinds = [shape_kind(5, index, "all") for index in range(2 * count)]
    assert sorted(kinds[:count]) == sorted(kinds[count:]) == sorted(ALL_KINDS) and kinds[:count] != kinds[count:]
    index = kinds.index("skull")
    kind, mesh = make_shape(5, index, (300, 300), kinds="all")
    assert kind == "skull" and 210 <= len(mesh.vertices) <= 390


def test_the_base_kinds_come_as_before() -> None:
    assert len(SHAPE_KINDS) == 18
    assert [shape_kind(0, index) for index in range(6)] == ["displaced", "sheet", "limbs", "plate", "blob", "cavity"]
    base, named = make_shape(5, 2, (300, 400))[1], make_shape(5, 2, (300, 400), kinds="base")[1]
    np.testing.assert_array_equal(base.vertices, named.vertices)


@pytest.mark.parametrize("kinds", ["some", ""])
def test_other_kinds_are_refused(kinds: str) -> None:
    with pytest.raises(ValueError, match="use base, all, broken"):
        shape_kind(0, 0, kinds)


def test_a_thickened_sheet_by_hand() -> None:
    """A unit square of thickness .1 has the volume .1."""
    body = _thickened(flat_domain(np.random.default_rng(0), 60), 0.1)
    assert closed(body.faces) and abs(signed_volume(body) - 0.1) < 1e-9


def test_thinning_goes_on_where_contraction_stops() -> None:
    ball = icosphere(4)
    surface = RawMesh(ball.vertices.astype(np.float64), ball.faces.astype(np.int64))
    few = thinned(surface, np.random.default_rng(0), 60)
    assert len(few.vertices) <= 60 and closed(few.faces) and signed_volume(few) > 0
