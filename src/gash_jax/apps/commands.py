"""Commands that need no network: compare, light, render, info.

Inputs are checked before work begins, outputs are written last.
"""

from pathlib import Path
from typing import Any

import numpy as np

from gash_jax.apps.pictures.montage import montage, write_png
from gash_jax.apps.pictures.views import cast_view, exposure_for, shade_view, to_srgb
from gash_jax.apps.progress import progress_bar, say
from gash_jax.files.atomic import FileError, check_writable
from gash_jax.files.npz import read_npz
from gash_jax.formats.meshes import read_mesh
from gash_jax.light.environment import load_light, save_light
from gash_jax.light.shading import shade
from gash_jax.measure import metrics
from gash_jax.prt.transfer import Transfer, load_transfer


def _require_same_mesh(transfer: Transfer, reference: Transfer) -> None:
    same_faces = transfer.faces.shape == reference.faces.shape and np.array_equal(transfer.faces, reference.faces)
    if transfer.vertices.shape != reference.vertices.shape or not same_faces:
        raise ValueError(
            f"the two files are of different meshes ({len(transfer.vertices)} and {len(reference.vertices)} vertices, "
            f"{len(transfer.faces)} and {len(reference.faces)} faces): bake both from the same file"
        )
    size = max(float(np.ptp(reference.vertices, axis=0).max()), 1e-30)
    if float(np.abs(transfer.vertices - reference.vertices).max()) > 1e-6 * size:
        raise ValueError("the two files are of different meshes (vertices moved): bake both from the same file")
    if transfer.bands != reference.bands:
        raise ValueError(f"the two files have {transfer.bands} and {reference.bands} bands: bake one of them again")


def compare(transfer_path: Path, reference_path: Path, quiet: bool) -> dict[str, Any]:
    """`gash compare`: every measure of a transfer against a reference of the same mesh."""
    transfer, reference = load_transfer(transfer_path), load_transfer(reference_path)
    _require_same_mesh(transfer, reference)
    estimate, truth = transfer.coefficients, reference.coefficients
    per_mse, per_std = metrics.coefficient_errors(estimate, truth)
    rays = reference.metadata.get("parameters", {}).get("rays")
    if rays is None:
        raise ValueError(f"{reference_path} is not a bake: compare with one, such as gash bake MESH --rays 4096")
    with progress_bar("baking the yardstick", quiet) as update:
        curve = metrics.plain_bake_curve(reference.mesh, truth, rays, progress=update)
    error = metrics.mse(estimate, truth)
    return {
        "relrmse": metrics.relrmse(estimate, truth),
        "skill": metrics.skill(estimate, truth, reference.normals),
        "mse": error,
        "mse_per_coefficient": per_mse.tolist(),
        "std": per_std.tolist(),
        "shadow_mse": metrics.shadow_mse(estimate, truth),
        "equivalent_rays": metrics.equivalent_rays(error, curve) if np.any(truth) else "no transfer",
        "vertices": len(truth),
        "bands": reference.bands,
        "reference_rays": rays,
    }


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def comparison_text(values: dict[str, Any]) -> str:
    """The measures for people."""
    names = (
        "relrmse",
        "skill",
        "mse",
        "shadow_mse",
        "equivalent_rays",
        "vertices",
        "bands",
        "reference_rays",
    )
    lines = [f"{name:16s} {_number(values[name])}" for name in names]
    lines += ["per coefficient  " + " ".join(f"{k}" for k in ("mse", "std"))]
    pairs = zip(values["mse_per_coefficient"], values["std"], strict=True)
    lines += [f"  {index:3d}            {m:.3e} {s:.3e}" for index, (m, s) in enumerate(pairs)]
    return "\n".join(lines)


def light(map_path: Path, output: Path, bands: int, quiet: bool) -> None:
    """`gash light`."""
    check_writable(output)
    projected = load_light(map_path, bands)
    save_light(output, projected)
    say("coefficient      red      green       blue", quiet)
    for index, rgb in enumerate(np.asarray(projected.coefficients)):
        say(f"  {index:3d}     " + " ".join(f"{value:10.5f}" for value in rgb), quiet)
    say(f"wrote {output}", quiet)


def render(transfer_path: Path, light_path: Path, output: Path, views: tuple[str, ...], size: int, quiet: bool) -> None:
    """`gash render`."""
    check_writable(output)
    transfer = load_transfer(transfer_path)
    radiance = np.asarray(shade(transfer.coefficients, load_light(light_path, transfer.bands)))
    images = []
    with progress_bar("rendering", quiet) as update:
        for step, view in enumerate(views):
            images.append(shade_view(cast_view(transfer.mesh, view, size), radiance))
            update(step + 1, len(views))
    exposure = exposure_for(images)
    panels = [(view, to_srgb(image, covered, exposure)) for view, (image, covered) in zip(views, images, strict=True)]
    write_png(output, montage(panels))
    say(f"wrote {output} ({len(views)} views, {size} pixels each)", quiet)


def info(path: Path) -> dict[str, Any]:
    """`gash info`: a mesh's health, or the metadata of an npz file."""
    if path.suffix != ".npz":
        mesh, health = read_mesh(path)
        return {
            "kind": "mesh",
            "vertices": len(mesh.vertices),
            "faces": len(mesh.faces),
            "health": health.to_dict(),
        }
    arrays, metadata = read_npz(path, "gash_jax", ())
    shapes = {name: list(array.shape) for name, array in arrays.items()}
    if metadata.get("format") == "gash-model":
        return {
            "kind": "model",
            "parameters": sum(array.size for array in arrays.values()),
            "arrays": shapes,
            **metadata,
        }
    if "format" not in metadata:
        raise FileError(f"{path} was not written by gash_jax")
    return {"kind": metadata["format"].removeprefix("gash-"), "arrays": shapes, **metadata}


def info_text(values: dict[str, Any]) -> str:
    """The same for people: one line an entry, nested entries indented."""

    def lines(entries: dict[str, Any], indent: str) -> list[str]:
        out = []
        for key, value in entries.items():
            if isinstance(value, dict):
                out += [f"{indent}{key}:", *lines(value, indent + "  ")]
            elif isinstance(value, list) and any(isinstance(entry, str) for entry in value):
                out += [f"{indent}{key}:", *(f"{indent}  {entry}" for entry in value)]
            else:
                out.append(f"{indent}{key}: {_number(value)}")
        return out

    return "\n".join(lines(values, ""))
