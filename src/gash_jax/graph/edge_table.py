"""For every vertex the vertices at the other ends of its edges, as a table of fixed width."""

import numpy as np
from jaxtyping import Bool, Int
from scipy.sparse import csr_array

WIDTH = 6  # of a closed mesh a vertex has six edges on average


def edge_table(
    faces: Int[np.ndarray, "f 3"], n_vertices: int, width: int = WIDTH
) -> tuple[Int[np.ndarray, "v m"], Bool[np.ndarray, "v m"]]:
    """Ends of the first `width` edges of every vertex, and which of the entries are one; the others are the vertex.

    Faces are gone around as they are wound, each edge from its first to its second corner: of a closed surface that
    finds every edge of every vertex once, at a boundary one edge less. An edge of three faces may be found twice.

    >>> table, found = edge_table(np.array([[0, 1, 2]]), 4, 2)
    >>> table.tolist(), found.tolist()
    ([[1, 0], [2, 1], [0, 2], [3, 3]], [[True, False], [True, False], [True, False], [False, False]])
    """
    start, end = faces.T.ravel(), faces[:, [1, 2, 0]].T.ravel()
    # a matrix of one entry a row, by columns: the rows of each column, counted, not sorted
    entries = csr_array(
        (np.ones(len(start), np.int8), start, np.arange(len(start) + 1, dtype=start.dtype)),
        shape=(len(start), n_vertices),
    ).tocsc()
    place = entries.indptr[:-1, None] + np.arange(width, dtype=np.int32)
    found = place < entries.indptr[1:, None]
    ends = np.append(end[entries.indices], end.dtype.type(0))
    own = np.arange(n_vertices, dtype=np.int32)[:, None]
    return np.where(found, ends[np.where(found, place, 0)], own).astype(np.int32), found
