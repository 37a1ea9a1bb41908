"""What a family minimises: phases, trained one after the other.

The two-stage network (GNN paper, 4.2) first learns visibility by class-balanced BCE, then, with that net fixed,
coefficients by MSE. The surfel network learns the first bands, then, with these fixed, higher bands and bounces, then,
on the validation shapes, which it has not seen, what errors to expect. All others have one phase. How a phase is run,
measured and logged is `train`'s business.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from gash_jax.models.losses import Mask, balanced_bce, masked_mean, squared_error
from gash_jax.nn.config import ModelConfig
from gash_jax.nn.surfel_net import BASE, SurfelConfig, split_said

RELATIVE, ARRIVING = 0.0005, 0.05

# (output of the network, labels, mask or weights of the vertices) -> loss
LossFn = Callable[[Float[Array, "v m"], Float[Array, "v k"], Mask], Float[Array, ""]]


class Phase(NamedTuple):
    """`labels` is the field of the batch that `loss` holds the output of the network's `method` against.

    The first columns of the output are what the labels are of; a network may say more after them, and `columns` of them
    are measured (None: all labels). `share` is the part of the budget; `trainable` names the top-level parameters that
    change (None: all); `held_out`: batches are of the validation shapes, where there are any.
    """

    name: str
    loss: LossFn
    labels: str = "coefficients"
    method: str = "__call__"
    share: float = 1.0
    trainable: tuple[str, ...] | None = None
    columns: int | None = None
    held_out: bool = False


def coefficient_loss(output: Float[Array, "v m"], labels: Float[Array, "v k"], mask: Mask) -> Float[Array, ""]:
    """MSE of the coefficients, which the network says first."""
    return squared_error(prediction=output[:, : labels.shape[1]], target=labels, mask=mask)


def visibility_loss(output: Float[Array, "v n"], labels: Float[Array, "v n"], mask: Mask) -> Float[Array, ""]:
    """Class-balanced BCE of logits."""
    return balanced_bce(logits=output, labels=labels, mask=mask)


def surfel_loss(
    output: Float[Array, "v m"], labels: Float[Array, "v n"], mask: Mask, *, config: SurfelConfig
) -> Float[Array, ""]:
    """What the surfel network (`SurfelNet.everything`) gets wrong of the first BASE bands; labels: `label_columns`.

    The squared error, and RELATIVE times that relative to what arrives, |t| + ARRIVING times the closed form's length:
    what is nearly closed hardly counts in the first, where almost nothing is lit.
    """
    base = min(config.learnt_bands, BASE) ** 2
    said = split_said(output, config.learnt_bands, config.known_bounces)
    lost = jnp.sum((said.own - labels[:, : config.learnt_bands**2])[:, :base] ** 2, axis=1)
    formula = jax.lax.stop_gradient(said.formula[:, :base])  # where it is 0 its length has no gradient
    arriving = jnp.linalg.norm(labels[:, :base], axis=1) + ARRIVING * jnp.linalg.norm(formula, axis=1)
    relative = lost / jnp.maximum(arriving, 1e-6) ** 2
    plain = jnp.asarray(mask > 0, output.dtype)
    return (masked_mean(lost[:, None], mask) + RELATIVE * masked_mean(relative[:, None], plain)) / base


def further_loss(
    output: Float[Array, "v m"], labels: Float[Array, "v n"], mask: Mask, *, config: SurfelConfig
) -> Float[Array, ""]:
    """The squared error of the bands after the first BASE and of what bounces."""
    k, bounces = config.learnt_bands**2, config.known_bounces
    said = split_said(output, config.learnt_bands, bounces)
    higher = (said.own - labels[:, :k])[:, min(config.learnt_bands, BASE) ** 2 :]
    bounced = said.bounced - labels[:, k : k * (1 + bounces)]
    return masked_mean(jnp.sum(jnp.concatenate([higher, bounced], axis=1) ** 2, axis=1)[:, None], mask)


def error_likelihood(
    output: Float[Array, "v m"], labels: Float[Array, "v n"], mask: Mask, *, config: SurfelConfig
) -> Float[Array, ""]:
    """Negative log likelihood of the errors of network, bounces and closed form, as normal ones in each band.

    The labels' own noise is taken off the squares. Vertices above which hardly anything stands do not count: their
    expected error is drawn to 0 by itself.
    """
    bands, bounces = config.learnt_bands, config.known_bounces
    k = bands**2
    said, noise = split_said(output, bands, bounces), labels[:, -bands:]
    estimates = [(said.own, labels[:, :k], said.log_own), (said.formula, labels[:, :k], said.log_formula)]
    for i in range(bounces):
        columns = slice(i * k, (i + 1) * k)
        logs = said.log_bounced[:, i * bands : (i + 1) * bands]
        estimates.append((said.bounced[:, columns], labels[:, k:][:, columns], logs))
    terms = []
    for number, (estimate, label, log) in enumerate(estimates):
        square = (estimate - label) ** 2
        bandwise = [jnp.mean(square[:, band**2 : (band + 1) ** 2], axis=1) for band in range(bands)]
        taken = jnp.stack(bandwise, axis=1) - (noise if number < 2 else 0)
        terms.append(log + taken * jnp.exp(-log))
    counted = (mask > 0) & (said.gate[:, 0] > 0.5)
    return masked_mean(jnp.concatenate(terms, axis=1), jnp.asarray(counted, labels.dtype))


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
    """Coefficients of the first bands; with these fixed what else is known; then the errors to expect of all."""
    body = ("surfel", "near", "mix", "head", *(f"hidden_{i}" for i in range(config.layers)))
    further, errors = ("further_mix", "further_hidden", "further_head"), ("error_hidden", "error_head")
    errors += tuple(f"further_{name}" for name in errors)
    lost, beyond, unlikely = (partial(f, config=config) for f in (surfel_loss, further_loss, error_likelihood))
    known: dict[str, Any] = {"method": "everything", "columns": config.bands**2}
    last = Phase("error", unlikely, share=0.1, trainable=errors, held_out=True, **known)
    if config.learnt_bands <= BASE and not config.known_bounces:
        return Phase("coefficients", lost, share=0.9, trainable=body, **known), last
    first = Phase("coefficients", lost, share=0.6, trainable=body, **known)
    return first, Phase("further", beyond, share=0.3, trainable=further, **known), last
