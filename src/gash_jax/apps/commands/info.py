"""`gash info`: what a file or folder holds; a mesh's health, an animation's frames, a map's range, what own files say.

Readers are imported when a file of their kind comes: some wait for JAX.
"""

import json
from pathlib import Path
from typing import Any

import click
import numpy as np

from gash_jax.apps.options import PATH, Command, json_option
from gash_jax.apps.printing import number
from gash_jax.files.atomic import FileError
from gash_jax.files.npz import read_npz
from gash_jax.formats.animations import GLTF, animation_form, load_animation
from gash_jax.formats.gltf_animation import clip_names, moves
from gash_jax.formats.maps import SUFFIXES, read_map
from gash_jax.formats.meshes import READERS, read_mesh
from gash_jax.formats.others import OTHERS
from gash_jax.formats.picture import LightError

CONFIGS = (".toml", ".json")
ONNX = ".onnx"
RESULTS, RUN = "results.jsonl", "config.json"


@click.command(cls=Command, epilog="gash info bunny.npz")
@click.argument("file", type=PATH)
@json_option
def info(file: Path, as_json: bool) -> None:
    """Say what FILE holds: a mesh with its health, an animation, a map, a config, an ONNX file, what gash wrote."""
    values = _describe(file)
    click.echo(json.dumps(values) if as_json else "\n".join(_lines(values)))


def _describe(path: Path) -> dict[str, Any]:
    suffix = path.suffix.lower()
    if path.is_dir():
        return _folder(path)
    if not path.exists():
        raise FileError(f"no such file: {path}")
    if suffix == ".npz":
        return _archive(path)
    if suffix in SUFFIXES:
        return _map(path)
    if suffix in CONFIGS:
        return _config(path)
    if suffix == ONNX:
        return _onnx(path)
    if suffix in READERS or suffix in OTHERS:
        return _mesh(path) | (_animation(path) if suffix in GLTF and moves(path) else {})
    known = " ".join([*READERS, *OTHERS, *SUFFIXES, ".npz", *CONFIGS, ONNX])
    raise FileError(f"{path}: not a kind of file that gash knows; known are {known}, folders of runs and of sweeps")


def _mesh(path: Path) -> dict[str, Any]:
    mesh, health = read_mesh(path)
    return {"kind": "mesh", "vertices": len(mesh.vertices), "faces": len(mesh.faces), "health": health.to_dict()}


def _animation(path: Path) -> dict[str, Any]:
    """Frames of an animation and what moves in them; every frame is checked."""
    animation = load_animation(path)
    mesh, seconds = animation.mesh, animation.seconds
    return {
        **{"kind": "animation", "frames": len(animation), "vertices": len(mesh.vertices), "faces": len(mesh.faces)},
        **{"shapes": animation.shape_weights.shape[1], "bones": animation.transforms.shape[1]},
        **{"names": list(animation.names), "clips": clip_names(path) if path.suffix.lower() in GLTF else []},
        "seconds": None if seconds is None or not len(seconds) else [float(seconds[0]), float(seconds[-1])],
        "notes": list(animation.notes),
    }


def _map(path: Path) -> dict[str, Any]:
    """Size, layout and range of an environment map; a layout that is neither said nor certain is left open."""
    from gash_jax.light.layouts import layout_of

    picture = read_map(path)
    radiance, notes = picture.radiance, list(picture.notes)
    try:
        layout, more = layout_of(radiance, picture.layout)
        notes += more
    except LightError as error:
        layout, notes = "unknown", [*notes, str(error)]
    lit = radiance[radiance > 0]
    return {
        **{"kind": "environment map", "width": radiance.shape[1], "height": radiance.shape[0], "layout": layout},
        "radiance": {
            **{"least": float(radiance.min()), "least_above_0": float(lit.min()) if lit.size else None},
            **{"mean": float(radiance.mean(dtype=np.float64)), "most": float(radiance.max())},
        },
        "notes": notes,
    }


def _archive(path: Path) -> dict[str, Any]:
    """Kind, arrays and metadata of an npz file; raises FileError for one that another program wrote or that is damaged.

    Files that a command reads are read as it would: what does not fit together is refused.
    """
    if animation_form(path):
        return _animation(path)
    arrays, metadata = read_npz(path, "gash_jax", ())
    kind = str(metadata.get("format", "")).removeprefix("gash-") or _cached_kind(arrays, metadata)
    if not kind:
        raise FileError(f"{path} was not written by gash_jax")
    values: dict[str, Any] = {"kind": kind}
    if kind == "transfer":
        from gash_jax.prt.transfer import load_transfer

        load_transfer(path)
    if kind == "transfer-texture":
        from gash_jax.prt.texture import load_texture

        load_texture(path)
    if kind == "light":
        from gash_jax.light.environment import load_light

        load_light(path, 1)
    if kind == "model":
        from gash_jax.models.model import load_model

        load_model(path)
        values["parameters"] = sum(array.size for array in arrays.values())
    if kind == "corpus item":
        from gash_jax.train.corpus import load_item

        load_item(path)
        metadata = {"shape": metadata["kind"], **{name: metadata[name] for name in metadata if name != "kind"}}
    return {**values, "arrays": {name: list(array.shape) for name, array in arrays.items()}, **metadata}


def _cached_kind(arrays: dict[str, np.ndarray], metadata: dict[str, Any]) -> str:
    """What the cache holds says it by its arrays: labelled shapes and reference bakes; "" for anything else."""
    if {"coefficients", "visibility", "faces"} <= arrays.keys() and {"kind", "index", "seed"} <= metadata.keys():
        return "corpus item"
    return "reference" if {"coefficients", "standard_error"} == arrays.keys() and "curve" in metadata else ""


def _config(path: Path) -> dict[str, Any]:
    """A config of a run with all it inherits, or of a sweep. Raises ConfigError for another file."""
    import tomllib

    from gash_jax.train.config import load_config
    from gash_jax.train.sweep import load_sweep

    try:
        is_sweep = path.suffix.lower() == ".toml" and "axes" in tomllib.loads(path.read_text(encoding="utf-8"))
    except ValueError:  # no TOML, no UTF-8: load_config says so
        is_sweep = False
    if is_sweep:
        name, runs = load_sweep(path)
        return {"kind": "sweep config", "name": name, "runs": len(runs), "axes": list(runs[0].point)}
    return {"kind": "config", **load_config(path).to_dict()}


def _onnx(path: Path) -> dict[str, Any]:
    try:
        from gash_jax.apps.exports.onnx_reader import describe_onnx
    except ModuleNotFoundError as error:
        raise click.ClickException(f"{error.name} is not installed: pip install 'gash-jax[onnx]'") from None
    return describe_onnx(path)


def _folder(path: Path) -> dict[str, Any]:
    """What a run or a sweep has come to. Raises FileError for another folder."""
    from gash_jax.train.checkpoint import has_checkpoint
    from gash_jax.train.config import load_config
    from gash_jax.train.logs import read_lines, whole_lines

    if (path / RUN).is_file():
        config, lines = load_config(path / RUN), read_lines(path)
        validated = [line for line in lines if "validation" in line]
        return {
            **{"kind": "run", "name": config.name, "model": config.model.name, "bands": config.model.bands},
            **{"finished": (path / "model.npz").is_file(), "checkpoint": has_checkpoint(path)},
            "steps": {line["phase"]: line["step"] for line in lines},
            "last_validation": validated[-1] if validated else None,
            "config": config.to_dict(),
        }
    if (path / RESULTS).is_file():
        lines = [line for line in whole_lines(path / RESULTS) if "id" in line]
        best = max((line for line in lines if "skill" in line), key=lambda line: line["skill"], default=None)
        started = len(list((path / "runs").glob("*"))) if (path / "runs").is_dir() else 0
        return {"kind": "sweep", "finished": len(lines), "started": max(started, len(lines)), "best": best}
    raise FileError(f"{path} is a folder, but of no run ({RUN}) and of no sweep ({RESULTS}): name a file in it")


def _lines(entries: dict[str, Any], indent: str = "") -> list[str]:
    """The same for people: one line an entry, nested entries indented."""
    lines = []
    for key, value in entries.items():
        if isinstance(value, dict) and {"type", "shape"} <= value.keys():  # an array of an ONNX file
            sides = ", ".join(map(str, value["shape"]))
            lines.append(f"{indent}{key}: {value['type']} ({sides}) {value.get('meaning', '')}".rstrip())
        elif isinstance(value, dict):
            lines += [f"{indent}{key}:", *_lines(value, indent + "  ")]
        elif isinstance(value, list) and any(isinstance(entry, str) for entry in value):
            lines += [f"{indent}{key}:", *(f"{indent}  {entry}" for entry in value)]
        else:
            lines.append(f"{indent}{key}: {number(value)}")
    return lines
