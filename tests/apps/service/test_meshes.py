"""What is held, and what leaves."""

import pytest

from gash_jax.apps.service.limits import Limits, Refusal
from gash_jax.apps.service.meshes import MIB, HeldMeshes
from gash_jax.models.held import HeldMesh
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.service import tiny_model


@pytest.fixture(scope="module")
def mesh() -> HeldMesh:
    return HeldMesh(tiny_model(), bumpy_sphere(11))


def test_names_cannot_be_guessed_and_find_their_mesh(mesh: HeldMesh) -> None:
    meshes = HeldMeshes(Limits())
    names = [meshes.add(mesh) for _ in range(5)]
    assert len(set(names)) == 5 and all(len(name) == 16 for name in names)
    assert meshes.get(names[0]) is mesh and meshes.nbytes == 5 * mesh.nbytes
    meshes.remove(names[0])
    for call in (meshes.get, meshes.remove):
        with pytest.raises(Refusal, match="is held"):
            call(names[0])


def test_the_least_recently_used_leaves_by_number(mesh: HeldMesh) -> None:
    meshes = HeldMeshes(Limits(meshes=2))
    first, second = meshes.add(mesh), meshes.add(mesh)
    meshes.get(first)
    meshes.add(mesh)
    assert len(meshes) == 2 and meshes.get(first) is mesh
    with pytest.raises(Refusal):
        meshes.get(second)


def test_the_least_recently_used_leaves_by_memory(mesh: HeldMesh) -> None:
    """As many as four MiB hold stay; one that is larger than the limit is held alone."""
    meshes, fit = HeldMeshes(Limits(memory_mib=4)), 4 * MIB // mesh.nbytes
    assert fit > 1
    names = [meshes.add(mesh) for _ in range(fit + 2)]
    assert len(meshes) == fit and meshes.nbytes <= 4 * MIB and meshes.get(names[-1]) is mesh
    large = HeldMesh(mesh.model, bumpy_sphere(36))
    assert large.nbytes > 4 * MIB
    meshes.add(large)
    assert len(meshes) == 1
