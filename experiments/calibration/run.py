"""Are the error bars honest: every closed-form scene, every way to bake with error bars.

    .venv/bin/python -m experiments.calibration.run --output docs/results/calibration.json

For each scene the partly occluded probes are baked under many seeds; the rms z-score is the rms error over the rms
standard error, the coverage that of the 95 % intervals of Student's t with 3 degrees of freedom.
"""

from pathlib import Path

from benchmarks.options import parser, saved
from gash_jax.measure.metrics import calibration
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.error_target import bake_to_error
from tests.helpers.calibration import FREE, LESS_THAN_A_RAY, BakeFn, scene_errors
from tests.helpers.closed_forms import closed_form_scenes

WAYS: dict[str, BakeFn] = {
    "64 rays": lambda mesh, bands, seed: bake_transfer(mesh, bands, 64, seed=seed),
    "256 rays": lambda mesh, bands, seed: bake_transfer(mesh, bands, 256, seed=seed),
    "error 0.02": lambda mesh, bands, seed: bake_to_error(mesh, 0.02, bands, seed=seed),
}


def main(samples: int, output: Path | None) -> None:
    rows = []
    for scene in closed_form_scenes():
        if scene.name in FREE:
            continue
        row: dict = {"scene": scene.name, "less_than_a_ray": scene.name in LESS_THAN_A_RAY}
        for way, bake in WAYS.items():
            row[way] = calibration(*scene_errors(scene, bake, samples))
        rows.append(row)
        print(f"{scene.name:30s}" + "  ".join(f"{way}: z {row[way][0]:.2f} in {row[way][1]:.1%}" for way in WAYS))
    saved(output, provenance(samples=samples, rows=rows))


if __name__ == "__main__":
    command = parser(__doc__, "output")
    command.add_argument("--samples", type=int, default=1500, help="rows of coefficients per scene and way")
    main(**vars(command.parse_args()))
