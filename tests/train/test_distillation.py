"""Distillation: a student's labels are the teacher's predictions; a teacher is told the visibility."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gash_jax.models.families import build_model, make_examples, model_config, model_graph
from gash_jax.models.model import Model, load_model
from gash_jax.prt.hemisphere import hemisphere_visibility
from gash_jax.train.config import DataConfig, OptimConfig, RunConfig, TrainConfig
from gash_jax.train.corpus import build_corpus
from gash_jax.train.distillation import distilled
from gash_jax.train.run import run_config
from tests.helpers.bumpy import random_variables

DATA = DataConfig(shapes=2, validation_shapes=1, rays=32, min_vertices=150, max_vertices=300)
BUDGET = TrainConfig(steps=10, batch_vertices=512)
TEACHER = model_config("teacher", channels=8, layers=1, heads=2, neighbours=6)
STUDENT = model_config("mlp", channels=8, layers=1)


@pytest.fixture(scope="module")
def teacher(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("teacher")
    return run_config(RunConfig("teacher", TEACHER, DATA, OptimConfig(), BUDGET), folder)[0]


def test_labels_are_the_teachers_predictions(teacher: Path) -> None:
    items, model = build_corpus(DATA, 3, np.arange(2)), load_model(teacher)
    examples = make_examples(items, STUDENT)
    lessons = distilled(examples, items, model)
    for lesson, example, item in zip(lessons, examples, items, strict=True):
        np.testing.assert_allclose(lesson.coefficients, model.predict(item.mesh).coefficients, atol=1e-6)
        assert lesson.graph is example.graph
        assert np.abs(lesson.coefficients - item.coefficients).max() > 1e-3


def test_a_teacher_reads_visibility_and_says_so(teacher: Path) -> None:
    (item,), model = build_corpus(DATA, 3, np.arange(1)), load_model(teacher)
    graph = model.graph(item.mesh)
    np.testing.assert_array_equal(graph.nodes["visibility"], hemisphere_visibility(item.mesh))  # type: ignore[index]
    assert model.predict(item.mesh).metadata["rays_total"] == 25 * len(item.mesh.vertices)
    blind = graph._replace(nodes={**dict(graph.nodes), "visibility": 0 * graph.nodes["visibility"]})  # type: ignore
    assert np.abs(np.asarray(model(graph)) - np.asarray(model(blind))).max() > 1e-3


def test_a_student_learns_and_is_validated_on_bakes(teacher: Path, tmp_path: Path) -> None:
    budget = TrainConfig(steps=10, batch_vertices=512, teacher=str(teacher))
    path, validation = run_config(RunConfig("student", STUDENT, DATA, OptimConfig(), budget), tmp_path)
    model = load_model(path)
    predicted = np.concatenate([model.predict(item.mesh).coefficients for item in validation])
    labels = np.concatenate([item.coefficients for item in validation])
    assert model.metadata["validation"] == pytest.approx(float(np.mean((predicted - labels) ** 2)), rel=1e-4)


@pytest.mark.parametrize(("frame", "world"), [("mixed", False), ("vertex", False), ("world", True)])
def test_labels_are_visibilities_in_the_frame_of_the_config(frame: str, world: bool) -> None:
    """Of the labels that a network learns, and of what a teacher is told while it teaches."""
    (item,) = build_corpus(DATA, 3, np.arange(1))
    truth = hemisphere_visibility(item.mesh, world=world)
    config: Any = replace(TEACHER, frame=frame)  # type: ignore[call-arg]
    (example,) = make_examples([item], config)
    np.testing.assert_array_equal(example.visibility, truth)
    np.testing.assert_array_equal(example.graph.nodes["visibility"], truth)
    assert world == (np.abs(example.visibility - item.visibility).max() > 0)


def test_a_teacher_in_the_world_teaches_what_it_predicts() -> None:
    config: Any = replace(TEACHER, frame="world")  # type: ignore[call-arg]
    items = build_corpus(DATA, 3, np.arange(1))
    model = Model(config, random_variables(build_model(config), model_graph(config, items[0].mesh))["params"])
    (lesson,) = distilled(make_examples(items, STUDENT), items, model)
    np.testing.assert_allclose(lesson.coefficients, model.predict(items[0].mesh).coefficients, atol=1e-6)
