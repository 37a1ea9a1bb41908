"""Every public name has a docstring with an example that runs, and stands on the page that is made of them."""

import doctest
from pathlib import Path

import numpy as np
import pytest

import gash_jax
from docs.api_page import page
from gash_jax.formats.hdr import write_hdr
from gash_jax.light.studio import studio_light
from gash_jax.shapes.primitives import bumpy_sphere

NAMES = sorted(gash_jax.__all__)


def _run(name: str, docstring: str) -> tuple[int, int, str]:
    """How many examples failed, how many there are, and what went wrong."""
    names = {"gash_jax": gash_jax, "np": np}
    test = doctest.DocTestParser().get_doctest(docstring, names, name, None, 0)
    said: list[str] = []
    failed, count = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=said.append)
    return failed, count, "".join(said)


@pytest.mark.parametrize("name", NAMES)
def test_the_examples_of_a_public_name_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    gash_jax.save_mesh("bunny.ply", bumpy_sphere(6))
    write_hdr("studio.hdr", studio_light(32))
    failed, count, said = _run(name, getattr(gash_jax, name).__doc__)
    assert count > 0, f"{name} has no example"
    assert not failed, said


def test_an_example_that_is_wrong_is_noticed() -> None:
    failed, count, said = _run("sum", ">>> 1 + 1\n3\n")
    assert (failed, count) == (1, 1) and "Expected" in said


def test_the_page_names_everything_that_is_public() -> None:
    text = page()
    assert [name for name in NAMES if f"### `{name}`\n" not in text] == []
    assert "bake_transfer(mesh: MeshLike, bands: WholeNumber=3, rays: WholeNumber=256" in text
