"""What is hard about objects that deform: faces that collapse, poses far from those of the training, no motion at all.

Models are fitted as `gash train` fits them, to bakes of `RAYS` rays a vertex, here of 24 poses of a small body with
four random bumps. Poses that they are tested on are others of the same bumps, held against a bake of `CHECK_RAYS`; its
own noise and that of the training are in every relrmse, 0.01 to 0.02.
"""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from experiments.hard_cases.directions import SILENT
from experiments.hard_cases.recordings import temporary_file
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.files.settings import from_dict
from gash_jax.geometry.animation import Animation, Recorded
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.metrics import relrmse
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.deforming_model import DeformingModel, load_deforming_model, save_deforming_model
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.prt.sequence import moving_scene
from gash_jax.shapes.deformations import blendshape_animation, random_poses
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train.truth import Truth, bake_truth

BANDS, RAYS, CHECK_RAYS = 3, 64, 1024
PATCHES = {"deform": {"patches": 8}, "momo-prt": {}}
FAR = "`outside`: True; `gash animate` counts such frames"


def _moving() -> Animation:
    return blendshape_animation(bumpy_sphere(5), 3, 24, 4)


def _held_out() -> Animation:
    return random_poses(_moving(), 9, 4, held_out=True)


def _recorded(mesh: Mesh, frames: Iterable[np.ndarray]) -> Animation:
    stacked = np.stack(list(frames)).astype(np.float32)
    return Animation(mesh, np.arange(len(stacked), dtype=np.float64)[:, None], ("frame",), Recorded(stacked))


def _fitted(family: str, animation: Animation) -> tuple[DeformingModel, Truth]:
    """A model, and the bakes that it was fitted to."""
    config = from_dict(DEFORMING[family].config, {"name": family, "bands": BANDS, **PATCHES[family]})
    truth, fit = bake_truth(moving_scene(animation), BANDS, RAYS), DEFORMING[family].fit
    assert fit is not None
    arrays = fit(config, TrainingPoses(animation, truth.shards()))
    return DeformingModel(config, arrays, animation.mesh, {"name": "hard"}), truth


def _error(model: DeformingModel, test: Animation) -> float:
    """relrmse against a bake of the same poses; nan where a coefficient is not finite."""
    reference = bake_truth(moving_scene(test), BANDS, CHECK_RAYS).coefficients().astype(np.float64)
    error = relrmse(np.stack([np.asarray(model(frame)) for frame in test.frames()]), reference)
    return float("nan") if error is None else error


def _collapse(positions: Float[np.ndarray, "v 3"], shape: str) -> Float[np.ndarray, "v 3"]:
    """A pose with a twentieth of its vertices moved into one point, or onto a line."""
    rest, kept = _moving().mesh.vertices, positions.astype(np.float64)
    near = np.linalg.norm(rest - rest[40], axis=1) < 0.5
    along = np.array([[0.48, -0.6, 0.64]])
    beside = (kept[near] - kept[40]) @ along.T * along if shape == "line" else 0
    kept[near] = kept[40] + beside
    return kept


def collapsed(family: str, shape: str) -> tuple[float, str]:
    """Poses with collapsed faces, of a model a quarter of whose training poses had them."""
    moving, held_out = _moving(), _held_out()
    frames = [_collapse(frame, shape) if i % 4 == 3 else frame for i, frame in enumerate(moving.frames())]
    model, _ = _fitted(family, _recorded(moving.mesh, frames))
    whole = _error(model, held_out)
    error = _error(model, _recorded(moving.mesh, (_collapse(frame, shape) for frame in held_out.frames())))
    return error, f"{SILENT}; {whole:.2g} in poses without them"


def far_outside(family: str, times: float) -> tuple[float, str]:
    """Poses so many times farther out than those of the training."""
    model, test = _fitted(family, _moving())[0], _held_out()
    far = test._replace(parameters=times * test.parameters)
    told = all(model.outside(frame) for frame in far.frames())
    return (_error(model, far) if told else float("nan")), FAR


def brightest_outside(family: str) -> tuple[float, str]:
    """|t_00| of poses of weights to 1e3, and of one 1e35 large, over that of a free vertex."""
    model, moving = _fitted(family, _moving())[0], _moving()
    free = np.abs(np.asarray(unshadowed_transfer(moving.mesh.normals, BANDS))[:, 0]).max()
    far = [times * moving.parameters[1:] for times in (-1e3, 1e3)]
    poses = [*moving._replace(parameters=np.concatenate(far)).frames(), 1e35 * moving.mesh.vertices]
    told = all(model.outside(positions) for positions in poses)
    found = max(float(np.abs(np.asarray(model(positions))[:, 0]).max() / free) for positions in poses)
    return (found if told else float("nan")), FAR


def unused_shape(family: str) -> tuple[float, str]:
    """How many poses are said to be outside that lie within the training, where one bump moves and three never do."""
    moving = _moving()
    moving.parameters[:] = [0, 0, 0.25, 0.5]
    moving.parameters[:, 0] = np.linspace(0, 1, len(moving))
    model = _fitted(family, moving._replace(parameters=moving.parameters[[0, 6, 12, 18, -1]]))[0]
    return float(np.mean([model.outside(frame) for frame in moving.frames()])), SILENT


def no_motion(family: str) -> tuple[float, str]:
    """Frames that are all the same: the model against the mean of their bakes."""
    mesh = _moving().mesh
    model, truth = _fitted(family, _recorded(mesh, [mesh.vertices] * 7))
    mean = truth.coefficients().astype(np.float64).mean(axis=0)
    return float(np.abs(np.asarray(model(mesh.vertices)) - mean).max()), SILENT


def split_vertices(family: str) -> tuple[float, str]:
    """Every vertex twice, its faces shared out among both; normals are those of the body, as at a seam of a texture."""
    moving, test = _moving(), _held_out()
    mesh = moving.mesh
    faces = mesh.faces + np.arange(len(mesh.faces), dtype=np.int32)[:, None] % 2 * np.int32(len(mesh.vertices))
    twice = Mesh(np.tile(mesh.vertices, (2, 1)), np.tile(mesh.normals, (2, 1)), faces)
    parts = [_recorded(twice, (np.tile(frame, (2, 1)) for frame in some.frames())) for some in (moving, test)]
    clean = _error(_fitted(family, moving)[0], test)
    return _error(_fitted(family, parts[0])[0], parts[1]), f"{SILENT}; {clean:.2g} of the clean mesh"


def isolated_vertices(family: str) -> tuple[float, str]:
    """Vertices in no face, one at 1e30, one that leaps about; the larger of the error and of their own transfer."""
    moving, test, leap = _moving(), _held_out(), np.random.default_rng(0)
    mesh = moving.mesh

    def more(frame: np.ndarray) -> np.ndarray:
        return np.concatenate([frame, [[1e30, 0, 0]], 1e3 * leap.normal(size=(1, 3))]).astype(np.float32)

    loose = Mesh(more(mesh.vertices), np.pad(mesh.normals, ((0, 2), (0, 0))), mesh.faces)
    model, _ = _fitted(family, _recorded(loose, map(more, moving.frames())))
    others = _recorded(loose, map(more, test.frames()))
    own = max(float(np.abs(np.asarray(model(frame))[-2:]).max()) for frame in others.frames())
    return max(_error(model, others), own), SILENT


def _posed(positions: np.ndarray) -> object:
    return _fitted("deform", _moving())[0](positions)


def pose_not_finite() -> object:
    """A vertex of a pose that is no number."""
    positions = _moving().mesh.vertices.copy()
    positions[7, 1] = np.nan
    return _posed(positions)


def pose_beyond_float32() -> object:
    """A pose in float64 that float32 cannot hold."""
    return _posed(1e40 * _moving().mesh.vertices.astype(np.float64))


def pose_of_another_mesh() -> object:
    """A pose with a vertex less."""
    return _posed(_moving().mesh.vertices[1:])


def cut_weights() -> object:
    """A model file of which the second half is missing."""
    model = _fitted("momo-prt", _moving())[0]
    with temporary_file("model.npz") as path:
        save_deforming_model(path, model.config, model.arrays, model.mesh)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        return load_deforming_model(path)
