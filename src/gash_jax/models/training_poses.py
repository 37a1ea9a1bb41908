"""What a model of a deforming object is fitted to: an animation, and the coefficients of all its frames, or
the radiance that arrives under a light, of each coefficient red, green and blue.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.geometry.animation import Animation


class TrainingPoses(NamedTuple):
    """Frames and what is said of them, c numbers a vertex, in files of some frames each."""

    animation: Animation
    shards: list[Float[np.ndarray, "t v c"]]  # float16; may be memory maps
