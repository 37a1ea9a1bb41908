"""`gash export`: the weights of a run, finished or not, or of a model file, for other runtimes."""

from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import click
import numpy as np
from flax.traverse_util import flatten_dict

from gash_jax.apps.options import PATH, Command, output_option, quiet_option
from gash_jax.apps.printing import number, say
from gash_jax.files.atomic import FileError, check_writable
from gash_jax.measure.half_weights import rounded, rounding_error
from gash_jax.models.deforming_model import as_stored, is_deforming, load_deforming_model, save_deforming_model
from gash_jax.models.families import with_bands
from gash_jax.models.model import Model, load_model, model_file, save_model, shipped_models
from gash_jax.nn.config import ModelConfig
from gash_jax.train.run import best_so_far

SUFFIXES = (".npz", ".onnx")


class Weights(NamedTuple):
    """What an ONNX file is made of: arrays that are float16 stay so."""

    config: ModelConfig
    arrays: dict[str, np.ndarray]
    metadata: dict[str, Any]


@click.command(cls=Command, epilog="gash export runs/two-stage -o two-stage.onnx")
@click.argument("run", type=PATH)
@output_option
@click.option("--bands", type=int, help="SH bands that the file says, of those that the network knows: local 1 to 6.")
@click.option("--half", is_flag=True, help="Weights in float16: half the bytes. What that costs is measured and said.")
@quiet_option
def export(run: Path, output: Path, bands: int | None, half: bool, quiet: bool) -> None:
    """Write the best weights of RUN, finished or not, for other runtimes: as .npz, or as .onnx with the network.

    RUN may also be a weights file, or the name of weights that ship.
    """
    check_writable(output, [run, run / "model.npz", *run.glob("*.json*")])
    if output.suffix.lower() not in SUFFIXES:
        raise click.UsageError(f"cannot write {output}: give a name that ends in {' or '.join(SUFFIXES)}")
    graphs = _graph_writer() if output.suffix.lower() == ".onnx" else None
    file = _model_file(run)
    if file and is_deforming(file):
        if bands is not None:
            raise click.UsageError("a model of one object says the bands that it was fitted to: leave out --bands")
        weights, count = _deforming(file, output, half, written=graphs is None)
    else:
        weights, count = _network(file, run, output, bands, half, written=graphs is None)
    if graphs:
        model = graphs.onnx_model(*weights)
        graphs.save_onnx(output, model)
        used = ", ".join(graphs.operators(model))
        say(f"wrote {output}: {count} numbers, ONNX opset {graphs.OPSET}; operators: {used}", quiet)
    else:
        say(f"wrote {output}: {count} numbers, format in docs/model_file.md", quiet)
    if half:
        error = weights.metadata["half_weights"]
        median, worst = (number(error[f"relrmse_{name}"]) for name in ("median", "worst"))
        say(f"weights in float16: relrmse {median} at the median of {error['meshes']} meshes, {worst} at worst", quiet)


def _graph_writer() -> ModuleType:
    """The writer of ONNX files, which is an extra."""
    try:
        from gash_jax.apps.exports import onnx_file
    except ModuleNotFoundError as error:
        raise click.ClickException(f"{error.name} is not installed: pip install 'gash-jax[onnx]'") from None
    return onnx_file


def _model_file(run: Path) -> Path | None:
    """The file of the weights; None where a run has not finished."""
    known = str(run) in shipped_models() or run.is_file() or (run / "model.npz").is_file()
    return model_file(run) if known else None


def _deforming(file: Path, output: Path, half: bool, written: bool) -> tuple[Weights, int]:
    """A model of one object that deforms; as .npz where it is to be `written`."""
    if half:
        raise FileError(
            "a model of one object is not rounded, its large arrays are float16 where they may be: leave out --half"
        )
    fitted = load_deforming_model(file)
    if written:
        save_deforming_model(output, fitted.config, fitted.arrays, fitted.mesh, **fitted.metadata)
    arrays = as_stored(fitted.arrays)
    return Weights(fitted.config, arrays, fitted.metadata), sum(array.size for array in arrays.values())


def _network(
    file: Path | None, run: Path, output: Path, bands: int | None, half: bool, written: bool
) -> tuple[Weights, int]:
    """A network; as .npz where it is to be `written`."""
    if file:
        model = load_model(file, bands)
    else:
        config, params, error = best_so_far(run)
        asked = config.model if bands is None else with_bands(config.model, bands)
        model = Model(asked, params, {"name": config.name, "run": config.to_dict(), "validation": error})
    metadata = model.metadata
    if half:
        exact, model = model, rounded(model)
        metadata = {**metadata, "half_weights": rounding_error(exact, model)}
    if written:
        save_model(output, model.config, model.params, half, **metadata)
    arrays = {
        name: np.asarray(leaf, np.float16 if half else np.float32)
        for name, leaf in flatten_dict(model.params, sep="/").items()
    }
    return Weights(model.config, arrays, metadata), sum(array.size for array in arrays.values())
