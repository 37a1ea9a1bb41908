"""A part of the mesh stands for the whole: it is reconstructed as the whole is, and says nearly the same error."""

import numpy as np
import pytest

from gash_jax.models import guided, guided_sample
from gash_jax.models.guided import GuidedBake, bake_to_error
from gash_jax.models.guided_sample import expected_everywhere, make_sample
from gash_jax.models.reconstruction import Rebuilt, _around_hidden, reconstruct, shipped_network
from gash_jax.nn.reconstruction import LEAST
from gash_jax.shapes.primitives import bumpy_sphere, icosphere
from gash_jax.shapes.procedural import make_shape


def test_the_part_is_reconstructed_as_the_whole_is() -> None:
    bake = GuidedBake(bumpy_sphere(20), 3, 8, 8, 0, "embree", [])
    few, surface = bake.first()
    sample = make_sample(surface, bake.order)
    assert sample is not None
    index, asked = sample.vertices, sample.asked
    assert len(asked) == guided_sample.RUN * guided_sample.FEWEST_RUNS and len(index) < len(few.rays) / 3
    part = few.take(index)
    found, whole = (reconstruct(shipped_network(), *args) for args in ((sample.surface, part), (surface, few)))
    np.testing.assert_allclose(found.coefficients[asked], whole.coefficients[index[asked]], rtol=1e-5, atol=1e-7)
    # where nothing is hidden around them, vertices share the mean of some, which the part has others of
    busy = _around_hidden(surface, few.share)[index[asked]]
    one, other = found.variance[asked], whole.variance[index[asked]]
    np.testing.assert_allclose(one[busy], other[busy], rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(one[~busy], other[~busy], atol=2e-6)
    assert busy.mean() > 0.5


@pytest.mark.parametrize("index", range(4))
def test_it_says_nearly_the_error_of_the_whole(index: int) -> None:
    bake = GuidedBake(make_shape(54, index, (2500, 6000))[1], 3, 8, 8, 0, "embree", [])
    few, surface = bake.first()
    sample = make_sample(surface, bake.order)
    assert sample is not None
    variance, energy = expected_everywhere(shipped_network(), sample, surface, few, 9)
    whole = reconstruct(shipped_network(), surface, few)
    truth = np.maximum(whole.variance - LEAST, 0).sum(axis=1)
    assert np.sqrt(variance.sum() / truth.sum()) == pytest.approx(1, abs=0.2)
    # vertex by vertex it says far more than that all are alike
    logs = np.log(truth + 1e-9)
    assert np.corrcoef(np.log(variance), logs)[0, 1] > 0.6
    # what rays alone say has more energy, by that of their noise, of which most is taken out
    right, noisy = (float(np.sum(values.astype(np.float64) ** 2)) for values in (whole.coefficients, few.local))
    assert noisy > right and abs(energy - right) < 0.7 * (noisy - right)


def test_known_errors_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of errors that follow the law exactly, the part finds all others."""
    bake = GuidedBake(bumpy_sphere(18), 3, 8, 8, 0, "embree", [])
    few, surface = bake.first()
    sample = make_sample(surface, bake.order)
    assert sample is not None
    law = np.exp(guided_sample._features(surface, few) @ [-7.0, 0.8, 0.5, 0.2])
    variance = np.repeat(law[sample.vertices, None] / 9, 9, axis=1) + LEAST
    made = Rebuilt(few.local[sample.vertices], variance)
    monkeypatch.setattr(guided_sample, "reconstruct", lambda *_: made)
    found, energy = expected_everywhere(shipped_network(), sample, surface, few, 9)
    np.testing.assert_allclose(found, law, rtol=1e-4)
    assert energy == pytest.approx(np.sum(few.local.astype(np.float64) ** 2))


def test_nothing_hidden_and_few_vertices() -> None:
    ball = GuidedBake(icosphere(4), 3, 8, 8, 0, "embree", [])
    few, surface = ball.first()
    sample = make_sample(surface, ball.order)
    assert sample is not None
    variance, energy = expected_everywhere(shipped_network(), sample, surface, few, 9)
    assert np.isfinite(variance).all() and variance.sum() < 1e-4 * energy
    small = GuidedBake(bumpy_sphere(8), 3, 8, 8, 0, "embree", [])
    assert make_sample(small.first()[1], small.order) is None


@pytest.mark.parametrize("factor", [1e-4, 1e4])
def test_a_part_that_misleads_costs_rays_or_rounds_and_no_error(factor: float, monkeypatch: pytest.MonkeyPatch) -> None:
    def misled(*arguments: object) -> tuple[np.ndarray, float]:
        variance, energy = expected_everywhere(*arguments)  # type: ignore[arg-type]
        return factor * variance, energy

    mesh = bumpy_sphere(18)
    honest = bake_to_error(mesh, 0.02)
    monkeypatch.setattr(guided, "expected_everywhere", misled)
    found = bake_to_error(mesh, 0.02)
    assert found.metadata["estimated_error"] <= 0.02 and honest.metadata["estimated_error"] <= 0.02
    traced = [told.metadata["rounds"][1]["rays"] for told in (found, honest)]
    assert traced[0] > traced[1] if factor > 1 else traced[0] != traced[1]
