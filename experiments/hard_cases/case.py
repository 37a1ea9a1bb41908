"""A hard case: what it measures and the bound that it must keep, or the words in which it is refused; and its judge.

A case with a number as bound passes if what it measures is not above it (nan never passes). A case with a text as
bound passes if the input is refused by a ValueError of exactly this text. Bounds in units of U = 2^-24, the rounding
of float32, follow from the number of operations; those that are not say in `why` where they come from.
"""

from collections.abc import Callable
from typing import NamedTuple

U = 2.0**-24


class Case(NamedTuple):
    """One hard case."""

    name: str
    measured: str
    bound: float | str
    run: Callable[[], object]  # -> (measured, what the user is told); what a refused case returns does not matter
    why: str = "rounding"
    slow: bool = False  # run by the script alone: a mesh of that size, a compilation of that length


class Result(NamedTuple):
    """What came out: the number, or the text of the refusal."""

    name: str
    measured: str
    value: float | str
    bound: float | str
    why: str
    passed: bool
    told: str


def judge(case: Case) -> Result:
    """Run a case and hold the outcome against its bound; an error other than a refusal is the caller's."""
    head, why = case[:2], case.why
    if isinstance(case.bound, str):
        try:
            case.run()
        except ValueError as error:
            return Result(*head, str(error), case.bound, "refused", str(error) == case.bound, "the error, one line")
        return Result(*head, "accepted", case.bound, "refused", False, "nothing")
    value, told = case.run()  # type: ignore[misc]
    return Result(*head, value, case.bound, why, bool(value <= case.bound), told)
