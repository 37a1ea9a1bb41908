"""A trained network as one value: config and weights in, graph of a mesh, coefficients out.

Model files are npz: float32 or float16 arrays named by their path in the parameter tree, such as
"coefficient/conv_0/source/kernel", plus JSON metadata with the full config, so that a runtime without JAX can rebuild
the network.
"""

import time
from collections.abc import Callable
from functools import cache, partial
from importlib import resources
from pathlib import Path
from typing import Any

import jax
import numpy as np
from flax.traverse_util import flatten_dict, unflatten_dict
from jax.core import Tracer
from jaxtyping import Float

from gash_jax.algebra.arguments import ArrayLike, WholeNumber, whole_number
from gash_jax.files.atomic import FileError, as_path
from gash_jax.files.npz import check_arrays, read_npz, write_npz
from gash_jax.files.settings import ConfigError
from gash_jax.formats.meshes import MeshLike, as_mesh, is_mesh_like
from gash_jax.models.families import (
    build_model,
    config_from_file,
    family_of,
    labels_of,
    model_graph,
    with_bands,
)
from gash_jax.models.parameter_shapes import graph_structure, parameter_shapes
from gash_jax.nn.config import ModelConfig
from gash_jax.prt.bounce_series import summed
from gash_jax.prt.bounces import checked_albedo, describe_albedo
from gash_jax.prt.transfer import Transfer, make_metadata

FORMAT, FORMAT_VERSION = "gash-model", 1
DEFORMING_FORMAT = "gash-deforming-model"
# arrays by the names that the first files gave them
RENAMED = {
    f"{old}/{kind}": f"{new}/{kind}"
    for old, new in (("doubt", "error_hidden"), ("error", "error_head"))
    for kind in ("kernel", "bias")
}


@cache
def _compiled(config: ModelConfig) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Prediction, and logits of the visibility, compiled once for all models of equal configs."""
    module = build_model(config)
    logits = jax.jit(partial(module.apply, method="visibility_logits"))
    return jax.jit(partial(family_of(config).predict, module)), logits


class Model:
    """A trained network: `model(mesh)` predicts (v, k) coefficients, as `model(model.graph(mesh))` does in two steps.

    A mesh is a path, arrays (vertices, faces[, normals]), a trimesh or a `Mesh`. The graph is what a JAX function
    takes: under jit, grad and vmap give that one. `params` is the tree of the weights.

    >>> model = gash_jax.load_model("local")
    >>> model("bunny.ply").shape
    (362, 9)
    >>> graph = model.graph("bunny.ply")
    >>> coefficients, predicted_error = model.with_error(graph)
    >>> transfer = model.predict("bunny.ply")
    """

    def __init__(self, config: ModelConfig, params: dict[str, Any], metadata: dict[str, Any] | None = None):
        self.config: Any = config  # that of its family
        self.params, self.metadata = params, metadata or {}
        self.module, self.family = build_model(config), family_of(config)
        self._apply, self._logits = _compiled(config)

    def graph(self, mesh: MeshLike, seed: WholeNumber = 0) -> Any:
        """What this model reads of a mesh; `seed` draws the neighbours of a `rings` graph."""
        return model_graph(self.config, as_mesh(mesh), whole_number(seed, "seed", 0))

    def __call__(self, graph: Any) -> jax.Array:
        """Coefficients of every vertex, "v k", in the order of the mesh; of a graph, or of a mesh itself."""
        return self.with_error(graph)[0]

    def with_error(self, graph: Any, params: Any = None) -> tuple[jax.Array, jax.Array | None]:
        """Coefficients, and the RMS error expected of each where the network says it (`local` does), both "v k".

        A JAX function of the graph's arrays and of `params` (the model's own unless given): jit, grad and vmap work.
        Raises ValueError for the graph of another network and for the weights of one.
        """
        params, graph = self.params if params is None else self._weights(params), self._read(graph)
        traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((graph, params)))
        if self.family.predict_fast and not traced:
            return self.family.predict_fast(self.module, params, graph)
        return self._apply(params, graph)

    def __reduce__(self) -> tuple[Any, ...]:
        return Model, (self.config, self.params, self.metadata)  # compiled functions cannot be pickled

    @property
    def predicts_visibility(self) -> bool:
        """Whether the network has a first net that predicts visibility."""
        return hasattr(self.module, "visibility_logits")

    def visibility_logits(self, graph: Any) -> jax.Array:
        """What the first net of a two-stage network says of its directions, "v n".

        Raises ValueError for a model without one.
        """
        if not self.predicts_visibility:
            raise ValueError(f"model {self.config.name} predicts no visibility: only two-stage does")
        return self._logits({"params": self.params}, self._read(graph))

    def _read(self, graph: Any) -> Any:
        """The graph, or that of the mesh that is given in its place."""
        if is_mesh_like(graph):
            return self.graph(graph)
        if jax.tree.structure(graph) != graph_structure(self.config):
            raise ValueError(
                f"a {type(graph).__name__} that model {self.config.name} does not read: give a mesh, "
                "or what graph(mesh) of this model returns"
            )
        return graph

    def _weights(self, params: Any) -> Any:
        own, given = (jax.tree.map(np.shape, tree) for tree in (self.params, params))
        if own != given:
            raise ValueError(
                f"params are not those of model {self.config.name}: give a tree of the shapes of its params"
            )
        return params

    def predict(
        self, mesh: MeshLike, seed: WholeNumber = 0, *, bounces: WholeNumber = 0, albedo: ArrayLike | None = None
    ) -> Transfer:
        """Predict the transfer of a mesh; vertices without a usable normal get 0, as in a bake.

        `bounces` of light off surfaces of one albedo, a number or a colour (3,), which gives coefficients (v, k, 3):
        of `local`, which knows two. Raises ValueError for more than the network knows, for an albedo that is none, and
        for one without bounces.
        """
        mesh, seed = as_mesh(mesh), whole_number(seed, "seed", 0)
        bounces, known = whole_number(bounces, "bounces", 0), labels_of(self.config)[1]
        if bounces > known:
            raise ValueError(f"bounces={bounces}: model {self.config.name} knows {known or 'none'}; bake them instead")
        if albedo is not None and not bounces:
            raise ValueError("an albedo says how much of the light bounces: give bounces=1 or more with it")
        colour = checked_albedo(albedo, len(mesh.vertices)) if bounces else None
        if colour is not None and np.any(colour != colour[:1]):
            raise ValueError("a network knows bounces off one albedo: give a number or a colour, or bake them instead")
        started = time.perf_counter()
        graph = self.graph(mesh, seed)
        built = time.perf_counter()
        if colour is None:
            coefficients, error = jax.block_until_ready(self.with_error(graph))
        else:
            coefficients, error = self._bounced(graph, bounces, colour[0] if len(colour) else np.zeros(1))
        finished = time.perf_counter()
        usable = np.any(mesh.normals != 0, axis=1)
        seconds = {"graph": built - started, "network": finished - built, "total": finished - started}
        parameters = {"model": self.config.to_dict(), "weights": self.metadata.get("name", ""), "seed": seed}
        parameters |= {"bounces": bounces, "albedo": describe_albedo(albedo)} if bounces else {}
        # a network that is told visibilities had one ray traced for each direction
        told = getattr(graph, "nodes", None) or {}
        rays = told["visibility"].size if "visibility" in told else 0
        metadata = make_metadata(self.config.bands, "predict", parameters, rays_total=rays, seconds=seconds)
        if error is not None and "bound" in self.metadata:
            metadata["bound"] = self.metadata["bound"]

        def masked(values: Any) -> np.ndarray:
            values = np.asarray(values, np.float32)
            return np.where(usable.reshape(-1, *(1,) * (values.ndim - 1)), values, np.float32(0))

        return Transfer(masked(coefficients), None, *mesh, metadata, None if error is None else masked(error))

    def _bounced(self, graph: Any, bounces: int, albedo: Float[np.ndarray, "c"]) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients and expected errors with bounces; errors of terms may all go one way, so they are added up."""
        assert self.family.predict_bounces
        terms = self.family.predict_bounces(self.module, self.params, graph, bounces)
        found = (np.stack([summed(part, float(a)) for a in albedo], axis=-1) for part in terms)
        coefficients, error = (array[..., 0] if len(albedo) == 1 else array for array in found)
        return coefficients, error


def save_model(
    path: str | Path, config: ModelConfig, params: dict[str, Any], half: bool = False, **metadata: Any
) -> None:
    """Write a model file; `metadata` entries (run config, measures, commit) go in beside the model config.

    With `half` the weights are rounded to float16 (`measure.half_weights` says what that costs).
    """
    kind = np.float16 if half else np.float32
    arrays = {name: np.asarray(leaf, kind) for name, leaf in flatten_dict(params, sep="/").items()}
    header = {**metadata, "format": FORMAT, "version": FORMAT_VERSION, "model": config.to_dict()}
    write_npz(path, arrays, header)


def shipped_models() -> dict[str, Path]:
    """Names and files of the weights inside the package."""
    folder = Path(str(resources.files("gash_jax"))) / "weights"
    return {path.stem: path for path in sorted(folder.glob("*.npz"))}


def model_file(name: str | Path) -> Path:
    """The file of weights that ship by a name, the file at a path, or that of the run in a folder. Raises FileError."""
    shipped = shipped_models()
    path = shipped.get(str(name)) or as_path(name)
    if not path.exists():
        known = ", ".join(shipped) or "none"
        raise FileError(f"no model {str(name)!r}: give a weights file, or one of the shipped names ({known})")
    if path.is_dir():
        path = path / "model.npz"
        if not path.is_file():
            raise FileError(f"no model in the folder {name}: give a weights file, or the folder of a finished run")
    return path


def load_model(name: str | Path, bands: WholeNumber | None = None) -> Model:
    """Load weights that ship with the package by name, or a model file or a run's folder by path.

    `bands` other than those in the file are for networks that know more, as `local` does: 1 to 6. Raises FileError
    where there is no model, or its arrays are not finite or not exactly those of its network, ValueError for bands that
    it does not know.

    >>> gash_jax.load_model("local", bands=5)("bunny.ply").shape
    (362, 25)
    """
    path = model_file(name)
    arrays, metadata = read_npz(path, "model", ())
    if metadata.get("format") == DEFORMING_FORMAT:
        raise FileError(
            f"{path} is of one object that deforms: use it with gash animate --model or load_deforming_model"
        )
    if metadata.get("format") != FORMAT:
        raise FileError(f"{path} is not a model file: write one with `gash train` or `gash export`")
    try:
        config = config_from_file(metadata["model"])
    except ConfigError as error:
        raise FileError(f"{path} was written by another version of gash_jax: {error}") from None
    arrays = {RENAMED.get(name, name): array for name, array in arrays.items()}
    shapes = parameter_shapes(config)
    check_arrays(path, "model", arrays, shapes)
    if unknown := sorted(arrays.keys() - shapes.keys()):
        raise FileError(f"{path} is not a model file: its network has no array {unknown[0]!r}; write it again")
    # float16 is how they were kept, never how they are computed with
    arrays = {name: array.astype(np.float32, copy=False) for name, array in arrays.items()}
    config = config if bands is None else with_bands(config, whole_number(bands, "bands", 1))
    return Model(config, unflatten_dict(arrays, sep="/"), metadata)
