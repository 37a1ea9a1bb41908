"""What a light is: radiance of an environment as SH coefficients L_k (k, 3), linear RGB, never windowed.

`environment` projects maps to it, `sources` and `sky` make it from code.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from jax import Array
from jaxtyping import Float

from gash_jax.algebra.arguments import ArrayLike
from gash_jax.algebra.sh import bands_of, radiance_coefficients
from gash_jax.files.containers import Container

FORMAT, FORMAT_VERSION = "gash-light", 1
CONVENTIONS = (
    "real orthonormal SH, polar axis z, k = l*l + l + m, no Condon-Shortley sign; world +y up; "
    "linear RGB radiance, not windowed"
)


@dataclass(frozen=True, eq=False)
class Light(Container):
    """Radiance of an environment as SH coefficients (k, 3), and where it comes from; a pytree (`files.containers`).

    >>> light = gash_jax.load_light("studio.hdr")
    >>> light.coefficients.shape, light.bands, light.metadata["layout"]
    ((9, 3), 3, 'latlong')
    """

    coefficients: Any  # Float "k 3", checked in words
    metadata: Mapping[str, Any] = field(default_factory=dict)
    bands: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", light_coefficients(self.coefficients))
        self._set(bands_of(len(self.coefficients)))


if TYPE_CHECKING:  # wherever a light goes in: the container, or its coefficients (k, 3) as an array of NumPy or JAX
    LightLike: TypeAlias = Light | ArrayLike | Array
else:  # what does not fit is refused in words
    LightLike = Any


def light_coefficients(light: LightLike) -> Float[Array | np.ndarray, "k 3"]:
    """Coefficients of a light, as the array they are. Raises ValueError unless they are (bands^2, 3) real numbers."""
    if isinstance(light, Light):
        return light.coefficients
    return radiance_coefficients(light)


def light_metadata(bands: int, **entries: Any) -> dict[str, Any]:
    """The metadata every light file carries, plus where the light comes from."""
    return {"format": FORMAT, "version": FORMAT_VERSION, "bands": bands, "conventions": CONVENTIONS, **entries}
