"""docs/api.md: every public name with its signature, its docstring and its examples, read from the source."""

import ast
import inspect
from doctest import DocTestParser, Example

from docs.tables import ROOT
from gash_jax import _HOMES

PACKAGE = ROOT / "src" / "gash_jax"
# sections by the room that a name lives in
SECTIONS = {
    "Meshes": ("formats", "geometry", "shapes"),
    "Bakes": ("prt", "algebra.closed_forms"),
    "Light and pictures": ("light", "apps"),
    "Networks": ("models", "train"),
    "Conformal geometric algebra": ("algebra",),
    "Files, settings and errors": ("files",),
}
INTRODUCTION = """# Python API

Everything that `import gash_jax` gives, written from the docstrings by `python -m docs`. A test runs the examples, in a
folder that holds a mesh `bunny.ply` and an environment map `studio.hdr`.

Wherever a mesh goes in (`MeshLike`) a path will do, a `Mesh`, a `trimesh.Trimesh` or `Scene`, or arrays `(vertices,
faces)` or `(vertices, faces, normals)` of NumPy or JAX; all pass the same checks. Wherever coefficients or a light go
in (`TransferLike`, `LightLike`), the container or the plain array will do. Errors are ValueErrors of one line that says
what to do.
"""


def page() -> str:
    """The whole page, Markdown."""
    parts = [INTRODUCTION]
    for title in SECTIONS:
        entries = [(name, home) for home, names in _HOMES.items() if _section(home) == title for name in names]
        parts += [f"## {title}\n"] * bool(entries)
        parts += [_entry(name, _definition(name, home)) for name, home in sorted(entries, key=lambda e: e[0].lower())]
    return "\n".join(parts)


def _section(home: str) -> str:
    """The section of a module; the longest place that it begins with decides."""
    fitting = [
        (len(place), title)
        for title, places in SECTIONS.items()
        for place in places
        if home == place or home.startswith(f"{place}.")
    ]
    return max(fitting)[1]


def _definition(name: str, home: str) -> ast.FunctionDef | ast.ClassDef:
    path = PACKAGE / f"{home.replace('.', '/')}.py"
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in reversed(tree.body):  # the overloads of a function stand before it
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name:
            return node
        if isinstance(node, ast.ImportFrom) and node.module and name in {alias.name for alias in node.names}:
            return _definition(name, node.module.removeprefix("gash_jax."))
    raise LookupError(f"{name} is not defined in {path.name}")


def _entry(name: str, node: ast.FunctionDef | ast.ClassDef) -> str:
    """One name: heading, signature or fields, text, examples; of a class also its public methods."""
    lines = [f"### `{name}`\n", "```python", *_signature(node), "```\n", *_text(node)]
    methods = [n for n in node.body if isinstance(n, ast.FunctionDef)] if isinstance(node, ast.ClassDef) else []
    for method in methods:
        if not method.name.startswith("_") and ast.get_docstring(method):
            (head, *_) = _signature(method)
            summary = " ".join(_prose(ast.get_docstring(method) or "").split())
            lines.append(f"- `{head.removeprefix('def ')}`: {summary}")
    return "\n".join(lines).rstrip() + "\n"


def _signature(node: ast.FunctionDef | ast.ClassDef) -> list[str]:
    """The definition as it stands in the source, without its body; a class with its annotated fields."""
    if isinstance(node, ast.ClassDef):
        bases = ", ".join(ast.unparse(base) for base in node.bases)
        fields = [n for n in node.body if isinstance(n, ast.AnnAssign)]
        shown = [f"    {ast.unparse(field.target)}: {ast.unparse(field.annotation)}" for field in fields]
        return [f"class {node.name}({bases})" if bases else f"class {node.name}", *shown]
    if any(isinstance(decorator, ast.Name) and decorator.id == "property" for decorator in node.decorator_list):
        return [node.name]
    result = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return [f"def {node.name}({ast.unparse(node.args)}){result}"]


def _prose(docstring: str) -> str:
    """A docstring without its examples."""
    pieces = DocTestParser().parse(inspect.cleandoc(docstring))
    return "".join(piece for piece in pieces if not isinstance(piece, Example)).strip()


def _text(node: ast.FunctionDef | ast.ClassDef) -> list[str]:
    docstring = ast.get_docstring(node) or ""
    examples = [piece for piece in DocTestParser().parse(docstring) if isinstance(piece, Example)]
    lines = [_prose(docstring), ""]
    if examples:
        code = []
        for example in examples:
            first, *rest = example.source.rstrip("\n").split("\n")
            code += [f">>> {first}", *(f"... {line}" for line in rest), *example.want.rstrip("\n").split("\n")]
        lines += ["```python", *(line for line in code if line), "```", ""]
    return lines
