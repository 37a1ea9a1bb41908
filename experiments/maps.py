"""The lights of an experiment: every map of a folder, or without one lights from code that ring as those do."""

from pathlib import Path

import numpy as np

from gash_jax.light.environment import load_light

CODE = ("studio", "sun-sky:elevation=30", "sun-sky:elevation=5", "directional:direction=1,2,3")


def lights(folder: Path | None, bands: int) -> dict[str, np.ndarray]:
    """Coefficients (k, 3) by the name of the map."""
    sources = sorted(folder.glob("*.hdr")) if folder else [Path(name) for name in CODE]
    if not sources:
        raise ValueError(f"{folder} holds no .hdr map")
    names = [source.stem if folder else str(source) for source in sources]
    return {n: np.asarray(load_light(s, bands).coefficients, np.float64) for n, s in zip(names, sources, strict=True)}
