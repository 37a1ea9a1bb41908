"""Texture files: what is written is read back, and what is not whole is refused in one line."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gash_jax.files.atomic import FileError
from gash_jax.files.npz import write_npz
from gash_jax.prt.texture import FORMAT, TransferTexture, load_texture, save_texture
from tests.helpers.textured import SQUARE, SQUARE_UV


def _texture(**changes: Any) -> TransferTexture:
    random = np.random.default_rng(0)
    values = random.random((4, 4, 9)).astype(np.float16)
    texture = TransferTexture(
        values, values / 8, np.full((4, 4), 2, np.uint8), SQUARE_UV, *SQUARE, {"method": "made up"}
    )
    return texture._replace(**changes)


@pytest.mark.parametrize("changes", [{}, {"standard_error": None}, {"texture": np.ones((4, 4, 4, 3), np.float16)}])
def test_round_trip(tmp_path: Path, changes: dict[str, Any]) -> None:
    if "texture" in changes:
        changes = {**changes, "standard_error": None}
    texture = _texture(**changes)
    save_texture(tmp_path / "t.npz", texture)
    found = load_texture(tmp_path / "t.npz")
    for name in TransferTexture._fields[:-1]:
        ours, theirs = getattr(texture, name), getattr(found, name)
        if ours is None or theirs is None:
            assert ours is theirs, name
        else:
            assert ours.dtype == theirs.dtype and np.array_equal(ours, theirs), name
    assert found.metadata["format"] == FORMAT and found.metadata["method"] == "made up"
    assert found.bands == (2 if "texture" in changes else 3) and np.array_equal(found.mesh.faces, SQUARE.faces)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("texture", np.ones((4, 3, 9), np.float16), "'texture' has shape"),
        ("texture", np.ones((4, 4, 8), np.float16), "'standard_error' has shape"),
        ("texture", np.full((4, 4, 9), np.inf, np.float16), "not finite"),
        ("texture", np.ones((4, 4, 9), np.int32), "not floats"),
        ("standard_error", np.ones((4, 4, 4), np.float16), "'standard_error' has shape"),
        ("coverage", np.full((4, 4), 3, np.uint8), "coverage beyond 2"),
        ("coverage", np.uint8(2), "has shape"),
        ("uv", SQUARE_UV[:1], "'faces' has shape"),
        ("uv", SQUARE_UV * 2, "uv beyond 0 to 1"),
        ("faces", SQUARE.faces + 2, "faces of no vertices"),
        ("normals", SQUARE.normals[:2], "'normals' has shape"),
    ],
)
def test_what_is_not_whole_is_refused(tmp_path: Path, name: str, value: np.ndarray, words: str) -> None:
    arrays = {key: value for key, value in _texture()._asdict().items() if key != "metadata"}
    write_npz(tmp_path / "bad.npz", {**arrays, name: value}, {"format": FORMAT})
    with pytest.raises(FileError, match=words) as refusal:
        load_texture(tmp_path / "bad.npz")
    assert "\n" not in str(refusal.value)
    with pytest.raises(FileError):
        save_texture(tmp_path / "never.npz", _texture(**{name: value}))
    assert not (tmp_path / "never.npz").exists()


def test_other_files_are_refused(tmp_path: Path) -> None:
    save_texture(tmp_path / "t.npz", _texture())
    whole = (tmp_path / "t.npz").read_bytes()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FileError, match="truncated"):
        load_texture(tmp_path / "half.npz")
    arrays = {key: value for key, value in _texture()._asdict().items() if key != "metadata"}
    write_npz(tmp_path / "other.npz", arrays, {"format": "other"})
    with pytest.raises(FileError, match="is not a texture file"):
        load_texture(tmp_path / "other.npz")
    del arrays["uv"]
    write_npz(tmp_path / "less.npz", arrays, {"format": FORMAT})
    with pytest.raises(FileError, match="no array 'uv'"):
        load_texture(tmp_path / "less.npz")
    with pytest.raises(FileError, match="bake it again"):
        save_texture(tmp_path / "x.npz", _texture(texture=np.ones((4, 4, 8), np.float16), standard_error=None))
