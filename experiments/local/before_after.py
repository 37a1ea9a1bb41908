"""The first edition of `local` and this one in pictures: `.venv/bin/python -m experiments.local.before_after`.

Reference, both editions and what each gets wrong, at one exposure; with --meshes FOLDER of those meshes, too, whose
pictures may be shown. The first edition runs from its own source (`first_edition`), which needs the whole history.
"""

from pathlib import Path

from benchmarks.options import options
from experiments.local.first_edition import predictions
from experiments.neural_gash.evaluate import load_meshes
from experiments.neural_gash.pictures import SHOWN, draw
from gash_jax.measure.reference import REFERENCE_RAYS, make_reference
from gash_jax.models.model import load_model


def main(meshes: Path | None, output: Path, quick: bool) -> list[Path]:
    model, readers, written = load_model("local"), load_meshes(meshes, quick), []
    for name, before in predictions(meshes, quick).items():
        if name in SHOWN:
            mesh, path = readers[name](), output / f"editions_{name.replace(' ', '_')}.png"
            truth = make_reference(mesh, rays=256 if quick else REFERENCE_RAYS).coefficients
            found = {"reference": truth, "first edition": before, "this edition": model.predict(mesh).coefficients}
            draw(name, mesh, found, ("first edition", "this edition"), 64 if quick else 340, path)
            written.append(path)
    return written


if __name__ == "__main__":
    main(**options(__doc__, "meshes", "output", "quick", output="docs/pictures"))
