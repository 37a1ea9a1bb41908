"""What windows keep of a light and what they cost: `.venv/bin/python -m experiments.windows.run --output FILE`.

Of every light, in 3, 4 and 6 bands: what each window keeps of l = 1 and l = 2, and the least radiance and irradiance
that remain in any direction and colour, as shares of the mean. Of meshes, in 3 bands: how many vertices are negative in
a colour, the least radiance of any, and relrmse against the same light and the same rays in 10 bands, without a window.
"""

from pathlib import Path

import numpy as np

from benchmarks.options import options, saved
from experiments.maps import lights
from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.windows import WINDOWS, least_share, light_window
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import bumpy_sphere

BANDS, SHADED, TRUE_BANDS = (3, 4, 6), 3, 10
RAYS, SEED = 1024, 0
MESHES = ("spot", "stanford_bunny", "armadillo")
KINDS = ("none", *WINDOWS)


def window(light: np.ndarray, kind: str) -> np.ndarray:
    """Factors of a window by its name, or ones."""
    return np.ones(len(light)) if kind == "none" else light_window(light, kind)


def kept(light: np.ndarray, bands: int) -> list[dict]:
    """What each window leaves of a light."""
    rows = []
    for kind in KINDS:
        factors = window(light[: bands**2], kind)
        left = light[: bands**2] * factors[:, None]
        least = {name: least_share(left, name) for name in ("radiance", "irradiance")}
        rows.append({"bands": bands, "window": kind, "l=1": float(factors[1]), "l=2": float(factors[4]), **least})
    return rows


def shaded(transfer: np.ndarray, light: np.ndarray) -> list[dict]:
    """What each window does to a mesh under a light."""
    true, rows = transfer @ light, []
    few = light[: SHADED**2]
    mean = few[0] / (2 * np.sqrt(np.pi))
    for kind in KINDS:
        radiance = transfer[:, : SHADED**2] @ (few * window(few, kind)[:, None])
        shares = (radiance / mean).min(axis=1)
        error = np.sqrt(np.sum((radiance - true) ** 2) / np.sum(true**2))
        figures = {"negative": float(np.mean(shares < -1e-6)), "least": float(shares.min()), "relrmse": float(error)}
        rows.append({"window": kind, **figures})
    return rows


def chosen_meshes(folder: Path | None, quick: bool) -> dict[str, Mesh]:
    """Three meshes of a folder, or one that is generated."""
    if folder is None:
        return {"bumpy sphere": bumpy_sphere(8 if quick else 32)}
    return {name: load_mesh(folder / f"{name}.ply") for name in MESHES}


def main(output: Path | None, meshes: Path | None, maps: Path | None, quick: bool) -> dict:
    found = lights(maps, TRUE_BANDS)
    results: dict = {"kept": [], "shaded": []}
    for name, light in found.items():
        for bands in BANDS[: 1 if quick else None]:
            results["kept"] += [{"light": name, **row} for row in kept(light, bands)]
        print(name, flush=True)
    for name, mesh in chosen_meshes(meshes, quick).items():
        transfer = np.asarray(bake_transfer(mesh, TRUE_BANDS, 64 if quick else RAYS, seed=SEED).coefficients)
        for source, light in found.items():
            results["shaded"] += [{"mesh": name, "light": source, **row} for row in shaded(transfer, light)]
        print(name, len(transfer), flush=True)
    return saved(output, provenance(rays=RAYS, seed=SEED, **results))


if __name__ == "__main__":
    main(**options(__doc__, "output", "meshes", "maps", "quick"))
