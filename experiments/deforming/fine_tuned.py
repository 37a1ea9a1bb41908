"""The shipped `local` trained on for one object: poses of it as meshes, and a run that starts from its weights.

    .venv/bin/python -m experiments.deforming.fine_tuned --object figure --seconds 300 --work runs/fine_tuned
    .venv/bin/python -m experiments.deforming.run --object figure --also "local, fine-tuned=runs/fine_tuned/run" ...

The poses are some of the training frames of `experiments.deforming.run`, spread over all of them; those that it is
validated on are others of them.
"""

from pathlib import Path

import numpy as np

from benchmarks.options import parser
from experiments.deforming.objects import OBJECTS, object_file
from gash_jax.formats.meshes import save_mesh
from gash_jax.prt.sequence import posed_meshes
from gash_jax.train.config import load_config
from gash_jax.train.deforming_run import split_animation
from gash_jax.train.run import run_config

POSES, VALIDATION = 48, 4


def main(object: str, animation: Path | None, vertices: str, frames: int, seconds: float, work: Path) -> Path:
    """Write the poses and train; the model's file."""
    data = [f"data.animation={object_file(object, animation, work)}", f'data.vertices="{vertices}"']
    data += [f"data.frames={frames}", f"data.poses={OBJECTS[object].split}"]
    moving = split_animation(load_config("deform", data).data).training.receivers
    chosen = np.unique(np.linspace(0, len(moving) - 1, POSES + VALIDATION).astype(int))
    held = chosen[:: max(len(chosen) // VALIDATION, 1)]
    folders = {"training": np.setdiff1d(chosen, held), "validation": held}
    for name, numbers in folders.items():
        (work / name).mkdir(parents=True, exist_ok=True)
        part = moving._replace(parameters=moving.parameters[numbers], seconds=None)
        for number, mesh in zip(numbers, posed_meshes(part), strict=True):
            save_mesh(work / name / f"{number:04d}.ply", mesh)
    data = [f"data.folder={work / 'training'}", f"data.validation_folder={work / 'validation'}"]
    train = ["train.start_from=local", f"train.seconds={seconds}", "train.clock=cpu", "optim.learning_rate=5e-4"]
    path, _ = run_config(load_config("local", [*data, *train, "name=local-fine-tuned"]), work / "run")
    return path


if __name__ == "__main__":
    asked = parser(__doc__)
    asked.add_argument("--object", choices=OBJECTS, default="bumps")
    asked.add_argument("--animation", type=Path, help="its file, where it is not generated")
    asked.add_argument("--vertices", default="", help="part of it, FIRST:LAST")
    asked.add_argument("--frames", type=int, default=450, help="training frames, of which the poses are some")
    asked.add_argument("--seconds", type=float, default=300.0, help="of training, CPU seconds of each core")
    asked.add_argument("--work", type=Path, default=Path("runs/fine_tuned"), help="folder of poses and run")
    print(main(**vars(asked.parse_args())))
