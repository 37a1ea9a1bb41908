"""Lights by name, for the command line and for `load_light`: NAME or NAME:OPTION=VALUE,OPTION=VALUE.

Options are the arguments of the function behind the name, numbers or several of them with commas, as in
directional:direction=1,2,0.5,irradiance=3.
"""

import inspect
from collections.abc import Callable

from gash_jax.algebra.arguments import WholeNumber
from gash_jax.algebra.sh import validate_bands
from gash_jax.formats.picture import LightError
from gash_jax.light.container import Light, light_metadata
from gash_jax.light.projection import project_map
from gash_jax.light.sky import sun_sky_light
from gash_jax.light.sources import constant_light, directional_light, sphere_light
from gash_jax.light.studio import studio_light


def _studio(bands: WholeNumber) -> Light:
    bands = validate_bands(bands)
    return Light(project_map(studio_light(), bands), light_metadata(bands))


NAMES: dict[str, Callable[..., Light]] = {
    "constant": constant_light,
    "directional": directional_light,
    "sphere": sphere_light,
    "studio": _studio,
    "sun-sky": sun_sky_light,
}


def named_light(text: str, bands: WholeNumber) -> Light | None:
    """The light that a name describes; None for what does not begin with a name.

    Raises LightError for options that it has not, that are missing or no numbers; ValueError where they are out of
    range.
    """
    name, _, options = text.partition(":")
    if name not in NAMES:
        return None
    values = _options(name, options)
    known = {key: value for key, value in inspect.signature(NAMES[name]).parameters.items() if key != "bands"}
    for key in values:
        if key not in known:
            listed = f"it knows {', '.join(known)}" if known else "it has none"
            raise LightError(f"the light {name} has no option {key!r}: {listed}")
    for key, parameter in known.items():
        if parameter.default is parameter.empty and key not in values:
            raise LightError(f"the light {name} needs {key}: as in {name}:{key}=1,2,0.5")
    light = NAMES[name](**values, bands=bands)
    return light._replace(metadata={**light.metadata, "source": text})


def _options(name: str, text: str) -> dict[str, float | list[float]]:
    """Options by name; a piece between commas without an equals sign is one more number of the option before it."""
    found: dict[str, list[str]] = {}
    for piece in text.split(",") if text else []:
        key, equals, value = piece.partition("=")
        if equals and key not in found:
            found[key] = [value]
        elif found and not equals:
            found[next(reversed(found))].append(piece)
        else:
            raise LightError(f"cannot read {piece!r} of the light {name}: write {name}:option=number,option=number")
    values: dict[str, float | list[float]] = {}
    for key, pieces in found.items():
        try:
            numbers = [float(piece) for piece in pieces]
        except ValueError:
            raise LightError(f"{key} of the light {name} is {','.join(pieces)!r}: write numbers") from None
        values[key] = numbers[0] if len(numbers) == 1 else numbers
    return values
