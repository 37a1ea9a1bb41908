"""DeepPRT as a model of one object that deforms (Li et al., "DeepPRT"): its mesh as geometry images, and their U-Net.

Positions and normals of a pose become an image of six channels by the map of the rest, the network makes images of the
coefficients of them, each within the range that it had in training, widened a little, and every vertex takes its own
from the four texels around it. Of a glossy surface they are images of the radiance that arrives under one light, T_G of
the paper. The network is trained by `train.image_training`.

With `model.changes` the images hold what changes: the network reads beside a pose its difference to the mean one of the
training, and says differences to the mean coefficients, which every vertex keeps as its own numbers. The paper's does
neither; but an image has fewer texels than a mesh has vertices, and most of what it would have to hold never changes.
"""

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax.traverse_util import flatten_dict, unflatten_dict
from jaxtyping import Array, Float

from gash_jax.geometry.geometry_image import GeometryImage
from gash_jax.geometry.mesh import Mesh
from gash_jax.nn.unet import UNetConfig, build_unet

INPUTS = 6  # positions and normals
NET, MEAN = "net/", "mean"
MEAN_POSE, SPREAD = "input/mean", "input/spread"
_IMAGE = ("corners", "barycentric", "members", "shares", "texels", "bilinear")


def image_arrays(image: GeometryImage, rest: Mesh) -> dict[str, np.ndarray]:
    """What a model keeps of its geometry image, and the middle and the size of its rest."""
    low, high = rest.vertices.min(axis=0), rest.vertices.max(axis=0)
    kept = {f"image/{name}": np.asarray(getattr(image, name), np.float32) for name in _IMAGE}
    size = np.array([np.linalg.norm(high - low) / 2], np.float32)
    return {**kept, "input/middle": ((low + high) / 2).astype(np.float32), "input/size": size}


def image_of(arrays: Mapping[str, Any]) -> GeometryImage:
    """The geometry image among the arrays of a model."""
    whole = {name: arrays[f"image/{name}"] for name in _IMAGE}
    numbers = {name: whole[name].astype("int32") for name in ("corners", "members", "texels")}
    return GeometryImage(face=numbers["corners"][..., 0], **{**whole, **numbers})


def change_arrays(
    arrays: Mapping[str, Any], poses: Iterable[Mesh], coefficients: Iterable[np.ndarray]
) -> dict[str, np.ndarray]:
    """The means of all poses and of all their coefficients, and how far positions and normals are from theirs (RMS)."""
    count, sums, squares, frames = 0, 0.0, 0.0, 0.0
    for mesh, frame in zip(poses, coefficients, strict=True):
        seen = pose_numbers(arrays, mesh.vertices, mesh.normals).astype(np.float64)
        count, sums, squares, frames = count + 1, sums + seen, squares + seen**2, frames + np.asarray(frame, np.float64)
    middle = np.asarray(sums / count)
    variance = np.maximum(squares / count - middle**2, 0).mean(axis=0).reshape(2, 3).mean(axis=1)
    spread = np.repeat(np.maximum(np.sqrt(variance), 1e-6), 3)
    found = {MEAN: frames / count, MEAN_POSE: middle, SPREAD: spread}
    return {name: np.asarray(array, np.float32) for name, array in found.items()}


def pose_numbers(arrays: Mapping[str, Any], positions: Any, normals: Any) -> Any:
    """Positions, relative to the rest, and normals of a pose, (v, 6); arrays of NumPy or JAX."""
    placed = (positions - arrays["input/middle"][None]) / arrays["input/size"][None]
    return positions.__array_namespace__().concatenate([placed, normals], axis=1)


def pose_image(arrays: Mapping[str, Any], positions: Any, normals: Any) -> Any:
    """What the network reads of a pose, an image (n, n, 6), or (n, n, 12) with `model.changes`; NumPy or JAX."""
    seen = pose_numbers(arrays, positions, normals)
    if MEAN_POSE in arrays:
        apart = (seen - arrays[MEAN_POSE]) / arrays[SPREAD][None]
        seen = positions.__array_namespace__().concatenate([seen, apart], axis=1)
    return image_of(arrays).to_image(seen)


def network_arrays(variables: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Parameters and running means as flat names."""
    return {NET + name: np.asarray(leaf) for name, leaf in flatten_dict(dict(variables), sep="/").items()}


def network_variables(arrays: Mapping[str, Any]) -> Any:
    """Parameters and running means as the network takes them."""
    return unflatten_dict({k.removeprefix(NET): v for k, v in arrays.items() if k.startswith(NET)}, sep="/")


def inputs_of(config: UNetConfig) -> int:
    """Channels of the images that the network reads."""
    return INPUTS * (2 if config.changes else 1)


@cache
def network_shapes(config: UNetConfig, outputs: int) -> dict[str, tuple[int, ...]]:
    """Shapes of all arrays of the network, by name; nothing is computed."""
    image = jax.ShapeDtypeStruct((1, config.size, config.size, inputs_of(config)), jnp.float32)
    found = jax.eval_shape(build_unet(config, outputs).init, jax.eval_shape(lambda: jax.random.key(0)), image)
    leaves: dict[str, Any] = flatten_dict(found, sep="/")  # type: ignore[assignment]
    return {NET + name: leaf.shape for name, leaf in leaves.items()}


def deep_prt_shapes(config: UNetConfig, outputs: int) -> dict[str, tuple[int | str, ...]]:
    """Shapes of all arrays of a model file but those of the rest, the pose and the light."""
    n, ends = config.size, {"low": (outputs,), "high": (outputs,)}
    corners: dict[str, tuple[int | str, ...]] = {"image/corners": (n, n, 3), "image/barycentric": (n, n, 3)}
    corners |= {"image/members": ("e", "w"), "image/shares": ("e", "w")}
    corners |= {"image/texels": ("v", 4), "image/bilinear": ("v", 4)}
    placed: dict[str, tuple[int | str, ...]] = {"input/middle": (3,), "input/size": (1,)}
    if config.changes:
        placed |= {MEAN: ("v", outputs), MEAN_POSE: ("v", INPUTS), SPREAD: (INPUTS,)}
    return {**corners, **placed, **ends, **network_shapes(config, outputs)}


def predict_deep_prt(
    config: UNetConfig, arrays: Mapping[str, Any], positions: Float[Array, "v 3"], normals: Float[Array, "v 3"]
) -> Float[Array, "v c"]:
    """What the network says of a pose, all of its channels."""
    seen = pose_image(arrays, positions, normals)
    shares = build_unet(config, len(arrays["low"])).apply(network_variables(arrays), seen[None])[0]  # type: ignore[index]
    low, high = (arrays[name][None, None] for name in ("low", "high"))
    found = image_of(arrays).from_image(low + (high - low) * shares)
    return found + arrays[MEAN] if config.changes else found
