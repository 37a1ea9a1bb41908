"""The meshes that are held between requests: by a name that cannot be guessed; the least recently used leaves."""

import secrets
from collections import OrderedDict

from gash_jax.apps.service.limits import Limits, Refusal
from gash_jax.models.held import HeldMesh

MIB = 1 << 20


class HeldMeshes:
    """At most so many meshes, in so much memory; used by one thread, that of the event loop."""

    def __init__(self, limits: Limits):
        self._most, self._most_bytes = limits.meshes, limits.memory_mib * MIB
        self._meshes: OrderedDict[str, HeldMesh] = OrderedDict()

    def __len__(self) -> int:
        return len(self._meshes)

    @property
    def nbytes(self) -> int:
        """Memory of all of them."""
        return sum(mesh.nbytes for mesh in self._meshes.values())

    def add(self, mesh: HeldMesh) -> str:
        """Hold a mesh, the newest; returns its name. One that is too large for the memory alone is held alone."""
        name = secrets.token_hex(8)
        self._meshes[name] = mesh
        self.shrink()
        return name

    def shrink(self) -> None:
        """Let go of what is over the limits, the least recently used first, but never of the newest."""
        while len(self._meshes) > self._most or (len(self._meshes) > 1 and self.nbytes > self._most_bytes):
            self._meshes.popitem(last=False)

    def get(self, name: str) -> HeldMesh:
        """The mesh of a name, which is then the one used last. Raises Refusal."""
        if name not in self._meshes:
            raise Refusal(404, f"no mesh {name[:40]!r} is held: it was deleted, or left for newer ones; send it again")
        self._meshes.move_to_end(name)
        return self._meshes[name]

    def remove(self, name: str) -> None:
        """Let go of a mesh. Raises Refusal where there is none."""
        self.get(name)
        del self._meshes[name]
