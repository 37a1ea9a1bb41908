"""The rooms: no circle of imports, every room in the contract, and CONTRIBUTING tells of the contract as it is."""

import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from docs.rooms import diagram, import_graph, layers, room_imports, without_shortcuts

ROOT = Path(__file__).parents[1]
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def modules() -> dict[str, set[str]]:
    return import_graph()


def test_no_module_imports_itself_in_a_circle(modules: dict[str, set[str]]) -> None:
    assert len(modules) > 50 and "gash_jax.prt.tracing" in modules["gash_jax.prt.bake"]
    TopologicalSorter(modules).prepare()


def test_a_circle_is_found(modules: dict[str, set[str]]) -> None:
    circle = {**modules, "gash_jax.prt.sampling": modules["gash_jax.prt.sampling"] | {"gash_jax.prt.bake"}}
    with pytest.raises(CycleError):
        TopologicalSorter(circle).prepare()


def test_every_room_stands_in_the_contract() -> None:
    rooms = {path.parent.name for path in (ROOT / "src" / "gash_jax").glob("*/__init__.py")}
    assert sorted(rooms) == sorted(room for row in layers() for room in row)


def test_rooms_import_only_rooms_of_lower_rows(modules: dict[str, set[str]]) -> None:
    row = {room: number for number, rooms in enumerate(layers()) for room in rooms}
    imports = room_imports(modules)
    assert imports["models"] >= {"nn", "graph", "prt"}
    assert [(room, low) for room, all_low in imports.items() for low in all_low if row[low] <= row[room]] == []


def test_the_table_of_rooms_is_that_of_the_contract() -> None:
    told = re.findall(r"^\| (\d+) \| `(\w+)` \|", CONTRIBUTING, re.MULTILINE)
    assert sorted(told) == sorted((str(number + 1), room) for number, row in enumerate(layers()) for room in row)


def test_the_readme_tells_of_every_room() -> None:
    layout = (ROOT / "README.md").read_text(encoding="utf-8").split("src/gash_jax/ ")[1].split("```")[0]
    told = re.findall(r"^ +(\w+)  ", layout.split("tests/")[0], re.MULTILINE)
    assert sorted(told) == sorted(room for row in layers() for room in row)


def test_the_drawing_by_hand() -> None:
    modules = {"p.a.x": {"p.b.x", "p.c.x", "p.a.y"}, "p.b.x": {"p.c.x"}, "p.c.x": set(), "p": {"p.a.x"}, "p.a.y": {"p"}}
    rooms = room_imports(modules)
    assert rooms == {"a": {"b", "c"}, "b": {"c"}}
    assert without_shortcuts(rooms) == {"a": {"b"}, "b": {"c"}}
    assert diagram([["a"], ["b"], ["c"]], rooms) == "```mermaid\ngraph TD\n  a --> b\n  b --> c\n```"
