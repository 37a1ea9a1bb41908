"""Ray-cast pictures of a shaded mesh with Embree: no window, no GPU.

Radiance is linear in the transfer, so interpolating the radiance of the three corners equals interpolating their
transfer. Pixels are averaged in linear light over `SAMPLES` x `SAMPLES` rays, exposed, clipped and written as sRGB.

"Front" looks from +z, where the face of a figure is in most files (glTF defines it so). The ground behind the mesh
grows lighter downwards, where bodies lit from above are dark: neither their lit nor their dark side melts into it.
"""

from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, UInt8

from gash_jax.geometry.bilinear import lookup
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.visibility import closest_hit

SAMPLES = 2
FIELD_OF_VIEW = np.radians(28.0)
# linear radiance of the ground at the upper and at the lower edge of a picture, whatever the exposure
GROUND = (0.1, 0.4)
# azimuth from +z towards +x and elevation, degrees
VIEWS = {
    "front": (0.0, 8.0),
    "side": (90.0, 8.0),
    "back": (180.0, 8.0),
    "top": (0.0, 65.0),
    "below": (0.0, -35.0),
}


# the image, 0 beside the mesh, and the covered share of each pixel
Picture: TypeAlias = tuple[np.ndarray, np.ndarray]


class Hit(NamedTuple):
    """What every pixel sample of a view sees: corners of the face and their weights; empty pixels have weight 0."""

    corners: np.ndarray  # (h, w, 3) vertex indices
    weights: np.ndarray  # (h, w, 3) float32
    face: np.ndarray  # (h, w), -1 where nothing


if TYPE_CHECKING:  # the name of a view, or azimuth and elevation in degrees
    Camera: TypeAlias = str | tuple[float, float] | np.ndarray
else:  # what does not fit is refused in words
    Camera = Any


def _camera(view: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Eye position and a matrix with rows right, up, forward."""
    azimuth, elevation = np.radians(VIEWS[view] if isinstance(view, str) else view)
    eye = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
    forward = -eye
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    return eye / np.sin(FIELD_OF_VIEW / 2), np.stack([right, np.cross(right, forward), forward])


def cast_view(mesh: Mesh, view: Camera = "front", size: int = 512, around: Mesh | None = None) -> Hit:
    """Find what each of size x size pixels (times SAMPLES²) sees; the mesh fills the frame, or `around` would.

    Poses that are shown one after the other take one `around`, or the camera would move with them.
    """
    framed = mesh if around is None else around
    held = trace_geometry(framed).vertices
    vertices = held if around is None else _placed(mesh, framed)
    eye, axes = _camera(view)
    seen = (held[np.unique(framed.faces)] - eye) @ axes.T
    plane = seen[:, :2] / seen[:, 2:]
    middle, half = (plane.max(0) + plane.min(0)) / 2, np.ptp(plane, axis=0).max() / 2 * 1.06
    steps = ((np.arange(size * SAMPLES) + 0.5) / (size * SAMPLES) * 2 - 1) * half
    x, y = np.meshgrid(steps + middle[0], middle[1] - steps)
    directions = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3) @ axes
    origins = np.broadcast_to(eye.astype(np.float32), directions.shape)
    hits = closest_hit(vertices, mesh.faces)(
        np.ascontiguousarray(origins), np.ascontiguousarray(directions, np.float32)
    )
    found = hits.face >= 0
    corners = mesh.faces[np.where(found, hits.face, 0)]
    weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], -1) * found[:, None]
    shape = (size * SAMPLES, size * SAMPLES, 3)
    return Hit(corners.reshape(shape), weights.reshape(shape).astype(np.float32), hits.face.reshape(shape[:2]))


def _placed(mesh: Mesh, framed: Mesh) -> Float[np.ndarray, "v 3"]:
    """The vertices of a mesh where they are in the trace space of another; loose ones in its middle."""
    own, other = NormalisedMesh(mesh), NormalisedMesh(framed)
    placed = (mesh.vertices.astype(np.float64) - other.center) / other.half_diagonal
    return np.where(own.referenced[:, None], placed, 0).astype(np.float32)


def toward_camera(mesh: Mesh, view: Camera = "front") -> Float[np.ndarray, "v 3"]:
    """Unit directions from the vertices towards the eye of `cast_view`, which is never on the mesh."""
    apart = _camera(view)[0] - trace_geometry(mesh).vertices
    return (apart / np.linalg.norm(apart, axis=1, keepdims=True)).astype(np.float32)


def shade_view(hit: Hit, values: Float[np.ndarray, "v c"]) -> Picture:
    """Interpolate per-vertex values over the faces, and average the samples of each pixel."""
    return _averaged(hit, np.einsum("hwj,hwjc->hwc", hit.weights, values[hit.corners]))


def look_up_view(hit: Hit, uv: Float[np.ndarray, "f 3 2"], image: Float[np.ndarray, "n n c"]) -> Picture:
    """As `shade_view`, but every sample looks its value up in a texture, bilinearly."""
    seen = hit.face >= 0
    values = np.zeros((*hit.face.shape, image.shape[-1]))
    values[seen] = lookup(image, np.einsum("sj,sji->si", hit.weights[seen], uv[hit.face[seen]]))
    return _averaged(hit, values)


def _averaged(hit: Hit, image: Float[np.ndarray, "h w c"]) -> Picture:
    """The mean of the samples of each pixel."""
    channels = np.concatenate([image, hit.weights.sum(-1, keepdims=True)], -1)
    height, width = channels.shape[:2]
    pixels = channels.reshape(height // SAMPLES, SAMPLES, width // SAMPLES, SAMPLES, -1).mean((1, 3))
    return pixels[..., :-1], pixels[..., -1]


def exposure_for(views: list[tuple[np.ndarray, np.ndarray]]) -> float:
    """One exposure for pictures that are compared: the 98th percentile of the mesh's luminance becomes 0.9."""
    luminance = np.concatenate([image.mean(-1)[coverage > 0.5] for image, coverage in views])
    return float(0.9 / max(np.quantile(luminance, 0.98), 1e-9)) if luminance.size else 1.0


def to_srgb(
    image: Float[np.ndarray, "h w 3"], coverage: Float[np.ndarray, "h w"], exposure: float
) -> UInt8[np.ndarray, "h w 3"]:
    """Exposed linear radiance before the ground, as 8-bit sRGB (IEC 61966-2-1); negative and above 1 is clipped."""
    ground = np.linspace(*GROUND, len(image))[:, None, None]
    linear = np.clip(np.maximum(image, 0) * exposure + ground * (1 - coverage[..., None]), 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-8) ** (1 / 2.4) - 0.055)
    return np.round(encoded * 255).astype(np.uint8)
