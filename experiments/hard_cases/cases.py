"""The hard cases that have an answer: what each one measures, and its bound; those that are refused follow."""

from functools import partial

import numpy as np

from experiments.hard_cases import bounces, directions, gloss, lights, meshes, textures
from experiments.hard_cases.case import Case, U
from experiments.hard_cases.moving import MOVING
from experiments.hard_cases.refusals import REFUSALS

FREE = "transfer - closed form"
SAME = "transfer - that of the clean mesh"
HALF = "float16"
GRAZE = "rays that graze may fall either way"

CASES = [
    Case("normals at and near -e_y: rotor", "R e_y ~R - n", 8 * U, directions.rotor_at_pole),
    Case("normals at and near -e_y: motor", "M ~M - 1", 8 * U, directions.motor_at_pole),
    Case(
        "normals at and near -e_y, -e_z: frames of the bake", "F^T F - 1, det F - 1", 8 * U, directions.frame_at_poles
    ),
    Case("a mesh with all normals -e_y: graph", "motor against position and n", 8 * U, directions.graph_of_a_ceiling),
    Case("1e4 motors composed", "M ~M - 1", 3e4 * U, partial(directions.drift, False), "3 U for each product"),
    Case("1e4 motors composed, renormalised", "M ~M - 1", 8 * U, partial(directions.drift, True)),
    Case(
        "1e4 motors composed",
        "place of a point",
        3e4 * U,
        partial(directions.displacement, False),
        "3 U for each product",
    ),
    Case(
        "1e4 motors composed, renormalised",
        "place of a point",
        3e4 * U,
        partial(directions.displacement, True),
        "3 U for each product: what drifts is the angle",
    ),
    Case("rotation by 180 degrees: rotor", "matrix -> rotor -> matrix", 16 * U, directions.rotor_of_half_turns),
    *(
        Case(
            f"rotation by 180 degrees: {bands} bands",
            "D(R) Y(w) - Y(R w)",
            64 * U,
            partial(directions.rotation_of_half_turns, bands),
            slow=bands == 10,
        )
        for bands in (5, 10)
    ),
    Case("10 bands", FREE, 4 * U, meshes.ten_bands, slow=True),
    Case("10 bands", "first 9 coefficients - bake of 3 bands", 4 * U, meshes.first_of_ten_bands, slow=True),
    Case("mesh of scale 1e-6", "relrmse against scale 1", 2e-3, partial(meshes.scaled, 1e-6), GRAZE),
    Case("mesh of scale 1e6", "relrmse against scale 1", 2e-3, partial(meshes.scaled, 1e6), GRAZE),
    Case(
        "mesh of radius 1e5, 1e6 from the origin",
        "relrmse against origin",
        2e-3,
        partial(meshes.far_away, 1e5),
        GRAZE,
    ),
    Case(
        "mesh of radius 1e3, 1e6 from the origin",
        "relrmse against origin",
        1e-2,
        partial(meshes.far_away, 1e3),
        "coordinates in steps of 6e-5 of the radius",
    ),
    Case(
        "mesh of radius 1, 1e6 from the origin",
        "relrmse against origin",
        0.3,
        partial(meshes.far_away, 1.0),
        "coordinates in steps of 1/16 of the radius; rays start 1/4 off",
    ),
    Case("convex mesh of radius 1, 1e6 from the origin", FREE, 4 * U, meshes.far_away_convex),
    Case("convex body of slivers, up to 1 : 5e4", FREE, 4 * U, meshes.needles),
    *(
        Case(
            f"flat sheet of slivers, 1 : {aspect:.0e}",
            "mean light lost",
            bound,
            partial(meshes.flat_needles, aspect),
            "rounding" if bound < 1e-6 else "the further lift of slivers ends at 1e-3",
        )
        for aspect, bound in ((1e3, 4 * U), (1e4, 4 * U), (1e5, 4 * U), (1e6, 2e-5))
    ),
    *(
        Case(
            f"convex body of random slivers, 1 : {stretch:.0e}",
            "mean light lost",
            bound,
            partial(meshes.stretched_body, stretch),
            why,
        )
        for stretch, bound, why in (
            (1e3, 4 * U, "rounding"),
            (1e4, 1e-4, "rounding of the vertices and of Embree beyond the lift of the rays"),
            (1e5, 1e-4, "rounding of the vertices and of Embree beyond the lift of the rays"),
        )
    ),
    Case("a third of the faces twice", SAME, 4 * U, meshes.duplicated),
    Case("faces of zero area", SAME, 1 / 64, meshes.zero_area, "one ray of 64"),
    Case("every face doubled", SAME, 4 * U, partial(meshes.doubled, False)),
    Case("every face doubled, back to back", SAME, 4 * U, partial(meshes.doubled, True)),
    Case("two coincident shells", SAME, 4 * U, partial(meshes.coincident_shells, False)),
    Case("two coincident shells, one inside out", SAME, 4 * U, partial(meshes.coincident_shells, True)),
    Case(
        "crevices narrower than the ray offset",
        "narrowest gap that stays dark, in half diagonals",
        1.3e-5,
        meshes.narrowest_crevice,
        "the offset, 1.2e-5 (more at slivers); light leaks into narrower ones",
    ),
    Case("rays through edges, Embree", "share that gets through", 0.0, partial(meshes.rays_at, "edges", "embree")),
    Case(
        "rays through vertices, Embree",
        "share that gets through",
        5e-3,
        partial(meshes.rays_at, "vertices", "embree"),
        "robust Embree is tight at edges, not at vertices",
    ),
    Case(
        "rays through edges, brute force",
        "share that gets through",
        0.25,
        partial(meshes.rays_at, "edges", "jax"),
        "Möller–Trumbore rounds each triangle by itself",
    ),
    Case("in a closed room", "transfer", 0.0, meshes.closed_room),
    Case("below an open sheet seen from behind", "transfer - that of the sheet turned", 4 * U, meshes.lid_from_behind),
    Case("flat open sheet", FREE, 4 * U, meshes.open_sheet),
    Case("open bowl, faces outside", FREE, 4 * U, meshes.bowl_from_behind),
    Case("single triangle", FREE, 4 * U, meshes.single_triangle),
    Case("100 loose triangles", "transfer - brute force, same rays", 1 / 64, meshes.loose_triangles, "one ray of 64"),
    Case("isolated vertices, one at 1e30", SAME + ", their own transfer", 4 * U, meshes.isolated_vertices),
    Case("inconsistent winding", SAME, 4 * U, meshes.inconsistent_winding),
    Case("three bodies, one inside out", SAME, 4 * U, meshes.opposite_orientations),
    Case("a million vertices", FREE, 4 * U, meshes.million_vertices, slow=True),
    Case("1e4 in one pixel", "energy of each band, relative", 8 * U, directions.energy_of_a_bright_pixel),
    *(
        Case(
            f"1e4 in one pixel, {bands} bands, {'shadows' if shadows else 'no shadows'}, window: {window}",
            "most negative / greatest radiance",
            bound,
            partial(directions.ringing, bands, window, shadows),
            "the light's series is cut",
            slow=bands == 10,
        )
        for bands, window, shadows, bound in (
            (3, "none", False, 0.04),
            (3, "Hann", False, 0.07),
            (3, "Lanczos", False, 0.045),
            (3, "none", True, 0.12),
            (3, "Hann", True, 0.07),
            (3, "Lanczos", True, 0.05),
            (10, "none", True, 0.15),
            (10, "Hann", True, 0.05),
            (10, "Lanczos", True, 0.06),
        )
    ),
    *(
        Case(
            f"1e4 in one pixel, {bands} bands, shadows, window: radiance",
            "most negative / greatest radiance",
            1e-6,
            partial(lights.sun_of_one_pixel, bands),
            "the window's own, for the mean over a vertex's rays",
            slow=bands == 10,
        )
        for bands in (3, 10)
    ),
    Case("black light, every window", "radiance; factors of the least windows - 1", 0.0, lights.black),
    *(
        Case(
            f"a map of {2 * height} x {height}, radiance 1",
            "coefficients - 2 sqrt(pi), 0, 0, ...",
            0.35 * (np.pi / height) ** 2 + 16 * U,
            partial(lights.map_of, 2 * height),
            "the light of a pixel comes from its middle: 0.33 (pi/H)² in l = 2 at H rows",
            slow=height == 8192,
        )
        for height in (4, 8192)
    ),
    Case("texture coordinates one tile beside 0 to 1", "texture - that within", 0.0, textures.beside_the_tile),
    Case("texture coordinates turned over", FREE, 2.0**-11, textures.turned_over, HALF),
    Case(
        "every edge a seam, few texels a face",
        "largest seam jump at points / largest coefficient",
        2.0**-10,
        textures.seams_everywhere,
        "float16 on both sides",
    ),
    Case("bounces, albedo 0", "coefficients - direct bake", 0.0, bounces.black_walls),
    Case("50 bounces, albedo 1", "irradiance / pi above 1", 1e-6, bounces.white_walls, "rounding of 50 sums"),
    Case("bounces, black light", "radiance", 0.0, bounces.black_light),
    Case("bounces, no vertex has a normal", "transfer", 0.0, bounces.no_normals),
    Case(
        "gloss, exponent 0",
        "radiance under constant light - closed form",
        2.0**-11,
        partial(gloss.constant_light, 0),
        HALF,
    ),
    Case(
        "gloss, exponent 1e4",
        "radiance under constant light - closed form",
        2.0**-11,
        partial(gloss.constant_light, 1e4),
        HALF,
    ),
    Case("gloss, black light", "radiance", 0.0, gloss.black_light),
    Case("gloss, a vertex without a normal", "radiance", 0.0, gloss.no_normal),
    Case("gloss, 10 bands", "visibility in 19 bands - hemisphere", 2.0**-11, gloss.ten_bands, HALF, slow=True),
    Case("gloss, a million vertices", "planned bytes, relative", 1e-3, gloss.million_vertices, "metadata", slow=True),
    *MOVING,
    *REFUSALS,
]
