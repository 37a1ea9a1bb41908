"""What a family minimises: phases, trained one after the other.

The two-stage network (GNN paper, 4.2) first learns visibility by class-balanced BCE, then, with that net fixed,
coefficients by MSE. The surfel network learns coefficients by MSE and then, with them fixed, what errors to expect. All
others have one phase. How a phase is run, measured and logged is `train`'s business.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from gash_jax.models.losses import Mask, balanced_bce, masked_mean, squared_error
from gash_jax.nn.config import ModelConfig
from gash_jax.nn.surfel_net import SurfelConfig

# (output of the network, labels, mask or weights of the vertices) -> loss
LossFn = Callable[[Float[Array, "v m"], Float[Array, "v k"], Mask], Float[Array, ""]]


class Phase(NamedTuple):
    """`labels` is the field of the batch that `loss` holds the output of the network's `method` against.

    The first columns of the output are what the labels are of; a network may say more after them. `share` is the part
    of the budget; `trainable` names the top-level parameters that change (None: all).
    """

    name: str
    loss: LossFn
    labels: str = "coefficients"
    method: str = "__call__"
    share: float = 1.0
    trainable: tuple[str, ...] | None = None


def coefficient_loss(output: Float[Array, "v m"], labels: Float[Array, "v k"], mask: Mask) -> Float[Array, ""]:
    """MSE of the coefficients, which the network says first."""
    return squared_error(prediction=output[:, : labels.shape[1]], target=labels, mask=mask)


def visibility_loss(output: Float[Array, "v n"], labels: Float[Array, "v n"], mask: Mask) -> Float[Array, ""]:
    """Class-balanced BCE of logits."""
    return balanced_bce(logits=output, labels=labels, mask=mask)


def error_likelihood(output: Float[Array, "v m"], labels: Float[Array, "v k"], mask: Mask) -> Float[Array, ""]:
    """Negative log likelihood of the errors of the network and of the closed form, as normal ones in each band.

    `output` as of `SurfelNet.with_error`: coefficients, closed form, logarithms of the two mean square errors by band.
    """
    k = labels.shape[1]
    bands = round(k**0.5)
    own, exact, log_mse = output[:, :k], output[:, k : 2 * k], output[:, 2 * k :]
    terms = []
    for estimate, log in ((own, log_mse[:, :bands]), (exact, log_mse[:, bands:])):
        square = (estimate - labels) ** 2
        bandwise = [jnp.mean(square[:, band**2 : (band + 1) ** 2], axis=1) for band in range(bands)]
        terms.append(log + jnp.stack(bandwise, axis=1) * jnp.exp(-log))
    return masked_mean(jnp.concatenate(terms, axis=1), jnp.asarray(mask > 0, labels.dtype))


def one_phase(config: ModelConfig) -> tuple[Phase, ...]:
    """Coefficients by MSE, all parameters at once."""
    return (Phase("coefficients", coefficient_loss),)


def two_stage_phases(config: ModelConfig) -> tuple[Phase, ...]:
    """Visibility, then coefficients from the visibility that was learnt."""
    return (
        Phase("visibility", visibility_loss, "visibility", "visibility_logits", 0.4, ("visibility",)),
        Phase("coefficients", coefficient_loss, share=0.6, trainable=("coefficient",)),
    )


def surfel_phases(config: SurfelConfig) -> tuple[Phase, ...]:
    """Coefficients, then the errors to expect of them."""
    body = ("surfel", "near", "mix", "head", *(f"hidden_{i}" for i in range(config.layers)))
    error = ("error_hidden", "error_head")
    return (
        Phase("coefficients", coefficient_loss, method="with_error", share=0.9, trainable=body),
        Phase("error", error_likelihood, method="with_error", share=0.1, trainable=error),
    )
