"""A mesh that is held with its graph: a new pose costs positions alone, and nothing is ever compiled for one mesh.

What depends on the faces (tree of surfels, lists) is built from the first pose and kept, as in
`models.deforming`, whose rules for normals hold here too. The difference is what runs: there one program is compiled
for each mesh, for whoever plays thousands of frames of one; here NumPy makes the arrays and the network runs in the
calls that all meshes share, for whoever is sent meshes of any size, as a service is. Both give the same coefficients.

The unit of length is that of the first pose; the centre is that of each pose, so a mesh may travel far.
"""

import time
from functools import cached_property
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Shaped

from gash_jax.geometry.carried_normals import CarriedNormals, carried_normals, posed_mesh
from gash_jax.geometry.checks import checked_vertices
from gash_jax.geometry.mesh import Mesh, MeshError
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.graph.surfel_graph import SurfelGraph, check_together, normalised, plan_surfels, planned_graph
from gash_jax.graph.surfels import surfel_records
from gash_jax.models.deforming import check_deforms
from gash_jax.models.model import Model
from gash_jax.models.surfel_inference import compile_calls, predict_on_host

TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32)
SIDES = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.int32)


class Prediction(NamedTuple):
    """Coefficients of a pose, and the seconds that its graph and the network took."""

    coefficients: Float[np.ndarray, "v k"]  # float32; 0 at vertices without a usable normal
    seconds: dict[str, float]


class HeldMesh:
    """A checked mesh with what of its graph does not depend on the pose. Raises ValueError for a model but `local`."""

    def __init__(self, model: Model, mesh: Mesh):
        check_deforms(model)
        started = time.perf_counter()
        self.model, self.mesh, shape = model, mesh, NormalisedMesh(mesh)
        positions, center, self.unit = normalised(shape)
        self.plan, records = plan_surfels(shape, positions, moves=True)
        graph = planned_graph(self.plan, records, positions, mesh.normals, center, self.unit)
        self.first = self._predicted(graph, mesh.normals, started)

    @cached_property
    def _carried(self) -> CarriedNormals:
        """The normals in the frames of their vertices; for the first pose they are not needed."""
        return carried_normals(self.mesh, self.plan.faces)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays that are kept."""
        arrays = jax.tree.leaves((self.mesh, self.plan, self.first.coefficients, vars(self).get("_carried")))
        return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))

    def predict(self, vertices: Shaped[np.ndarray, "..."]) -> Prediction:
        """The transfer of a pose: positions of all vertices in the units of the mesh.

        Raises MeshError where they are of another number, or not finite, or part where the mesh was whole.
        """
        started = time.perf_counter()
        if vertices.shape != self.mesh.vertices.shape:
            raise MeshError(f"positions have shape {vertices.shape}, the mesh has {self.mesh.vertices.shape}")
        shape = NormalisedMesh(self.mesh._replace(vertices=checked_vertices(vertices)))
        positions = shape.positions(self.unit).astype(np.float32)
        check_together(self.plan, positions)
        normals = posed_mesh(positions, self.plan.faces, self._carried).normals[self.plan.first]
        records = surfel_records(self.plan.tree, positions, self.plan.faces)
        graph = planned_graph(self.plan, records, positions, normals, shape.center, self.unit)
        return self._predicted(graph, normals, started)

    def _predicted(self, graph: SurfelGraph, normals: Float[np.ndarray, "v 3"], started: float) -> Prediction:
        built = time.perf_counter()
        found = predict_on_host(self.model.module, self.model.params, graph)[0]
        usable = np.any(normals != 0, axis=1)[:, None]
        coefficients = np.where(usable, found, np.float32(0))
        return Prediction(coefficients, {"graph": built - started, "network": time.perf_counter() - built})


def warm_up(model: Model) -> None:
    """Compile all that a `HeldMesh` of this model will ever run. Raises ValueError for a model but `local`."""
    check_deforms(model)
    normals = TETRAHEDRON / np.float32(3**0.5)
    compile_calls(model.module, model.params, model.graph(Mesh(TETRAHEDRON, normals, SIDES)))
