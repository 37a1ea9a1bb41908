"""What a model of a deforming object is fitted to: an animation, and the coefficients of all its frames."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.geometry.animation import Animation


class TrainingPoses(NamedTuple):
    """Frames and their transfer, in files of some frames each."""

    animation: Animation
    shards: list[Float[np.ndarray, "t v k"]]  # float16; may be memory maps
