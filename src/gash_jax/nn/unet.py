"""The U-Net of DeepPRT over geometry images (Li et al., "DeepPRT", 3.2.1): images of a pose in, images of transfer out.

Residual blocks of two 3 x 3 convolutions with batch normalisation and ReLU; down by a convolution of stride 2 in place
of pooling, up by repeating texels; skips from every level of the encoder; a sigmoid at the end. The paper gives no
widths: here each level has twice the channels of the one above it, and `deep-prt` comes to its 11.8 million parameters.

With `fold` the first level stands for blocks of fold x fold texels, whose channels it takes together, and the last one
gives such blocks back: images that are finer than what a CPU can convolve.
"""

from dataclasses import dataclass

import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.files.settings import setting
from gash_jax.nn.config import ModelConfig

MOMENTUM = 0.95  # of the running means of batch normalisation: a run has some thousand steps


@dataclass(frozen=True)
class UNetConfig(ModelConfig):
    """The U-Net. Raises ValueError where images cannot be halved that often."""

    size: int = setting(64, "texels along a side of the geometry images", least=8, most=1024)
    channels: int = setting(12, "channels of the first level; each level below has twice as many", least=1)
    levels: int = setting(4, "how often images are halved", least=1, most=8)
    blocks: int = setting(1, "residual blocks of each level, down and up", least=1)
    fold: int = setting(1, "texels along a side of the blocks that the first level takes as one", least=1, most=16)
    changes: bool = setting(False, "images hold differences to the mean of training, and beside the pose its own")

    def __post_init__(self) -> None:
        super().__post_init__()
        least = self.fold * 2**self.levels
        if self.size % least:
            folded = "" if self.fold == 1 else f" in blocks of {self.fold}"
            raise ValueError(
                f"images of {self.size} texels{folded} cannot be halved {self.levels} times: use a multiple of {least}"
            )


class ResidualBlock(nn.Module):
    """x + F(x) with F of two convolutions; where width or stride change, x goes through one of 1 x 1."""

    channels: int
    stride: int = 1

    @nn.compact
    def __call__(self, x: Float[Array, "b n n c"], training: bool) -> Float[Array, "b m m d"]:
        """The block's output; `training` normalises by the batch and moves the running means."""
        steps = (self.stride, self.stride)

        def normalised(y: Array, name: str) -> Array:
            return nn.BatchNorm(use_running_average=not training, momentum=MOMENTUM, name=name)(y)

        y = nn.Conv(self.channels, (3, 3), steps, use_bias=False, name="first")(x)
        y = nn.relu(normalised(y, "first_norm"))
        y = normalised(nn.Conv(self.channels, (3, 3), use_bias=False, name="second")(y), "second_norm")
        if x.shape != y.shape:
            x = nn.Conv(self.channels, (1, 1), steps, name="shortcut")(x)
        return nn.relu(x + y)


class UNet(nn.Module):
    """`levels` halvings below the full size, `outputs` channels between 0 and 1."""

    channels: int
    levels: int
    blocks: int
    outputs: int
    fold: int = 1

    @nn.compact
    def __call__(self, x: Float[Array, "b n n c"], training: bool = False) -> Float[Array, "b n n {self.outputs}"]:
        """Images of the same size."""
        x, kept = folded(x, self.fold), []
        for level in range(self.levels + 1):
            width = self.channels * 2**level
            for block in range(self.blocks):
                stride = 2 if level and not block else 1
                x = ResidualBlock(width, stride, name=f"down_{level}_{block}")(x, training)
            kept.append(x)
        for level in reversed(range(self.levels)):
            x = jnp.concatenate([kept[level], _doubled(x)], axis=-1)
            for block in range(self.blocks):
                x = ResidualBlock(self.channels * 2**level, name=f"up_{level}_{block}")(x, training)
        head = nn.Conv(self.outputs * self.fold**2, (1, 1), name="head")
        return nn.sigmoid(unfolded(head(x), self.fold))


def folded(x: Float[Array, "b n n c"], fold: int) -> Float[Array, "b m m d"]:
    """Blocks of fold x fold texels as one texel with all their channels, row by row."""
    b, n, m, c = x.shape
    x = x.reshape(b, n // fold, fold, m // fold, fold, c)
    return x.transpose(0, 1, 3, 2, 4, 5).reshape(b, n // fold, m // fold, fold * fold * c)


def unfolded(x: Float[Array, "b m m d"], fold: int) -> Float[Array, "b n n c"]:
    """The inverse of `folded`."""
    b, n, m, d = x.shape
    x = x.reshape(b, n, m, fold, fold, d // fold**2)
    return x.transpose(0, 1, 3, 2, 4, 5).reshape(b, n * fold, m * fold, d // fold**2)


def _doubled(x: Float[Array, "b n n c"]) -> Float[Array, "b m m c"]:
    """Every texel four times."""
    b, n, m, c = x.shape
    return jnp.broadcast_to(x[:, :, None, :, None], (b, n, 2, m, 2, c)).reshape(b, 2 * n, 2 * m, c)


def build_unet(config: UNetConfig, outputs: int) -> UNet:
    """The network of a config, with so many channels: coefficients, or of each red, green and blue under a light."""
    return UNet(config.channels, config.levels, config.blocks, outputs, config.fold)
