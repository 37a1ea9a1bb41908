"""The store of baked frames: what is there is not baked again, what is damaged is."""

from pathlib import Path

import numpy as np
import pytest

from gash_jax.geometry.animation import Animation, Recorded
from gash_jax.geometry.mesh import MeshError
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.sequence import bake_frame, bake_pose, moving_scene, posed_meshes
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train import truth
from gash_jax.train.truth import FRAMES, bake_truth

SCENE = moving_scene(blendshape_animation(bumpy_sphere(3), 1, FRAMES + 2, 3))


@pytest.fixture(autouse=True)
def baked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """An empty cache, and the seeds of the frames that are baked."""
    monkeypatch.setenv("GASH_CACHE", str(tmp_path))
    seeds: list[int] = []

    def counted(*arguments: object) -> dict[str, np.ndarray]:
        seeds.append(arguments[4])  # type: ignore[arg-type]
        return bake_frame(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(truth, "bake_frame", counted)
    return seeds


def test_every_frame_is_baked_once_with_its_own_seed(baked: list[int]) -> None:
    found = bake_truth(SCENE, 2, 4)
    assert baked == list(range(len(SCENE.animation))) and len(found.files) == 2
    again = bake_truth(SCENE, 2, 4)
    assert len(baked) == len(SCENE.animation) and again.files == found.files
    assert again.cpu_seconds == found.cpu_seconds > 0
    held = found.coefficients()
    assert held.dtype == np.float16 and held.shape == (FRAMES + 2, len(SCENE.animation.mesh.vertices), 4)
    (mesh,) = posed_meshes(SCENE.animation, FRAMES, FRAMES + 1)
    np.testing.assert_array_equal(held[FRAMES], bake_pose(mesh, SCENE.rows, 2, 4, FRAMES).astype(np.float16))


def test_a_glossy_bake_keeps_what_the_vertices_see(baked: list[int]) -> None:
    found = bake_truth(SCENE, 2, 4, glossy=True)
    (mesh,) = posed_meshes(SCENE.animation, FRAMES, FRAMES + 1)
    wanted = bake_transfer(mesh, 2, 4, replicates=1, seed=FRAMES, glossy=True)
    held = np.concatenate(found.shards("visibility"))
    assert held.shape == (FRAMES + 2, len(mesh.vertices), 9) and held.dtype == np.float16
    np.testing.assert_array_equal(held[FRAMES], np.asarray(wanted.visibility))
    np.testing.assert_array_equal(found.coefficients()[FRAMES], np.asarray(wanted.coefficients, np.float16))
    assert set(found.files).isdisjoint(bake_truth(SCENE, 2, 4).files)
    # what is seen is guarded as the coefficients are
    data = bytearray(found.files[1].read_bytes())
    data[data.index(found.shards("visibility")[1].tobytes()[:64])] ^= 1
    found.files[1].write_bytes(bytes(data))
    baked.clear()
    bake_truth(SCENE, 2, 4, glossy=True)
    assert baked == [FRAMES, FRAMES + 1]


def test_an_interrupted_bake_goes_on(baked: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(done: int, total: int) -> None:
        if done == FRAMES + 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bake_truth(SCENE, 2, 4, interrupted)
    baked.clear()
    assert len(bake_truth(SCENE, 2, 4)) == FRAMES + 2 and baked == [FRAMES, FRAMES + 1]


@pytest.mark.parametrize("harm", ["cut", "changed", "emptied"])
def test_a_damaged_file_is_baked_again(baked: list[int], harm: str) -> None:
    found = bake_truth(SCENE, 2, 4)
    path, before = found.files[1], found.coefficients()
    data = bytearray(path.read_bytes())
    if harm == "changed":
        place = data.index(found.shards()[1].tobytes()[:64])
        data[place] ^= 1
    path.write_bytes(bytes(data[: {"cut": len(data) // 2, "changed": len(data), "emptied": 0}[harm]]))
    baked.clear()
    np.testing.assert_array_equal(bake_truth(SCENE, 2, 4).coefficients(), before)
    assert baked == [FRAMES, FRAMES + 1]


def test_a_frame_that_cannot_be_baked_is_named() -> None:
    moving = SCENE.animation
    frames = np.stack(list(moving.frames()))
    frames[FRAMES + 1] = 1
    numbers = np.arange(len(frames), dtype=np.float64)[:, None]
    shrunk = Animation(moving.mesh, numbers, ("frame",), Recorded(frames))
    with pytest.raises(MeshError, match=f"^frame {FRAMES + 1}: all faces lie in one point"):
        bake_truth(moving_scene(shrunk), 2, 4)


def test_other_rays_poses_and_parts_are_other_files() -> None:
    files = set(bake_truth(SCENE, 2, 4).files)
    others = [bake_truth(SCENE, 2, 5), bake_truth(SCENE, 3, 4), bake_truth(SCENE._replace(rows=slice(0, 9)), 2, 4)]
    grown = SCENE.animation._replace(parameters=1.5 * SCENE.animation.parameters)
    others.append(bake_truth(SCENE._replace(animation=grown), 2, 4))
    for other in others:
        assert files.isdisjoint(other.files)
        files |= set(other.files)
