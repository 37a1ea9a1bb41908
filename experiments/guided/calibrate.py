"""How the halves of the rays tell what a guided bake is off by: the constants of `models.guided_error`.

    .venv/bin/python -m experiments.guided.calibrate --output experiments/guided/calibration.json

On generated shapes that the network was not trained on, rays are doubled from 8 on. At each number of rays, `worth` is
the squared error of the rays' own estimates over that of their halves; the *noise ratio* of a mesh is that squared
error, as its halves tell it, over the law that the network counts in. `power` and `level` are those of a line through
log(squared error of the guided bake / expected) against log(noise ratio), one point for each shape. Within a shape, by
tenths of its vertices from the smallest error that is expected to the largest, `slope` is that of the same against the
logarithm of what is expected, the median over the shapes.
"""

from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from benchmarks.options import options, saved
from gash_jax.apps.progress import progress_bar
from gash_jax.measure.provenance import provenance
from gash_jax.models.guided import GuidedBake
from gash_jax.models.reconstruction import reconstruct, shipped_network
from gash_jax.nn.reconstruction import rough_variance
from gash_jax.prt.allocation import PILOT
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.few_rays import HALVES, LARGEST_ROW
from gash_jax.prt.integrands import to_world
from gash_jax.shapes.procedural import make_shape

SEED, SHAPES, COARSE, FINE = 67, 64, (1000, 3000), (3000, 8000)
DOUBLINGS, REFERENCE = 7, 4096


def measure(index: int, seed: int, reference: int, doublings: int, sizes: tuple[int, int]) -> list[dict[str, Any]]:
    """One shape at all numbers of rays."""
    kind, mesh = make_shape(seed, index, sizes)
    baked = bake_transfer(mesh, rays=reference, seed=seed)
    assert baked.standard_error is not None
    bake = GuidedBake(mesh, 3, PILOT, LARGEST_ROW, index, "embree", [])
    truth = baked.coefficients[bake.active]
    doubts = np.sum(baked.standard_error[bake.active].astype(np.float64) ** 2, axis=1)
    few, surface = bake.first()
    rows = []
    for step in range(doublings + 1):
        few = bake.add(few, np.full(len(few.rays), PILOT << step))
        rebuilt = reconstruct(shipped_network(), surface, few)
        expected = rebuilt.variance.sum(axis=1, dtype=np.float64)
        error = np.sum((rebuilt.coefficients - truth).astype(np.float64) ** 2, axis=1) - doubts
        own = np.asarray(to_world(jnp.asarray(few.local[:, None]), bake.rows.frames))[:, 0]
        rows.append(
            {
                "shape": f"{index} {kind}",
                "rays": PILOT << step,
                "guided": float(error.sum()),
                "expected": float(expected.sum()),
                "tenths": [_tenths(values, np.argsort(expected)) for values in (error, expected, doubts)],
                "own": float(np.sum((own - truth).astype(np.float64) ** 2) - doubts.sum()),
                "halves": float(few.halves.sum(dtype=np.float64)),
                "law": float(HALVES * rough_variance(few.rays.astype(np.float64), few.share).sum()),
                "doubt": float(doubts.sum()),
            }
        )
    return rows


def _tenths(values: np.ndarray, order: np.ndarray) -> list[float]:
    """Sums over ten parts of the vertices in this order."""
    return [float(part.sum()) for part in np.array_split(values[order], 10)]


def fit(rows: list[dict[str, Any]]) -> list[dict[str, float]]:
    """The constants for each number of rays, of shapes whose reference is good enough there."""
    found = []
    for rays in sorted({row["rays"] for row in rows}):
        held = [r for r in rows if r["rays"] == rays and min(r["guided"], r["own"]) > 2 * r["doubt"]]
        held = [r for r in held if r["expected"] > 0 and r["guided"] > 1e-7]
        worth = float(np.median([r["own"] / r["halves"] for r in held]))
        ratio = np.log([worth * r["halves"] / r["law"] for r in held])
        off = np.log([r["guided"] / r["expected"] for r in held])
        power, level = np.polyfit(ratio, off, 1)
        left = off - power * ratio - level
        slopes = [slope for r in held if (slope := _slope(*map(np.array, r["tenths"]))) is not None]
        found.append(
            {
                "rays": rays,
                "shapes": len(held),
                "worth": worth,
                "power": float(power),
                "level": float(level),
                "slope": float(np.median(slopes)),
                "spread_before": float(np.std(off) / 2),
                "spread_after": float(np.std(left) / 2),
            }
        )
    return found


def _slope(error: np.ndarray, expected: np.ndarray, doubt: np.ndarray) -> float | None:
    """Of log(error / expected) against log(expected), where the reference is good enough; None where it nowhere is."""
    good = (error > 2 * doubt) & (expected > 0)
    if np.count_nonzero(good) < 4:
        return None
    return float(np.polyfit(np.log(expected[good]), np.log(error[good] / expected[good]), 1)[0])


def main(output: Path | None, quick: bool) -> dict[str, Any]:
    shapes, doublings = (8, 2) if quick else (SHAPES, DOUBLINGS)
    rows: list[dict[str, Any]] = []
    with progress_bar(f"{shapes} shapes") as update:
        for index in range(shapes):
            sizes = (300, 600) if quick else COARSE if index % 2 else FINE
            rows += measure(index, SEED, 256 if quick else REFERENCE, doublings, sizes)
            update(index + 1, shapes)
    levels = fit(rows)
    results = {
        **provenance(seed=SEED),
        "levels": levels,
        "rows": [{name: value for name, value in row.items() if name != "tenths"} for row in rows],
    }
    saved(output, results)
    for level in levels:
        print(
            f"{level['rays']:5d} rays, {level['shapes']} shapes: worth {level['worth']:.3f}, "
            f"power {level['power']:.2f}, level {level['level']:+.2f}, slope {level['slope']:+.2f}; "
            "logarithm of error over expected spreads by "
            f"{level['spread_after']:.3f} (not corrected: {level['spread_before']:.3f})"
        )
    return results


if __name__ == "__main__":
    main(**options(__doc__, "output", "quick"))
