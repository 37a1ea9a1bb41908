"""What fewer numbers and fewer bits cost: `.venv/bin/python -m experiments.fewer_numbers.run --output FILE`.

Every mesh is baked in three bands and shaded with every light; relrmse of the radiance against shading with the nine
floats of that bake, over vertices and colours, for every way of storing the transfer, and for lights in fewer numbers.
*two bands* drops band 2, what four numbers would be without a curve for it; *constant* is the curve z / c_0 = sqrt(5)/4
of vertices that see everything; *fit for light* is the curve of lights on transfer.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from benchmarks.options import options, saved
from experiments.maps import lights
from gash_jax.algebra.zonal import from_zonal, light_curve
from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.compression import compress_light, compress_transfer, expand_light, expand_transfer
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.procedural import make_shape

RAYS, SEED = 256, 0
LEFT_OUT = ("armadillo_sub1", "brain_pial_both")  # the surface of another mesh once more
Way = Callable[[np.ndarray], np.ndarray]


def stored(numbers: int | None, bits: int) -> Way:
    """There and back."""
    return lambda t: np.asarray(expand_transfer(compress_transfer(t, numbers, bits)))


TRANSFERS: dict[str, tuple[int, Way]] = {
    "9 of 16 bits": (18, stored(None, 16)),
    "9 of 8 bits": (9, stored(None, 8)),
    "5 floats": (20, stored(5, 32)),
    "5 of 16 bits": (10, stored(5, 16)),
    "5 of 8 bits": (5, stored(5, 8)),
    "4 floats": (16, stored(4, 32)),
    "4 of 16 bits": (8, stored(4, 16)),
    "4 of 8 bits": (4, stored(4, 8)),
    "4 floats, constant": (16, lambda t: np.asarray(from_zonal(t[:, :4], lambda r: 5**0.5 / 4 * jnp.ones_like(r)))),
    "4 floats, fit for light": (16, lambda t: np.asarray(from_zonal(t[:, :4], light_curve))),
    "4 floats, two bands": (16, lambda t: np.pad(t[:, :4], ((0, 0), (0, 5)))),
}
LIGHTS: dict[str, tuple[int, Way]] = {
    "5 floats": (60, lambda c: np.asarray(expand_light(compress_light(c, 5, 32)))),
    "5 of 8 bits": (15, lambda c: np.asarray(expand_light(compress_light(c, 5, 8)))),
    "4 floats": (48, lambda c: np.asarray(expand_light(compress_light(c, 4, 32)))),
    "4 of 8 bits": (12, lambda c: np.asarray(expand_light(compress_light(c, 4, 8)))),
    "9 of 8 bits": (27, lambda c: np.asarray(expand_light(compress_light(c, None, 8)))),
    "4 floats, two bands": (48, lambda c: np.pad(c[:4], ((0, 5), (0, 0)))),
}


def chosen_meshes(folder: Path | None, quick: bool) -> Iterator[tuple[str, Mesh]]:
    """Every mesh of a folder, or some that are generated."""
    if folder is None:
        for index in range(1 if quick else 8):
            kind, mesh = make_shape(SEED, index, (300, 500) if quick else (2000, 3000))
            yield f"{kind} {index}", mesh
        return
    for path in sorted(folder.glob("*.ply")):
        if path.stem not in LEFT_OUT:
            yield path.stem, load_mesh(path)


def relative(found: np.ndarray, exact: np.ndarray) -> float:
    """relrmse over vertices and colours."""
    return float(np.sqrt(np.sum((found - exact) ** 2) / np.sum(exact**2)))


def main(output: Path | None, meshes: Path | None, maps: Path | None, quick: bool) -> dict:
    found = lights(maps, 3)
    rows = []
    for name, mesh in chosen_meshes(meshes, quick):
        baked = bake_transfer(mesh, 3, RAYS, seed=SEED).coefficients
        if not np.any(baked):
            continue
        small = {way: np.asarray(make(baked), np.float64) for way, (_, make) in TRANSFERS.items()}
        transfer = np.asarray(baked, np.float64)
        for source, light in found.items():
            exact = transfer @ light
            for way, values in small.items():
                row = {"what": "transfer", "way": way, "bytes": TRANSFERS[way][0]}
                rows.append({**row, "mesh": name, "light": source, "relrmse": relative(values @ light, exact)})
            for way, (size, make) in LIGHTS.items():
                lit = transfer @ np.asarray(make(light.astype(np.float32)), np.float64)
                row = {"what": "light", "way": way, "bytes": size}
                rows.append({**row, "mesh": name, "light": source, "relrmse": relative(lit, exact)})
        print(name, len(baked), flush=True)
    return saved(output, provenance(rays=RAYS, seed=SEED, lights=list(found), rows=summary(rows)))


def summary(rows: list[dict]) -> list[dict]:
    """Median and largest over the meshes of each way under each light."""
    kept = []
    for key in dict.fromkeys((row["what"], row["way"], row["bytes"], row["light"]) for row in rows):
        own = [row for row in rows if (row["what"], row["way"], row["bytes"], row["light"]) == key]
        worst = max(own, key=lambda row: row["relrmse"])
        entry = dict(zip(("what", "way", "bytes", "light"), key, strict=True))
        median = float(np.median([row["relrmse"] for row in own]))
        kept.append({**entry, "meshes": len(own), "median": median, "worst": worst["relrmse"], "mesh": worst["mesh"]})
    return kept


if __name__ == "__main__":
    main(**options(__doc__, "output", "meshes", "maps", "quick"))
