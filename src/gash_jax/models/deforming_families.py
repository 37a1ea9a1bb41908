"""Networks and fits for one object that deforms: a table beside `families`, whose networks read any mesh.

A model of this table belongs to one mesh and one motion. It reads the positions and normals of a pose of that mesh and
gives the coefficients of all its vertices, or, of a glossy surface, the radiance that arrives there under one light, c
numbers a vertex. A new kind is a config, `fit` (training poses -> arrays) and `predict` (config, arrays, pose -> the
numbers, a JAX function), and one entry here. What has no `fit` is trained step by step (`train.image_training`).

    momo-prt   pose -> coefficients by least squares (Schneider et al. 2017)
    deform     regression of each patch of the surface on how what is around it is placed, in the frames of the vertices
    deep-prt   a U-Net over geometry images of the pose (DeepPRT)
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from jaxtyping import Array, Float

from gash_jax.models.deep_prt import deep_prt_shapes, predict_deep_prt
from gash_jax.models.deform import DEFORM_SHAPES, DeformConfig, fit_deform, predict_deform
from gash_jax.models.momo_prt import MomoConfig, fit_momo, momo_shapes, predict_momo
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.nn.config import ModelConfig
from gash_jax.nn.unet import UNetConfig

Arrays = dict[str, Any]  # by name
Shapes = dict[str, tuple[int | str, ...]]


class DeformingFamily(NamedTuple):
    """A kind of model of one object that deforms."""

    config: type[ModelConfig]
    fit: Callable[[Any, TrainingPoses], Arrays] | None
    shapes: Callable[[Any, int], Shapes]  # of its arrays by config and c, beside those of `pose_reader`
    predict: Callable[[Any, Arrays, Float[Array, "v 3"], Float[Array, "v 3"]], Float[Array, "v c"]]
    glossy: bool = True  # whether it may say radiance


DEFORMING: dict[str, DeformingFamily] = {
    "momo-prt": DeformingFamily(
        MomoConfig, fit_momo, lambda config, c: momo_shapes(c), lambda config, *pose: predict_momo(*pose)
    ),
    "deform": DeformingFamily(
        DeformConfig,
        fit_deform,
        lambda config, c: DEFORM_SHAPES,
        lambda config, *pose: predict_deform(*pose),
        glossy=False,  # it turns with the skin, and the light does not
    ),
    "deep-prt": DeformingFamily(UNetConfig, None, deep_prt_shapes, predict_deep_prt),
}
