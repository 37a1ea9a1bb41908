"""What commands print: lines on standard output, numbers in them."""

from typing import Any


def say(text: str, quiet: bool = False) -> None:
    """A line for the user on standard output."""
    if not quiet:
        print(text, flush=True)


def number(value: Any) -> str:
    """A value for people: four digits of a float, everything else as it is."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
