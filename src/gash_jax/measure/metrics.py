"""The measures of the project, defined once.

Estimates t, reference t*, both (v, k), or (v, k, 3) where surfaces are coloured: then over all colours, and the closed
form is the same for each. Raw MSE depends on scale and albedo, so it never stands alone:
relrmse = sqrt(sum |t - t*|² / sum |t*|²);  skill = 1 - MSE(method) / MSE(unshadowed closed form), where 0 means
nothing learnt beyond the formula. Skill is undefined where the closed form is already right ("no occlusion") or the
reference has no energy ("no transfer"). *Equivalent rays* is the fewest rays at which the plain bake of the same mesh
is as good, interpolated in log-log. *Shadow MSE* looks only at the darkest quartile of vertices by reference
t_0. *Visibility scores*: the share of directions called right, that share averaged over the two classes (balanced; a
constant answer has 1/2), and what always answering with the more frequent class would score. *Flicker* is the RMS of
the second difference in time of the error of a sequence. *Calibration* of error bars: the rms z-score is the rms error
over the rms standard error (1 where they are honest), the coverage is the share of errors inside the 95 % intervals of
Student's t.
"""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.tracing import ProgressFn

NO_OCCLUSION = 1e-9
PARTLY = 0.02
REFERENCE_SHARE = 8  # a plain bake above an eighth of the reference's rays is as noisy as what it is held against


def _difference(estimate: np.ndarray, reference: np.ndarray) -> np.ndarray:
    if estimate.shape != reference.shape:
        raise ValueError(f"shapes differ: {estimate.shape} against {reference.shape}; same mesh, same bands needed")
    return estimate.astype(np.float64) - reference.astype(np.float64)


def mse(estimate: np.ndarray, reference: np.ndarray) -> float:
    """Mean squared error over vertices and coefficients."""
    return float(np.mean(_difference(estimate, reference) ** 2))


def relrmse(estimate: np.ndarray, reference: np.ndarray) -> float | None:
    """Relative RMS error; None where the reference has no energy."""
    energy = float(np.sum(reference.astype(np.float64) ** 2))
    return float(np.sqrt(np.sum(_difference(estimate, reference) ** 2) / energy)) if energy > 0 else None


def skill(estimate: np.ndarray, reference: np.ndarray, normals: Float[np.ndarray, "v 3"]) -> float | str:
    """1 - MSE / MSE of the closed form, or the reason why it is undefined."""
    if not np.any(reference):
        return "no transfer"
    formula = np.asarray(unshadowed_transfer(normals, round(reference.shape[1] ** 0.5)))
    same_for_all = formula.reshape(*formula.shape, *(1,) * (reference.ndim - 2))
    floor = mse(np.broadcast_to(same_for_all, reference.shape), reference)
    return "no occlusion" if floor < NO_OCCLUSION else 1.0 - mse(estimate, reference) / floor


def partly_hidden(reference: Float[np.ndarray, "v k"]) -> Bool[np.ndarray, "v"]:
    """Vertices that receive between 2 and 98 % of what they would if nothing stood above them, by t_0."""
    share = reference[:, 0] * np.sqrt(4 * np.pi)
    return (share >= PARTLY) & (share <= 1 - PARTLY)


def coefficient_errors(estimate: np.ndarray, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Per coefficient: MSE, and standard deviation of the error over vertices and colours, each (k,)."""
    error = _difference(estimate, reference)
    others = tuple(axis for axis in range(error.ndim) if axis != 1)
    return np.mean(error**2, others), np.std(error, others)


def shadow_mse(estimate: np.ndarray, reference: np.ndarray) -> float:
    """MSE on the darkest quartile of vertices by the reference's t_0."""
    light = reference[:, 0].reshape(len(reference), -1).mean(1)
    darkest = light <= np.quantile(light, 0.25)
    return mse(estimate[darkest], reference[darkest])


def visibility_scores(called: Bool[np.ndarray, "*n"], truth: Bool[np.ndarray, "*n"]) -> dict[str, float]:
    """Accuracy, balanced accuracy and the majority's accuracy; a class that does not occur is left out of the mean."""
    hits = [float(np.mean(called[truth == c] == c)) for c in (True, False) if np.any(truth == c)]
    majority = max(float(np.mean(truth)), 1 - float(np.mean(truth)))
    accuracy = float(np.mean(called == truth))
    return {"accuracy": accuracy, "balanced_accuracy": float(np.mean(hits)), "majority_accuracy": majority}


def image_scores(image: Float[np.ndarray, "h w c"], reference: Float[np.ndarray, "h w c"]) -> dict[str, float]:
    """PSNR (dB) and SSIM (Wang et al. 2004) of linear pictures of the same view; the reference's maximum is the peak.

    Raises ValueError where the reference is black: nothing is its peak.
    """
    peak = float(reference.max())
    if peak <= 0:
        raise ValueError("the reference picture is black: it has no peak to measure against")
    noise = max(mse(image, reference), np.finfo(np.float32).tiny)
    from skimage.metrics import structural_similarity  # slow to import: a bake measures no picture

    similarity: Any = structural_similarity(
        image.astype(np.float64), reference.astype(np.float64), data_range=peak, channel_axis=-1
    )
    return {"psnr": float(10 * np.log10(peak**2 / noise)), "ssim": float(similarity)}


def flicker(estimates: Float[np.ndarray, "t v k"], references: Float[np.ndarray, "t v k"]) -> float:
    """RMS of the second difference in time of the error; needs three frames."""
    if len(estimates) < 3:
        raise ValueError(f"flicker needs at least 3 frames, got {len(estimates)}")
    return float(np.sqrt(np.mean(np.diff(_difference(estimates, references), n=2, axis=0) ** 2)))


def calibration(
    error: Float[np.ndarray, "*n"], standard_error: Float[np.ndarray, "*n"], freedom: int = 3
) -> tuple[float, float]:
    """rms z-score, and coverage of the 95 % t-intervals, of errors against the truth."""
    from scipy import stats  # slow to import: a bake measures itself otherwise

    if error.shape != standard_error.shape or not np.all(standard_error > 0):
        raise ValueError("calibration needs one positive standard error for each error")
    score = float(np.sqrt(np.mean(error.astype(np.float64) ** 2) / np.mean(standard_error.astype(np.float64) ** 2)))
    return score, float(np.mean(np.abs(error) <= stats.t.ppf(0.975, freedom) * standard_error))


def plain_bake_curve(
    mesh: Mesh,
    reference: np.ndarray,
    reference_rays: int,
    seed: int = 1,
    progress: ProgressFn | None = None,
    **light: Any,
) -> dict[int, float]:
    """MSE of the plain bake at 4, 8, 16 ... rays, up to an eighth of the reference's rays.

    `light` are `bounces` and `albedo` of the bakes, where the reference has light that bounces.
    """
    bands, counts = round(reference.shape[1] ** 0.5), [4]
    while counts[-1] * 2 <= reference_rays // REFERENCE_SHARE:
        counts.append(counts[-1] * 2)
    curve = {}
    for step, rays in enumerate(counts):
        found = bake_transfer(mesh, bands, rays, replicates=1, seed=seed, **light).coefficients
        curve[rays] = mse(found, reference)
        if progress:
            progress(step + 1, len(counts))
    return curve


def equivalent_rays(error: float, curve: dict[int, float]) -> float | str:
    """Fewest rays at which the plain bake has at most this MSE; "< 4" or ">= N" outside the curve.

    Between two points it is interpolated in log-log, where an MSE of 0 is the limit of ever smaller ones: any larger
    error is met at the point before. A point that is no better than one with fewer rays counts for nothing.
    """
    counts = np.array(sorted(curve))
    errors = np.minimum.accumulate([curve[n] for n in counts])
    if error > errors[0]:
        return f"< {counts[0]}"
    if error < errors[-1]:
        return f">= {counts[-1]}"
    met = int(np.argmax(errors <= error))
    if errors[met] == error:
        return float(counts[met])
    if errors[met] == 0:
        return float(counts[met - 1])
    fall, part = np.log(errors[met - 1] / errors[met]), np.log(errors[met - 1] / error)
    return float(counts[met - 1] * (counts[met] / counts[met - 1]) ** (part / fall))
