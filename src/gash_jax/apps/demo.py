"""`gash demo`: the whole way of the data on one mesh, from an empty folder to a relit prediction.

Corpus -> training (MLP, the paper's two-stage network, `local`) -> reference bake of an unseen mesh -> predictions
-> one table (speed against error) and one picture. Runs are kept in the output folder: a second call continues or
reuses them.
"""

import hashlib
import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from gash_jax.apps.picture import montage, signed_colors, write_png
from gash_jax.apps.progress import progress_bar, say
from gash_jax.apps.provenance import provenance
from gash_jax.apps.render import cast_view, exposure_for, shade_view, to_srgb
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.mesh_io import read_mesh
from gash_jax.learn import metrics
from gash_jax.learn.batches import make_examples
from gash_jax.learn.config import RunConfig, load_config
from gash_jax.learn.corpus import build_corpus, split_indices
from gash_jax.learn.model import Model, load_model
from gash_jax.learn.shapes import make_shape
from gash_jax.learn.train import train_model
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.light import load_light, project_light
from gash_jax.prt.shading import shade
from gash_jax.prt.studio import studio_light
from gash_jax.prt.transfer import unshadowed_transfer

REFERENCE_RAYS = 4096
PLAIN_RAYS = (8, 16, 32, 64, 128, 256)
MODELS = ("mlp", "two-stage", "local")
UNSEEN = (1, 1)  # seed and index of the generated mesh: another seed than the corpus


def _timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """Result and median seconds of three calls after a warm-up."""
    result, seconds = work(), []
    for _ in range(3):
        started = time.perf_counter()
        jax.block_until_ready(work())
        seconds.append(time.perf_counter() - started)
    return result, float(np.median(seconds))


def demo_configs(seconds: float) -> dict[str, RunConfig]:
    """The shipped configs with the demo's budget: `seconds` for each graph network, a quarter for the MLP."""
    configs = {name: load_config(name) for name in MODELS}
    budgets = {"mlp": seconds / 4, "two-stage": seconds, "local": seconds}
    return {name: replace(c, train=replace(c.train, seconds=budgets[name])) for name, c in configs.items()}


def _train_all(output: Path, seconds: float, quiet: bool) -> dict[str, Model]:
    models, items = {}, []
    for name, config in demo_configs(seconds).items():
        training, validation = split_indices(config.data)
        if not items:
            say(f"corpus of {len(training)} + {len(validation)} generated shapes", quiet)
            with progress_bar("corpus", quiet) as update:
                items = build_corpus(config.data, config.model.bands, np.concatenate([training, validation]), update)
        digest = hashlib.sha256(json.dumps(config.to_dict()).encode()).hexdigest()[:8]
        say(f"training {name} for {config.train.seconds:.0f} s", quiet)
        with progress_bar(f"training {name}", quiet) as update:
            examples = make_examples(items, config.model)
            split = len(training)
            report = lambda phase, fraction, measures, u=update: u(round(1000 * fraction), 1000)  # noqa: E731
            folder = output / "runs" / f"{name}-{digest}"
            models[name] = load_model(train_model(config, examples[:split], examples[split:], folder, report))
    return models


def _measure(mesh: Mesh, models: dict[str, Model], quiet: bool) -> tuple[list[dict[str, Any]], dict[str, np.ndarray]]:
    """Rows of the table, and the coefficients the picture needs."""
    with progress_bar(f"reference, {REFERENCE_RAYS} rays per vertex", quiet) as update:
        reference = bake_transfer(mesh, rays=REFERENCE_RAYS, seed=99, progress=update).coefficients
    with progress_bar("plain bake at several counts", quiet) as update:
        curve = metrics.plain_bake_curve(mesh, reference, REFERENCE_RAYS, progress=update)
    formula = lambda: np.asarray(unshadowed_transfer(mesh.normals, 3))  # noqa: E731
    methods: dict[str, Callable[[], np.ndarray]] = {"closed form": formula}
    for rays in PLAIN_RAYS:
        methods[f"plain bake, {rays} rays"] = lambda n=rays: bake_transfer(mesh, rays=n, replicates=1).coefficients
    for name, model in models.items():
        methods[name] = lambda m=model: m.predict(mesh).coefficients
    rows, found = [], {"reference": reference}
    with progress_bar("timing", quiet) as update:
        for step, (name, work) in enumerate(methods.items()):
            found[name], seconds = _timed(work)
            error = metrics.mse(found[name], reference)
            rows.append(
                {
                    "method": name,
                    "seconds": seconds,
                    "relrmse": metrics.relrmse(found[name], reference),
                    "skill": metrics.skill(found[name], reference, mesh.normals),
                    "equivalent_rays": metrics.equivalent_rays(error, curve),
                }
            )
            update(step + 1, len(methods))
    return rows, found


def print_table(rows: list[dict[str, Any]]) -> None:
    """The table of the demo on standard output."""
    table = Table("method", box=box.SIMPLE_HEAD)
    for name in ("seconds", "relrmse", "skill", "equivalent rays"):
        table.add_column(name, justify="right")
    for row in rows:
        skill, rays = row["skill"], row["equivalent_rays"]
        table.add_row(
            row["method"],
            f"{row['seconds']:.3f}",
            f"{row['relrmse']:.4f}" if row["relrmse"] is not None else "no transfer",
            skill if isinstance(skill, str) else f"{skill:.3f}",
            rays if isinstance(rays, str) else f"{rays:.1f}",
        )
    Console(width=100).print(table)


def _picture(
    mesh: Mesh, found: dict[str, np.ndarray], light: np.ndarray, rows: list[dict[str, Any]], path: Path
) -> None:
    """Reference, closed form, prediction, difference, side by side under the light, front and back."""
    skills = {row["method"]: row["skill"] for row in rows}
    label = {n: f"skill {s:.2f}" if isinstance(s, float) else s for n, s in skills.items()}
    names = {"reference": f"reference\n{REFERENCE_RAYS} rays per vertex"}
    names |= {"closed form": f"closed form, no shadows\n{label['closed form']}"}
    names |= {"local": f"prediction (local), no rays\n{label['local']}"}
    radiance = {name: np.asarray(shade(found[name], light)) for name in names}
    hits = {view: cast_view(mesh, view, 480) for view in ("front", "back")}
    exposure = exposure_for([shade_view(hit, radiance["reference"]) for hit in hits.values()])
    panels = []
    for hit in hits.values():
        images = {name: shade_view(hit, values) for name, values in radiance.items()}
        panels += [(names[name], to_srgb(*image, exposure)) for name, image in images.items()]
        difference = (images["local"][0] - images["reference"][0]).mean(-1) * exposure
        caption = "difference, prediction - reference\nblue darker, red brighter, full at 0.3"
        panels.append((caption, signed_colors(difference, 0.3)))
    write_png(path, montage(panels, columns=4))


def run_demo(output: Path, mesh_path: Path | None, light_path: Path | None, seconds: float, quiet: bool) -> None:
    """Run everything; writes picture.png, results.json and the runs into `output`."""
    started = time.perf_counter()
    light = load_light(light_path, 3).coefficients if light_path else project_light(studio_light(), 3)
    mesh, lines = (make_shape(*UNSEEN, vertices=(9000, 12000))[1], []) if mesh_path is None else _read(mesh_path)
    output.mkdir(parents=True, exist_ok=True)
    models = _train_all(output, seconds, quiet)
    name = mesh_path.name if mesh_path else "a generated mesh"
    say(f"{name}: {len(mesh.vertices)} vertices, {len(mesh.faces)} faces, not in the corpus", quiet)
    for line in lines:
        say(f"  {line}", quiet)
    rows, found = _measure(mesh, models, quiet)
    print_table(rows)
    _picture(mesh, found, np.asarray(light), rows, output / "picture.png")
    arguments = {
        "mesh": name,
        "light": light_path.name if light_path else "studio",
        "training_seconds": seconds,
    }
    results = {**provenance(seed=0, arguments=arguments), "vertices": len(mesh.vertices), "rows": rows}
    temporary = output / ".results.json.tmp"
    temporary.write_text(json.dumps(results, indent=1) + "\n")
    os.replace(temporary, output / "results.json")
    say(
        f"wrote {output / 'picture.png'} and {output / 'results.json'} after {time.perf_counter() - started:.0f} s",
        quiet,
    )


def _read(path: Path) -> tuple[Mesh, list[str]]:
    mesh, health = read_mesh(path)
    return mesh, health.lines()
