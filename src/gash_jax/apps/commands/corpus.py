"""`gash corpus`: the shapes and labels that a config trains on, and a sheet with all of them to look at."""

from collections import Counter
from pathlib import Path

import click
import numpy as np

from gash_jax.apps.options import PATH, Command, overrides_argument, quiet_option
from gash_jax.apps.pictures.contact_sheet import contact_sheet
from gash_jax.apps.pictures.montage import check_picture, write_picture
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.shard_options import Work, by_jobs, shard_options
from gash_jax.files.atomic import check_writable
from gash_jax.models.families import labels_of
from gash_jax.train.config import load_config
from gash_jax.train.corpus import build_corpus, check_corpus, split_indices


@click.command(cls=Command, epilog="gash corpus base -o corpus.png")
@click.argument("config", type=PATH)
@overrides_argument
@click.option("-o", "--output", type=PATH, help="Contact sheet to draw (.png, .jpg).")
@shard_options
@quiet_option
def corpus(config: Path, overrides: tuple[str, ...], output: Path | None, quiet: bool, work: Work) -> None:
    """Make and bake the shapes that CONFIG trains on, in parallel; run it again to continue after an interruption.

    Shapes are kept in the cache folder, $GASH_CACHE, which machines that share the work must share.
    """
    if output:
        check_writable(output, [config])
        check_picture(output)
    run = load_config(config, overrides)
    split = split_indices(run.data)
    indices, (bands, bounces) = np.concatenate([split.validation, split.training, split.broken]), labels_of(run.model)
    left = by_jobs(work, quiet)
    if left is None:
        return
    if left.merge:
        check_corpus(run.data, bands, indices, left.merge, bounces=bounces)
    own = indices if left.shard is None else np.array(left.shard.of(indices.tolist()), int)
    with progress_bar("corpus", quiet) as update:
        items = build_corpus(run.data, bands, own, update, bounces=bounces)
    if left.shard is not None:
        say(f"shard {left.shard}: {len(own)} of {len(indices)} shapes are in the cache", quiet)
        return
    counts = [len(item.mesh.vertices) for item in items]
    broken = f", {len(split.broken)} broken" if len(split.broken) else ""
    shapes = f"{len(split.training)} shapes to train on, {len(split.validation)} to validate{broken}"
    say(f"{shapes}: {sum(counts)} vertices", quiet)
    say(f"  {min(counts)} to {max(counts)} vertices each, median {int(np.median(counts))}", quiet)
    kinds = Counter(item.kind for item in items)
    say("  " + ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())), quiet)
    if output:
        with progress_bar("contact sheet", quiet) as update:
            write_picture(output, contact_sheet(items, update))
        say(f"wrote {output}", quiet)
