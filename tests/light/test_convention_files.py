"""Files for other programs, read the way those programs read them, and back."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import gash_jax
from gash_jax.files.atomic import FileError
from gash_jax.light.convention_files import read_numbers, write_numbers, written_beside
from gash_jax.light.engines import CONVENTIONS
from gash_jax.light.environment import Light
from gash_jax.prt.transfer import Transfer
from gash_jax.shapes.primitives import icosphere
from tests.helpers.engine_formulas import filament, shade_sh9
from tests.helpers.node import run_node

RNG = np.random.default_rng(5)
LIGHT = Light(RNG.normal(size=(9, 3)).astype(np.float32), {"notes": ["made up"]})
BALL = icosphere(1)
TRANSFER = Transfer(RNG.normal(size=(len(BALL.vertices), 9)).astype(np.float32), None, *BALL, {})
COLOURED = TRANSFER._replace(coefficients=RNG.normal(size=(len(BALL.vertices), 9, 3)).astype(np.float32))
NORMALS = RNG.normal(size=(20, 3))
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)


@pytest.mark.parametrize("suffix", [".npz", ".json", ".txt", ".npy"])
@pytest.mark.parametrize("name", CONVENTIONS)
def test_there_and_back(name: str, suffix: str, tmp_path: Path) -> None:
    for value, file in ((LIGHT, "light"), (TRANSFER, "transfer")):
        path = tmp_path / f"{file}{suffix}"
        write_numbers(path, value, name)
        numbers, mesh = read_numbers(path, name)
        np.testing.assert_allclose(numbers, gash_jax.to_convention(value, name), atol=2e-7)
        back = gash_jax.from_convention(numbers, name)
        back = back.coefficients if isinstance(back, Light) else back
        np.testing.assert_allclose(back, value.coefficients, atol=1e-4)
        assert set(mesh) == ({"vertices", "normals", "faces"} if suffix == ".npz" and value is TRANSFER else set())
        assert not list(tmp_path.glob("*.tmp"))


def test_coloured_transfer(tmp_path: Path) -> None:
    for suffix in (".npz", ".json", ".npy"):
        write_numbers(tmp_path / f"c{suffix}", COLOURED, "unity")
        numbers, _ = read_numbers(tmp_path / f"c{suffix}", "unity")
        back = np.asarray(gash_jax.from_convention(numbers, "unity"))
        np.testing.assert_allclose(back, COLOURED.coefficients, atol=1e-5)
    with pytest.raises(FileError, match="a row of text has no place for red, green and blue"):
        write_numbers(tmp_path / "c.txt", COLOURED, "pifu")


def test_unity_reads_seven_float4(tmp_path: Path) -> None:
    write_numbers(tmp_path / "u.json", LIGHT, "unity")
    entries = json.loads((tmp_path / "u.json").read_text())
    constants = {key: np.array(value) for key, value in entries.items() if key.startswith("unity_")}
    assert len(constants) == 7 and np.shape(entries["SphericalHarmonicsL2"]) == (3, 9)
    shown = shade_sh9(constants, NORMALS * [1, 1, -1])
    transfer = np.asarray(gash_jax.unshadowed_transfer(NORMALS.astype(np.float32), 3))
    np.testing.assert_allclose(shown, transfer @ LIGHT.coefficients, atol=1e-5)


def test_filament_reads_lines_of_cmgen(tmp_path: Path) -> None:
    """filamentapp, IBL.cpp: sscanf(line, "(%f,%f,%f)") of nine lines."""
    write_numbers(tmp_path / "sh.txt", LIGHT, "filament")
    lines = (tmp_path / "sh.txt").read_text().splitlines()
    found = [re.match(r"\(\s*(\S+),\s*(\S+),\s*(\S+)\)", line) for line in lines]
    numbers = np.array([[float(word) for word in match.groups()] for match in found if match])
    assert [line.split("// ")[1].split(",")[0] for line in lines[:4]] == ["L00", "L1-1", "L10", "L11"]
    transfer = np.asarray(gash_jax.unshadowed_transfer(NORMALS.astype(np.float32), 3))
    np.testing.assert_allclose(filament(numbers, NORMALS), transfer @ LIGHT.coefficients, atol=1e-5)


def test_three_reads_an_object(tmp_path: Path) -> None:
    """three.js itself: ObjectLoader, then getIrradianceAt; its material divides by pi."""
    write_numbers(tmp_path / "probe.json", LIGHT, "three")
    (tmp_path / "normals.json").write_text(json.dumps(NORMALS.tolist()))
    script = """
    const THREE = require('three');
    const read = (index) => JSON.parse(fs.readFileSync(process.argv[index]));
    const probe = new THREE.ObjectLoader().parse(read(2));
    const at = (n) => probe.sh.getIrradianceAt(new THREE.Vector3(...n), new THREE.Vector3()).toArray();
    console.log(JSON.stringify({ isProbe: probe.isLightProbe, values: read(3).map(at) }));
    """
    found = run_node(script, tmp_path / "probe.json", tmp_path / "normals.json")
    transfer = np.asarray(gash_jax.unshadowed_transfer(NORMALS.astype(np.float32), 3))
    assert found["isProbe"]
    np.testing.assert_allclose(np.array(found["values"]) / np.pi, transfer @ LIGHT.coefficients, atol=2e-5)


def test_pifu_gathers_rows_by_corners(tmp_path: Path) -> None:
    """render_data.py and prt_render.py: np.loadtxt, np.load, prt[face_prt.reshape(-1)], then the sum of prt.fs."""
    write_numbers(tmp_path / "bounce0.txt", TRANSFER, "pifu")
    write_numbers(tmp_path / "env_sh.npy", LIGHT, "pifu")
    prt, faces = np.loadtxt(tmp_path / "bounce0.txt"), np.load(tmp_path / "face.npy")
    sh = np.load(tmp_path / "env_sh.npy")[0]
    shown = prt[faces.reshape(-1)] @ sh
    expected = np.asarray(gash_jax.shade(TRANSFER, LIGHT))[BALL.faces.reshape(-1)]
    np.testing.assert_allclose(shown, expected, atol=1e-5)


def test_only_numbers_are_read(tmp_path: Path) -> None:
    for name, content in (
        ("a.json", "{}"),
        ("b.json", "[1"),
        ("c.txt", "one two"),
        ("d.json", '{"coefficients": "x"}'),
    ):
        (tmp_path / name).write_text(content)
        with pytest.raises(FileError, match="holds no table of coefficients"):
            read_numbers(tmp_path / name, "unity")
    np.savetxt(tmp_path / "nan.txt", np.full((9, 3), np.nan))
    with pytest.raises(FileError, match="not finite"):
        read_numbers(tmp_path / "nan.txt", "unity")
    with pytest.raises(FileError, match="no such file"):
        read_numbers(tmp_path / "absent.txt", "unity")
    for use in (lambda path: read_numbers(path, "three"), lambda path: written_beside(path, LIGHT, "three")):
        with pytest.raises(FileError, match=r"\.npz \.json \.txt \.npy"):
            use(tmp_path / "a.exr")


def test_numbers_of_another_program_are_not_taken_for_its_own(tmp_path: Path) -> None:
    for suffix in (".npz", ".json"):
        write_numbers(tmp_path / f"a{suffix}", LIGHT, "unity")
        with pytest.raises(FileError, match="are those of unity: use --from unity"):
            read_numbers(tmp_path / f"a{suffix}", "filament")
    write_numbers(tmp_path / "probe.json", LIGHT, "three")
    with pytest.raises(FileError, match="are those of three"):
        read_numbers(tmp_path / "probe.json", "unity")
    gash_jax.save_light(tmp_path / "own.npz", LIGHT)
    with pytest.raises(FileError, match="are our own: it needs no --from"):
        read_numbers(tmp_path / "own.npz", "unity")


def test_nothing_is_written_where_bands_do_not_fit(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="reads 3: keep the first 3"):
        write_numbers(tmp_path / "x.json", Light(np.ones((16, 3), np.float32), {}), "three")
    assert not list(tmp_path.iterdir())
