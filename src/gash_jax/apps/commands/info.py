"""`gash info`: a mesh's health, or what a file of the project says of itself."""

import json
from pathlib import Path
from typing import Any

import click

from gash_jax.apps.options import PATH, Command, json_option
from gash_jax.apps.printing import number
from gash_jax.files.atomic import FileError
from gash_jax.files.npz import read_npz
from gash_jax.formats.meshes import read_mesh


@click.command(cls=Command, epilog="gash info bunny.npz")
@click.argument("file", type=PATH)
@json_option
def info(file: Path, as_json: bool) -> None:
    """Say what FILE (mesh, transfer, light or model) holds; a mesh gets its health report."""
    values = _archive(file) if file.suffix == ".npz" else _mesh(file)
    click.echo(json.dumps(values) if as_json else "\n".join(_lines(values)))


def _mesh(path: Path) -> dict[str, Any]:
    mesh, health = read_mesh(path)
    return {"kind": "mesh", "vertices": len(mesh.vertices), "faces": len(mesh.faces), "health": health.to_dict()}


def _archive(path: Path) -> dict[str, Any]:
    """Kind, arrays and metadata of an npz file; raises FileError for one that another program wrote."""
    arrays, metadata = read_npz(path, "gash_jax", ())
    if "format" not in metadata:
        raise FileError(f"{path} was not written by gash_jax")
    values: dict[str, Any] = {"kind": metadata["format"].removeprefix("gash-")}
    if values["kind"] == "transfer":
        from gash_jax.prt.transfer import load_transfer  # it waits for JAX

        load_transfer(path)  # refuses what does not fit together
    if values["kind"] == "model":
        values["parameters"] = sum(array.size for array in arrays.values())
    return {**values, "arrays": {name: list(array.shape) for name, array in arrays.items()}, **metadata}


def _lines(entries: dict[str, Any], indent: str = "") -> list[str]:
    """The same for people: one line an entry, nested entries indented."""
    lines = []
    for key, value in entries.items():
        if isinstance(value, dict):
            lines += [f"{indent}{key}:", *_lines(value, indent + "  ")]
        elif isinstance(value, list) and any(isinstance(entry, str) for entry in value):
            lines += [f"{indent}{key}:", *(f"{indent}  {entry}" for entry in value)]
        else:
            lines.append(f"{indent}{key}: {number(value)}")
    return lines
