"""Distillation: a student learns a teacher's predictions instead of the baked labels (GNN paper, 4.1.1)."""

from collections.abc import Sequence

import numpy as np

from gash_jax.models.examples import Example, Item
from gash_jax.models.families import label_visibility, model_graph
from gash_jax.models.model import Model


def distilled(examples: Sequence[Example], items: Sequence[Item], teacher: Model) -> list[Example]:
    """The examples of a student with the teacher's coefficients as labels; items are the same shapes, in order."""
    changed = []
    for example, item in zip(examples, items, strict=True):
        graph = model_graph(teacher.config, item.mesh, 0, label_visibility(teacher.config, item))
        changed.append(example._replace(coefficients=np.asarray(teacher(graph), np.float32)))
    return changed
