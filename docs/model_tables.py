"""The worked example inside docs/model_file.md: numbers of every stage, from docs/results/model_example.json."""

from collections.abc import Callable
from functools import partial
from typing import Any

STAGES = (
    "inputs",
    "motors",
    "directions",
    "graphs",
    "edges",
    "surfels",
    "layers",
    "closed form",
    "models",
    "deforming",
)


def stage_table(stage: str, result: dict[str, Any]) -> str:
    """The numbers of one stage."""
    lines = ["| worked example | numbers |", "|---|---|"]
    return "\n".join(lines + [f"| {label} | {', '.join(map(_text, row))} |" for label, row in result["stages"][stage]])


def _text(number: float) -> str:
    return f"{number:.5g}"


def stage_tables() -> list[tuple[str, Callable[[dict[str, Any]], str]]]:
    """Name and renderer of the table of every stage."""
    return [(f"EXAMPLE {stage.upper()}", partial(stage_table, stage)) for stage in STAGES]
