"""Our bakes at the mesh sizes of the GNN paper's Table 1: `.venv/bin/python -m benchmarks.paper_sizes`.

The paper's meshes are not public under those sizes, so generated ones of nearly the same vertex counts stand in; the
paper's seconds are those of its Python PRT. Ours are warm (compiled before), medians of three: the closed form, the
default bake of 256 rays, the bake to 2 %, each with its scene build.
"""

import json
from pathlib import Path

from benchmarks.options import options, saved
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.measure.provenance import provenance
from gash_jax.measure.timing import timed
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.error_target import bake_to_error
from gash_jax.shapes.primitives import bumpy_sphere

# vertices, unshadowed and shadowed seconds of Table 1
PAPER = ((2868, 25.5, 117.0), (24461, 216.9, 1408.7), (49990, 445.9, 2963.7), (72027, 639.2, 5009.2))


def main(output: Path | None) -> None:
    rows = []
    for vertices, unshadowed, shadowed in PAPER:
        mesh = bumpy_sphere(round(((vertices - 2) / 10) ** 0.5))  # 10 n² + 2 vertices
        rows.append(
            {
                "paper_vertices": vertices,
                "paper_unshadowed_s": unshadowed,
                "paper_shadowed_s": shadowed,
                "vertices": len(mesh.vertices),
                "closed_form_s": timed(lambda m=mesh: unshadowed_transfer(m.normals, 3), 3)[1],
                "bake_s": timed(lambda m=mesh: bake_transfer(m, rays=256).coefficients, 3)[1],
                "error_s": timed(lambda m=mesh: bake_to_error(m, 0.02).coefficients, 3)[1],
            }
        )
        print(json.dumps(rows[-1]), flush=True)
    saved(output, provenance(seed=0, rows=rows))


if __name__ == "__main__":
    main(**options(__doc__, "output"))
