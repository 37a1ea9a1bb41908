"""GashTransfer.cs, compiled against as much of Unity as it touches and run by Mono: what the shader is sent.

The sum that GashTransfer.shader forms of it is done here. Unity itself is not run.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gash_jax
from gash_jax.formats.gltf_document import open_document
from gash_jax.light.conventions import axis_map
from gash_jax.light.engines import convention
from gash_jax.light.environment import load_light
from gash_jax.prt.transfer import load_transfer
from tests.formats.test_gltf_writing import accessors
from tests.helpers.tools import tool
from tests.runtimes.engines.conftest import TURN, convert, matrix

HERE = Path(__file__).parent
SOURCE = Path(__file__).parents[3] / "runtimes" / "engines" / "GashTransfer.cs"
STILL = (0.0, 0.0, 0.0, 1.0)
REST = (0.0, 0.6, 0.0, 0.8)
AXES = axis_map(convention("unity-gltf").axes)
UNITY = ("--to", "unity-gltf", "--attributes", "uv", "--bands", "3")


def compiled(source: Path, output: Path) -> str:
    """What the compiler says, warnings too."""
    result = tool("mcs", "-warnaserror", f"-out:{output}", HERE / "unity.cs", source)
    return result.stdout + result.stderr


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("unity") / "engines.exe"
    assert compiled(SOURCE, path) == ""
    return path


def answer(program: Path, asset: Path, light: Path | str, probe: Any = None, **turns: tuple[float, ...]) -> Any:
    numbers = np.zeros(27) if probe is None else np.asarray(probe)
    quaternions = [turns.get(name, STILL) for name in ("rest", "root", "now")]
    words = [",".join(str(float(x)) for x in values) for values in (numbers.ravel(), *quaternions)]
    return tool("mono", program, asset, light, *words)


def sent(program: Path, asset: Path, light: Path | str, probe: Any = None, **turns: tuple[float, ...]) -> dict:
    result = answer(program, asset, light, probe, **turns)
    assert result.returncode == 0, result.stderr
    return {name: np.array(values) for name, values in json.loads(result.stdout).items()}


def radiance(asset: Path, uniforms: dict) -> np.ndarray:
    """What the shader sums up, from texture coordinates as an importer leaves them: v from below."""
    content = asset.read_bytes()
    first = int(uniforms["gashFirstSet"][0])
    pairs = [accessors(content, f"TEXCOORD_{first + i}")[0] for i in range(5)]
    imported = [np.stack([pair[:, 0], 1 - pair[:, 1]], axis=1) for pair in pairs]
    stored = np.concatenate([np.stack([pair[:, 0], 1 - pair[:, 1]], axis=1) for pair in imported], axis=1)
    stored = np.pad(stored, ((0, 0), (0, 2)))
    rows = stored * uniforms["gashScale"] + uniforms["gashOffset"]
    return rows @ uniforms["gashLight"].reshape(3, 12).T


def ours(rotation: np.ndarray) -> np.ndarray:
    """A rotation of Unity's axes in ours."""
    return AXES.T @ rotation @ AXES


def wanted(made: Path, rotation: np.ndarray) -> np.ndarray:
    transfer = np.asarray(load_transfer(made / "grey.npz").coefficients)[:, :9]
    light = np.asarray(load_light(made / "nine.npz").coefficients)
    return np.asarray(gash_jax.shade(transfer, gash_jax.rotate_light(light, ours(rotation).T)))


@pytest.mark.parametrize(("store", "tolerance"), [("float", 2e-5), ("short", 2e-3), ("byte", 0.3)])
@pytest.mark.parametrize("turn", [STILL, TURN], ids=["at rest", "turned"])
def test_the_shader_sums_up_to_the_radiance(
    store: str, tolerance: float, turn: tuple[float, ...], made: Path, program: Path
) -> None:
    asset, light = made / f"unity-{store}.glb", made / "unity.json"
    convert(made / "grey.npz", "-o", asset, *UNITY, "--store", store)
    convert(made / "nine.npz", "--to", "unity-gltf", "-o", light)
    found = radiance(asset, sent(program, asset, light, now=turn))
    # rounded to 65535 or 255 levels, nine coefficients whose factors reach about 10
    np.testing.assert_allclose(found, wanted(made, matrix(turn)), atol=tolerance)
    assert found.std() > 0.5


def test_the_ambient_probe_lights_where_no_file_is_given(made: Path, program: Path) -> None:
    convert(made / "grey.npz", "-o", made / "probe.glb", *UNITY)
    probe = gash_jax.to_convention(load_light(made / "nine.npz"), "unity-gltf").T
    found = radiance(made / "probe.glb", sent(program, made / "probe.glb", "-", probe, now=TURN))
    np.testing.assert_allclose(found, wanted(made, matrix(TURN)), atol=2e-5)


def test_light_is_turned_by_what_moved_since_the_bake(made: Path, program: Path) -> None:
    """A node that rests at an angle, in a file that was put into the scene at another."""
    convert(made / "grey.npz", "-o", made / "node.glb", *UNITY)
    probe = gash_jax.to_convention(load_light(made / "nine.npz"), "unity-gltf").T
    uniforms = sent(program, made / "node.glb", "-", probe, rest=REST, root=TURN, now=(0.6, 0.0, 0.0, 0.8))
    moved = matrix((0.6, 0.0, 0.0, 0.8)) @ matrix(REST).T
    np.testing.assert_allclose(radiance(made / "node.glb", uniforms), wanted(made, moved), atol=2e-5)


def test_the_first_set_follows_the_files_own(made: Path, program: Path) -> None:
    convert(made / "grey.npz", "-o", made / "plain.glb", *UNITY)
    content = (made / "plain.glb").read_bytes()
    (mesh,) = open_document(content, made).json["meshes"]
    assert mesh["extras"]["gash"]["attributes"][0] == "TEXCOORD_1"
    later = content
    for n in range(5, 0, -1):  # five sets, as if one came before
        later = later.replace(f"TEXCOORD_{n}".encode(), f"TEXCOORD_{n + 1}".encode())
    (made / "later.glb").write_bytes(later)
    found = [sent(program, made / name, "-")["gashFirstSet"].tolist() for name in ("plain.glb", "later.glb")]
    assert found == [[1.0], [2.0]]


def test_swapped_coefficients_are_noticed(made: Path, program: Path) -> None:
    convert(made / "grey.npz", "-o", made / "known.glb", *UNITY)
    probe = gash_jax.to_convention(load_light(made / "nine.npz"), "unity-gltf").T
    for swapped in (probe[:, [0, 3, 2, 1, 4, 5, 6, 7, 8]], probe[[1, 0, 2]]):
        found = radiance(made / "known.glb", sent(program, made / "known.glb", "-", swapped))
        assert np.abs(found - wanted(made, np.eye(3))).max() > 0.1


def test_wrong_source_is_noticed(tmp_path: Path) -> None:
    text = SOURCE.read_text()
    for right, wrong in (("glb.Length < 20", "glb.Lenght < 20"), ("return packed;", "return packed")):
        assert text.count(right) == 1
        (tmp_path / "Wrong.cs").write_text(text.replace(right, wrong))
        assert "error CS" in compiled(tmp_path / "Wrong.cs", tmp_path / "wrong.exe")


def test_a_wrong_sign_in_the_turn_is_noticed(made: Path, tmp_path: Path) -> None:
    text = SOURCE.read_text()
    assert text.count("-c[8] - c[6]") == 1
    (tmp_path / "Wrong.cs").write_text(text.replace("-c[8] - c[6]", "c[8] - c[6]"))
    assert compiled(tmp_path / "Wrong.cs", tmp_path / "wrong.exe") == ""
    convert(made / "grey.npz", "-o", made / "sign.glb", *UNITY)
    probe = gash_jax.to_convention(load_light(made / "nine.npz"), "unity-gltf").T
    found = radiance(made / "sign.glb", sent(tmp_path / "wrong.exe", made / "sign.glb", "-", probe, now=TURN))
    assert np.abs(found - wanted(made, matrix(TURN))).max() > 0.1


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (("--bands", "3"), "convert with --to unity-gltf --attributes uv --bands 3"),
        (("--bands", "3", "--attributes", "uv"), "convert with --to unity-gltf --attributes uv --bands 3"),
        (None, "no .glb file: give the one that gash convert wrote"),
    ],
)
def test_files_that_it_cannot_read_are_refused(
    extra: tuple[str, ...] | None, message: str, made: Path, program: Path
) -> None:
    if extra is None:
        (made / "other.glb").write_bytes(b"no file of that kind, and longer than a head")
    else:
        convert(made / "grey.npz", "-o", made / "other.glb", *extra)
    result = answer(program, made / "other.glb", "-")
    assert result.returncode == 2 and result.stderr.strip() == message
