"""The methods that `gash bench frontier` measures, in one table: a new one is one entry of `METHODS`.

An entry says what the method is called, which settings it has for a mesh, whether it knows light that bounces, and what
it does on meshes that deform. A setting is called with a seed and gives an `Outcome`: coefficients, the seconds that
the scene or the graph took in it, and rays per vertex. What cannot be run here (another program that is not installed,
weights that nobody gave) raises `Unavailable`: it is left out, and the results say why.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.apps.frontier import runtimes
from gash_jax.apps.frontier.moving import frame_by_frame, kept_graph, one_object
from gash_jax.apps.frontier.traced import Unavailable, peer_bake, pseudo_random_bake
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.frontier import Outcome, Setting
from gash_jax.models.ambient import ambient_refinement
from gash_jax.models.deforming_model import DeformingModel
from gash_jax.models.guided import bake_guided, bake_to_error
from gash_jax.models.model import Model
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.transfer import Transfer

PLAIN_RAYS = (8, 16, 32, 64, 128, 256, 512)
RANDOM_RAYS = (16, 64, 256)
DEFAULT_RAYS = (16, 32, 64, 128, 256, 512)
GUIDED_RAYS = (4, 8, 16, 32, 64, 128)
ERRORS = (0.1, 0.05, 0.03, 0.02, 0.01)
PEER_RAYS = (16, 64)
NEIGHBOURS = (16, 64)

Run = Callable[[int], Outcome]


class Task(NamedTuple):
    """A mesh to measure methods on: light that bounces so often off surfaces of one grey, and models by name.

    `frames` are those of an animation, of which `mesh` is the first; `plain_counts` are ray counts of the plain bake
    beside the usual ones.
    """

    mesh: Mesh
    bands: int
    models: Mapping[str, Model]
    bounces: int = 0
    albedo: float = 1.0
    frames: Sequence[Mesh] = ()
    deforming: Mapping[str, DeformingModel] = {}
    plain_counts: Sequence[int] = ()


class Method(NamedTuple):
    """What a method is called in figures, its settings for a mesh by name, and what else it can do.

    `moving` says whether it is measured on animations: "no", each of the "frames" by itself, or on animations "only".
    """

    label: str
    settings: Callable[[Task], dict[str, Run]]
    knows_bounces: bool = False
    moving: Literal["no", "frames", "only"] = "no"


def _closed_form(task: Task) -> dict[str, Run]:
    return {"": lambda seed: Outcome(_formula(task), 0.0)}


def _formula(task: Task) -> np.ndarray:
    return np.asarray(unshadowed_transfer(task.mesh.normals, task.bands))


def _ambient(task: Task) -> dict[str, Run]:
    """The closed form, and the paper's own use: predictions of its network, darkened."""
    found: dict[str, Run] = {
        f"closed form, {count} neighbours": lambda seed, n=count: Outcome(
            ambient_refinement(task.mesh, _formula(task), neighbours=n), 0.0
        )
        for count in NEIGHBOURS
    }

    def darkened(seed: int, run: Run) -> Outcome:
        outcome = run(seed)
        return outcome._replace(coefficients=ambient_refinement(task.mesh, outcome.coefficients))

    networks = {name: model for name, model in task.models.items() if model.config.name == "two-stage"}
    return found | {
        name: lambda seed, m=model: darkened(seed, _prediction(task, m)) for name, model in networks.items()
    }


def _pseudo_random(task: Task) -> dict[str, Run]:
    return {str(n): lambda seed, n=n: pseudo_random_bake(task.mesh, task.bands, n, seed) for n in RANDOM_RAYS}


def _baked(transfer: Transfer) -> Outcome:
    active = max(int(np.any(transfer.normals != 0, axis=1).sum()), 1)
    return Outcome(
        transfer.coefficients, transfer.metadata["seconds"]["build"], transfer.metadata["rays_total"] / active
    )


def _bakes(task: Task, counts: Sequence[int], replicates: int | None) -> dict[str, Run]:
    light = {"bounces": task.bounces, "albedo": task.albedo} if task.bounces else {}

    def run(seed: int, rays: int) -> Outcome:
        return _baked(bake_transfer(task.mesh, task.bands, rays, replicates=replicates, seed=seed, **light))

    return {str(rays): lambda seed, n=rays: run(seed, n) for rays in sorted(counts)}


def _plain(task: Task) -> dict[str, Run]:
    return _bakes(task, tuple({*PLAIN_RAYS, *task.plain_counts}), 1)


def _default(task: Task) -> dict[str, Run]:
    return _bakes(task, DEFAULT_RAYS, None)


def _guided(task: Task) -> dict[str, Run]:
    return {str(n): lambda seed, n=n: _baked(bake_guided(task.mesh, task.bands, n, seed=seed)) for n in GUIDED_RAYS}


def _to_error(unbiased: bool) -> Callable[[Task], dict[str, Run]]:
    def run(task: Task, seed: int, error: float) -> Outcome:
        return _baked(bake_to_error(task.mesh, error, task.bands, unbiased=unbiased, seed=seed))

    return lambda task: {f"{error:g}": lambda seed, e=error: run(task, seed, e) for error in ERRORS}


def _prediction(task: Task, model: Model) -> Run:
    def run(seed: int) -> Outcome:
        transfer = model.predict(task.mesh, seed)
        return Outcome(transfer.coefficients, transfer.metadata["seconds"]["graph"])

    return run


def _network(family: str) -> Callable[[Task], dict[str, Run]]:
    """Settings of a family of networks: the weights that ship, and those that were given."""

    def settings(task: Task) -> dict[str, Run]:
        found = {name: model for name, model in task.models.items() if model.config.name == family}
        if not found:
            raise Unavailable(f"no weights of {family} ship: train some and give them with --model")
        return {name: _prediction(task, model) for name, model in found.items()}

    return settings


def _runtime(ready: Callable[[Mesh, Model], Run]) -> Callable[[Task], dict[str, Run]]:
    """The same networks outside JAX."""
    return lambda task: {name: ready(task.mesh, model) for name, model in task.models.items()}


def _pyg(task: Task) -> dict[str, Run]:
    found = {name: model for name, model in task.models.items() if model.config.name == "two-stage"}
    return {name: runtimes.pyg_run(task.mesh, model) for name, model in found.items()}


def _peer(name: str) -> Callable[[Task], dict[str, Run]]:
    return lambda task: {str(n): peer_bake(name, task.mesh, task.bands, n) for n in PEER_RAYS}


def _kept(task: Task) -> dict[str, Run]:
    return kept_graph(task.frames, task.models)


def _one_object(task: Task) -> dict[str, Run]:
    return one_object(task.frames, task.deforming, task.bands)


METHODS: dict[str, Method] = {
    "closed-form": Method("closed form, no shadows", _closed_form, knows_bounces=True, moving="frames"),
    "pseudo-random": Method("pseudo-random rays", _pseudo_random),
    "plain": Method("plain bake", _plain, knows_bounces=True, moving="frames"),
    "default": Method("default bake", _default, knows_bounces=True, moving="frames"),
    "guided": Method("guided bake", _guided, moving="frames"),
    "error": Method("bake to an error", _to_error(unbiased=False), moving="frames"),
    "unbiased": Method("bake to an error, rays alone", _to_error(unbiased=True), moving="frames"),
    "mlp": Method("MLP", _network("mlp"), moving="frames"),
    "single-stage": Method("GATv2, single stage", _network("gnn"), moving="frames"),
    "two-stage": Method("TransformerConv + GATv2, two stages", _network("two-stage"), moving="frames"),
    "local": Method("surfel network (local)", _network("local"), moving="frames"),
    # after the network that it darkens, so that compilation counts as the network's
    "ambient-occlusion": Method("ambient occlusion", _ambient),
    "kept": Method("surfel network, graph kept", _kept, moving="only"),
    "one-object": Method("model of one object", _one_object, moving="only"),
    "numpy": Method("networks in NumPy", _runtime(runtimes.numpy_run)),
    "onnx": Method("networks in ONNX Runtime", _runtime(runtimes.onnx_run)),
    "trimesh": Method("plain bake by trimesh.ray", _peer("trimesh")),
    "open3d": Method("plain bake by Open3D", _peer("open3d")),
    "mitsuba": Method("plain bake by Mitsuba 3", _peer("mitsuba")),
    "warp": Method("plain bake by Warp", _peer("warp")),
    "pyg": Method("two stages in PyTorch Geometric", _pyg),
}


def settings_of(task: Task, names: Sequence[str] = tuple(METHODS)) -> tuple[list[Setting], dict[str, str]]:
    """All settings of the methods that are for such a mesh, and of each that cannot be run here the reason."""
    settings, skipped = [], {}
    for name in names:
        method = METHODS[name]
        if method.moving == ("no" if task.frames else "only"):
            continue
        try:
            if task.bounces and not method.knows_bounces:
                raise Unavailable("knows no light that bounces")
            settings += [Setting(name, setting, run) for setting, run in _settings(method, task).items()]
        except Unavailable as reason:
            skipped[name] = str(reason)
    return settings, skipped


def _settings(method: Method, task: Task) -> dict[str, Run]:
    if not task.frames or method.moving == "only":
        return method.settings(task)
    return frame_by_frame([method.settings(task._replace(mesh=frame, frames=())) for frame in task.frames])
