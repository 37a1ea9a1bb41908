"""Methods held side by side on one mesh: closed form, plain bakes, networks; each timed and scored."""

from collections.abc import Callable
from typing import Any

import numpy as np

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure import metrics
from gash_jax.measure.reference import Reference, score
from gash_jax.measure.timing import timed, timed_on_both_clocks
from gash_jax.models.families import traced_visibility
from gash_jax.models.model import Model
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.hemisphere import above_horizon
from gash_jax.prt.tracing import ProgressFn

PLAIN_RAYS = (8, 16, 32, 64, 128, 256)


def measure_methods(
    mesh: Mesh, models: dict[str, Model], reference: Reference, update: ProgressFn
) -> tuple[list[dict[str, Any]], dict[str, np.ndarray]]:
    """Rows of the table: closed form, plain bakes, models, each timed and scored; and the coefficients by method."""
    bands = round(reference.coefficients.shape[1] ** 0.5)
    methods: dict[str, Callable[[], np.ndarray]] = {
        "closed form": lambda: np.asarray(unshadowed_transfer(mesh.normals, bands))
    }
    for rays in PLAIN_RAYS:
        methods[f"plain bake, {rays} rays"] = lambda n=rays: bake_transfer(mesh, bands, n, replicates=1).coefficients
    for name, model in models.items():
        methods[name] = lambda m=model: m.predict(mesh).coefficients
    rows, found = [], {"reference": reference.coefficients}
    for step, (name, work) in enumerate(methods.items()):
        found[name], seconds = timed(work)
        rows.append({"method": name, "seconds": seconds, **score(found[name], mesh, reference)})
        update(step + 1, len(methods))
    return rows, found


def evaluate_mesh(model: Model, mesh: Mesh, reference: Reference) -> dict[str, Any]:
    """Scores and times of a model on one mesh; visibility scores where the model predicts visibility.

    Times are microseconds per vertex: `graph_us` and `network_us` on the wall, `graph_cpu_us` and `network_cpu_us` of
    all cores together.
    """
    graph, building = timed_on_both_clocks(lambda: model.graph(mesh))
    _, network = timed_on_both_clocks(lambda: model(graph))
    times = {"graph_us": building.wall, "network_us": network.wall}
    times |= {"graph_cpu_us": building.cpu, "network_cpu_us": network.cpu}
    times = {name: seconds * 1e6 / len(mesh.vertices) for name, seconds in times.items()}
    seen = visibility_score(model, mesh) if model.predicts_visibility else {}
    return {**times, **score(model.predict(mesh).coefficients, mesh, reference), **seen}


def visibility_score(model: Model, mesh: Mesh) -> dict[str, float]:
    """How a two-stage network's first net calls the visibility of a mesh, of directions above the horizon alone."""
    config = model.config
    truth = traced_visibility(config, mesh)
    called = np.asarray(model.visibility_logits(model.graph(mesh))) > 0
    above = above_horizon(mesh.normals, config.visibility_directions, world=config.frame == "world")
    return metrics.visibility_scores(called[above], truth[above])
