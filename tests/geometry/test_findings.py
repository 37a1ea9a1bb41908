import pytest

from gash_jax.geometry.findings import WORDING, describe


def test_hand_worked_lines() -> None:
    counts = dict.fromkeys(WORDING, 0) | {"duplicate_faces": 1, "boundary_edges": 7, "separate_parts": 3}
    lines = describe(counts, {"duplicate_faces": [12], "boundary_edges": [[3, 4], [3, 9]]})
    assert lines == [
        "3 parts without a common vertex: baked together, they shadow each other",
        "1 face on the vertices of an earlier face (first: 12): kept in the mesh, the first counts for the normals",
        "7 edges with one face only (first: 3-4, 3-9, ...): the rim of a hole, where light gets through, or a seam",
    ]


@pytest.mark.parametrize("name", WORDING)
def test_every_finding_says_what_was_done(name: str) -> None:
    for count in (1, 2):
        (line,) = describe(dict.fromkeys(WORDING, 0) | {name: count}, {})
        noun = WORDING[name].one if count == 1 else WORDING[name].several
        assert line.startswith(f"{count} {noun} ") and line.count(": ") == 1 and "\n" not in line
