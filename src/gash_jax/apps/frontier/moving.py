"""Methods on a mesh that deforms: those that take it frame by frame, and those that keep what does not change.

Coefficients of all frames stand one after another, (frames * vertices, k), as if they were one mesh.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gash_jax.apps.frontier.traced import Unavailable
from gash_jax.geometry.mesh import Mesh, MeshError
from gash_jax.measure.frontier import Outcome
from gash_jax.measure.reference import Reference
from gash_jax.models.deforming import deforming_predictor
from gash_jax.models.deforming_model import DeformingModel
from gash_jax.models.held import HeldMesh
from gash_jax.models.model import Model

Run = Callable[[int], Outcome]


def frame_by_frame(settings: Sequence[Mapping[str, Run]]) -> dict[str, Run]:
    """Settings of all frames together, given those of each; every frame has the same ones."""

    def together(seed: int, runs: Sequence[Run]) -> Outcome:
        found = [run(seed) for run in runs]
        rays = [each.rays for each in found if each.rays is not None]
        coefficients = np.concatenate([each.coefficients for each in found])
        return Outcome(coefficients, sum(each.set_up for each in found), float(np.mean(rays)) if rays else None)

    return {name: lambda seed, n=name: together(seed, [each[n] for each in settings]) for name in settings[0]}


def joined_reference(references: Sequence[Reference]) -> Reference:
    """The references of all frames as one."""
    curve = {n: float(np.mean([each.curve[n] for each in references])) for n in references[0].curve}
    coefficients, errors = (
        np.concatenate([getattr(each, name) for each in references]) for name in ("coefficients", "standard_error")
    )
    return Reference(coefficients, errors, curve, references[0].rays)


def kept_graph(frames: Sequence[Mesh], models: Mapping[str, Model]) -> dict[str, Run]:
    """`local` with the graph of the first frame kept: by calls that all meshes share, and by one compiled call a frame.

    The first makes its graph in the timed call; that of the second is made with the program, once for the mesh, and is
    not in its time.
    """
    found: dict[str, Run] = {}
    for name, model in models.items():
        if model.config.name == "local":
            predict = deforming_predictor(model, frames[0])
            found[f"{name}, held"] = lambda seed, m=model: _held(m, frames)
            found[f"{name}, one program"] = lambda seed, p=predict: Outcome(
                np.concatenate([np.asarray(p(frame.vertices)[0]) for frame in frames]), 0.0
            )
    return found


def _held(model: Model, frames: Sequence[Mesh]) -> Outcome:
    held = HeldMesh(model, frames[0])
    later = [held.predict(frame.vertices).coefficients for frame in frames[1:]]
    return Outcome(np.concatenate([held.first.coefficients, *later]), held.first.seconds["graph"])


def one_object(frames: Sequence[Mesh], models: Mapping[str, DeformingModel], bands: int) -> dict[str, Run]:
    """Models that were fitted to this object, the first `bands` bands of what they say. Raises Unavailable."""
    if not models:
        raise Unavailable("no model of this object: train one with gash train deform and give it with --model")
    found: dict[str, Run] = {}
    for name, model in models.items():
        if model.light is not None:
            raise Unavailable(f"{name} says radiance under its own light: give a model of transfer")
        try:
            model.pose(frames[0].vertices)
        except MeshError as reason:
            raise Unavailable(f"{name}: {reason}") from None
        found[name] = lambda seed, m=model: Outcome(
            np.concatenate([np.asarray(m(frame.vertices))[:, : bands**2] for frame in frames]), 0.0
        )
    return found
