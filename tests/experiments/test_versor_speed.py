"""The benchmark of `versor`: all ways of multiplying say the same, and a wrong one shows."""

from typing import Any

import jax.numpy as jnp
import pytest

from benchmarks import versor_speed
from docs.cga_table import versor_speed as shown


def test_the_ways_say_the_same() -> None:
    result = versor_speed.main(None, quick=True)
    assert [row["way"] for row in result["rows"]] == ["dense", "even", "network"]
    assert all(row["seconds"] > 0 and row["difference"] < 1e-5 for row in result["rows"])
    text = shown(result)
    assert text.count("\n|") == 4 and "162 vertices" in text


def test_a_wrong_product_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong: Any = versor_speed.WAYS["even"]._replace(product=lambda a, b: jnp.flip(versor_speed.even_product(a, b), -2))
    monkeypatch.setitem(versor_speed.WAYS, "even", wrong)
    differences = {row["way"]: row["difference"] for row in versor_speed.main(None, quick=True)["rows"]}
    assert differences["dense"] < 1e-5 and differences["even"] > 1e-3
