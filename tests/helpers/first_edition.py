"""Results of the first edition of `local`, for the tests of the tables that set both editions side by side."""

from typing import Any

from experiments.local.first_edition import COMMIT


def first_edition_of(names: list[str]) -> dict[str, Any]:
    """Results of the first edition as `first_edition.py` writes them, with one number throughout."""
    row = {"skill": 0.5, "relrmse": 0.5, "equivalent_rays": 0.5, "relative": 0.5, "predict": 0.5}
    row |= {"jumps": {"error": 0.5, "reference": 0.5, "shifted": 0.5}}
    origin = {"machine": {"processor": "P", "cores": 1}, "commit": "c"}
    names_of = ("neural_gash", "local_trust", "local_speed")
    return {
        **origin,
        "arguments": {"commit": COMMIT},
        "meshes": dict.fromkeys(names, row),
        "motions": {"a breathing sphere": {"skill": 0.5, "flicker": 0.5}},
        "origins": dict.fromkeys(names_of, origin),
    }
