"""Gloss against dense rays: `.venv/bin/python -m experiments.gloss.run --output docs/results/gloss.json`.

On vertices of five generated meshes under the generated studio:

    integral    shade of 256-ray bakes against quadrature of K_B V [n.w > 0] L_B, what it is by definition: rms z-score
    bands       shade in 4 to 8 bands against the whole K V L and, for GGX, the microfacets' f V (n.w) L: relrmse at
                view angles of 0, 45 and 75 degrees; the bake has so many rays that bands are what is wrong
    eigenvalues of the matrices of the plain estimate: none below 0, the largest 1, as the rays grow
    ggx         the fitted lobe alone against the microfacets, all bands: relative L2 over directions
    components  PCA of the visibility: bytes against error
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.options import options, saved
from experiments.gloss.components import component_curves
from experiments.gloss.dense import Integral, Kernel, Rays, choose_vertices, dense_rays, integrate, only
from gash_jax.algebra.sh import hann_window
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.brdf import Lobe, ggx, phong
from gash_jax.light.environment import project_map
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.glossy import glossy_matrices
from gash_jax.prt.transfer import Transfer
from gash_jax.shapes.procedural import make_shape, shape_kind
from tests.helpers.gloss import (
    cut_lobe,
    half_sphere,
    harmonics,
    map_radiance,
    microfacets,
    mirrored,
    phong_lobe,
    viewers,
)

SEED, VERTICES, RAYS, BAKED = 17, 200, 32768, 8192
KINDS = ("blob", "knot", "vessel", "cavity", "scene")
ANGLES, BANDS, GATE = (0, 45, 75), (4, 5, 6, 7, 8), 4
LOBES = {"Phong 10": phong(10), "Phong 30": phong(30), "GGX 0.5": ggx(0.5), "GGX 0.3": ggx(0.3)}
EXPONENTS = {"Phong 10": 10.0, "Phong 30": 30.0}
ROUGHNESS = {"GGX 0.5": 0.5, "GGX 0.3": 0.3}


def shapes(quick: bool) -> dict[str, Mesh]:
    """One generated mesh of each kind."""
    size = (300, 500) if quick else (2000, 3000)
    found = {kind: next(i for i in range(100) if shape_kind(SEED, i) == kind) for kind in KINDS[: 1 if quick else None]}
    return {kind: make_shape(SEED, index, size)[1] for kind, index in found.items()}


def relative(found: np.ndarray, exact: np.ndarray) -> float:
    """relrmse over vertices and colours."""
    return float(np.sqrt(np.mean((found - exact) ** 2) / np.mean(exact**2)))


def cut(transfer: Transfer, bands: int) -> Transfer:
    """A bake in fewer bands."""
    assert transfer.visibility is not None
    return transfer._replace(
        coefficients=transfer.coefficients[:, : bands**2],
        standard_error=None,
        visibility=transfer.visibility[:, : (2 * bands - 1) ** 2],
        visibility_error=None,
    )


def score(bakes: np.ndarray, exact: Integral) -> float:
    """Rms over vertices and colours of the difference of two means, in its standard deviations."""
    variance = bakes.var(0, ddof=1) / len(bakes) + exact.error**2
    return float(np.sqrt(np.mean((bakes.mean(0) - exact.value) ** 2) / np.mean(variance)))


def against_dense_rays(mesh: Mesh, image: np.ndarray, vertices: int, rays: int, seeds: int) -> tuple[list, list]:
    """Rows of `integral` and `bands` for one mesh."""
    chosen = choose_vertices(mesh, vertices, SEED)
    sparse, normals = only(mesh, chosen), mesh.normals[chosen].astype(np.float64)
    light = project_map(image, 10)
    fine = bake_transfer(sparse, max(BANDS), BAKED, glossy=True)
    coarse = [bake_transfer(sparse, GATE, 256, glossy=True, seed=seed) for seed in range(seeds)]
    integral, bands = [], []
    for angle in ANGLES:
        full = whole_radiance(dense_rays(mesh, chosen, rays, SEED), image, normals, angle)
        bands += cut_to_bands(full, fine, light, chosen, angle)
        toward = viewers(normals, angle)
        everywhere, axis = _everywhere(mesh, chosen, toward), mirrored(normals, toward)
        few = {name: _cut_lobe(axis, lobe) for name, lobe in LOBES.items()}
        exact = integrate(dense_rays(mesh, chosen, rays, SEED), lambda w: harmonics(w, GATE) @ light[: GATE**2], few)
        for name, lobe in LOBES.items():
            bakes = np.array([np.asarray(shade(bake, light, view=everywhere, lobe=lobe))[chosen] for bake in coarse])
            row = {"lobe": name, "angle": angle, "score": score(bakes, exact[name]), "dense_error": _size(exact[name])}
            integral.append(row | {"bake_error": relative(bakes[0], exact[name].value)})
    return integral, bands


def whole_radiance(blocks: Iterator[Rays], image: np.ndarray, normals: np.ndarray, angle: int) -> dict[str, Integral]:
    """Radiance of each lobe, or its microfacets, in no bands at all; `normals` are those of the rays' vertices.

    What a lobe reflects of white surroundings is taken out of the microfacets, as their lobe is normalised.
    """
    toward = viewers(normals, angle)
    axis = mirrored(normals, toward)
    kernels = {name: whole_lobe(axis, EXPONENTS[name]) for name in EXPONENTS}
    kernels |= {name: facets(normals, toward, ROUGHNESS[name] ** 2) for name in ROUGHNESS}
    full = integrate(blocks, lambda w: map_radiance(image, w), kernels)
    for name in ROUGHNESS:
        full[name] = Integral(*(part / reflected_share(angle, ROUGHNESS[name] ** 2) for part in full[name]))
    return full


def cut_to_bands(
    full: dict[str, Integral], fine: Transfer, light: np.ndarray, chosen: np.ndarray, angle: int
) -> list[dict]:
    """Rows of `bands`: shading the chosen vertices of a bake against their whole radiance."""
    everywhere = _everywhere(fine.mesh, chosen, viewers(fine.normals[chosen].astype(np.float64), angle))
    rows = []
    for name, lobe in LOBES.items():
        row: dict = {"lobe": name, "angle": angle, "dense_error": _size(full[name])}
        for count in BANDS:
            found = np.asarray(shade(cut(fine, count), light, view=everywhere, lobe=lobe))[chosen]
            row[str(count)] = relative(found, full[name].value)
        window = hann_window(max(BANDS), max(BANDS) + 2)
        found = np.asarray(shade(fine, light, window=window, view=everywhere, lobe=lobe))[chosen]
        rows.append(row | {"windowed": relative(found, full[name].value)})
    return rows


def _everywhere(mesh: Mesh, chosen: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """Directions towards the viewer for the chosen vertices, 0 for the others."""
    result = np.zeros_like(mesh.normals)
    result[chosen] = toward
    return result


def _size(integral: Integral) -> float:
    return float(np.sqrt(np.mean(integral.error**2) / np.mean(integral.value**2)))


def whole_lobe(axis: np.ndarray, exponent: float) -> Kernel:
    """Phong's lobe about the mirror directions."""
    return lambda index, w: phong_lobe(np.sum(axis[index] * w, axis=-1), exponent)


def _cut_lobe(axis: np.ndarray, lobe: Lobe) -> Kernel:
    return lambda index, w: cut_lobe(np.sum(axis[index] * w, axis=-1), np.asarray(lobe.factors)[:GATE])


def facets(normals: np.ndarray, toward: np.ndarray, alpha: float) -> Kernel:
    """GGX microfacets, f (n.w)."""
    return lambda index, w: microfacets(normals[index], toward[index], w, alpha)


def reflected_share(angle: float, alpha: float) -> float:
    """What microfacets reflect in all towards a view angle."""
    up, (w, area) = np.array([[0.0, 0, 1]]), half_sphere(np.array([0.0, 0, 1]), 400)
    return float(np.sum(area * microfacets(up, viewers(up, angle), w, alpha)))


def eigenvalues(mesh: Mesh, counts: list[int]) -> list[dict]:
    """Extreme eigenvalues of the plain estimate's matrices over all vertices, as the rays grow."""
    rows = []
    for rays in counts:
        matrices = glossy_matrices(bake_transfer(mesh, 4, rays, replicates=1, glossy=True))
        values = np.linalg.eigvalsh(np.asarray(matrices, np.float64))
        rows.append({"rays": rays, "least": float(values.min()), "largest": float(values.max())})
    return rows


def ggx_fit(roughness: float, nodes: int = 600) -> dict:
    """The lobe in all its bands against the microfacets that it stands for, both with integral 1 over the hemisphere's
    directions, at each view angle: relative L2."""
    alpha, up = roughness**2, np.array([[0.0, 0, 1]])
    row: dict = {"roughness": roughness}
    for angle in ANGLES:
        toward = viewers(up, angle)
        axis = mirrored(up, toward)[0]
        w, area = half_sphere(np.array([0.0, 0, 1]), nodes)
        true, lobe = microfacets(up, toward, w, alpha), _normal_view_lobe(w @ axis, alpha, nodes)
        true = true / np.sum(area * true)
        row[str(angle)] = float(np.sqrt(np.sum(area * (lobe - true) ** 2) / np.sum(area * true**2)))
    return row


def _normal_view_lobe(cosine: np.ndarray, alpha: float, nodes: int) -> np.ndarray:
    """The GGX lobe at normal view as a function of the cosine to the mirror direction, integral 1."""
    up = np.array([[0.0, 0, 1]])
    w, area = half_sphere(np.array([0.0, 0, 1]), nodes)
    total = np.sum(area * microfacets(up, up, w, alpha))
    around = np.stack([np.sqrt(np.maximum(1 - cosine**2, 0)), 0 * cosine, cosine], axis=-1)
    return microfacets(up, up, around, alpha) / total


def main(output: Path | None, quick: bool) -> dict:
    image = studio_light(256)
    results: dict = {"integral": [], "bands": [], "eigenvalues": [], "components": []}
    vertices, rays, seeds = (20, 2048, 3) if quick else (VERTICES, RAYS, 8)
    for kind, mesh in shapes(quick).items():
        integral, bands = against_dense_rays(mesh, image, vertices, rays, seeds)
        results["integral"] += [{"mesh": kind, **row} for row in integral]
        results["bands"] += [{"mesh": kind, **row} for row in bands]
        counts = [64, 256] if quick else [64, 256, 1024, 4096]
        results["eigenvalues"] += [{"mesh": kind, **row} for row in eigenvalues(mesh, counts)]
        results["components"] += [{"mesh": kind, **row} for row in component_curves(mesh, 64 if quick else 4096)]
        print(kind, "z", [round(row["score"], 2) for row in integral], flush=True)
    results["ggx"] = [ggx_fit(roughness) for roughness in (0.2, 0.3, 0.5, 0.7, 1.0)]
    sizes = {"vertices": vertices, "rays": rays, "baked": BAKED, "seeds": seeds, "seed": SEED}
    return saved(output, provenance(**sizes, **results))


if __name__ == "__main__":
    main(**options(__doc__, "output", "quick"))
