"""The hard cases that are refused, in the words in which they are."""

from collections.abc import Callable

import numpy as np

from experiments.hard_cases import bounces, deforming, gloss, recordings, textures
from experiments.hard_cases.case import Case
from gash_jax.algebra.sh import validate_bands
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.texture_coordinates import ATLAS
from gash_jax.light.brdf import phong
from gash_jax.light.environment import project_map
from gash_jax.light.shading import shade

TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def _mesh(vertices: object, faces: object) -> Callable[[], object]:
    return lambda: prepare_mesh(np.array(vertices, np.float64).reshape(-1, 3), np.array(faces, int).reshape(-1, 3))


def _pixel(value: float) -> Callable[[], object]:
    image = np.ones((8, 16, 3), np.float32)
    image[3, 5] = value
    return lambda: project_map(image, 3)


REFUSALS = [
    Case(
        "no faces",
        "refusal",
        "the mesh has no faces: point clouds and curves cannot be baked, give a triangle mesh",
        _mesh(TRIANGLE, []),
    ),
    Case(
        "all vertices in one point",
        "refusal",
        "all faces lie in one point: the mesh has no size; check its coordinates and units",
        _mesh(np.ones((3, 3)), [[0, 1, 2]]),
    ),
    Case(
        "a vertex that is not finite",
        "refusal",
        "1 of 3 vertices are not finite (first: 1): repair or remove them in the program that wrote the mesh",
        _mesh([[0, 0, 0], [np.nan, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
    ),
    Case(
        "coordinates beyond float32",
        "refusal",
        "1 of 3 vertices are not finite (first: 2): repair or remove them in the program that wrote the mesh",
        _mesh([[0, 0, 0], [1, 0, 0], [0, 1e39, 0]], [[0, 1, 2]]),
    ),
    Case(
        "a face of a vertex that does not exist",
        "refusal",
        "1 of 1 faces name a vertex that does not exist (first: face 0 [0, 1, 3], the mesh has 3 vertices from 0): "
        "export the mesh again",
        _mesh(TRIANGLE, [[0, 1, 3]]),
    ),
    Case("11 bands", "refusal", "bands is 11: use a whole number from 1 to 10", lambda: validate_bands(11)),
    Case(
        "a pixel that is infinite",
        "refusal",
        "the environment map holds values that are not finite: repair these pixels first",
        _pixel(np.inf),
    ),
    Case(
        "a pixel that is no number",
        "refusal",
        "the environment map holds values that are not finite: repair these pixels first",
        _pixel(np.nan),
    ),
    Case(
        "no texture coordinates of its own",
        "refusal",
        f"the mesh has no texture coordinates of its own: unwrap it, or {ATLAS}",
        textures.none_of_its_own,
    ),
    Case(
        "texture coordinates that overlap",
        "refusal",
        "1128 of 1176 texels on the mesh lie on two faces: its texture coordinates overlap, as mirrored halves do; "
        + ATLAS,
        textures.overlapping,
    ),
    Case(
        "texture coordinates over several tiles",
        "refusal",
        "texture coordinates run over several tiles, u from 0 to 3 and v from 0 to 3 (UDIM, or a texture that repeats)"
        f": bring them into one square, or {ATLAS}",
        textures.several_tiles,
    ),
    Case(
        "a corner without texture coordinates",
        "refusal",
        "1 of 2 faces have no texture coordinates (first: face 1): unwrap them in the program that made the mesh, or "
        + ATLAS,
        textures.not_finite,
    ),
    Case(
        "a light of fewer bands than the transfer",
        "refusal",
        "the light has 4 coefficients, the transfer 9: project the light again with 3 bands",
        lambda: shade(np.zeros((1, 9), np.float32), np.zeros((4, 3), np.float32)),
    ),
    Case(
        "gloss of a bake without visibility",
        "refusal",
        "the transfer has no visibility to make gloss of: bake it with glossy=True (gash bake --glossy)",
        gloss.without_visibility,
    ),
    Case(
        "albedo above 1",
        "refusal",
        "1 of 1 albedos are not from 0 to 1 (first: 1.2): no surface sends back more light than it receives",
        bounces.brighter_than_white,
    ),
    Case(
        "a frame that is not finite",
        "refusal",
        "moves.npz: 1 vertices of frame 2 are not finite (first: 7): repair or leave out the frame",
        recordings.frame_not_finite,
    ),
    Case(
        "faces that change from frame to frame",
        "refusal",
        "moves.npz: 'faces' has shape (4, 80, 3), one list for each frame: all frames must share one (f, 3)",
        recordings.faces_that_change,
    ),
    Case(
        "a frame in which the whole object is one point",
        "refusal",
        "frame 2: all faces lie in one point: the mesh has no size; check its coordinates and units",
        recordings.shrunk_to_a_point,
    ),
    Case(
        "a model of an animation of one frame",
        "refusal",
        "moves.npz has 1 frames: a model needs two to be fitted to and one to be tested on; bake it with gash animate",
        recordings.one_frame_to_train,
    ),
    Case(
        "a pose that is not finite, given to a model",
        "refusal",
        "1 of 252 positions are not finite or beyond 1e+36 (first: 7): repair or leave out the pose",
        deforming.pose_not_finite,
    ),
    Case(
        "a pose beyond float32, given to a model",
        "refusal",
        "252 of 252 positions are not finite or beyond 1e+36 (first: 0): repair or leave out the pose",
        deforming.pose_beyond_float32,
    ),
    Case(
        "a pose of another mesh, given to a model",
        "refusal",
        "positions have shape (251, 3) float32: this model is of one mesh, give positions of all its vertices, "
        "(252, 3)",
        deforming.pose_of_another_mesh,
    ),
    Case(
        "a model file that is cut",
        "refusal",
        "model.npz is not a readable npz file: truncated or another format; write it again",
        deforming.cut_weights,
    ),
    Case("exponent below 0", "refusal", "exponent is -1: use a number of 0 or more", lambda: phong(-1)),
]
