"""`gash render`: a relit picture of a transfer or texture file from several sides, diffuse or glossy."""

from collections.abc import Callable
from pathlib import Path

import click
import numpy as np

from gash_jax.apps.options import LIGHT_HELP, PATH, Command, layout_option, output_option, quiet_option
from gash_jax.apps.pictures.montage import check_picture, montage, write_picture
from gash_jax.apps.pictures.views import (
    VIEWS,
    Hit,
    Picture,
    cast_view,
    exposure_for,
    look_up_view,
    shade_view,
    to_srgb,
    toward_camera,
)
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.rotate_option import rotate_option
from gash_jax.files.atomic import check_writable
from gash_jax.files.npz import names_in_npz
from gash_jax.light.brdf import Lobe, ggx, phong
from gash_jax.light.environment import Light, load_light, rotate_light
from gash_jax.light.shading import shade, shade_texture
from gash_jax.light.windows import DIP, WINDOWS, kept, light_window
from gash_jax.prt.texture import TransferTexture, load_texture
from gash_jax.prt.transfer import Transfer, load_transfer


@click.command(cls=Command, epilog="gash render bunny.npz --light studio.hdr -o bunny.png --view front --view back")
@click.argument("transfer", type=PATH)
@click.option("--light", "light_path", required=True, type=PATH, help=LIGHT_HELP)
@layout_option
@rotate_option
@output_option
@click.option(
    "--view",
    "views",
    multiple=True,
    type=click.Choice(list(VIEWS)),
    default=("front", "side", "back"),
    show_default=True,
    help="Camera; may be given several times.",
)
@click.option("--exponent", type=float, help="Glossy: Phong's exponent, 0 or more. TRANSFER from gash bake --glossy.")
@click.option("--roughness", type=float, help="Glossy: GGX of this roughness, 0 to 1, as in glTF.")
@click.option(
    "--window",
    type=click.Choice(WINDOWS),
    help="Damp the light's ringing; radiance and irradiance do it as little as they can.  [default: none]",
)
@click.option("--size", type=click.IntRange(16, 4096), default=512, show_default=True, help="Pixels per view.")
@quiet_option
def render(
    transfer: Path,
    light_path: Path,
    layout: str | None,
    turn: np.ndarray | None,
    output: Path,
    views: tuple[str, ...],
    exponent: float | None,
    roughness: float | None,
    window: str | None,
    size: int,
    quiet: bool,
) -> None:
    """Relight TRANSFER and write a picture (.png, .jpg) of several views."""
    lobe = _lobe(exponent, roughness)
    check_writable(output, [transfer, light_path])
    check_picture(output)
    textured = "texture" in names_in_npz(transfer)
    if textured and lobe is not None:
        raise click.UsageError(f"{transfer} is a texture, which is diffuse: leave out --exponent and --roughness")
    lit = load_texture(transfer) if textured else load_transfer(transfer)
    with progress_bar(f"projecting {light_path.name}", quiet) as update:
        light = load_light(light_path, lit.bands, layout, update)
    for note in light.metadata.get("notes", []):
        say(f"  {note}", quiet)
    light = light if turn is None else rotate_light(light, turn)
    factors = None if window is None else light_window(light, window)
    if factors is not None:
        say(f"  window {window} keeps {kept(factors)}", quiet)
    images = []
    with progress_bar("rendering", quiet) as update:
        draw = _drawing(lit, light, lobe, factors)
        for step, view in enumerate(views):
            images.append(draw(view, cast_view(lit.mesh, view, size)))
            update(step + 1, len(views))
    exposure = exposure_for(images)
    panels = [(view, to_srgb(image, covered, exposure)) for view, (image, covered) in zip(views, images, strict=True)]
    write_picture(output, montage(panels))
    if below := _negative(images):
        advice = "" if window == "radiance" or lobe else "; --window radiance avoids it"
        say(f"  {below}: drawn black{advice}", quiet)
    say(f"wrote {output} ({len(views)} views, {size} pixels each)", quiet)


def _negative(images: list[tuple[np.ndarray, np.ndarray]]) -> str:
    """How many pixels of the mesh are negative in a colour, by more than a window leaves; "" if none is."""
    pixels = np.concatenate([image[covered > 0] for image, covered in images])
    below = pixels.min(axis=-1, initial=0.0) < -DIP * np.abs(pixels).mean() if pixels.size else np.zeros(0, bool)
    if not below.any():
        return ""
    return f"{below.sum()} of {len(pixels)} pixels of the mesh are negative in a colour ({below.mean():.1%})"


def _drawing(
    lit: Transfer | TransferTexture, light: Light, lobe: Lobe | None, factors: np.ndarray | None
) -> Callable[[str, Hit], Picture]:
    """What makes a picture of a view; what all views share is shaded once. `factors` are those of the window."""
    if isinstance(lit, TransferTexture):
        image, uv = shade_texture(lit, light, window=factors), lit.uv
        return lambda view, hit: look_up_view(hit, uv, image)
    if lobe is None:
        radiance = np.asarray(shade(lit, light, window=factors))
        return lambda view, hit: shade_view(hit, radiance)
    return lambda view, hit: shade_view(
        hit, np.asarray(shade(lit, light, window=factors, view=toward_camera(lit.mesh, view), lobe=lobe))
    )


def _lobe(exponent: float | None, roughness: float | None) -> Lobe | None:
    if exponent is not None and roughness is not None:
        raise click.UsageError("--exponent and --roughness each name a lobe: give one of them")
    if exponent is not None:
        return phong(exponent)
    return None if roughness is None else ggx(roughness)
