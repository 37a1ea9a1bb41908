"""What hard meshes do to the bake: each function measures one number, `told` is what the health report says.

Every mesh goes through `prepare_mesh`, the door that files come in by. *Clean* means the same mesh without what makes
it hard. Three yardsticks: the closed form, for convex bodies and single sheets, all of whose rays are free (a
convex body lies in the cone that the angle-weighted normal of a vertex is inside of); the clean mesh's bake from
the same rays; darkness, for vertices behind walls. Differences are the largest over vertices and coefficients.
"""

import re
import resource
import time

import numpy as np
from scipy.spatial import ConvexHull

from experiments.hard_cases.directions import SILENT
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.health import HealthReport, prepare_mesh
from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.visibility import visibility
from gash_jax.shapes.primitives import bumpy_sphere, grid, icosphere, patch, spherical_bowl, uv_sphere

RAYS = 64
X, Y, Z = np.eye(3)


def _told(report: HealthReport) -> str:
    """The report's lines without the examples that it names."""
    return "; ".join(re.sub(r" \(first: [^)]*\)", "", line) for line in report.lines()) or SILENT


def _bake(mesh: Mesh, bands: int = 3, rays: int = RAYS) -> np.ndarray:
    return bake_transfer(mesh, bands, rays).coefficients


def _from_closed_form(vertices: np.ndarray, faces: np.ndarray, bands: int = 3) -> tuple[float, str]:
    """Largest difference between bake and closed form; nan where a vertex has no normal."""
    mesh, report = prepare_mesh(vertices, faces)
    difference = np.abs(_bake(mesh, bands) - np.asarray(unshadowed_transfer(mesh.normals, bands))).max()
    return (float("nan") if report.counts["vertices_without_normal"] else float(difference)), _told(report)


def _from_clean(vertices: np.ndarray, faces: np.ndarray, clean: Mesh) -> tuple[float, str]:
    """Largest difference between the bakes of a mesh and of a clean one that its first vertices belong to."""
    mesh, report = prepare_mesh(vertices, faces)
    ours, theirs = (prepared.astype(np.float64) for prepared in (_bake(mesh), _bake(clean)))
    return float(np.abs(ours[: len(theirs)] - theirs).max()), _told(report)


def _relrmse(ours: np.ndarray, reference: np.ndarray) -> float:
    return float(np.sqrt(np.sum((ours - reference) ** 2) / np.sum(reference**2)))


def _bumpy() -> Mesh:
    ball = bumpy_sphere(8)
    return prepare_mesh(ball.vertices, ball.faces)[0]


def scaled(scale: float) -> tuple[float, str]:
    """relrmse against the bake at scale 1."""
    clean = _bumpy()
    mesh, report = prepare_mesh(clean.vertices.astype(np.float64) * scale, clean.faces)
    return _relrmse(_bake(mesh), _bake(clean)), _told(report)


def far_away(size: float, distance: float = 1e6) -> tuple[float, str]:
    """relrmse against the bake at the origin."""
    clean = _bumpy()
    moved = clean.vertices.astype(np.float64) * size + distance * X
    mesh, report = prepare_mesh(moved.astype(np.float32), clean.faces)
    return _relrmse(_bake(mesh), _bake(clean)), _told(report)


def far_away_convex(distance: float = 1e6) -> tuple[float, str]:
    """The ray offset keeps a ball of radius 1 free of the staircase that its coordinates have become."""
    ball = icosphere(3)
    return _from_closed_form((ball.vertices.astype(np.float64) + distance * X).astype(np.float32), ball.faces)


def needles() -> tuple[float, str]:
    """A convex body of slivers: a sphere of 6 circles with 500 vertices each, drawn out to 1000 times its width."""
    ball = uv_sphere(7, 500)
    return _from_closed_form(ball.vertices.astype(np.float64) * [1, 1000, 1], ball.faces)


def flat_needles(aspect: float) -> tuple[float, str]:
    """Mean part of the light that ten flat sheets of random slivers, turned at random, take from themselves."""
    lost, told = [], ""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        u, w, faces = grid(4, 4)
        u, w = (t + rng.uniform(-0.05, 0.05, t.shape) for t in (u, w))
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        mesh, report = prepare_mesh(np.stack([u, w / aspect, 0 * u], axis=1) @ (q * np.linalg.det(q)).T, faces)
        lost.append(1 - _bake(mesh, 1, 1024)[:, 0] / np.asarray(unshadowed_transfer(mesh.normals, 1))[:, 0])
        told = _told(report)
    return float(np.mean(lost)), told


def stretched_body(stretch: float) -> tuple[float, str]:
    """Mean part of the light that ten random convex bodies, drawn out and turned at random, take from themselves."""
    lost, told = [], ""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        points = rng.normal(size=(40, 3))
        points *= [1 / stretch, 1, 1 / stretch] / np.linalg.norm(points, axis=1, keepdims=True)
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        points = (points @ (q * np.linalg.det(q)).T).astype(np.float32)
        hull = ConvexHull(points.astype(np.float64))  # of what is stored, so that it is convex
        a, b, c = np.moveaxis(hull.points[hull.simplices], 1, 0)
        inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
        mesh, report = prepare_mesh(points, np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices))
        lost.append(1 - _bake(mesh, 1, 1024)[:, 0] / np.asarray(unshadowed_transfer(mesh.normals, 1))[:, 0])
        told = _told(report)
    return float(np.mean(lost)), told


def duplicated() -> tuple[float, str]:
    """A third of the faces once more, at the end."""
    clean = _bumpy()
    return _from_clean(clean.vertices, np.concatenate([clean.faces, clean.faces[::3]]), clean)


def zero_area() -> tuple[float, str]:
    """Faces with a repeated corner, and faces between three corners in a line, among the others."""
    clean = _bumpy()
    first = clean.faces[:50]
    repeated = first[:, [0, 0, 1]]
    middle = clean.vertices[first[:, :2]].astype(np.float64).mean(axis=1)
    vertices = np.concatenate([clean.vertices, middle.astype(np.float32)])
    flat = np.stack([first[:, 0], len(clean.vertices) + np.arange(50), first[:, 1]], axis=1)
    return _from_clean(vertices, np.concatenate([repeated, clean.faces, flat]).astype(np.int32), clean)


def doubled(reverse: bool) -> tuple[float, str]:
    """Every face twice, the second time as it is or the other way round."""
    clean = _bumpy()
    again = clean.faces[:, ::-1] if reverse else clean.faces
    return _from_clean(clean.vertices, np.concatenate([clean.faces, again]), clean)


def coincident_shells(reverse: bool) -> tuple[float, str]:
    """The whole surface twice, each with vertices of its own, the second as it is or turned inside out."""
    clean = _bumpy()
    again = (clean.faces[:, ::-1] if reverse else clean.faces) + len(clean.vertices)
    return _from_clean(np.tile(clean.vertices, (2, 1)), np.concatenate([clean.faces, again]), clean)


def narrowest_crevice() -> tuple[float, str]:
    """Bisection of the gap between two facing squares down to which their middles stay dark; in half diagonals."""
    corners = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1], [0, 0, 0]], np.float64) / np.sqrt(2)
    fan = np.array([[4, 0, 3], [4, 3, 2], [4, 2, 1], [4, 1, 0]])  # faces up
    dark, bright, told = 1e-3, 0.0, ""
    for _ in range(20):
        gap = (dark + bright) / 2
        vertices = np.concatenate([corners, corners + gap * Y]).astype(np.float32)
        mesh, report = prepare_mesh(vertices, np.concatenate([fan, fan[:, ::-1] + 5]).astype(np.int32))
        told = _told(report)
        dark, bright = (dark, gap) if _bake(mesh)[[4, 9]].any() else (gap, bright)
    return dark, told


def rays_at(what: str, backend: str) -> tuple[float, str]:
    """Share of rays from inside a closed ball, aimed at its "vertices" or at points of its "edges", that get out."""
    ball = transform(icosphere(4), np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0], [0.48, 0.64, 0.6]]))
    corners = ball.vertices.astype(np.float64)
    a, b = corners[ball.faces].reshape(-1, 3), corners[ball.faces[:, [1, 2, 0]]].reshape(-1, 3)
    targets = corners if what == "vertices" else np.concatenate([(1 - s) * a + s * b for s in (0.5, 0.123)])
    centers = np.array([[0, 0, 0], [0.3, -0.2, 0.1], [-0.01, 0.95, 0.02]])
    directions = np.concatenate([targets - center for center in centers]).astype(np.float32)
    origins = np.repeat(centers, len(targets), axis=0).astype(np.float32)
    step = 1 if backend == "embree" else len(origins) // 500  # there every ray meets every triangle
    free = visibility(ball.vertices, ball.faces, backend)(origins[::step], directions[::step])
    return float(np.mean(free)), "nothing: the rays of a bake are random and aim at no vertex or edge"


def closed_room() -> tuple[float, str]:
    """A bumpy ball in a closed room of long triangles: any transfer that is not 0 is a wall missed."""
    inside = _bumpy()
    room = uv_sphere(5, 31).vertices.astype(np.float64) * 1.7, uv_sphere(5, 31).faces + len(inside.vertices)
    mesh, report = prepare_mesh(np.concatenate([inside.vertices, room[0]]), np.concatenate([inside.faces, room[1]]))
    return float(np.abs(_bake(mesh)[: len(inside.vertices)]).max()), _told(report)


def lid_from_behind() -> tuple[float, str]:
    """Below an open sheet that shows its back, against the sheet that shows its face."""
    ground, lid = patch(np.zeros(3), Z, X, 8), patch(0.4 * Y - X - Z, 3 * Z, 3 * X)
    vertices, count = np.concatenate([ground.vertices, lid.vertices]), len(ground.vertices)
    clean, _ = prepare_mesh(vertices, np.concatenate([ground.faces, lid.faces[:, ::-1] + count]))
    mesh, report = prepare_mesh(vertices, np.concatenate([ground.faces, lid.faces + count]))
    return float(np.abs(_bake(mesh)[:count] - _bake(clean)[:count]).max()), _told(report)


def open_sheet() -> tuple[float, str]:
    """A flat open sheet is lit from the side that its winding faces, and from that side alone."""
    sheet = patch(np.zeros(3), X, Y, 8)  # faces +z
    return _from_closed_form(sheet.vertices, sheet.faces[:, ::-1])


def bowl_from_behind() -> tuple[float, str]:
    """An open bowl with its faces on the outside is convex: kept as in the file, it is unshadowed."""
    bowl = spherical_bowl(np.radians(60), 12)
    return _from_closed_form(bowl.vertices, bowl.faces[:, ::-1])


def single_triangle() -> tuple[float, str]:
    """Three vertices, one face."""
    return _from_closed_form(np.stack([X, 2 * Y, 3 * Z]), np.array([[0, 1, 2]]))


def loose_triangles() -> tuple[float, str]:
    """100 triangles in a unit cube, against the brute-force tracer and the same rays."""
    rng = np.random.default_rng(7)
    vertices = (rng.random((100, 1, 3)) + 0.2 * rng.normal(size=(100, 3, 3))).reshape(-1, 3)
    mesh, report = prepare_mesh(vertices, np.arange(300).reshape(-1, 3))
    other = bake_transfer(mesh, 3, RAYS, backend="jax").coefficients
    return float(np.abs(_bake(mesh) - other).max()), _told(report)


def isolated_vertices() -> tuple[float, str]:
    """Ten vertices in no face, one of them at 1e30: theirs is transfer 0, the others' that of the clean mesh."""
    clean = _bumpy()
    loose = np.concatenate([np.full((1, 3), 1e30), np.random.default_rng(0).normal(size=(9, 3))])
    mesh, report = prepare_mesh(np.concatenate([clean.vertices, loose]), clean.faces)
    baked, count = _bake(mesh), len(clean.vertices)
    difference = np.abs(baked[:count] - _bake(clean)).max()
    return max(float(difference), float(np.abs(baked[count:]).max())), _told(report)


def inconsistent_winding() -> tuple[float, str]:
    """Three in ten faces wound the wrong way."""
    clean, faces = _bumpy(), _bumpy().faces.copy()
    wrong = np.random.default_rng(0).random(len(faces)) < 0.3
    faces[wrong] = faces[wrong, ::-1]
    return _from_clean(clean.vertices, faces, clean)


def opposite_orientations() -> tuple[float, str]:
    """Three bumpy balls in a row, the one in the middle inside out, against the three as they should be."""
    ball = _bumpy()
    vertices = np.concatenate([ball.vertices + shift * X for shift in (0.0, 3.0, 6.0)]).astype(np.float32)
    faces = [ball.faces + i * len(ball.vertices) for i in range(3)]
    clean, _ = prepare_mesh(vertices, np.concatenate(faces))
    return _from_clean(vertices, np.concatenate([faces[0], faces[1][:, ::-1], faces[2]]), clean)


def ten_bands() -> tuple[float, str]:
    """100 coefficients of a free ball against the closed form."""
    ball = icosphere(3)
    return _from_closed_form(ball.vertices, ball.faces, 10)


def first_of_ten_bands() -> tuple[float, str]:
    """The first nine of 100 coefficients against a bake of three bands with the same rays."""
    mesh = _bumpy()
    return float(np.abs(_bake(mesh, 10)[:, :9] - _bake(mesh, 3)).max()), SILENT


def million_vertices() -> tuple[float, str]:
    """A ball of a million vertices, 16 rays each, from arrays to transfer; tells memory and seconds."""
    ball = bumpy_sphere(317, amplitude=0.0)
    started = time.perf_counter()
    mesh, report = prepare_mesh(ball.vertices, ball.faces)
    prepared = time.perf_counter()
    baked = bake_transfer(mesh, 3, 16).coefficients
    finished = time.perf_counter()
    difference = np.abs(baked - np.asarray(unshadowed_transfer(mesh.normals, 3))).max()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    told = f"{_told(report)}; {len(mesh.vertices)} vertices: health report {prepared - started:.1f} s, "
    return float(difference), told + f"bake {finished - prepared:.1f} s, peak memory of the process {peak:.0f} MiB"
