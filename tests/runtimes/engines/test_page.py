"""docs/engines.md shows what the files say, and names all of them."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
ENGINES = ROOT / "runtimes" / "engines"
PAGE = (ROOT / "docs" / "engines.md").read_text(encoding="utf-8")


def missing(page: str) -> list[str]:
    """Excerpts, blocks of code that name a language, that stand in no file of that language."""
    suffixes = {"glsl": ".glsl", "hlsl": ".shader", "js": ".js", "cs": ".cs"}
    blocks = re.findall(r"^```(\w+)\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    assert {language for language, _ in blocks} == set(suffixes)
    texts = {s: "".join(p.read_text() for p in ENGINES.iterdir() if p.suffix == s) for s in suffixes.values()}
    return [block for language, block in blocks if block not in texts[suffixes[language]]]


def test_excerpts_are_those_of_the_files() -> None:
    assert missing(PAGE) == []


@pytest.mark.parametrize("line", ["gashLight[colour * GASH_VECTORS + i]", "2 * c[6] }", "1 - second.y"])
def test_an_excerpt_that_differs_is_found(line: str) -> None:
    assert len(missing(PAGE.replace(line, f"{line} "))) == 1


def test_every_file_is_on_the_page() -> None:
    linked = set(re.findall(r"\]\(\.\./runtimes/engines/([\w.]+)\)", PAGE))
    assert linked == {path.name for path in ENGINES.iterdir()}
