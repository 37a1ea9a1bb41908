"""Counts and bodies of requests: what fits, and one line for what does not."""

import numpy as np
import pytest

from gash_jax.apps.service import wire
from gash_jax.apps.service.limits import Limits, Refusal
from gash_jax.formats.meshes import read_mesh
from gash_jax.geometry.mesh import MeshError
from gash_jax.shapes.primitives import bumpy_sphere

MESH = bumpy_sphere(3)
V, F = len(MESH.vertices), len(MESH.faces)
LIMITS = Limits(vertices=1000, faces=2000)
POSITIONS, NORMALS, FACES = (array.tobytes() for array in MESH)


def test_a_mesh_by_hand() -> None:
    """One triangle in the plane z = 0, counter-clockwise seen from +z; its lengths in bytes."""
    body = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes() + np.array([[0, 1, 2]], "<i4").tobytes()
    assert wire.mesh_lengths(3, 1) == (len(body), len(body) + 36) == (48, 84)
    mesh = wire.mesh_of_body(body, 3, 1)
    assert mesh.faces.tolist() == [[0, 1, 2]] and mesh.normals.tolist() == [[0, 0, 1]] * 3
    assert wire.read_positions(body[:36])[1].tolist() == [1, 0, 0]


def test_normals_are_taken_or_computed() -> None:
    tripled = (3 * MESH.normals).tobytes()
    sent = wire.mesh_of_body(POSITIONS + tripled + FACES, V, F)
    for found, expected in zip(sent, MESH, strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-6)
    assert all(array.base is None for array in sent), "what is held would hold the body"
    computed = wire.mesh_of_body(POSITIONS + FACES, V, F)
    np.testing.assert_array_equal(computed.normals, read_mesh((MESH.vertices, MESH.faces))[0].normals)


def _with(array: np.ndarray, value: float) -> bytes:
    changed = array.copy()
    changed[1, 1] = value
    return changed.tobytes()


BODIES = {
    "1 of 92 vertices are not finite .first: 1": _with(MESH.vertices, np.nan) + NORMALS + FACES,
    "vertices are not finite": _with(MESH.vertices, np.inf) + FACES,
    "1 of 92 normals are not finite .first: 1": POSITIONS + _with(MESH.normals, np.nan) + FACES,
    "1 of 180 faces name a vertex that does not exist": POSITIONS + NORMALS + _with(MESH.faces, V),
    "faces name a vertex that does not exist": POSITIONS + _with(MESH.faces, -1),
    "all faces lie in one point": bytes(len(POSITIONS)) + NORMALS + FACES,
}


@pytest.mark.parametrize("said", BODIES)
def test_a_body_passes_the_checks_of_every_mesh(said: str) -> None:
    with pytest.raises(MeshError, match=said):
        wire.mesh_of_body(BODIES[said], V, F)


def test_a_soup_of_long_faces_is_refused() -> None:
    """Random corners: every face is as long as the mesh. A fine surface of more faces passes."""
    random, count = np.random.default_rng(0), wire.CROWDED + 1
    points, faces = random.normal(size=(900, 3)).astype("<f4"), random.integers(0, 900, (count, 3)).astype("<i4")
    for normals in (b"", points.tobytes()):
        with pytest.raises(MeshError, match="too long for their number"):
            wire.mesh_of_body(points.tobytes() + normals + faces.tobytes(), 900, count)
    fine = bumpy_sphere(40)
    assert len(fine.faces) > wire.CROWDED
    body = b"".join(array.tobytes() for array in fine)
    assert len(wire.mesh_of_body(body, len(fine.vertices), len(fine.faces)).faces) == len(fine.faces)


@pytest.mark.parametrize("text", ["", "0", "-1", "1.5", "1e3", "٣", "9" * 10, " 5", "+5", "0x10"])
def test_what_is_no_count_is_refused(text: str) -> None:
    with pytest.raises(Refusal, match="say how many vertices") as caught:
        wire.mesh_counts({"vertices": text, "faces": "1"}, LIMITS)
    assert caught.value.status == 400


def test_counts_have_limits() -> None:
    assert wire.mesh_counts({"vertices": "1000", "faces": "2000"}, LIMITS) == (1000, 2000)
    for query in ({"vertices": "1001", "faces": "1"}, {"vertices": "1", "faces": "2001"}):
        with pytest.raises(Refusal, match="more than this service takes") as caught:
            wire.mesh_counts(query, LIMITS)
        assert caught.value.status == 413


def test_only_a_length_that_fits_is_taken() -> None:
    assert wire.check_length("48", (48, 84)) == 48
    for text, status in ((None, 411), ("47", 400), ("85", 400), ("9" * 400, 400), ("", 400), ("-48", 400)):
        with pytest.raises(Refusal) as caught:
            wire.check_length(text, (48, 84))
        assert caught.value.status == status and len(caught.value.text) < 200


def test_a_slip_of_the_pen_is_named() -> None:
    wire.check_names({"faces": "1"}, ("vertices", "faces"))
    with pytest.raises(
        Refusal, match="unknown parameter 'vertice', did you mean 'vertices'.; known here: vertices, faces"
    ):
        wire.check_names({"vertice": "1"}, ("vertices", "faces"))
    with pytest.raises(Refusal, match="this address takes none"):
        wire.check_names({"a": "1"}, ())
