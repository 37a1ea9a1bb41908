"""How far a network's expected errors have to be stretched to be a bound: found on the validation shapes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from gash_jax.measure.metrics import partly_hidden
from gash_jax.models.examples import Example
from gash_jax.models.families import build_model, family_of
from gash_jax.nn.config import ModelConfig
from gash_jax.nn.surfel_net import SurfelConfig

HELD = 0.9


def rms_by_vertex(values: Float[np.ndarray, "v k"]) -> Float[np.ndarray, "v"]:
    """Root mean square over the coefficients of every vertex."""
    return np.sqrt(np.mean(values**2, axis=1))


def error_bound(config: ModelConfig, params: Any, examples: Sequence[Example]) -> float | None:
    """The factor by which 90 % of the partly hidden vertices err at most of what is expected of them.

    Errors are RMS over the coefficients of a vertex, without the labels' own noise where it is known. None for a
    network that expects no errors, and where there is no partly hidden vertex.
    """
    if not isinstance(config, SurfelConfig):  # no other says what errors to expect
        return None
    family, ratios = family_of(config), []
    module = build_model(config)
    for example in examples:
        found, expected = (family.predict_fast or family.predict)(module, params, example.graph)
        if expected is None:
            return None
        labels, bands = example.coefficients[:, : config.bands**2], config.bands
        square = np.mean((np.asarray(found) - labels) ** 2, axis=1)
        if example.noise is not None:
            square = square - example.noise[:, :bands] @ (2 * np.arange(bands) + 1) / bands**2
        said = rms_by_vertex(np.asarray(expected))
        counted = partly_hidden(labels) & (said > 0)
        ratios.append(np.sqrt(np.maximum(square, 0))[counted] / said[counted])
    together = np.concatenate(ratios) if ratios else np.zeros(0)
    return float(np.quantile(together, HELD)) if len(together) else None
