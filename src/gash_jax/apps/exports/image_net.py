"""`deep-prt` as an ONNX graph: a pose as an image, the U-Net of `nn.unet`, the coefficients of the vertices out of it.

Images stand channel before row and column, (1, c, n, n), as ONNX convolves them; kernels are stored in that order,
(out, in, row, column), under names of their own. Flax pads what a stride of 2 halves at the far sides only.
"""

from typing import Any

import numpy as np

from gash_jax.apps.exports.deforming import indices, pose_position
from gash_jax.apps.exports.graph import Graph, Value
from gash_jax.models.deep_prt import MEAN, MEAN_POSE, NET, SPREAD

PARAMETERS, MEANS = f"{NET}params/", f"{NET}batch_stats/"
FLAX_EPSILON = 1e-5  # of batch normalisation


def write_deep_prt(g: Graph, config: Any) -> Value:
    """Coefficients of a pose, (v, k), or radiance."""
    count, size, outputs = len(g.weights["image/texels"]), config.size, len(g.weights["low"])
    placed = (pose_position(g, count) - g.weight("input/middle")) / g.weight("input/size")
    normals = g.input("normal", (count, 3), "unit normal of each vertex in the pose, 0 where it has none")
    seen = g.concat([placed, normals], 1)
    if config.changes:
        seen = g.concat([seen, (seen - g.weight(MEAN_POSE)) / g.weight(SPREAD)], 1)
    x = _to_image(g, seen).transpose(2, 0, 1).unsqueeze(0)
    shares = _unet(g, config, x).reshape(outputs, size * size).transpose(1, 0)
    found = g.weight("low") + (g.weights["high"] - g.weights["low"]) * shares
    around = found.take(indices(g, "image/texels"))  # (v, 4, k)
    found = (g.weight("image/bilinear").unsqueeze(2) * around).sum(1)
    return found + g.weight(MEAN) if config.changes else found


def _to_image(g: Graph, values: Value) -> Value:
    """What the vertices hold, (v, c), as an image (n, n, c)."""
    if len(g.weights["image/members"]):
        means = (g.weight("image/shares").unsqueeze(2) * values.take(indices(g, "image/members"))).sum(1)
        values = g.concat([values, means], 0)
    return (g.weight("image/barycentric").unsqueeze(3) * values.take(indices(g, "image/corners"))).sum(2)


def _unet(g: Graph, config: Any, x: Value) -> Value:
    """Images (1, k, n, n) of the shares between 0 and 1."""
    kept = []
    if config.fold > 1:
        x = g.add("SpaceToDepth", x, blocksize=config.fold)
    for level in range(config.levels + 1):
        for block in range(config.blocks):
            x = _residual(g, f"down_{level}_{block}/", x, 2 if level and not block else 1)
        kept.append(x)
    for level in reversed(range(config.levels)):
        x = g.concat([kept[level], _doubled(x)], 1)
        for block in range(config.blocks):
            x = _residual(g, f"up_{level}_{block}/", x, 1)
    x = _convolved(g, "head", x, 1)
    if config.fold > 1:
        x = g.add("DepthToSpace", x, blocksize=config.fold)  # its first mode, DCR: block before channel
    return x.apply("Sigmoid")


def _residual(g: Graph, name: str, x: Value, stride: int) -> Value:
    """x + F(x), both through convolutions where width or stride change."""
    y = _normalised(g, f"{name}first_norm", _convolved(g, f"{name}first", x, stride)).apply("Relu")
    y = _normalised(g, f"{name}second_norm", _convolved(g, f"{name}second", y, 1))
    if f"{PARAMETERS}{name}shortcut/kernel" in g.weights:
        x = _convolved(g, f"{name}shortcut", x, stride)
    return (x + y).apply("Relu")


def _convolved(g: Graph, name: str, x: Value, stride: int) -> Value:
    """A convolution of 3 x 3 or 1 x 1 that keeps the size of images, or halves it."""
    kernel = g.weights[f"{PARAMETERS}{name}/kernel"]
    far = len(kernel) // 2
    near = 0 if stride == 2 else far
    operands: list[Any] = [x, kernel.transpose(3, 2, 0, 1)]
    if f"{PARAMETERS}{name}/bias" in g.weights:
        operands.append(g.weight(f"{PARAMETERS}{name}/bias"))
    pads, shape = [near, near, far, far], list(kernel.shape[:2])
    return g.add("Conv", *operands, kernel_shape=shape, strides=[stride, stride], pads=pads)


def _normalised(g: Graph, name: str, x: Value) -> Value:
    """By the running means of training."""
    own = [g.weight(f"{PARAMETERS}{name}/{part}") for part in ("scale", "bias")]
    seen = [g.weight(f"{MEANS}{name}/{part}") for part in ("mean", "var")]
    return g.add("BatchNormalization", x, *own, *seen, epsilon=FLAX_EPSILON)


def _doubled(x: Value) -> Value:
    """Every texel four times."""
    told = {"mode": "nearest", "coordinate_transformation_mode": "asymmetric", "nearest_mode": "floor"}
    no_region, scales = np.zeros(0, np.float32), np.array([1, 1, 2, 2], np.float32)
    return x.graph.add("Resize", x, no_region, scales, **told)
