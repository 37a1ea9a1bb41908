"""Speed of the algebra against kingdon and sphericart: `.venv/bin/python -m benchmarks.algebra_speed`.

(1) Geometric products of R(4,1) in float32, jitted, batches of (n, 32): transpositions included. kingdon takes its own
best of four forms: 32 arrays of n values, or those in chunks whose temporaries fit a cache (results left in chunks).
(2) Spherical harmonics of n directions with 3 and with 10 bands: `sh_components`, jitted, as bands^2 arrays, against
sphericart's (n, bands^2) array, both into fresh memory.

One process; ours and theirs in strict turn, medians of --repeats (at least five); compilation timed apart. Floors: the
bytes of both factors and the product at the speed of a copy measured in this run, and the 2 x 1024 operations of a
product at the speed of a float32 matrix product measured in this run.
"""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import sphericart
from kingdon import Algebra

from benchmarks.options import parser, saved
from gash_jax.algebra.cga import geometric_product
from gash_jax.algebra.sh import sh_components
from gash_jax.measure.provenance import provenance

CHUNKS = (2048, 8192, 32768)


def seconds(run: Callable[[], Any]) -> float:
    """Seconds of one call, until the results are there; freeing them is not timed."""
    started = time.perf_counter()
    result = jax.block_until_ready(run())
    elapsed = time.perf_counter() - started
    del result
    return elapsed


def in_turn(runs: dict[str, Callable[[], Any]], repeats: int) -> dict[str, float]:
    """Median seconds of each, called in turn after one warm-up."""
    for run in runs.values():
        seconds(run)
    times = [{name: seconds(run) for name, run in runs.items()} for _ in range(repeats)]
    return {name: float(np.median([t[name] for t in times])) for name in runs}


def compiled(function: Callable, *arguments: jax.Array) -> tuple[Callable, float]:
    """The compiled function and the seconds that took."""
    started = time.perf_counter()
    result = jax.jit(function).lower(*arguments).compile()
    return result, time.perf_counter() - started


def kingdon_runs(a: np.ndarray, b: np.ndarray) -> dict[str, Callable[[], Any]]:
    """kingdon's product of blade-first factors, whole and in chunks."""
    algebra, keys = Algebra(4, 1), tuple(range(32))

    def product(start: int, stop: int) -> Any:
        x, y = (algebra.multivector(list(v[:, start:stop]), keys=keys) for v in (a, b))
        return (x * y).values()

    def run(chunk: int) -> list:
        return [product(start, start + chunk) for start in range(0, a.shape[1], chunk)]

    sizes = [a.shape[1], *(chunk for chunk in CHUNKS if chunk < a.shape[1])]
    return {f"kingdon {size}": lambda size=size: run(size) for size in sizes}


def floors(a: jax.Array) -> dict[str, float]:
    """Seconds for the bytes (two factors in, one product out) and for the operations of len(a) products."""
    add, square = jax.jit(lambda x: x + 1.0), jnp.ones((1024, 1024), jnp.float32)
    multiply = jax.jit(lambda x: x @ x)
    times = in_turn({"copy": lambda: add(a), "matmul": lambda: multiply(square)}, 5)
    return {"bytes_s": 1.5 * times["copy"], "flops_s": len(a) * 2048 * times["matmul"] / (2 * 1024**3)}


def time_product(count: int, repeats: int) -> dict[str, float]:
    """Figures of the geometric product."""
    a, b = (np.random.default_rng(seed).normal(size=(count, 32)).astype(np.float32) for seed in (0, 1))
    ours_a, ours_b = jnp.asarray(a), jnp.asarray(b)
    product, compile_s = compiled(geometric_product, ours_a, ours_b)
    theirs = kingdon_runs(np.ascontiguousarray(a.T), np.ascontiguousarray(b.T))
    medians = in_turn({"ours": lambda: product(ours_a, ours_b), **theirs}, repeats)
    whole, best = medians[f"kingdon {count}"], min(medians[name] for name in theirs)
    figures = {"ours_s": medians["ours"], "kingdon_s": best, "kingdon_whole_s": whole, "compile_s": compile_s}
    return figures | floors(ours_a)


def time_gradient(count: int) -> dict[str, float]:
    """Compilation and median seconds of the gradient of a sum of squared coefficients along both factors."""
    a, b = (jax.random.normal(jax.random.key(seed), (count, 32)) for seed in (0, 1))
    gradient, compile_s = compiled(jax.grad(lambda a, b: jnp.sum(geometric_product(a, b) ** 2), (0, 1)), a, b)
    return {"gradient_s": in_turn({"ours": lambda: gradient(a, b)}, 5)["ours"], "gradient_compile_s": compile_s}


def time_harmonics(count: int, bands: int, repeats: int) -> dict[str, float]:
    """Figures of spherical harmonics with a number of bands."""
    directions = np.random.default_rng(2).normal(size=(count, 3)).astype(np.float32)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    axes = [jnp.asarray(np.ascontiguousarray(axis)) for axis in directions.T]
    ours, compile_s = compiled(lambda x, y, z: sh_components(x, y, z, bands), *axes)
    theirs = sphericart.SphericalHarmonics(bands - 1)
    medians = in_turn({"ours": lambda: ours(*axes), "theirs": lambda: theirs.compute(directions)}, repeats)
    return {"ours_s": medians["ours"], "sphericart_s": medians["theirs"], "compile_s": compile_s}


def main(count: int, repeats: int, output: Path | None) -> None:
    repeats = max(5, repeats)
    load = os.getloadavg()[0]
    product = time_product(count, repeats)
    print(f"{count} each, load average {load:.1f} before the run")
    for name in ("ours", "kingdon", "kingdon_whole", "bytes", "flops"):
        print(f"product, {name:14} {product[name + '_s'] * 1e3:8.1f} ms  {count / product[name + '_s'] / 1e6:7.2f} M/s")
    ratio = product["kingdon_s"] / product["ours_s"]
    print(f"  {ratio:.2f} x kingdon's best (target >= 2); compiled in {product['compile_s']:.2f} s")
    gradient = time_gradient(count // 5)
    print(
        f"gradient of {count // 5}: {gradient['gradient_s']:.2f} s, compiled in {gradient['gradient_compile_s']:.2f} s"
    )
    harmonics = {bands: time_harmonics(count, bands, repeats) for bands in (3, 10)}
    for bands, figures in harmonics.items():
        ours, theirs = figures["ours_s"], figures["sphericart_s"]
        print(f"l <= {bands - 1}: ours {ours * 1e3:6.1f} ms, sphericart {theirs * 1e3:6.1f} ms", end="")
        print(f" = {ours / theirs:.2f} x (target <= 2); compiled in {figures['compile_s']:.2f} s")
    entries = {"product": product, "gradient": gradient, **{f"bands_{b}": f for b, f in harmonics.items()}}
    saved(output, provenance(count=count, repeats=repeats, load_before=load, **entries))


if __name__ == "__main__":
    command = parser(__doc__, "output")
    command.add_argument("--count", type=int, default=1_000_000, help="products and directions")
    command.add_argument("--repeats", type=int, default=7)
    main(**vars(command.parse_args()))
