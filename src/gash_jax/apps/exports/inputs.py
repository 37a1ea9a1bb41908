"""What an ONNX file wants of a mesh: names, shapes and meanings; section numbers are those of docs/model_file.md.

The first axis of each is free: as many vertices as there are.
"""

from gash_jax.algebra.even import MOTOR_8
from gash_jax.apps.exports.graph import Graph, Value
from gash_jax.nn.inputs import MOTOR_7, ROTOR

VERTICES = "vertices"


def motor(g: Graph) -> Value:
    """The motor of each vertex, (v, 32)."""
    return g.input("motor", (VERTICES, 32), "motor M = T R of each vertex, by blade (Motors)")


def normal(g: Graph) -> Value:
    """Unit normals, (v, 3)."""
    return g.input("normal", (VERTICES, 3), "unit normal of each vertex, 0 where it has none (Input)")


def position(g: Graph) -> Value:
    """Positions, (v, 3)."""
    return g.input("position", (VERTICES, 3), "position of each vertex, (p - c) / s (Input)")


def neighbours(g: Graph, count: int) -> Value:
    """The table of senders, (v, k) int32."""
    return g.input("neighbours", (VERTICES, count), "row i: whose messages vertex i receives (Graphs)", "int32")


def edge_motors(g: Graph, count: int) -> Value:
    """Relative motors of edges, (v, k, 8)."""
    shape = (VERTICES, count, len(MOTOR_8))
    return g.input("edge_motor", shape, "motor of each edge, its 8 numbers (graph.encodings)")


def edge_features(g: Graph, count: int) -> Value:
    """Features of edges, (v, k, 16)."""
    return g.input("edges", (VERTICES, count, 16), "features of each edge (Edge features)")


def frame(g: Graph) -> Value:
    """Frames of vertices, (v, 3, 3)."""
    return g.input("frame", (VERTICES, 3, 3), "frame of each vertex, axes as columns (Edge features)")


def visibility(g: Graph, directions: int) -> Value:
    """Traced visibilities, (v, n)."""
    return g.input("visibility", (VERTICES, directions), "1 where a direction is free, 0 where not (Directions)")


def vertex_inputs(g: Graph, encoding: str) -> Value:
    """Every vertex in an encoding of `nn.inputs`."""
    if encoding == "position-normal":
        return g.concat([position(g), normal(g)], 1)
    columns = {"motor-7": MOTOR_7, "relative-motor": ROTOR}.get(encoding)
    return motor(g) if columns is None else motor(g).take(columns, 1)
