"""Visibility scores of a two-stage network: against rays in its own frame, above the horizon alone."""

from typing import Any

import numpy as np
import pytest

from gash_jax.measure.methods import visibility_score
from gash_jax.models.families import model_config
from gash_jax.models.model import Model
from gash_jax.prt.hemisphere import above_horizon, hemisphere_visibility
from gash_jax.shapes.primitives import spherical_bowl


@pytest.mark.parametrize(("frame", "world"), [("mixed", False), ("vertex", False), ("world", True)])
def test_visibility_is_scored_in_the_frame_of_the_network(
    frame: str, world: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = spherical_bowl(np.radians(60), 6)
    mesh.normals[3] = 0
    truth = hemisphere_visibility(mesh, world=world)
    above = above_horizon(mesh.normals, world=world)
    model: Any = Model(model_config("two-stage", frame=frame), {})
    # what it says of directions below the horizon, and of a vertex without a normal, is wrong and does not count
    monkeypatch.setattr(model, "visibility_logits", lambda graph: np.where(truth | ~above, 1.0, -1.0))
    scores = visibility_score(model, mesh)
    share = truth[above].mean()
    expected = {"accuracy": 1.0, "balanced_accuracy": 1.0, "majority_accuracy": max(share, 1 - share)}
    assert scores == pytest.approx(expected) and 0.1 < share < 0.9
