"""The hard cases of objects that deform and of files of animations that have an answer: what each measures, its bound.

Bounds of errors against a bake are about twice what was measured when they were set: so much a change of seeds, or of
the order of sums, may make of it.
"""

from functools import partial

from experiments.hard_cases import deforming, recordings
from experiments.hard_cases.case import Case, U

BAKED = "relrmse against a bake"
POSES = "24 training poses, noise of both bakes"
HELD = "each number of a pose is held to its range"
FLAT = "normals of faces without area hang on rounding"

MOVING = [
    *(
        Case(
            f"a part of a deforming body collapses to a {shape}, {family}",
            BAKED,
            bound,
            partial(deforming.collapsed, family, shape),
            why,
        )
        for shape, family, bound, why in (
            ("point", "deform", 0.03, POSES + "; the closed form where all edges of a vertex vanish"),
            ("point", "momo-prt", 0.07, POSES),
            ("line", "deform", 0.15, FLAT),
            ("line", "momo-prt", 0.25, FLAT),
        )
    ),
    *(
        Case(
            f"weights of shapes {times:.0f} times those of the training, {family}",
            BAKED,
            bound,
            partial(deforming.far_outside, family, times),
            "shadows are those of a pose within the range",
        )
        for times, family, bound in (
            (3.0, "deform", 0.08),
            (3.0, "momo-prt", 0.12),
            (10.0, "deform", 0.4),
            (10.0, "momo-prt", 0.5),
        )
    ),
    *(
        Case(
            f"{name}, {family}",
            measured,
            bound,
            partial(measure, family),
            why,
        )
        for name, measured, measure, bounds, why in (
            (
                "poses 1e3 times farther out than those of the training, and of size 1e35",
                "largest |t_00| / that of a free vertex",
                deforming.brightest_outside,
                (1.3, 1.3),
                HELD,
            ),
            (
                "shapes that never move or never change in the training",
                "poses within the training said to be outside",
                deforming.unused_shape,
                (0.0, 0.0),
                "rounding counts as inside",
            ),
            (
                "frames that are all the same",
                "prediction - mean of the bakes",
                deforming.no_motion,
                (2.0**-12, 4 * U),
                "float16 in turned frames, or rounding",
            ),
            ("every vertex of a deforming body twice", BAKED, deforming.split_vertices, (0.025, 0.035), POSES),
            (
                "isolated vertices of a deforming body, one at 1e30",
                BAKED + ", their own transfer",
                deforming.isolated_vertices,
                (0.025, 0.035),
                POSES,
            ),
        )
        for family, bound in zip(("deform", "momo-prt"), bounds, strict=True)
    ),
    Case(
        "an animation of one frame, gash animate",
        "transfer - bake of its mesh",
        2.0**-12,
        recordings.single_frame,
        "float16",
    ),
    Case(
        "a recording of 187 MiB, opened",
        "heap / that of the health report of its first frame",
        1.1,
        partial(recordings.long_recording, "opened"),
        "frames are checked one by one",
    ),
    Case(
        "a recording of 187 MiB, read frame by frame",
        "heap / bytes of a frame",
        5.0,
        partial(recordings.long_recording, "read"),
        "a frame in float64 and in float32, and the one before it",
    ),
]
