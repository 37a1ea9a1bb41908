"""`gash export`: the best parameters of a run, finished or not, as a model file."""

from pathlib import Path

import click
import jax

from gash_jax.apps.options import PATH, Command, output_option, quiet_option
from gash_jax.apps.printing import say
from gash_jax.files.atomic import check_writable
from gash_jax.models.deforming_model import is_deforming, load_deforming_model, save_deforming_model
from gash_jax.models.model import load_model, save_model
from gash_jax.train.run import best_so_far


@click.command(cls=Command, epilog="gash export runs/two-stage -o two-stage.npz")
@click.argument("run", type=PATH)
@output_option
@quiet_option
def export(run: Path, output: Path, quiet: bool) -> None:
    """Write the best weights of RUN, finished or not, as one npz that any runtime can read."""
    check_writable(output, [run / "model.npz", *run.glob("*.json*")])
    if (run / "model.npz").is_file() and is_deforming(run / "model.npz"):
        fitted = load_deforming_model(run)
        save_deforming_model(output, fitted.config, fitted.arrays, fitted.mesh, **fitted.metadata)
        count = sum(array.size for array in load_deforming_model(output).arrays.values())
        say(f"wrote {output}: {count} numbers, format in docs/model_file.md", quiet)
        return
    if (run / "model.npz").is_file():
        model = load_model(run / "model.npz")
        save_model(output, model.config, model.params, **model.metadata)
    else:
        config, params, error = best_so_far(run)
        save_model(output, config.model, params, name=config.name, run=config.to_dict(), validation=error)
    arrays = load_model(output).params
    count = sum(leaf.size for leaf in jax.tree.leaves(arrays))
    say(f"wrote {output}: {count} parameters, format in docs/model_file.md", quiet)
