"""Whether two transfer files can be compared: one mesh, one number of bands."""

import numpy as np

from gash_jax.prt.texture import TransferTexture
from gash_jax.prt.transfer import Transfer

MOVED = 1e-6  # of the mesh's size: further apart, two vertices are not the same


def check_same_mesh(transfer: Transfer | TransferTexture, reference: Transfer | TransferTexture) -> None:
    """Raise ValueError unless both are of the same mesh and have the same number of bands."""
    same_faces = transfer.faces.shape == reference.faces.shape and np.array_equal(transfer.faces, reference.faces)
    if transfer.vertices.shape != reference.vertices.shape or not same_faces:
        raise ValueError(
            f"the two files are of different meshes ({len(transfer.vertices)} and {len(reference.vertices)} vertices, "
            f"{len(transfer.faces)} and {len(reference.faces)} faces): bake both from the same file"
        )
    size = max(float(np.ptp(reference.vertices, axis=0).max()), 1e-30)
    if float(np.abs(transfer.vertices - reference.vertices).max()) > MOVED * size:
        raise ValueError("the two files are of different meshes (vertices moved): bake both from the same file")
    if transfer.bands != reference.bands:
        raise ValueError(f"the two files have {transfer.bands} and {reference.bands} bands: bake one of them again")
