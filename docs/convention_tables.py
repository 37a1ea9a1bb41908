"""The tables of everybody's conventions in docs/light.md, from the records themselves."""

import numpy as np

from gash_jax.light.conventions import AXES, Convention, encoded
from gash_jax.light.engines import CONVENTIONS

_SEEN = {0: "-z", -90: "+x", 90: "-x", 180: "+z"}


def _first_band(record: Convention) -> str:
    """k = 1, 2, 3 of light from direction (x, y, z), as a factor and the three in their order."""
    band_one = np.zeros((3, 4))
    band_one[[1, 2, 0], [1, 2, 3]] = np.sqrt(3 / (4 * np.pi))  # light from x, y and z
    columns = encoded(band_one, record, "light")[:, 1:] if record.bands[0] < 3 else _padded(band_one, record)
    names = []
    for column in columns.T:
        axis = int(np.argmax(np.abs(column)))
        names.append(("-" if column[axis] < 0 else "") + AXES[axis])
    return f"{np.abs(columns).max():.4f} ({', '.join(names)})"


def _padded(band_one: np.ndarray, record: Convention) -> np.ndarray:
    return encoded(np.pad(band_one, ((0, 0), (0, 5))), record, "light")[:, 1:4]


def conventions_table() -> str:
    """A row for each program."""
    lines = ["| `--to` | numbers of | its x, y, z in ours | light of radiance 1 from everywhere, k = 0 |"]
    lines[0] += " light from (x, y, z), k = 1, 2, 3 | numbers are | divides by π | bands | centre of a latlong map |"
    lines.append("|---|---|---|--:|---|---|---|---|---|")
    for name, record in CONVENTIONS.items():
        least, most = record.bands
        constant = np.zeros(max(least, 1) ** 2)
        constant[0] = 2 * np.sqrt(np.pi)
        numbers = "irradiance / π, a polynomial" if record.polynomial else "radiance"
        numbers += " / π" if record.scale != 1.0 else ""
        numbers += f" - {record.offset}" if record.offset else ""
        seen = "-" if record.turn is None else f"our {_SEEN[record.turn]}, `--rotate {record.turn}`"
        cells = [f"`{name}`", record.title, ", ".join(record.axes), f"{encoded(constant, record, 'light')[0]:.4f}"]
        cells += [_first_band(record), numbers, record.pi, f"{least} to {most}" if most > least else str(most), seen]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def sources_table() -> str:
    """Each statement beside its source."""
    lines = ["| `--to` | statement | where it stands |", "|---|---|---|"]
    for name, record in CONVENTIONS.items():
        lines += [f"| `{name}` | {fact.text} | {fact.source} |" for fact in record.facts]
    return "\n".join(lines)
