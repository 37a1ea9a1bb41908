"""One prediction of `versor` by three ways of multiplying in R(4,1), which say the same numbers.

    .venv/bin/python -m benchmarks.versor_speed --output docs/results/versor_speed.json

*dense*: multivectors of 32 numbers through the table of 32 x 32 signs (`algebra.cga`); every motor acts on the
multivectors of its edge by two products. *even*: the same with the 16 even blades and the 256 terms between them.
*network*: what the network does, the products of a motor's numbers summed over the neighbours first.

A generated mesh and random weights; graph and compilation are not timed. All in strict turn, medians; each way with
the size of blocks that is its fastest.
"""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.algebra_speed import compiled, in_turn
from benchmarks.options import options, saved
from gash_jax.algebra.cga import geometric_product, reverse
from gash_jax.algebra.even import EVEN, MOTOR_8, even_product
from gash_jax.measure.provenance import provenance
from gash_jax.models.families import model_config, model_graph
from gash_jax.nn.versor_net import SPARSE, Algebra, VersorConfig, build_versor_net
from gash_jax.shapes.primitives import bumpy_sphere

BLOCKS = (16, 128)  # vertices: on either side of what fits a core's cache
REPEATS = 7
EM_PARTS = MOTOR_8[4:] + 8  # e- in place of e+: bit 4 in place of bit 3


def whole(x: jax.Array) -> jax.Array:
    """Even multivectors (..., 16, c) as (..., c, 32)."""
    return jnp.zeros((*x.shape[:-2], x.shape[-1], 32), x.dtype).at[..., EVEN].set(jnp.swapaxes(x, -1, -2))


def even_part(x: jax.Array) -> jax.Array:
    """Multivectors (..., c, 32) as (..., 16, c)."""
    return jnp.swapaxes(x[..., EVEN], -1, -2)


def whole_motors(motors: jax.Array) -> jax.Array:
    """Motors (k, 8) as (k, 32)."""
    zeros = jnp.zeros((*motors.shape[:-1], 32), motors.dtype)
    return zeros.at[..., MOTOR_8].set(motors).at[..., EM_PARTS].set(motors[..., 4:])


def dense_act(motors: jax.Array, squares: jax.Array, weights: jax.Array, still: jax.Array) -> jax.Array:
    """Sum over neighbours of w m a ~m by products of 32 numbers."""
    m = whole_motors(motors)[:, None]
    acted = geometric_product(geometric_product(m, whole(still)[None]), reverse(m))
    return even_part(jnp.sum(weights[..., None] * acted, axis=0))


def even_act(motors: jax.Array, squares: jax.Array, weights: jax.Array, still: jax.Array) -> jax.Array:
    """The same by products of 16 numbers."""
    full = whole_motors(motors)
    shape = (len(motors), *still.shape)
    m, back = (jnp.broadcast_to(each[:, EVEN, None], shape) for each in (full, reverse(full)))
    return jnp.sum(weights[:, None] * even_product(even_product(m, jnp.broadcast_to(still, shape)), back), axis=0)


WAYS = {
    "dense": Algebra(lambda a, b: even_part(geometric_product(whole(a), whole(b))), dense_act),
    "even": Algebra(even_product, even_act),
    "network": SPARSE,
}


def main(output: Path | None, quick: bool) -> dict[str, Any]:
    """Time the ways; `quick`: on a small mesh, once."""
    mesh, config = bumpy_sphere(4 if quick else 16), model_config("versor")
    assert isinstance(config, VersorConfig)
    graph, network = jax.tree.map(jnp.asarray, model_graph(config, mesh)), build_versor_net(config)
    params = jax.jit(network.init)(jax.random.key(0), graph)["params"]
    params["head"]["kernel"] = 0.1 * jax.random.normal(jax.random.key(1), params["head"]["kernel"].shape)
    variables: Any = {"params": params}
    runs, found = {}, {}
    for way, algebra in WAYS.items():
        for block in BLOCKS[:1] if quick else BLOCKS:
            apply, _ = compiled(network.clone(algebra=algebra, block=block).apply, variables, graph)
            runs[f"{way} {block}"] = lambda apply=apply: apply(variables, graph)
            found[way] = np.asarray(runs[f"{way} {block}"]())
    medians, rows = in_turn(runs, 1 if quick else REPEATS), []
    for way in WAYS:
        seconds, block = min((time, int(name.split()[1])) for name, time in medians.items() if name.split()[0] == way)
        difference = float(np.abs(found[way] - found["network"]).max() / np.abs(found["network"]).max())
        rows.append({"way": way, "block": block, "seconds": seconds, "difference": difference})
        print(rows[-1], flush=True)
    arguments = {"mesh": "bumpy sphere", "vertices": len(mesh.vertices), "repeats": REPEATS, "blocks": BLOCKS}
    return saved(output, provenance(seed=0, arguments=arguments, model=config.to_dict(), rows=rows))


if __name__ == "__main__":
    main(**options(__doc__, "output", "quick"))
