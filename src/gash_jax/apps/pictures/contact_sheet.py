"""Every shape of a corpus on one sheet, relit with its own labels, to look at."""

from collections.abc import Sequence

import numpy as np
from PIL import Image

from gash_jax.apps.pictures.montage import montage
from gash_jax.apps.pictures.views import cast_view, shade_view, to_srgb
from gash_jax.apps.progress import UpdateFn
from gash_jax.light.environment import project_map
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.train.corpus import Item

COLUMNS, SIZE, EXPOSURE = 18, 120, 0.7


def contact_sheet(items: Sequence[Item], update: UpdateFn) -> Image.Image:
    """The shapes from the top left corner on, each with its kind and its number of vertices."""
    light, panels = project_map(studio_light(), round(items[0].coefficients.shape[1] ** 0.5)), []
    for step, item in enumerate(items):
        radiance = np.asarray(shade(item.coefficients, light))
        image, covered = shade_view(cast_view(item.mesh, "front", SIZE), radiance)
        panels.append((f"{item.kind}\n{len(item.mesh.vertices)}", to_srgb(image, covered, EXPOSURE)))
        update(step + 1, len(items))
    return montage(panels, columns=min(COLUMNS, len(items)))
