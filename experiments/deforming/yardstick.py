"""What coefficients of test frames are measured with: every measure of the table, of all methods alike.

*Equivalent rays* come from plain bakes of the same frames, interpolated in log-log as everywhere. SSIM is that of
linear pictures of some test frames under the studio light, the mean over the frames. *Flicker* is
measured on frames that follow one another: the test frames, or a path between some of them.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from experiments.deforming.movie import CAMERA
from gash_jax.apps.pictures.views import Hit, cast_view, shade_view
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.environment import project_light
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.measure.deforming import SequenceScores
from gash_jax.measure.metrics import equivalent_rays, image_scores
from gash_jax.prt.sequence import posed_meshes
from gash_jax.train.truth import Truth

SIZE, PICTURES = 256, 10
Say = Callable[[Mesh], Any]  # coefficients of a pose


class Frames(NamedTuple):
    """Baked frames in memory."""

    meshes: list[Mesh]
    references: list[Float[np.ndarray, "v k"]]


def frames_of(truth: Truth) -> Frames:
    """All frames of a truth, float32."""
    references = [np.asarray(frame, np.float32) for shard in truth.shards() for frame in shard]
    return Frames(list(posed_meshes(truth.scene.receivers)), references)


class Yardstick:
    """The measures of one object's test frames, of the first `bands` bands."""

    def __init__(self, test: Frames, in_time: Frames | None, ranges: Float[np.ndarray, "k"], bands: int) -> None:
        self._test, self._in_time, self._kept = test, in_time, bands**2
        self._ranges, self._light = ranges[: self._kept], project_light(studio_light(), bands)
        chosen = np.unique(np.linspace(0, len(test.meshes) - 1, PICTURES).round().astype(int))
        self._views: dict[int, Hit] = {int(t): cast_view(test.meshes[t], CAMERA, SIZE) for t in chosen}
        self._rays: dict[int, float] = {}
        self._milliseconds: dict[int, float] = {}

    def scores(self, estimates: Sequence[Any]) -> dict[str, float]:
        """The measures of estimates of all test frames, but those that need a curve or frames in time."""
        sums = SequenceScores(self._ranges)
        ssim = []
        for t, (mesh, reference, estimate) in enumerate(zip(*self._test, estimates, strict=True)):
            said, truth = (np.asarray(each, np.float32)[:, : self._kept] for each in (estimate, reference))
            sums.add(said, truth, mesh.normals)
            if t in self._views:
                drawn = [shade_view(self._views[t], np.asarray(shade(each, self._light)))[0] for each in (said, truth)]
                ssim.append(image_scores(*drawn)["ssim"])
        return {**sums.scores(), "ssim": float(np.mean(ssim))}

    def flicker(self, say: Say) -> dict[str, float]:
        """Flicker of a method, where there are frames in time."""
        if self._in_time is None:
            return {}
        sums = SequenceScores(self._ranges)
        for mesh, reference in zip(*self._in_time, strict=True):
            sums.add(np.asarray(say(mesh), np.float32)[:, : self._kept], reference[:, : self._kept], mesh.normals)
        found = sums.scores(flicker=True)
        return {"flicker": found["flicker"]} if "flicker" in found else {}

    def add_bake(self, rays: int, row: dict[str, Any]) -> None:
        """A point of the curve that equivalent rays are read from."""
        self._rays[rays], self._milliseconds[rays] = row["relrmse"] ** 2, row["model_ms"]

    def against_bakes(self, relrmse: float) -> dict[str, float | str]:
        """Rays of the bake of this error, and its milliseconds."""
        found = equivalent_rays(relrmse**2, self._rays)
        if isinstance(found, str):
            return {"equivalent_rays": found}
        counts = sorted(self._rays)
        times = np.log([self._milliseconds[n] for n in counts])
        return {"equivalent_rays": found, "bake_ms": float(np.exp(np.interp(np.log(found), np.log(counts), times)))}
