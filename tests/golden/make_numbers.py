"""Write numbers.npz: what bakes and the shipped weights give on one mesh; run by hand where numbers shall change.

    .venv/bin/python -m tests.golden.make_numbers

The mesh is generated, and moved a little so that no distances are equal; it is in the file, so nothing but bakes and
predictions can change it.
"""

from pathlib import Path

import numpy as np

from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.models.model import load_model, shipped_models
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.error_target import bake_to_error
from gash_jax.prt.transfer import Transfer
from gash_jax.shapes.procedural import make_shape

FILE = Path(__file__).with_name("numbers.npz")
BAKES = {
    "plain": lambda mesh: bake_transfer(mesh, rays=64, replicates=1),
    "default": lambda mesh: bake_transfer(mesh, rays=256),
    "error": lambda mesh: bake_to_error(mesh, 0.05),
}


def mesh() -> Mesh:
    """A generated body of some hundred vertices in general position."""
    body = make_shape(2, 5, (300, 400))[1]
    noise = np.random.default_rng(0).normal(scale=1e-3, size=body.vertices.shape)
    return prepare_mesh((body.vertices + noise).astype(np.float32), body.faces)[0]


def arrays(transfer: Transfer) -> dict[str, np.ndarray]:
    """Coefficients and whatever the transfer says of their errors."""
    found = {name: getattr(transfer, name) for name in ("coefficients", "standard_error", "predicted_error")}
    return {name: value for name, value in found.items() if value is not None}


def main() -> None:
    body = mesh()
    results = {f"bake/{name}": bake(body) for name, bake in BAKES.items()}
    results |= {f"predict/{name}": load_model(name).predict(body) for name in shipped_models()}
    golden = {f"mesh/{name}": value for name, value in body._asdict().items()}
    golden |= {f"{name}/{key}": value for name, result in results.items() for key, value in arrays(result).items()}
    np.savez_compressed(FILE, **golden)


if __name__ == "__main__":
    main()
