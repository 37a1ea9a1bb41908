"""`gash corpus`: build the shapes and labels of a config, and draw them all on one sheet to look at."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gash_jax.apps.pictures.montage import montage, write_png
from gash_jax.apps.pictures.views import cast_view, shade_view, to_srgb
from gash_jax.apps.progress import UpdateFn, progress_bar, say
from gash_jax.light.environment import project_light
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.train.config import load_config
from gash_jax.train.corpus import Item, build_corpus, split_indices

COLUMNS, SIZE, EXPOSURE = 18, 120, 0.7


def corpus(config_path: Path, overrides: tuple[str, ...], output: Path | None, quiet: bool) -> None:
    """`gash corpus`."""
    config = load_config(config_path, overrides)
    training, validation = split_indices(config.data)
    with progress_bar("corpus", quiet) as update:
        items = build_corpus(config.data, config.model.bands, np.concatenate([validation, training]), update)
    counts = [len(item.mesh.vertices) for item in items]
    say(f"{len(training)} shapes to train on, {len(validation)} to validate: {sum(counts)} vertices", quiet)
    say(f"  {min(counts)} to {max(counts)} vertices each, median {int(np.median(counts))}", quiet)
    kinds = Counter(item.kind for item in items)
    say("  " + ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())), quiet)
    if output:
        with progress_bar("contact sheet", quiet) as update:
            write_png(output, contact_sheet(items, update))
        say(f"wrote {output}", quiet)


def contact_sheet(items: Sequence[Item], update: UpdateFn):
    """Every shape relit with its own labels, with its kind and size; the first in the top left corner."""
    light, panels = project_light(studio_light(), round(items[0].coefficients.shape[1] ** 0.5)), []
    for step, item in enumerate(items):
        radiance = np.asarray(shade(item.coefficients, light))
        image, covered = shade_view(cast_view(item.mesh, "front", SIZE), radiance)
        panels.append((f"{item.kind}\n{len(item.mesh.vertices)}", to_srgb(image, covered, EXPOSURE)))
        update(step + 1, len(items))
    return montage(panels, columns=min(COLUMNS, len(items)))
