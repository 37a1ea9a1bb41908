"""Seconds of light that bounces over those of the direct bake of the same rays, and the peak memory of a large bake.

    .venv/bin/python -m benchmarks.bounce_speed --output docs/results/bounce_speed.json

On a bowl that is half open, in which half of all rays meet a wall, and on a generated body. Every figure is a median
over rounds in which the direct bake, one bounce and three, grey and in colour, take turns in one process; seconds are
those of all cores together, which other work on the machine prolongs little. Then a bowl of a million vertices is baked
with 64 rays and 3 bounces by a process of its own, whose peak memory is read.
"""

import json
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.options import options, saved
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import bumpy_sphere, spherical_bowl

RAYS, ROUNDS, COLOUR = 64, 5, (0.8, 0.5, 0.3)
ALONE = """
import json, resource, time
import numpy as np
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import spherical_bowl
bowl = spherical_bowl(np.pi / 2, {resolution})
before, started = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
baked = bake_transfer(bowl, rays={rays}, bounces=3, albedo={albedo})
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps(dict(vertices=len(bowl.vertices), seconds=time.perf_counter() - started, gib=peak / 2**20,
                      before_gib=before / 2**20, told=baked.metadata["bounced"])))
"""


def ratios(mesh: Mesh, rounds: int) -> dict[str, float]:
    """Median CPU seconds of the direct bake, and of what bounces add to it in units of these."""
    bakes = {
        "direct": partial(bake_transfer, mesh, rays=RAYS),
        "one": partial(bake_transfer, mesh, rays=RAYS, bounces=1, albedo=0.7),
        "three": partial(bake_transfer, mesh, rays=RAYS, bounces=3, albedo=0.7),
        "one in colour": partial(bake_transfer, mesh, rays=RAYS, bounces=1, albedo=COLOUR),
        "three in colour": partial(bake_transfer, mesh, rays=RAYS, bounces=3, albedo=COLOUR),
    }
    seconds: dict[str, list[float]] = {name: [] for name in bakes}
    for turn in range(rounds + 1):
        for name, work in bakes.items():
            started = time.process_time()
            work()
            if turn:  # the first round compiles
                seconds[name].append(time.process_time() - started)
    all_of = {name: np.array(values) for name, values in seconds.items()}
    direct = all_of["direct"]
    return {
        "direct_s": float(np.median(direct)),
        "first": float(np.median(all_of["one"] / direct)),
        "further": float(np.median((all_of["three"] - all_of["one"]) / direct)) / 2,
        "first_colour": float(np.median(all_of["one in colour"] / direct)),
        "further_colour": float(np.median((all_of["three in colour"] - all_of["one in colour"]) / direct)) / 2,
    }


def large(resolution: int, albedo: object) -> dict:
    """A bake by a process of its own: seconds and peak memory."""
    script = ALONE.format(resolution=resolution, rays=RAYS, albedo=albedo)
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def main(output: Path | None, quick: bool) -> dict:
    size = 20 if quick else 100
    meshes = {"half open bowl": spherical_bowl(np.pi / 2, size), "bumpy ball": bumpy_sphere(size)}
    rows = []
    for name, mesh in meshes.items():
        rows.append({"mesh": name, "vertices": len(mesh.vertices), **ratios(mesh, 2 if quick else ROUNDS)})
        print(rows[-1], flush=True)
    memory = {name: large(20 if quick else 500, albedo) for name, albedo in (("grey", 0.7), ("colour", COLOUR))}
    print(memory)
    return saved(output, provenance(seed=0, rays=RAYS, rows=rows, large=memory))


if __name__ == "__main__":
    main(**options(__doc__, "output", "quick"))
