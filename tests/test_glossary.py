"""The examples of docs/glossary.md run as they stand and print what they say; their formulas are the package's own."""

import re
from pathlib import Path

import numpy as np
import pytest

from gash_jax.measure import metrics

PAGE = (Path(__file__).parents[1] / "docs" / "glossary.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def run(blocks: list[str], capsys: pytest.CaptureFixture) -> tuple[dict, list[tuple[str, str]]]:
    """Execute the blocks in one namespace; names, and what each print said beside what its comment says."""
    names, pairs = {}, []
    for block in blocks:
        exec(block, names)
        said = [line.split("  # ")[1] for line in block.splitlines() if line.startswith("print(")]
        pairs += zip(capsys.readouterr().out.splitlines(), said, strict=True)
    return names, pairs


@pytest.mark.slow
def test_examples_print_what_they_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    names, pairs = run(BLOCKS, capsys)
    assert len(pairs) > 12 and [out for out, _ in pairs] == [said for _, said in pairs]
    truth, predicted = (names[key][:, None] for key in ("truth", "predicted"))
    assert metrics.relrmse(predicted, truth) == pytest.approx(0.023, abs=5e-4)
    assert metrics.equivalent_rays(2e-4, {8: 4e-4, 16: 1e-4}) == pytest.approx(11.3, abs=0.05)
    steady = np.zeros((4, 1, 1))
    assert metrics.flicker(names["jumping"][:, None, None], steady) == pytest.approx(0.4)


def test_an_example_that_says_something_else_is_found(capsys: pytest.CaptureFixture) -> None:
    (pair,) = run(["print(1 + 1)  # 3\n"], capsys)[1]
    assert pair == ("2", "3")
    with pytest.raises(ValueError, match="zip"):
        run(['print("two\\nlines")  # two\n'], capsys)


def test_every_term_is_explained_once() -> None:
    terms = re.findall(r"^### (.+)$", PAGE, re.MULTILINE)
    assert len(terms) == len(set(terms)) and {"Skill", "Surfel", "Equivalent rays", "Closed form"} <= set(terms)
