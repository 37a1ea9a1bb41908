"""The graph of rooms in CONTRIBUTING.md: which imports which, read from the imports themselves."""

import tomllib
from pathlib import Path

import grimp

from docs.tables import ROOT, fill

PACKAGE = "gash_jax"


def import_graph(package: str = PACKAGE) -> dict[str, set[str]]:
    """Every module of a package with the modules of it that it imports, also inside functions."""
    graph = grimp.build_graph(package, cache_dir=None)
    return {module: set(graph.find_modules_directly_imported_by(module)) for module in graph.modules}


def layers(root: Path = ROOT) -> list[list[str]]:
    """The rooms by rows, highest first, as the contract of import-linter in pyproject.toml has them."""
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    (found,) = (contract["layers"] for contract in settings["contracts"] if contract["type"] == "layers")
    return [[room.strip().removeprefix(f"{PACKAGE}.") for room in row.split("|")] for row in found]


def room_imports(modules: dict[str, set[str]]) -> dict[str, set[str]]:
    """Rooms with the other rooms that they import; what stands in the root of the package belongs to no room."""
    found: dict[str, set[str]] = {}
    for module, imported in modules.items():
        for other in imported:
            rooms = [name.split(".")[1] for name in (module, other) if name.count(".") > 1]
            if len(rooms) == 2 and rooms[0] != rooms[1]:
                found.setdefault(rooms[0], set()).add(rooms[1])
    return found


def without_shortcuts(rooms: dict[str, set[str]]) -> dict[str, set[str]]:
    """The same graph without the arrows that a longer way implies (its transitive reduction; it has no circle)."""

    def below(room: str) -> set[str]:
        return {far for near in rooms.get(room, ()) for far in {near, *below(near)}}

    return {room: near - {far for other in near for far in below(other)} for room, near in rooms.items()}


def diagram(rows: list[list[str]], rooms: dict[str, set[str]]) -> str:
    """The rooms as Mermaid draws them, top down, arrows from those that import to those imported."""
    order = [room for row in rows for room in row]
    arrows = without_shortcuts(rooms)
    lines = [f"  {room} --> {' & '.join(sorted(arrows[room], key=order.index))}" for room in order if arrows.get(room)]
    return "\n".join(["```mermaid", "graph TD", *lines, "```"])


def document(root: Path = ROOT) -> str:
    """CONTRIBUTING.md with the graph as the imports are."""
    text = (root / "CONTRIBUTING.md").read_text(encoding="utf-8")
    return fill(text, "ROOMS", diagram(layers(root), room_imports(import_graph())))
