"""What a transfer looks like, as a matplotlib figure for notebooks: relit, its coefficients, its errors."""

import io
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.figure import Figure

from gash_jax.apps.pictures.render import drawn_mesh, finite_radiance
from gash_jax.apps.pictures.views import Hit, cast_view, exposure_for, shade_view, to_srgb
from gash_jax.light.environment import LightLike, project_light
from gash_jax.light.studio import studio_light
from gash_jax.prt.transfer import Transfer

SIZE, COLUMNS, INCHES = 320, 4, 3.0
BESIDE = (0.75, 0.8, 0.75)  # the colour beside the mesh, which no map has
RELIT = ("front", "side", "back", "top")


class _Shown(Figure):
    """A figure that a notebook shows when it is the value of a cell, whether pyplot was imported or not."""

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        self.savefig(data, format="png")
        return data.getvalue()


class _Scalar(NamedTuple):
    """One number per vertex, to be drawn with a colour bar."""

    title: str
    values: Float[np.ndarray, "v"]
    colors: str
    low: float
    high: float


def show(transfer: Transfer, light: LightLike | None = None) -> Figure:
    """A figure of a transfer, for notebooks: relit from four sides, and its coefficients and errors on the surface.

    Relit under `light` (a generated studio if None); seen from the front the coefficients of bands 0 and 1 and, where
    there are any, standard error and predicted error.

    All relit views have one exposure; every map has a colour bar. Of coloured transfer the maps show the mean of the
    colours. Raises ValueError for what has no mesh.

    >>> figure = gash_jax.show(gash_jax.bake_transfer("bunny.ply", rays=64))
    >>> figure.savefig("bunny.png")
    """
    mesh = drawn_mesh(transfer)
    light = project_light(studio_light(), transfer.bands) if light is None else light
    radiance = finite_radiance(transfer, light)
    hits = {view: cast_view(mesh, view, SIZE) for view in RELIT}
    relit = {view: shade_view(hit, radiance) for view, hit in hits.items()}
    exposure, maps = exposure_for(list(relit.values())), _maps(transfer)
    rows = 1 + -(-len(maps) // COLUMNS)
    figure = _Shown(figsize=(INCHES * COLUMNS, INCHES * rows), layout="constrained")
    axes = figure.subplots(rows, COLUMNS).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, (view, picture) in zip(axes, relit.items(), strict=False):
        axis.imshow(to_srgb(*picture, exposure))
        axis.set_title(f"relit, {view}", fontsize=10)
    for axis, shown in zip(axes[COLUMNS:], maps, strict=False):
        colors = colormaps[shown.colors].with_extremes(bad=BESIDE)
        pixels = axis.imshow(_drawn(hits["front"], shown.values), cmap=colors, vmin=shown.low, vmax=shown.high)
        axis.set_title(shown.title, fontsize=10)
        figure.colorbar(pixels, ax=axis, shrink=0.8)
    return figure


def _drawn(hit: Hit, values: Float[np.ndarray, "v"]) -> np.ma.MaskedArray:
    """The values over the pixels, masked beside the mesh."""
    image, covered = shade_view(hit, values[:, None].astype(np.float32))
    return np.ma.masked_array(image[..., 0] / np.maximum(covered, 1e-6), covered < 0.5)


def _maps(transfer: Transfer) -> list[_Scalar]:
    coefficients = _grey(transfer.coefficients)
    seen = coefficients[:, 0] * np.sqrt(4 * np.pi)
    maps = [_Scalar("seen sky (1 = all of it)", seen, "gray", 0.0, 1.0)]
    if transfer.bands > 1:
        limit = float(np.abs(coefficients[:, 1:4]).max()) or 1.0
        for k, name in ((1, "y"), (2, "z"), (3, "x")):
            maps.append(_Scalar(f"coefficient {k} (l = 1, {name})", coefficients[:, k], "RdBu_r", -limit, limit))
    for name, error in (("standard error", transfer.standard_error), ("predicted error", transfer.predicted_error)):
        if error is not None:
            values = np.sqrt(np.mean(_grey(error).astype(np.float64) ** 2, axis=1))
            high = float(values.max()) or 1.0
            maps.append(_Scalar(f"{name} (rms)", values, "viridis", 0.0, high))
    return maps


def _grey(array: np.ndarray) -> np.ndarray:
    found = np.asarray(array)
    return found if found.ndim == 2 else found.mean(axis=2)
