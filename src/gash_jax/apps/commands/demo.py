"""`gash demo`: reference bake of a mesh that no network has seen, predictions, one table, one picture and one page.

The networks are those that ship (MLP, the paper's two-stage network, `local`), or with a training time small ones that
are trained first: corpus, training, everything. Such runs are kept in the output folder: a second call continues or
reuses them.
"""

import hashlib
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from gash_jax.apps.options import LIGHT_HELP, PATH, Command, check_layout, layout_option, light_option, quiet_option
from gash_jax.apps.pictures.montage import Panel, montage, signed_colors, write_picture
from gash_jax.apps.pictures.views import cast_view, exposure_for, shade_view, to_srgb
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.tables import print_methods
from gash_jax.apps.viewer.contents import map_file, own_lights
from gash_jax.apps.viewer.page import make_page
from gash_jax.files.atomic import write_json
from gash_jax.formats.meshes import read_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.environment import load_light, project_map
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.measure.methods import measure_methods
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import REFERENCE_RAYS, make_reference
from gash_jax.models.families import labels_of
from gash_jax.models.model import Model, load_model
from gash_jax.prt.transfer import Transfer
from gash_jax.shapes.procedural import make_shape
from gash_jax.train.config import DataConfig, RunConfig, load_config
from gash_jax.train.corpus import build_corpus, split_indices
from gash_jax.train.run import run_config

DATA = DataConfig(shapes=96, validation_shapes=8, rays=256, min_vertices=600, max_vertices=1800)
MODELS = ("mlp", "two-stage", "local")
FULL = 0.3  # difference, in shares of white, at which colours are full
UNSEEN = (1, 1)  # seed and index of the generated mesh: another seed than the corpus


@click.command(cls=Command, epilog="gash demo -o demo --mesh bunny.ply --light studio.hdr")
@click.option("-o", "--output", type=PATH, default=Path("demo"), show_default=True, help="Folder to write.")
@click.option("--mesh", type=PATH, help="Mesh to predict.  [default: one that the project generates]")
@light_option(f"{LIGHT_HELP}  [default: studio]")
@layout_option
@click.option(
    "--train",
    "seconds",
    type=click.FloatRange(1.0, 3600.0),
    help="Train small networks first, two of them for so many seconds each.  [default: the weights that ship]",
)
@quiet_option
def demo(
    output: Path, mesh: Path | None, light_path: Path | None, layout: str | None, seconds: float | None, quiet: bool
) -> None:
    """Bake a mesh, predict it, relight it: a table of speed against error, a picture, and a page to turn it on."""
    started = time.perf_counter()
    check_layout(layout, light_path)
    light = load_light(light_path, 3, layout).coefficients if light_path else project_map(studio_light(), 3)
    name, surface, found_in_mesh = _surface(mesh)
    output.mkdir(parents=True, exist_ok=True)
    models = _train_all(output, seconds, quiet) if seconds else {name: load_model(name) for name in MODELS}
    say(f"{name}: {len(surface.vertices)} vertices, {len(surface.faces)} faces, not in the corpus", quiet)
    for line in found_in_mesh:
        say(f"  {line}", quiet)
    with progress_bar(f"reference, {REFERENCE_RAYS} rays per vertex", quiet) as update:
        reference = make_reference(surface, rays=REFERENCE_RAYS, progress=update)
    with progress_bar("timing", quiet) as update:
        rows, found = measure_methods(surface, models, reference, update)
    print_methods(rows)
    picture, page, results = output / "picture.png", output / "page.html", output / "results.json"
    _draw(surface, found, np.asarray(light), rows, picture)
    lights = [map_file(light_path, 3, layout)] if light_path else own_lights()
    make_page(name, _results(surface, found), lights).save(page)
    arguments = {"mesh": name, "light": light_path.name if light_path else "studio", "training_seconds": seconds}
    origin = provenance(seed=0, arguments=arguments)
    write_json(results, {**origin, "vertices": len(surface.vertices), "rows": rows})
    say(f"wrote {picture}, {page} and {results} after {time.perf_counter() - started:.0f} s", quiet)


def _surface(path: Path | None) -> tuple[str, Mesh, list[str]]:
    """Name and mesh to show, and what its health report says."""
    if path is None:
        return "a generated mesh", make_shape(*UNSEEN, vertices=(9000, 12000))[1], []
    mesh, health = read_mesh(path)
    return path.name, mesh, health.lines()


def demo_configs(seconds: float) -> dict[str, RunConfig]:
    """The shipped configs on a small corpus: `seconds` for each graph network, a quarter for the MLP."""
    budgets = {"mlp": seconds / 4, "two-stage": seconds, "local": seconds}
    return {
        name: replace(c, data=DATA, train=replace(c.train, seconds=budgets[name], batch_vertices=2048))
        for name, c in ((name, load_config(name)) for name in MODELS)
    }


def _train_all(output: Path, seconds: float, quiet: bool) -> dict[str, Model]:
    models = {}
    for name, config in demo_configs(seconds).items():
        digest = hashlib.sha256(json.dumps(config.to_dict()).encode()).hexdigest()[:8]
        folder = output / "runs" / f"{name}-{digest}"
        with progress_bar(f"corpus of {config.data.shapes} generated shapes", quiet) as corpus:
            split = split_indices(config.data)
            bands, bounces = labels_of(config.model)
            build_corpus(config.data, bands, np.concatenate(split), corpus, bounces=bounces)
        say(f"training {name} for {config.train.seconds:.0f} s", quiet)
        with progress_bar(f"training {name}", quiet) as update:
            report = lambda phase, fraction, measures, u=update: u(round(1000 * fraction), 1000)  # noqa: E731
            models[name] = load_model(run_config(config, folder, report=report)[0])
    return models


def _results(mesh: Mesh, found: dict[str, np.ndarray]) -> dict[str, Transfer]:
    """The methods as the page shows them, the best one first; it has the closed form by itself."""
    names = {"reference": f"reference, {REFERENCE_RAYS} rays a vertex", **{name: f"network {name}" for name in MODELS}}
    names |= {name: name for name in found if name.startswith("plain bake")}
    return {name: Transfer(found[key], None, *mesh, {"method": name}) for key, name in names.items()}


def _draw(mesh: Mesh, found: dict[str, np.ndarray], light: np.ndarray, rows: list[dict[str, Any]], path: Path) -> None:
    """Reference, closed form, prediction and their differences under the light, front and back, at one exposure."""
    skills = {row["method"]: row["skill"] for row in rows}
    label = {n: f"skill {s:.2f}" if isinstance(s, float) else s for n, s in skills.items()}
    names = {"reference": f"reference\n{REFERENCE_RAYS} rays per vertex"}
    names |= {"closed form": f"closed form, no shadows\n{label['closed form']}"}
    names |= {"local": f"prediction (local), no rays\n{label['local']}"}
    radiance = {name: np.asarray(shade(found[name], light)) for name in names}
    hits = {view: cast_view(mesh, view, 360) for view in ("front", "back")}
    exposure = exposure_for([shade_view(hit, radiance["reference"]) for hit in hits.values()])
    panels = []
    for view, hit in hits.items():
        images = {name: shade_view(hit, values) for name, values in radiance.items()}
        panels += [Panel(f"{names[name]}, {view}", to_srgb(*image, exposure)) for name, image in images.items()]
        for name in ("closed form", "local"):
            wrong = (images[name][0] - images["reference"][0]).mean(-1) * exposure
            colors = signed_colors(wrong, FULL, images[name][1])
            panels.append(Panel(f"{name} - reference\n(1 is white)", colors, FULL))
    write_picture(path, montage(panels, columns=5))
