"""A relit picture of a transfer as an array, for scripts and notebooks."""

from typing import Any

import numpy as np
from jax import Array
from jaxtyping import Float, UInt8

from gash_jax.algebra.arguments import (
    ArrayLike,
    RealNumber,
    WholeNumber,
    as_array,
    is_real,
    real_number,
    shown,
    whole_number,
)
from gash_jax.apps.pictures.views import (
    VIEWS,
    Camera,
    cast_view,
    exposure_for,
    look_up_view,
    shade_view,
    to_srgb,
    toward_camera,
)
from gash_jax.formats.meshes import as_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.brdf import Lobe
from gash_jax.light.environment import LightLike, rotate_light
from gash_jax.light.shading import shade, shade_texture
from gash_jax.prt.texture import TransferTexture
from gash_jax.prt.transfer import Transfer


def render(
    transfer: Transfer | TransferTexture,
    light: LightLike,
    *,
    rotation: ArrayLike | Array | None = None,
    exposure: RealNumber | None = None,
    camera: Camera = "front",
    size: WholeNumber = 512,
    albedo: ArrayLike | Array | None = None,
    lobe: Lobe | None = None,
    window: str | ArrayLike | Array | None = None,
) -> UInt8[np.ndarray, "size size 3"]:
    """A picture of the relit mesh, (size, size, 3) in 8-bit sRGB.

    `rotation` turns the light, in the forms that `rotate_light` takes, and leaves the mesh where it is. `exposure`
    multiplies the radiance, of which 1 becomes white; None chooses it from the picture: give a number to compare
    pictures.
    `camera` is "front" (from +z), "side", "back", "top" or "below", or (azimuth from +z towards +x, elevation) in
    degrees; the mesh fills the frame. `albedo`, `lobe` and `window` are as for `shade`: with a lobe the picture is what
    a glossy surface reflects towards the camera. A TransferTexture is looked up at every sample of every pixel; it
    takes one colour as albedo, and no lobe. Negative radiance, which `shade` gives, is drawn black. Raises ValueError
    for options out of range.

    >>> transfer = gash_jax.bake_transfer("bunny.ply", rays=64)
    >>> image = gash_jax.render(transfer, gash_jax.load_light("studio.hdr"), exposure=1.0, size=64)
    >>> image.shape, image.dtype
    ((64, 64, 3), dtype('uint8'))
    """
    factor = real_number(exposure)
    if exposure is not None and not (factor and factor > 0):
        raise ValueError(f"exposure is {shown(exposure)}: use a number above 0, or None to choose one from the picture")
    size = whole_number(size, "size", 16, 4096)
    mesh = as_mesh(transfer.mesh) if isinstance(transfer, TransferTexture) else drawn_mesh(transfer)
    turned = light if rotation is None else rotate_light(light, rotation)
    camera = checked_camera(camera)
    if isinstance(transfer, TransferTexture):
        if lobe is not None:
            raise ValueError("a transfer texture is diffuse: leave out the lobe, or bake vertices with glossy=True")
        radiance = _finite(shade_texture(transfer, turned, albedo, window))
        picture = look_up_view(cast_view(mesh, camera, size), transfer.uv, radiance)
    else:
        view = None if lobe is None else toward_camera(mesh, camera)
        radiance = finite_radiance(transfer, turned, albedo, view, lobe, window)
        picture = shade_view(cast_view(mesh, camera, size), radiance)
    return to_srgb(*picture, factor or exposure_for([picture]))


def finite_radiance(
    transfer: Transfer,
    light: LightLike,
    albedo: ArrayLike | Array | None = None,
    view: ArrayLike | None = None,
    lobe: Lobe | None = None,
    window: str | ArrayLike | Array | None = None,
) -> Float[np.ndarray, "v 3"]:
    """Radiance of every vertex, as `shade` gives it. Raises ValueError where it cannot be drawn."""
    return _finite(np.asarray(shade(transfer, light, albedo, window, view=view, lobe=lobe), np.float32))


def _finite(radiance: Float[np.ndarray, "*shape 3"]) -> Float[np.ndarray, "*shape 3"]:
    if not np.isfinite(radiance).all():
        raise ValueError("the relit radiance is not finite: look for nan and inf in the transfer, light and albedo")
    return radiance


def drawn_mesh(transfer: Any) -> Mesh:
    """The mesh of a Transfer, with faces. Raises ValueError for anything else."""
    if not isinstance(transfer, Transfer):
        kind = type(transfer).__name__
        raise ValueError(f"a {kind} has no mesh to draw: give the Transfer that a bake or a model returns")
    return as_mesh(transfer.mesh)


def checked_camera(camera: Any) -> Camera:
    """A view's name, or two finite angles. Raises ValueError for anything else."""
    if isinstance(camera, str) and camera in VIEWS:
        return camera
    angles = as_array(camera)
    if angles.shape != (2,) or not is_real(angles) or not np.isfinite(angles).all() or abs(angles[1]) >= 90:
        raise ValueError(
            f"camera is {shown(camera)}: use {', '.join(VIEWS)}, or (azimuth, elevation) in degrees, "
            "elevation within 90"
        )
    return float(angles[0]), float(angles[1])
