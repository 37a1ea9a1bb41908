"""Which networks there are: one table. A family is a config, a network, what it reads of a mesh, and how it is trained.

A new kind of network is one file in `nn` (a config and a Flax module that answers `module.apply({"params": p}, graph,
deterministic=True)` with "v k" coefficients) and one entry here. What an entry leaves out is what most networks do:
batches of whole shapes, one phase of MSE, prediction of all vertices at once. docs/new_network.md adds one.

Models of one object that deforms read no mesh but a pose of theirs: `deforming_families`.

What a network reads need not be a graph: any pytree of arrays will do that its `batches` can put together.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np
from flax import linen as nn
from jaxtyping import Array, Bool, Float

from gash_jax.files.settings import ConfigError, from_dict, near_names
from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.mesh_graph import Graph, build_graph, edgeless_graph
from gash_jax.graph.surfel_graph import SurfelGraph, surfel_graph
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.examples import Batches, Example, Item, WholeShapes
from gash_jax.models.phases import Phase, one_phase, surfel_phases, two_stage_phases
from gash_jax.models.surfel_inference import Terms, apply_surfels, predict_bounces, predict_surfels
from gash_jax.models.surfel_parts import PartPool
from gash_jax.nn.config import ModelConfig
from gash_jax.nn.mlp import MLPConfig, build_mlp
from gash_jax.nn.ring_net import RingConfig, build_ring_net
from gash_jax.nn.surfel_net import SurfelConfig, build_surfel_net
from gash_jax.nn.two_stage import (
    GNNConfig,
    TeacherConfig,
    TwoStageConfig,
    build_coefficient_net,
    build_two_stage,
)
from gash_jax.nn.versor_net import VersorConfig, build_versor_net
from gash_jax.prt.hemisphere import hemisphere_visibility

Visibility = Float[np.ndarray, "v n"] | Bool[np.ndarray, "v n"]
# (config, mesh, seed of random neighbours, traced visibility of the config's directions if known) -> what is read
GraphFn = Callable[[Any, Mesh, int, Visibility | None], Any]
# (module, params, graph) -> coefficients and, where the network says it, the RMS error to expect; both "v k"
PredictFn = Callable[[nn.Module, Any, Any], tuple[Array, Array | None]]


def predict_at_once(module: nn.Module, params: Any, graph: Any) -> tuple[Array, None]:
    """Coefficients of all vertices in one application."""
    return module.apply({"params": params}, graph), None  # type: ignore[return-value]


class Family(NamedTuple):
    """`predict` is a JAX function; `predict_fast`, where there is one, is the same for arrays that are not traced.

    `predict_bounces`, where the network knows bounces, says what each of so many adds, as NumPy arrays.
    """

    config: type[ModelConfig]
    build: Callable[[Any], nn.Module]
    graph: GraphFn
    batches: Callable[[Sequence[Example]], Batches] = WholeShapes
    phases: Callable[[Any], tuple[Phase, ...]] = one_phase
    predict: PredictFn = predict_at_once
    predict_fast: PredictFn | None = None
    predict_bounces: Callable[[nn.Module, Any, Any, int], Terms] | None = None


def _edgeless(config: MLPConfig, mesh: Mesh, seed: int, visibility: Visibility | None) -> Graph:
    return edgeless_graph(mesh)


def _neighbours(config: GNNConfig, mesh: Mesh, seed: int, visibility: Visibility | None) -> Graph:
    return build_graph(mesh, config.graph, config.neighbours, seed, config.encoding)


def _rings(config: RingConfig | VersorConfig, mesh: Mesh, seed: int, visibility: Visibility | None) -> Graph:
    return build_graph(mesh, "rings", config.neighbours, seed, config.encoding)


def _told_visibility(config: TeacherConfig, mesh: Mesh, seed: int, visibility: Visibility | None) -> Graph:
    """The teacher (GNN paper, 4.1.1) reads nodes["visibility"]: one ray for each of its directions."""
    graph = _neighbours(config, mesh, seed, visibility)
    if visibility is None:
        visibility = traced_visibility(config, mesh)
    return graph._replace(nodes={**dict(graph.nodes), "visibility": np.asarray(visibility, np.float32)})  # type: ignore[call-overload]


def traced_visibility(config: TeacherConfig, mesh: Mesh) -> Bool[np.ndarray, "v n"]:
    """What every vertex sees along the directions of a network that is told visibilities, or predicts them."""
    return hemisphere_visibility(mesh, config.visibility_directions, world=config.frame == "world")


def label_visibility(config: ModelConfig, item: Item) -> Float[np.ndarray, "v n"]:
    """The visibility that a network learns from a shape: the shape's, or traced where the frame is the world's."""
    if isinstance(config, TeacherConfig) and config.frame == "world":
        return traced_visibility(config, item.mesh).astype(np.float32)
    return item.visibility


def _surfels(config: SurfelConfig, mesh: Mesh, seed: int, visibility: Visibility | None) -> SurfelGraph:
    return surfel_graph(mesh)


FAMILIES: dict[str, Family] = {
    "rings": Family(RingConfig, build_ring_net, _rings),
    "versor": Family(VersorConfig, build_versor_net, _rings),
    "local": Family(
        *(SurfelConfig, build_surfel_net, _surfels, PartPool, surfel_phases),
        *(apply_surfels, predict_surfels, predict_bounces),
    ),
    "two-stage": Family(TwoStageConfig, build_two_stage, _neighbours, phases=two_stage_phases),
    "gnn": Family(GNNConfig, build_coefficient_net, _neighbours),
    "teacher": Family(TeacherConfig, build_coefficient_net, _told_visibility),
    "mlp": Family(MLPConfig, build_mlp, _edgeless),
}


def family_of(config: ModelConfig) -> Family:
    """The family of a config."""
    return FAMILIES[config.name]


def model_config(name: str = "local", bands: int = 3, **values: Any) -> ModelConfig:
    """The config of a network by name; what is not given takes the family's default. Raises ConfigError."""
    return config_from_dict({"name": name, "bands": bands, **values})


def config_from_dict(values: Mapping[str, Any]) -> ModelConfig:
    """A config from the table `model` of a run, which is "local" unless it has a name. Raises ConfigError."""
    name = values.get("name", "local")
    known = {family: entry.config for table in (FAMILIES, DEFORMING) for family, entry in table.items()}
    if name not in known:
        near = near_names(str(name), known)
        raise ConfigError(f"unknown model {name!r}{near}: known are {', '.join(known)}")
    return from_dict(known[name], {"name": name, **values}, "model.")


def config_from_file(values: Mapping[str, Any]) -> ModelConfig:
    """A config as model files hold it: the first of them held the fields of all families in every file."""
    known = {entry.name for family in FAMILIES.values() for entry in fields(family.config)}
    own = FAMILIES[values["name"]].config if values.get("name") in FAMILIES else None
    kept = {entry.name for entry in fields(own)} if own else known
    return config_from_dict({key: value for key, value in values.items() if key in kept or key not in known})


def labels_of(config: ModelConfig) -> tuple[int, int]:
    """How many bands and bounces the labels have that a network learns."""
    return (config.learnt_bands, config.known_bounces) if isinstance(config, SurfelConfig) else (config.bands, 0)


def with_bands(config: ModelConfig, bands: int) -> ModelConfig:
    """The config of the same network, asked for another number of bands. Raises ValueError for more than it knows."""
    learnt, _ = labels_of(config)
    if bands > learnt:
        raise ValueError(f"bands={bands}: model {config.name} knows {learnt} {'bands' if learnt > 1 else 'band'}")
    if bands == config.bands:
        return config
    if not isinstance(config, SurfelConfig):
        raise ValueError(f"bands={bands}: model {config.name} says {config.bands} bands, no other number of them")
    return replace(config, bands=bands, known_bands=learnt)


def build_model(config: ModelConfig) -> nn.Module:
    """The network of a config."""
    return family_of(config).build(config)


def model_graph(config: ModelConfig, mesh: Mesh, seed: int = 0, visibility: Visibility | None = None) -> Any:
    """What a network reads of a mesh; `seed` draws the neighbours of rings, a teacher traces visibility not given."""
    return family_of(config).graph(config, mesh, seed, visibility)


def make_examples(items: Sequence[Item], config: ModelConfig, seed: int = 0) -> list[Example]:
    """Shapes with labels as a network reads them."""
    examples = []
    for i, item in enumerate(items):
        visibility = label_visibility(config, item)
        graph = model_graph(config, item.mesh, seed + i, visibility)
        examples.append(Example(graph, item.coefficients, visibility, item.bounced, item.noise))
    return examples
