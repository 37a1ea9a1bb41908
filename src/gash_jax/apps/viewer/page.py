"""The page itself: one HTML file with its script, its style and its data, which opens from disk and asks no network.

What stands in `page.html` is built from `viewer/` (`npm run build` there). The data are npz files in base64 between
script tags, in the order in which the page lists them. A page is at most `LARGEST` bytes: long animations are shortened
for it (`motion`), and the page says how.
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
from gash_jax.apps.viewer.components import Progress
from gash_jax.apps.viewer.contents import (
    PageFile,
    distinct,
    light_file,
    own_lights,
    result_name,
    still_file,
    texture_file,
)
from gash_jax.apps.viewer.motion import moving_files
from gash_jax.apps.viewer.moving import Moving
from gash_jax.files.atomic import FileError, write_text
from gash_jax.light.environment import LightLike, light_coefficients
from gash_jax.prt.texture import TransferTexture
from gash_jax.prt.transfer import Transfer

Shown = Transfer | TransferTexture | Moving  # what a page can show
LARGEST = 50 << 20
_BARE = 0.99 * 3 / 4  # bytes in a character of base64, and a little for headers
_HEIGHT = 560  # pixels in a notebook


@dataclass(frozen=True)
class Page:
    """A page as text; notebooks show it inline.

    >>> page = gash_jax.view(gash_jax.bake_transfer("bunny.ply", rays=64))
    >>> page.save("bunny.html")
    """

    html: str
    notes: tuple[str, ...] = ()  # what the page says of its files

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


def make_page(
    title: str, results: Mapping[str, Shown], lights: Sequence[PageFile], progress: Progress | None = None
) -> Page:
    """A page of results by the names of their files. Raises ValueError where they are not of one mesh or too large.

    `progress(done, total)` counts the steps of shortening a long animation."""
    found = list(results.values())
    for other in found[1:]:
        _check_together(found[0], other)
    names = distinct([result_name(one.metadata) for one in found], list(results))
    template = resources.files("gash_jax.apps.viewer").joinpath("page.html").read_text(encoding="utf-8")
    shining = [_element(light) for light in lights]
    left = LARGEST - len(template) - sum(map(len, shining))
    files = _files(names, found, int(_BARE * left), progress)
    elements = [*(_element(file) for file in files), *shining]
    notes = tuple(note for file in (*files, *lights) for note in file.metadata.get("notes", ()))
    return Page(_assembled(template, title, elements), notes)


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


def _files(names: Sequence[str], found: Sequence[Shown], room: int, progress: Progress | None) -> list[PageFile]:
    moving = [one for one in found if isinstance(one, Moving)]
    if moving:
        return moving_files(names, moving, room, progress)
    files = []
    for i, (name, one) in enumerate(zip(names, found, strict=True)):
        if isinstance(one, Transfer):
            files.append(still_file(one, name, mesh=i == 0))
        elif isinstance(one, TransferTexture):
            files.append(texture_file(one, name, mesh=i == 0))
    return files


def _assembled(template: str, title: str, elements: Sequence[str]) -> str:
    # the data come last: what they hold must not be taken for a placeholder
    page = template.replace("{{title}}", html.escape(title)).replace("<!-- files -->", "\n".join(elements))
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
