"""The numbers of docs/model_file.md, stage by stage, for whoever ports `gash_numpy.py`: a valley of four vertices.

    python -m runtimes.worked_example --output docs/results/model_example.json

The weights need no file: element i (from 0, row-major) of every array is sin(i + 1) / sqrt(n), n the length of its
first axis, in float32. So an array that is read in another order shows. Numbers of a vertex are those of vertex 2
unless a row says otherwise.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from runtimes import gash_numpy as gash

VERTICES = np.array([[0, 0, -1], [0.25, 0.125, 1], [1, 1, 0.125], [-0.75, 1.25, 0]], np.float32)
FACES = np.array([[0, 1, 2], [1, 0, 3]], np.int32)
NORMALS = np.array([[0, 1, 0], [0.28, 0.96, 0], [-0.6, 0.8, 0], [0.8, 0.6, 0]], np.float32)
VERTEX = 2
SMALL: dict[str, Any] = {"bands": 2, "channels": 4, "layers": 1}
NEAREST: dict[str, Any] = {**SMALL, "heads": 2, "neighbours": 2, "graph": "knn"}
SEEING: dict[str, Any] = {**NEAREST, "visibility_directions": 3}
CONFIGS: dict[str, dict[str, Any]] = {
    "mlp": {**SMALL, "name": "mlp"},
    "gnn": {**NEAREST, "name": "gnn", "frame": "vertex", "residual": True},
    "teacher": {**SEEING, "name": "teacher"},
    "two-stage": {**SEEING, "name": "two-stage", "visibility_channels": 4, "visibility_layers": 1},
    "rings": {**SMALL, "name": "rings", "heads": 2, "neighbours": 4},
    "local": {**SMALL, "name": "local", "bands": 4, "known_bands": 4, "known_bounces": 1},
}
VISIBILITY = np.array([[1, 0, 1], [1, 1, 0], [0, 1, 1], [1, 1, 1]], np.float32)

Rows = list[list[Any]]  # a label and its numbers


def sine_weights(*shape: int) -> np.ndarray:
    """The array of this shape (module docstring)."""
    return (np.sin(np.arange(1, math.prod(shape) + 1)) / math.sqrt(shape[0])).astype(np.float32).reshape(shape)


def sine_model(name: str, shapes: dict[str, tuple[int, ...]]) -> gash.Model:
    """A model of CONFIGS; `shapes` are those of its arrays."""
    return gash.Model(CONFIGS[name], {key: sine_weights(*shape) for key, shape in shapes.items()})


def _numbers(values: Any) -> list[float]:
    """Plain numbers, rounded to what float32 holds for certain."""
    return [float(f"{x:.6g}") + 0.0 for x in np.asarray(values, float).reshape(-1)]  # -0 is 0


def _units() -> tuple[np.ndarray, np.ndarray]:
    """Positions in units of the box, and of the surface."""
    return tuple(
        gash.normalised_positions(VERTICES, FACES, unit)[0] for unit in (0.0, gash.surface_radius(VERTICES, FACES))
    )  # type: ignore[return-value]


def inputs() -> Rows:
    """The mesh as networks read it."""
    center, half, _ = gash.bounding_box(VERTICES, FACES)
    rows: Rows = [["c", _numbers(center)], ["s", _numbers(half)]]
    return rows + [[f"(p - c) / s of vertex {i}", _numbers(p)] for i, p in enumerate(_units()[0])]


def motors() -> Rows:
    """What is not 0 of the motor."""
    found = gash.motors(_units()[0], NORMALS)[VERTEX]
    rows: Rows = [[f"index {i}", _numbers(found[i])] for i in np.flatnonzero(found)]
    return rows + [["column y of the rotor's matrix", _numbers(gash.rotor_matrices(found[None])[0, :, 1])]]


def directions() -> Rows:
    """Three directions about the normal, and three in the world."""
    azimuth = 2 * math.pi * np.arange(3) / ((1 + math.sqrt(5)) / 2)
    sets = []
    for height in (1 - (np.arange(3) + 0.5) / 3, 1 - (2 * np.arange(3) + 1) / 3):
        radius = np.sqrt(1 - height**2)
        sets.append(np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], -1))
    about_y = np.stack([sets[0][:, 0], sets[0][:, 2], -sets[0][:, 1]], -1)
    turned = about_y @ gash.rotor_matrices(gash.motors(_units()[0], NORMALS))[VERTEX].T
    rows: Rows = [[f"`vertex`, direction {i} of 3", _numbers(d)] for i, d in enumerate(turned)]
    return rows + [[f"`world`, direction {i} of 3", _numbers(d)] for i, d in enumerate(sets[1])]


def graphs() -> Rows:
    """The table of two neighbours."""
    table = gash.nearest(VERTICES.astype(float), np.arange(4), 2)
    return [[f"row {i}", _numbers(row)] for i, row in enumerate(table)]


def edges() -> Rows:
    """Frame and features of the edges to two neighbours."""
    table, units = gash.nearest(VERTICES.astype(float), np.arange(4), 2), _units()[1]
    frames = gash.vertex_frames(units.astype(float), NORMALS.astype(float), table)
    features = gash.edge_features(units, NORMALS, frames, table)[VERTEX, 0]
    rows: Rows = [["r", _numbers(gash.surface_radius(VERTICES, FACES))]]
    rows += [[f"column {'xyz'[i]} of F", _numbers(frames[VERTEX, :, i])] for i in range(3)]
    return [*rows, [f"edge to vertex {table[VERTEX, 0]}", _numbers(features)]]


def _surfels() -> tuple[np.ndarray, gash.Tree, np.ndarray]:
    """Axes, tree and records."""
    units, faces = _units()[1], gash.outward_faces(VERTICES, NORMALS, FACES)
    area = gash.face_areas(units, faces)
    axes = gash.surface_axes(units, faces, area)
    tree = gash.build_tree(units, faces, area, axes)
    return axes, tree, gash.surfel_records(tree, units, faces)


def _read() -> tuple[np.ndarray, ...]:
    """What `local` reads of the vertex, as `gash.encode` takes it; and the rows of its list."""
    (_, tree, records), units, one = _surfels(), _units()[1], slice(VERTEX, VERTEX + 1)
    table, weight, beside = gash.list_surfels(tree, records, units[one], NORMALS[one])
    faces = gash.outward_faces(VERTICES, NORMALS, FACES)
    covered = gash.cover(tree, faces, units, np.array([VERTEX]), NORMALS[one], beside)
    corners = gash.corner_table(faces, 4)[VERTEX]
    near = np.concatenate([units[corners] - units[VERTEX], NORMALS[corners]], axis=1)
    return records[table], weight, units[one], NORMALS[one], near[None], covered, table


def surfels() -> Rows:
    """Tree, records and the list of the vertex."""
    axes, tree, records = _surfels()
    _, weight, *_, beside, table = _read()
    rows: Rows = [[f"axis {i}", _numbers(axes[:, i])] for i in range(3)]
    rows += [["level sizes", _numbers(tree.level_sizes)], ["first child of row 0", _numbers(tree.first_child[0])]]
    leaf = sum(tree.level_sizes[:-1])
    part = tree.piece[leaf] - gash.PIECE_START[gash.MOST_PARTS - 1]  # both faces are cut into most parts
    rows += [[f"row {leaf}: face, part of it", _numbers([tree.face[leaf], part])]]
    rows += [["record of row 0", _numbers(records[0])], [f"record of row {leaf}", _numbers(records[leaf])]]
    rows += [["length of the list", _numbers(table.shape[1])], ["its rows", _numbers(table)]]
    near = gash.corner_table(gash.outward_faces(VERTICES, NORMALS, FACES), 4)[VERTEX]
    return [*rows, ["their weights", _numbers(weight)], ["near corners", _numbers(near)], ["cover", _numbers(beside)]]


def layers() -> Rows:
    """Each layer on states that are sine weights (4, 4), with two neighbours."""
    x, table = sine_weights(4, 4), gash.nearest(VERTICES.astype(float), np.arange(4), 2)
    square = {f"{name}/kernel": sine_weights(4, 4) for name in ("d", "t/query", "t/key", "t/value", "t/root")}
    square |= {f"g/{name}/kernel": sine_weights(4, 4) for name in ("source", "target")}
    biases = {name.replace("kernel", "bias"): sine_weights(4) for name in square}
    a = {**square, **biases, "n/scale": sine_weights(4), "n/bias": sine_weights(4)}
    a |= {"g/attention": sine_weights(2, 2), "g/bias": sine_weights(4)}
    return [
        ["x", _numbers(x[VERTEX])],
        ["Dense", _numbers(gash.dense(a, "d", x)[VERTEX])],
        ["LayerNorm", _numbers(gash.layer_norm(a, "n", x)[VERTEX])],
        ["TransformerConv, 2 heads", _numbers(gash.transformer_conv(a, "t", x, table, 2)[VERTEX])],
        ["GATv2Conv, 2 heads", _numbers(gash.gatv2_conv(a, "g", x, table, 2)[VERTEX])],
    ]


def closed_form() -> Rows:
    """Of the normal; and turned by the frame of the rotor."""
    exact = gash.closed_form(NORMALS.astype(float), 3)
    frames = gash.rotor_matrices(gash.motors(_units()[0], NORMALS))
    turned = gash.rotate_sh(sine_weights(4, 9), frames)
    rows: Rows = [["n", _numbers(NORMALS[VERTEX])], ["t, 3 bands", _numbers(exact[VERTEX])]]
    return [*rows, ["c", _numbers(sine_weights(4, 9)[VERTEX])], ["c turned by R", _numbers(turned[VERTEX])]]


def models(shapes: dict[str, dict[str, tuple[int, ...]]]) -> Rows:
    """Coefficients by every network with sine weights; `shapes` by model."""
    rows: Rows = []
    for name in CONFIGS:
        model = sine_model(name, shapes[name])
        told = VISIBILITY if name == "teacher" else None
        rows.append([f"`{name}`", _numbers(gash.predict(model, VERTICES, NORMALS, FACES, told)[VERTEX])])
        if name == "local":
            rows += _local(model)
    return rows


def _local(model: gash.Model) -> Rows:
    """What else `local` says, and on the way to it."""
    z, frames, seen = gash.encode(model.arrays, *_read()[:6])
    terms, errors = gash.surfel_net(model, VERTICES, NORMALS, FACES, bounces=1)
    by_band = np.arange(4) ** 2  # of the coefficients of a band the first: all have one error
    rows: Rows = [["`local`, t", _numbers(frames[0, :, 0])], ["`local`, z", _numbers(z)]]
    rows += [["`local`, Q", _numbers(seen)]]
    rows += [["`local`, predicted error by band", _numbers(errors[0, VERTEX, by_band])]]
    rows += [["`local`, first bounce", _numbers(terms[1, VERTEX])]]
    return [*rows, ["`local`, predicted error of the first bounce by band", _numbers(errors[1, VERTEX, by_band])]]


def deforming_models() -> dict[str, gash.Model]:
    """Both kinds that belong to one object, here the valley; the first patch compares all it reads, the second adds."""
    pose = {"pose/sample": np.array([3, 1]), "pose/still": np.zeros((2, 3)), "pose/matrix": sine_weights(6, 2)}
    pose |= {"pose/low": np.full(2, -1.0), "pose/high": np.full(2, 0.5), "mean": sine_weights(4, 4)}
    linear = {"middle": sine_weights(2), "weights": sine_weights(2, 3), "basis": sine_weights(3, 4, 4)}
    patches = {"patch": np.array([0, 0, 1, 1]), "row": np.array([2, 0, 3, 1]), "neighbour": np.array([1, 0, 1, 0])}
    patches |= {"anchors": np.array([[0, 1, 2], [3, 1, 0]]), "points": np.array([[3, 0], [2, 1]])}
    patches |= {"axes": sine_weights(2, 3, 2), "still": sine_weights(2, 2, 3), "into": sine_weights(2, 6, 16)}
    patches |= {
        "unit": np.array([2.0]),
        "together": np.array([1, 0]),
        "amounts": sine_weights(2, 8),
        "known": sine_weights(2, 16, 5),
    }
    for level, (numbered, rows, width) in enumerate(((2, 4, 1), (1, 2, 1), (1, 2, 2))):
        patches[f"directions/{level}"] = np.rint(100 * sine_weights(rows, 4, width))
        patches[f"weights/{level}"] = sine_weights(numbered, 5, width)
    kinds = {"momo-prt": linear, "deform": patches}
    return {
        name: gash.Model({"name": name, "bands": 2}, {key: array.astype(np.float32) for key, array in both.items()})
        for name, both in ((name, {**pose, **arrays}) for name, arrays in kinds.items())
    }


def deforming() -> Rows:
    """One pose of the four vertices by both kinds."""
    found = deforming_models()
    arrays = found["deform"].arrays
    middle, axes = gash.patch_axes(arrays, VERTICES)
    said = {name: gash.predict_pose(model, VERTICES, NORMALS) for name, model in found.items()}
    rows: Rows = [["`momo-prt`", _numbers(said["momo-prt"][VERTEX])], ["c of patch 1", _numbers(middle[1])]]
    rows += [[f"axis {name} of patch 1", _numbers(axis)] for name, axis in zip("xyz", axes[1], strict=True)]
    rows += [["f of patch 1", _numbers(gash.told_numbers(arrays, VERTICES)[1])]]
    rows += [[f"K of patch {i}", _numbers(row)] for i, row in enumerate(gash.pose_kernel(arrays, VERTICES))]
    rows += [["`deform`, vertex 1, in patch 0", _numbers(said["deform"][1])]]
    return [*rows, ["`deform`, vertex 2, in patch 1", _numbers(said["deform"][VERTEX])]]


def network_shapes() -> dict[str, dict[str, tuple[int, ...]]]:
    """Shapes of the arrays of every network of CONFIGS, by the package."""
    from gash_jax.models.families import config_from_dict
    from gash_jax.models.parameter_shapes import parameter_shapes

    return {name: parameter_shapes(config_from_dict(config)) for name, config in CONFIGS.items()}


def stages() -> dict[str, Rows]:
    """All of it."""
    found = {"inputs": inputs(), "motors": motors(), "directions": directions(), "graphs": graphs()}
    found |= {"edges": edges(), "surfels": surfels(), "layers": layers(), "closed form": closed_form()}
    return {**found, "models": models(network_shapes()), "deforming": deforming()}


def main(output: Path | None) -> dict[str, Any]:
    """Compute and write the numbers."""
    from benchmarks.options import saved
    from gash_jax.measure.provenance import provenance

    return saved(output, provenance(stages=stages()))


if __name__ == "__main__":
    from benchmarks.options import options

    main(**options(__doc__, "output"))
