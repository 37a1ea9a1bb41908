"""The page itself: one HTML file with its script, its style and its data, which opens from disk and asks no network.

What stands in `page.html` is built from `viewer/` (`npm run build` there). The data are npz files in base64 between
script tags, in the order in which the page lists them. A page is at most `LARGEST` bytes: of animations as many frames
are left out, evenly, as that takes, and the page says so.
"""

import base64
import html
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from gash_jax.apps.pictures.render import drawn_mesh
from gash_jax.apps.same_mesh import check_same_mesh
from gash_jax.apps.viewer.contents import (
    PageFile,
    distinct,
    light_file,
    own_lights,
    result_name,
    still_file,
    texture_file,
)
from gash_jax.apps.viewer.moving import Moving, moving_file
from gash_jax.files.atomic import FileError, write_text
from gash_jax.light.environment import LightLike, light_coefficients
from gash_jax.prt.texture import TransferTexture
from gash_jax.prt.transfer import Transfer

Shown = Transfer | TransferTexture | Moving  # what a page can show
LARGEST = 50 << 20
_HEIGHT = 560  # pixels in a notebook


@dataclass(frozen=True)
class Page:
    """A page as text; notebooks show it inline.

    >>> page = gash_jax.view(gash_jax.bake_transfer("bunny.ply", rays=64))
    >>> page.save("bunny.html")
    """

    html: str

    def save(self, path: str | Path) -> None:
        """Write the page, whole or not at all. Raises FileError where it cannot be written."""
        write_text(path, self.html)

    def _repr_html_(self) -> str:
        text = html.escape(self.html, quote=True)
        return f'<iframe srcdoc="{text}" style="width: 100%; height: {_HEIGHT}px; border: 0"></iframe>'


def view(
    transfer: Transfer | TransferTexture | Mapping[str, Transfer | TransferTexture],
    light: LightLike | Mapping[str, LightLike] | None = None,
) -> Page:
    """A page to look at transfer: turn it, turn the light, see errors and coefficients; inline in a notebook.

    Several transfers of one mesh, by the names that the page shows, can be switched and subtracted; beside transfer at
    vertices the closed form is there by itself. Of `light`, one or several by name, the page shows those bands that the
    transfer has; None gives a generated studio. Raises ValueError for transfers of different meshes, for a light with
    too few bands, and for what does not fit on a page.

    >>> transfer = gash_jax.bake_transfer("bunny.ply", rays=64)
    >>> page = gash_jax.view(transfer, gash_jax.load_light("studio.hdr"))
    >>> len(page.html) < 2_000_000
    True
    """
    named = transfer if isinstance(transfer, Mapping) else {"": transfer}
    for value in named.values():
        if not isinstance(value, TransferTexture):
            drawn_mesh(value)
    if not named:
        raise ValueError("there is nothing to show: give a Transfer, or several by name")
    bands = next(iter(named.values())).bands
    given = light if isinstance(light, Mapping) else {} if light is None else {"light": light}
    lights = [light_file(value, str(name)) for name, value in given.items()]
    for name, value in given.items():
        if len(light_coefficients(value)) < bands**2:
            raise ValueError(f"light {name!r} has fewer bands than the transfer: project it again with {bands} bands")
    return make_page("gash_jax", {str(name): value for name, value in named.items()}, lights or own_lights())


def make_page(title: str, results: Mapping[str, Shown], lights: Sequence[PageFile]) -> Page:
    """A page of results by the names of their files. Raises ValueError where they are not of one mesh or too large."""
    found = list(results.values())
    for other in found[1:]:
        _check_together(found[0], other)
    names = distinct([result_name(one.metadata) for one in found], list(results))
    return Page(_assembled(title, [*_files(names, found), *lights]))


def _check_together(first: Shown, other: Shown) -> None:
    if isinstance(first, Transfer) and isinstance(other, Transfer):
        check_same_mesh(other, first)
    elif isinstance(first, TransferTexture) and isinstance(other, TransferTexture):
        if first.texture.shape[:3] != other.texture.shape[:3] or not np.array_equal(first.uv, other.uv):
            raise ValueError("the textures have other sizes, coordinates or bands: show them on two pages")
        check_same_mesh(other, first)
    elif isinstance(first, TransferTexture) or isinstance(other, TransferTexture):
        raise ValueError("one file holds a texture, another one does not: show them on two pages")
    elif isinstance(first, Transfer) or isinstance(other, Transfer):
        raise ValueError("one file holds an animation, another one does not: show them on two pages")
    elif first.coefficients.shape[:3] != other.coefficients.shape[:3] or not np.array_equal(first.faces, other.faces):
        raise ValueError("the animations have other frames, meshes or bands: show them on two pages")


def _files(names: Sequence[str], found: Sequence[Shown]) -> list[PageFile]:
    files = []
    size = sum(one.frame_size for one in found if isinstance(one, Moving))
    for i, (name, one) in enumerate(zip(names, found, strict=True)):
        if isinstance(one, Transfer):
            files.append(still_file(one, name, mesh=i == 0))
        elif isinstance(one, TransferTexture):
            files.append(texture_file(one, name, mesh=i == 0))
        else:
            frames = kept_frames(len(one.coefficients), size)
            files.append(moving_file(one, name, frames, mesh=i == 0))
    return files


def kept_frames(count: int, size: int) -> list[int]:
    """Which of the frames, of `size` bytes each, fit on a page beside the rest of it: all, or every n-th."""
    room = int(0.9 * LARGEST * 3 / 4)
    return list(range(0, count, max(1, -(-count * size // room))))


def _assembled(title: str, files: Sequence[PageFile]) -> str:
    template = resources.files("gash_jax.apps.viewer").joinpath("page.html").read_text(encoding="utf-8")
    data = "\n".join(_element(file) for file in files)
    # the data come last: what they hold must not be taken for a placeholder
    page = template.replace("{{title}}", html.escape(title)).replace("<!-- files -->", data)
    if len(page) > LARGEST:
        raise FileError(
            f"the page would have {len(page) / 2**20:.0f} MiB, more than {LARGEST >> 20}: "
            "show fewer results or bands, or a coarser mesh"
        )
    return page


def _element(file: PageFile) -> str:
    packed = io.BytesIO()
    entries: dict[str, Any] = {**file.arrays, "metadata": np.array(json.dumps(file.metadata))}
    np.savez_compressed(packed, allow_pickle=False, **entries)
    text = base64.b64encode(packed.getvalue()).decode()
    name = html.escape(file.name, quote=True)
    return f'<script type="application/x-npz" data-kind="{file.kind}" data-name="{name}">{text}</script>'
