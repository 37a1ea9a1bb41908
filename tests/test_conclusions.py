"""The conclusions of the results page say what the committed results say."""

import json
import re
from typing import Any

import numpy as np
import pytest

from docs import conclusions
from docs.method_names import WHAT, method_name
from docs.results_page import committed_results
from gash_jax.models.families import FAMILIES


@pytest.fixture(scope="module")
def results() -> dict[str, dict[str, Any]]:
    return committed_results()


def test_their_words_hold(results: dict[str, dict[str, Any]]) -> None:
    methods = results["neural_gash"]["rows"][0]["methods"]
    networks = [name for name in methods if "graph_us" in methods[name]]

    def median(name: str) -> float:
        return float(np.median(conclusions.numbers(results["neural_gash"], name, "skill")))

    def time(name: str) -> float:
        of = (conclusions.numbers(results["neural_gash"], name, key) for key in ("graph_us", "network_us"))
        return float(sum(np.median(values) for values in of if values.size))

    assert min(row["256 rays"][1] for row in results["calibration"]["rows"]) > 0.9  # "a bake knows its error"
    told, long = "teacher-vertex", conclusions.numbers(results["neural_gash"], "two-stage-vertex-long", "skill")
    assert median("local") > 0.9 and all(median(name) < 0.6 for name in networks if name not in ("local", told))
    assert np.mean(long > 0) > 0.8 and long.min() < 0 and median(told) > 0.9  # "most meshes", "told the visibility"
    worlds = {name: name.replace("-world", "-vertex") for name in methods if name.endswith("-world")}
    assert median("mlp-world") >= median(worlds.pop("mlp-world"))  # "all but the MLP"
    assert len(worlds) == 5 and all(median(name) < median(other) for name, other in worlds.items())
    assert time("mlp-vertex") < 1.2 * min(map(time, networks))  # "the fastest of all", up to repetitions of itself
    graphs = [name for name in networks if name.startswith(("gnn", "two-stage"))]
    bake = "plain bake, 8 rays"
    assert all(median(name) < median(bake) and time(name) > time(bake) for name in graphs)
    _check_what_encodings_do(results["cga"])
    pyg = [row["pyg"] / (row["stage1"] + row["stage2"]) for row in results["latency"]["rows"] if row["pyg"]]
    assert min(pyg) > 1.5  # "the code is fast"


def _check_what_encodings_do(result: dict[str, Any]) -> None:
    """What the text says, whose differences are told from nothing where they are beyond their interval."""

    def told(form: str, encoding: str, unseen: bool = False) -> int:
        """1: better than position and normal; -1: worse; 0: not to be told apart."""
        mean, half = map(float, conclusions.seed_differences(result, form, encoding, unseen).split(" ± "))
        return int(np.sign(mean)) if abs(mean) > half else 0

    motors = ("motor-7", "motor")
    assert all(told(form, motor) == -1 for form in ("gnn", "rings") for motor in motors)
    assert [told("gnn", motor, unseen=True) for motor in motors] == [1, 0]
    assert all(told("rings", motor, unseen=True) <= 0 for motor in motors)
    assert told("rings", "relative-motor") == told("rings", "relative-motor", unseen=True) == 1

    def mean(form: str, encoding: str, key: str = "skill") -> float:
        return float(
            np.mean([row[key] for row in result["rows"] if (row["form"], row["encoding"]) == (form, encoding)])
        )

    plain = [mean(form, "position-normal") for form in ("gnn", "rings")]
    assert abs(plain[0] - plain[1]) < 0.02  # "as good as ours on generated shapes"
    for form in ("gnn", "rings"):
        assert abs(mean(form, "motor") - mean(form, "motor-7")) < 0.02  # "trains alike"
    published = [mean("gnn", encoding) for encoding in ("position-normal", *motors)]
    assert mean("gnn", "relative-motor") < min(published)  # "the worst"
    steps = [mean("gnn", encoding, "steps") for encoding in ("relative-motor", "motor")]
    assert 0.5 < steps[0] / steps[1] < 0.6  # "little more than half the steps"
    best, second, rest = (mean("rings", encoding) for encoding in ("relative", "relative-motor", "position-normal"))
    assert best - second > second - rest
    products, attention = (
        tuple(map(float, conclusions.mean_skill(result, form, "relative-motor").split(" ± ")))
        for form in ("versor", "rings")
    )
    assert products[0] - products[1] > attention[0] + attention[1]  # "better by more than both intervals"
    assert best - products[0] > products[0] - attention[0]  # "features count for more than the algebra"


@pytest.mark.parametrize("write", conclusions.CONCLUSIONS)
def test_their_numbers_are_those_of_the_results(write: Any, results: dict[str, dict[str, Any]]) -> None:
    """Other results, other numbers."""
    text = json.dumps(results)
    other = json.loads(re.sub(r'(?<!"error": )(?<=[ \[])-?\d+\.\d+', lambda m: repr(1.5 * float(m[0])), text))
    assert write(results) != write(other)


def test_methods_have_names() -> None:
    assert method_name("two-stage-vertex-long + AO") == "TransformerConv + GATv2, 90 min; with ambient occlusion"
    assert method_name("plain bake, 8 rays") == "plain bake, 8 rays"
    assert {name for name in WHAT if "student" not in name and name not in ("teacher", "mlp-deep")} <= set(FAMILIES)
