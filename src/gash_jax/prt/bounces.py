"""Light that bounces: transfer that counts light reflected by diffuse surfaces up to n times.

With the direct transfer D, the albedo a and the mean W over the rays of a vertex of what they find (`reflection`),

    t^0 = D,    t^n = D + W (a t^(n-1)).

Shading with t^n gives (arriving irradiance)/pi; the albedo of the receiver is not in it, those of the surfaces that
the light came from are. Rays have the density of diffuse transfer, so W is a plain mean. With a <= 1 nothing exceeds
what an unoccluded vertex receives under the same constant light.

*Error bars.* Every replicate r of a bake is a chain of its own: t^n_r = D_r + W_r (a t^(n-1)_r), with the rays of
replicate r at every vertex. Chains share no ray, so their spread is that of independent estimates, whatever happens
inside a chain. D_r is blended with the closed form as in a direct bake. Light that returns to the vertex that it came
from meets the same rays again, an error of the order of the share of one vertex in the scene.

*Memory and time.* The rays of one bake serve all bounces: where they meet fronts is kept, in 8 bytes a hit, up to
`MOST_KEPT` bytes. Chunks of rays beyond that are traced again for every bounce and meet the same faces, so the result
is the same to the last bit. Beside the hits there are three arrays (vertices, replicates, coefficients): D, t and a t.
"""

import threading
import time
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float, Int

from gash_jax.algebra.arguments import as_array, is_real, shown
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.integrands import to_world
from gash_jax.prt.rays import Hits, RayQuery
from gash_jax.prt.reflection import KeptHits, Reflected, Reflector, keep_hits, reflector, sums_at_hits
from gash_jax.prt.tracing import Chunk, Integrand, ProgressFn, Rows, chunks_of, in_threads, trace_chunk, trace_rows

MOST_KEPT = 1 << 30
MOST_BOUNCES = 256


class Estimate(NamedTuple):
    """Replicates of the transfer of all rows, and what there is to say about them."""

    replicas: Float[np.ndarray, "a r k"] | Float[np.ndarray, "a r k 3"]  # world
    share: Float[np.ndarray, "a"]  # of each row's rays that are free
    told: dict[str, Any]  # for the metadata
    reflected: Reflected | None = None  # what grey surfaces send in the last bounce; None without one


def checked_albedo(albedo: object, count: int) -> Float[np.ndarray, "s c"]:
    """Albedo of each of `count` vertices, of one colour (grey) or three, in float32.

    `albedo` is a number, a colour (3,), or one of these for each vertex, (count,) or (count, 3). Raises ValueError for
    other shapes and for values outside 0 .. 1.
    """
    if albedo is None:
        raise ValueError("light that bounces needs an albedo: give a number, a colour (3,), or one per vertex")
    found = np.asarray(as_array(albedo))
    if not is_real(found):
        raise ValueError(f"albedo is {shown(albedo)}: give numbers from 0 to 1")
    if found.shape not in ((), (3,), (count,), (count, 3)):
        raise ValueError(f"albedo has shape {found.shape}: give a number, (3,), ({count},) or ({count}, 3)")
    outside = found[~((found >= 0) & (found <= 1))]
    if outside.size:
        raise ValueError(
            f"{outside.size} of {found.size} albedos are not from 0 to 1 (first: {outside[0]:g}): "
            "no surface sends back more light than it receives"
        )
    colours = found if found.shape in ((3,), (count, 3)) else found[..., None]
    return np.broadcast_to(colours.astype(np.float32), (count, colours.shape[-1]))


def describe_albedo(albedo: object) -> Any:
    """An albedo for the metadata: the number or the colour, of more than one the shape and the mean."""
    found = np.asarray(as_array(albedo), np.float64)
    if found.shape in ((), (3,)):
        return found.tolist()
    return {"shape": list(found.shape), "mean": float(found.mean())}


class Exchange:
    """The rays of a bake, and how the light of one bounce becomes that of the next.

    `rows` are those of the starts `active`: the vertices of the surface that have a normal, and points after them.
    Each has r rows of n rays. `direct` integrates over what is free, `query` answers with the nearest hits.
    """

    def __init__(
        self,
        rows: Rows,
        direct: Integrand,
        n: int,
        query: RayQuery,
        *,
        active: Int[np.ndarray, "a"],
        surface: Mesh,
        share: Float[np.ndarray, "a"] | None = None,
        progress: ProgressFn | None = None,
    ):
        self.rows, self.n, self.query, self.density = rows, n, query, direct.density
        self.active, self.vertices, self.mirror = active, len(surface.vertices), reflector(surface)
        self.kept, self.traced_again = _Store(MOST_KEPT), 0
        self.sent: Float[np.ndarray, "s r k c"] | None = None  # what the surface sends in the last bounce

        def integrate(chunk: Chunk) -> Array | np.ndarray:
            assert isinstance(chunk.answer, Hits)
            self.kept.add(chunk.own, _hits_of(self.mirror, chunk))
            return direct.integrate(chunk._replace(answer=chunk.answer.face < 0))

        remembering = Integrand(direct.density, "closest", integrate)
        local, self.share = trace_rows(rows, remembering, n, query, share=share, progress=progress)
        # (a, r, k, 1) of the world: D, the same for all colours
        self.first = np.asarray(to_world(local, rows.frames))[..., None]

    def bounce(
        self,
        transfer: Float[np.ndarray, "a r k _"],
        albedo: Float[np.ndarray, "s c"],
        out: Float[np.ndarray, "a r k c"] | None = None,
    ) -> Float[np.ndarray, "a r k c"]:
        """D + W (albedo * transfer), replicate by replicate; `out`, where the result goes, may be `transfer` itself."""
        count, replicates = self.rows.shifts.shape[:2]
        shape = (*self.first.shape[:3], albedo.shape[1])
        self.sent = sent = np.zeros((self.vertices, *shape[1:]), np.float32)
        result = np.empty(shape, np.float32) if out is None else out
        chunks = chunks_of(count, replicates * self.n)

        def send(part: slice) -> None:
            own = self.active[part]
            own = own[own < self.vertices]  # points send nothing
            sent[own] = albedo[own][:, None, None] * transfer[part][: len(own)]

        def receive(part: slice) -> None:
            found = sums_at_hits(self.mirror, self.hits(part), sent.reshape(*sent.shape[:2], -1), 1 / self.n)
            result[part] = self.first[part] + found.reshape(-1, *shape[1:])

        in_threads(send, chunks)
        in_threads(receive, chunks)
        self.traced_again += (count - self.kept.rows) * replicates * self.n
        return result

    def bounced(self, albedo: Float[np.ndarray, "s c"], bounces: int, progress: ProgressFn | None = None) -> Estimate:
        """Transfer of all rows with up to `bounces` bounces, of three colours where the albedo has them.

        `progress` counts the rows of all passes, of which the tracing is the first.
        """
        started, found, count = time.perf_counter(), self.first, len(self.active)
        for bounce in range(1, bounces + 1):
            found = self.bounce(found, albedo, out=None if bounce == 1 else found)
            if progress:
                progress(count * (bounce + 1), count * (bounces + 1))
        told = {"seconds": time.perf_counter() - started, "hits_bytes": self.kept.used}
        told["rays_traced_again"] = self.traced_again
        if found.shape[-1] == 3:
            return Estimate(found, self.share, {"bounced": told})
        reflected = None if self.sent is None else Reflected(self.mirror, self.sent[..., 0])
        return Estimate(found[..., 0], self.share, {"bounced": told}, reflected)

    def hits(self, part: slice) -> KeptHits:
        """What the rays of one chunk meet: kept, or traced again."""
        kept = self.kept.get(part)
        return kept or _hits_of(self.mirror, trace_chunk(self.rows, part, self.density, self.query, self.n)[0])


def _hits_of(mirror: Reflector, chunk: Chunk) -> KeptHits:
    """What a chunk keeps of the rays that were traced for it."""
    assert isinstance(chunk.answer, Hits)
    n = chunk.directions.shape[2]
    hits = Hits(*(array[chunk.inner].reshape(-1, n) for array in chunk.answer))
    return keep_hits(mirror, hits, chunk.directions[chunk.inner].reshape(-1, n, 3))


class _Store:
    """Hits of chunks, up to a number of bytes; safe to fill from several threads."""

    def __init__(self, most: int):
        self.most, self.used, self.rows, self.hits = most, 0, 0, 0
        self._hits: dict[int, KeptHits] = {}
        self._lock = threading.Lock()

    def add(self, own: slice, hits: KeptHits) -> None:
        with self._lock:
            if self.used + hits.nbytes <= self.most:
                self._hits[own.start] = hits
                self.used += hits.nbytes
                self.hits += len(hits.face)
                self.rows += own.stop - own.start

    def get(self, own: slice) -> KeptHits | None:
        return self._hits.get(own.start)
