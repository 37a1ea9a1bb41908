"""Files in the conventions of other programs (`engines`), as those programs read them, and back.

    .npz    `coefficients`, of a transfer also its mesh, and `metadata`
    .json   {"convention", "kind", "bands", "coefficients"}; of a light for three.js an object for its ObjectLoader, of
            one for Unity also SphericalHarmonicsL2[channel][k] and the seven float4 that ShadeSH9 reads
    .txt    a row for each coefficient of a light, for each vertex of a transfer; for Filament the `sh.txt` of cmgen; a
            transfer for PIFu has `face.npy` beside it
    .npy    the array alone; a light for PIFu is an `env_sh.npy` of one light

Coefficients that go out may come back: what is read is ours again, in float32.
"""

import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from gash_jax.files.atomic import FileError, check_writable, whole_file, write_text
from gash_jax.files.npz import read_array, read_npz, write_npz
from gash_jax.light.conversion import to_convention
from gash_jax.light.environment import Light
from gash_jax.prt.transfer import Transfer

FORMAT = "gash-converted"
SUFFIXES = (".npz", ".json", ".txt", ".npy")
FACES = "face.npy"  # beside a transfer for PIFu
_MESH = ("vertices", "normals", "faces")
_LABELS = [f"L{band}{m}" for band in range(3) for m in range(-band, band + 1)]


def written_beside(path: Path, value: Light | Transfer, name: str) -> list[Path]:
    """The files that `write_numbers` will write. Raises FileError for a name of no kind that it knows."""
    if path.suffix.lower() not in SUFFIXES:
        raise FileError(f"{path}: numbers are written as {' '.join(SUFFIXES)}, and a transfer also as .glb")
    coloured = isinstance(value, Transfer) and value.coefficients.ndim == 3
    if path.suffix.lower() == ".txt" and coloured:
        raise FileError(f"{path}: a row of text has no place for red, green and blue: write .json, .npy or .npz")
    faces = name == "pifu" and isinstance(value, Transfer) and path.suffix.lower() == ".txt"
    return [path, path.with_name(FACES)] if faces else [path]


def write_numbers(
    path: Path, value: Light | Transfer, name: str, corners: Int[np.ndarray, "f 3"] | None = None
) -> None:
    """Write a light or a transfer in a convention, in the form that the suffix says; whole or not at all.

    `corners` takes the place of the transfer's faces in `face.npy`. Raises FileError, and ValueError for bands that the
    other program does not read.
    """
    numbers = to_convention(value, name)
    files = [check_writable(file) for file in written_beside(path, value, name)]
    suffix = path.suffix.lower()
    if len(files) == 2:
        assert isinstance(value, Transfer)
        with whole_file(files[1]) as temporary, open(temporary, "wb") as file:
            np.save(file, value.faces if corners is None else corners)
    if suffix == ".npz":
        mesh = {} if isinstance(value, Light) else {k: np.asarray(getattr(value, k)) for k in _MESH}
        entries = {"format": FORMAT, **_entries(value, name), "original": dict(value.metadata)}
        write_npz(path, {"coefficients": numbers, **mesh}, entries)
    elif suffix == ".json":
        write_text(path, json.dumps(_json(value, name, numbers)) + "\n")
    elif suffix == ".txt" and name == "filament" and isinstance(value, Light):
        write_text(path, _cmgen_text(numbers))
    else:
        with whole_file(path) as temporary, open(temporary, "wb") as file:
            if suffix == ".txt":
                np.savetxt(file, numbers, "%.8f" if name == "pifu" else "%.9g")
            else:
                np.save(file, numbers[None] if name == "pifu" and isinstance(value, Light) else numbers)


def _entries(value: Light | Transfer, name: str) -> dict[str, Any]:
    kind = "light" if isinstance(value, Light) else "transfer"
    return {"convention": name, "kind": kind, "bands": value.bands}


def _json(value: Light | Transfer, name: str, numbers: np.ndarray) -> dict[str, Any]:
    if name == "three" and isinstance(value, Light):
        probe = {"type": "LightProbe", "color": 0xFFFFFF, "intensity": 1, "sh": numbers.ravel().tolist()}
        return {"metadata": {"version": 4.7, "type": "Object", "generator": "gash_jax"}, "object": probe}
    entries = {**_entries(value, name), "coefficients": numbers.tolist()}
    if name.startswith("unity") and isinstance(value, Light):
        entries["SphericalHarmonicsL2"] = numbers.T.tolist()
        entries |= {key: row.tolist() for key, row in unity_constants(numbers).items()}
    return entries


def unity_constants(numbers: Float[np.ndarray, "9 3"]) -> dict[str, Float[np.ndarray, "4"]]:
    """The float4 that Unity's shaders read (HDRP, SphericalHarmonics.cs, PackCoefficients)."""
    found = {}
    for colour, k in zip("rgb", numbers.T, strict=True):
        found[f"unity_SHA{colour}"] = np.array([k[3], k[1], k[2], k[0] - k[6]])
        found[f"unity_SHB{colour}"] = np.array([k[4], k[5], 3.0 * k[6], k[7]])
    return {**found, "unity_SHC": np.append(numbers[8], 1.0)}


def _cmgen_text(numbers: Float[np.ndarray, "k 3"]) -> str:
    rows = zip(numbers, _LABELS, strict=False)
    return "".join(f"({r:.15f}, {g:.15f}, {b:.15f}); // {k}, irradiance, pre-scaled base\n" for (r, g, b), k in rows)


def read_numbers(path: Path, name: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The numbers of a file in a convention, and the arrays of a mesh where it holds one.

    Raises FileError, also where the file says that it is in another one.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FileError(f"{path}: numbers are read from {' '.join(SUFFIXES)}")
    if not path.is_file():
        raise FileError(f"no such file: {path}")
    mesh: dict[str, np.ndarray] = {}
    if suffix == ".npz":
        arrays, metadata = read_npz(path, "converted", ("coefficients",))
        _check_name(path, metadata.get("convention", "gash"), name)
        numbers = arrays["coefficients"]
        mesh = {key: arrays[key] for key in _MESH if key in arrays}
    elif suffix == ".npy":
        numbers = read_array(path)
        numbers = numbers[0] if numbers.ndim == 3 and len(numbers) == 1 else numbers
    else:
        try:
            numbers, said = _from_text(path.read_text(encoding="utf-8"), suffix)
        except (ValueError, LookupError, TypeError, RecursionError):
            raise FileError(f"{path} holds no table of coefficients: write it again") from None
        _check_name(path, said or name, name)
    if numbers.dtype.kind not in "fiu" or not np.isfinite(numbers).all():
        raise FileError(f"{path} holds values that are not finite numbers: write it again")
    return numbers, mesh


def _check_name(path: Path, said: str, name: str) -> None:
    if said != name:
        ours = "our own: it needs no --from" if said == "gash" else f"those of {said}: use --from {said}"
        raise FileError(f"the numbers in {path} are {ours}")


def _from_text(text: str, suffix: str) -> tuple[Float[np.ndarray, "..."], str | None]:
    """The table in a text, and the convention that it names, if any."""
    if suffix == ".json":
        entries = json.loads(text)
        probe = entries.get("object", {}).get("sh")
        if probe is not None:
            return np.reshape(np.array(probe, np.float64), (-1, 3)), "three"
        return np.array(entries["coefficients"], np.float64), entries.get("convention")
    return np.loadtxt(io.StringIO(re.sub(r"//[^\n]*|[(),;]", " ", text)), ndmin=2), None
