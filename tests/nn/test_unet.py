"""The U-Net of DeepPRT: what goes in and out, its size, its normalisation, what a block is by hand."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.models.deep_prt import network_shapes
from gash_jax.nn.unet import ResidualBlock, UNet, UNetConfig, _doubled, folded, unfolded
from gash_jax.train.config import load_config

IMAGES = jnp.asarray(np.random.default_rng(1).normal(size=(3, 16, 16, 6)), jnp.float32)
NETWORK = UNet(channels=2, levels=2, blocks=1, outputs=4)


@pytest.fixture(scope="module")
def variables() -> Any:
    return NETWORK.init(jax.random.key(0), IMAGES)


def test_images_keep_their_size_and_outputs_are_shares(variables: Any) -> None:
    found = jax.jit(NETWORK.apply)(variables, IMAGES)
    assert found.shape == (3, 16, 16, 4) and found.min() > 0 and found.max() < 1  # type: ignore[union-attr]
    one = jax.vmap(lambda image: NETWORK.apply(variables, image[None])[0])(IMAGES)  # type: ignore[index]
    np.testing.assert_allclose(one, found, atol=1e-5)  # running means: no image depends on the others
    slope = jax.grad(lambda x: NETWORK.apply(variables, x).sum())(IMAGES)  # type: ignore[union-attr]
    assert np.isfinite(slope).all() and np.abs(slope).max() > 0


def test_a_texel_sees_far_and_one_image_alone() -> None:
    """Two halvings of 16 texels leave 4; a block of the first level alone would reach 2."""
    wide = UNet(channels=16, levels=2, blocks=1, outputs=4)  # with few channels all that comes from afar may be cut off
    variables = wide.init(jax.random.key(0), IMAGES)
    slope = np.abs(np.asarray(jax.grad(lambda x: wide.apply(variables, x)[0, 0, 0].sum())(IMAGES)))  # type: ignore[index]
    assert slope[0, 10:].max() > 0 and slope[1:].max() == 0


def test_training_normalises_by_the_batch_and_moves_the_running_means(variables: Any) -> None:
    found, changed = NETWORK.apply(variables, IMAGES, training=True, mutable=["batch_stats"])
    before, after = (jax.tree.leaves(part["batch_stats"]) for part in (variables, changed))
    assert all(np.any(a != b) for a, b in zip(before, after, strict=True))
    assert np.abs(found - NETWORK.apply(variables, IMAGES)).max() > 1e-3  # type: ignore[operator]


def test_a_block_by_hand() -> None:
    """Kernels that pass their middle texel on: F(x) = 2 relu(3 x) and x + F(x), before the last ReLU."""
    block, x = ResidualBlock(1), jnp.array([[[1.0, -2.0], [0.5, 4.0]]])[..., None]
    variables = block.init(jax.random.key(0), x, False)
    middle = jnp.zeros((3, 3, 1, 1)).at[1, 1].set(1.0)
    variables["params"]["first"]["kernel"], variables["params"]["second"]["kernel"] = 3 * middle, 2 * middle
    epsilon = 1e-5  # of batch normalisation, whose running variance starts at 1
    expected = np.maximum(x + 2 * np.maximum(3 * x, 0) / (1 + epsilon), 0)
    found: Any = block.apply(variables, x, False)
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert "shortcut" not in variables["params"]
    halved = ResidualBlock(2, stride=2)
    wide = halved.init(jax.random.key(0), x, False)
    smaller: Any = halved.apply(wide, x, False)
    assert "shortcut" in wide["params"] and smaller.shape == (1, 1, 1, 2)


def test_texels_are_repeated() -> None:
    x = jnp.arange(8.0).reshape(1, 2, 2, 2)
    np.testing.assert_array_equal(_doubled(x), np.repeat(np.repeat(x, 2, axis=1), 2, axis=2))


def test_the_configs_have_the_sizes_that_they_say() -> None:
    for name, millions, size in (("deep-prt", 11.7, 256), ("deep-prt-small", 0.514, 128)):
        config = load_config(name).model
        shapes = network_shapes(config, config.bands**2)  # type: ignore[arg-type]
        found = sum(int(np.prod(shape)) for key, shape in shapes.items() if "/params/" in key)
        assert found == pytest.approx(1e6 * millions, rel=0.01) and config.size == size  # type: ignore[attr-defined]


def test_images_that_cannot_be_halved_are_refused() -> None:
    with pytest.raises(ValueError, match="cannot be halved 4 times"):
        UNetConfig("deep-prt", size=40)
    with pytest.raises(ValueError, match="of 16 texels in blocks of 2 cannot be halved 4 times: use a multiple of 32"):
        UNetConfig("deep-prt", size=16, fold=2)


def test_blocks_are_folded_into_channels_and_back() -> None:
    x = jnp.arange(2.0 * 4 * 4 * 3).reshape(2, 4, 4, 3)
    found = folded(x, 2)
    assert found.shape == (2, 2, 2, 12)
    np.testing.assert_array_equal(found[1, 0, 1].reshape(2, 2, 3), x[1, :2, 2:])  # a block, row by row
    np.testing.assert_array_equal(unfolded(found, 2), x)
    np.testing.assert_array_equal(folded(x, 1), x)


def test_a_folded_network_gives_images_of_the_whole_size() -> None:
    network = UNet(channels=4, levels=1, blocks=1, outputs=3, fold=2)
    variables = network.init(jax.random.key(0), IMAGES)
    found: Any = jax.jit(network.apply)(variables, IMAGES)
    assert found.shape == (3, 16, 16, 3) and found.min() > 0 and found.max() < 1
    assert np.abs(np.diff(found, axis=1)).max() > 1e-3  # texels of a block differ
    slope = jax.grad(lambda x: network.apply(variables, x).sum())(IMAGES)  # type: ignore[union-attr]
    assert np.isfinite(slope).all() and np.abs(slope).max() > 0
