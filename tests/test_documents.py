"""What documents, docstrings and comments name exists: files, links, modules, attributes, make targets.

Checked are words in backticks and in code blocks, and links. A word is taken for a path of the repository where its
first part is one of its folders, a room of the package or a file name that ends as ours do; words in capitals stand for
something (`tests/ROOM/test_FILE.py`).
"""

import importlib
import re
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "gash_jax"
FOLDERS = ("benchmarks", "docs", "experiments", "notebooks", "requirements", "runtimes", "src", "tests")
ROOMS = tuple(path.parent.name for path in PACKAGE.glob("*/__init__.py"))
WRITTEN = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")]
CODE = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
TARGETS = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def code_spans(text: str, markdown: bool) -> list[str]:
    """What stands in backticks, and in Markdown the lines of code blocks."""
    blocks = re.findall(r"^```\w*\n(.*?)^```", text, re.DOTALL | re.MULTILINE) if markdown else []
    rest = re.sub(r"^```\w*\n.*?^```", "", text, flags=re.DOTALL | re.MULTILINE) if markdown else text
    return re.findall(r"`([^`\n]+)`", rest) + [line for block in blocks for line in block.splitlines()]


def _is_ours(word: str) -> bool:
    first, *more = re.sub(r"^(\.\./)+", "", word).split("/")
    if re.search(r"[A-Z]{3}", word.rsplit("/", 1)[-1].split(".")[0]) and word not in ("README.md", "CHANGELOG.md"):
        return word.endswith(".md") and not more
    return first in FOLDERS + ROOMS if more else bool(re.fullmatch(r"\w+\.(py|md|ipynb)", word))


def _exists(word: str, folder: Path) -> bool:
    if "/" not in word:
        return any(path.name == word for path in CODE + WRITTEN + [*ROOT.glob("notebooks/*.ipynb")])
    return any(list(place.glob(word)) for place in (ROOT, PACKAGE, folder) if not word.startswith("..")) or (
        (folder / word).exists()
    )


def _leaves(path: str, folder: Path) -> bool:
    """Whether a path leads out of the repository."""
    return path.startswith("..") and not (folder / path).resolve().is_relative_to(ROOT)


def _resolves(name: str) -> bool:
    """Whether a dotted name is a module or something in one."""
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:end]))
        except ImportError:
            continue
        for part in parts[end:]:
            if not hasattr(found, part):
                return part in getattr(found, "__annotations__", {})
            found = getattr(found, part)
        return True
    return False


def missing(text: str, folder: Path, markdown: bool) -> list[str]:
    """Names in a text that lead nowhere."""
    found = []
    for span in code_spans(text, markdown):
        for word in re.split(r"[\s,;()'\"=]+", span):
            word = word.strip(":[]").rstrip(".:[]")
            if re.fullmatch(r"[\w./*-]+", word):
                if _leaves(word, folder if markdown else ROOT) or (_is_ours(word) and not _exists(word, folder)):
                    found.append(word)
        for module in re.findall(r"python -m ([\w.]+)", span):
            place = ROOT / module.replace(".", "/")
            ours = place.with_suffix(".py").exists() or (place / "__main__.py").exists()
            if not (ours or re.search("[A-Z]{3}", module) or (module.isidentifier() and find_spec(module))):
                found.append(module)
        found += [target for target in re.findall(r"^make ([a-z-]+)", span) if target not in TARGETS]
        for name in re.findall(r"^(?:gash_jax\.)?(\w+\.\w[\w.]*)(?:\(.*)?$", span):
            room = name.split(".")[0]
            # `train.seconds` is a key of a config
            if (room in ROOMS and room != "train") and not _resolves(f"gash_jax.{name}"):
                found.append(name)
    # sources in words: THIS item 3, THIS: "A section"
    found += [
        name for name in re.findall(r"\b([A-Z]{4,})(?: item \d|: \")", text) if not (ROOT / f"{name}.md").exists()
    ]
    links = [link for link in re.findall(r"\]\(([^)#\s]+)", text) if "://" not in link] if markdown else []
    return found + [link for link in links if _leaves(link, folder) or not (folder / link).exists()]


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.name)
def test_documents_name_what_exists(path: Path) -> None:
    assert missing(path.read_text(encoding="utf-8"), path.parent, markdown=True) == []


def test_docstrings_and_comments_name_what_exists() -> None:
    found = {
        str(path.relative_to(ROOT)): names
        for path in CODE
        if path != Path(__file__) and (names := missing(path.read_text(encoding="utf-8"), path.parent, markdown=False))
    }
    assert found == {}


@pytest.mark.parametrize(
    "text",
    [
        "`docs/no_such.md`",
        "`nn/no_such.py`",
        "`no_such.py`",
        "[a page](no_such.md)",
        "```\nmake nothing\n```",
        "```\n.venv/bin/python -m docs.no_such\n```",
        "`prt.no_such`",
        "`gash_jax.prt.bake.no_such`",
        "`tests/prt/no_*.py`",
        "[beside the repository](../)",
        "`../no_such/data`",
        "NOSUCH item 3 says so",
        'as in NOSUCH: "A section"',
    ],
)
def test_names_that_lead_nowhere_are_found(text: str) -> None:
    assert len(missing(text, ROOT, markdown=True)) == 1


@pytest.mark.parametrize(
    "text",
    [
        "`docs/baking.md` `nn/attention.py` `gash_numpy.py` [a page](docs/baking.md) [a site](https://no.such)",
        "```\nmake test\n.venv/bin/python -m docs\n.venv/bin/python -m pytest tests/ROOM/test_FILE.py\n```",
        "`gash_jax.prt.bake.bake_transfer` `prt.bake` `docs/results/*.json` `head/kernel` `bunny.ply` `train.seconds`",
        'as in README: "The files"',
    ],
)
def test_names_that_exist_and_words_of_other_kinds_pass(text: str) -> None:
    assert missing(text, ROOT, markdown=True) == []
