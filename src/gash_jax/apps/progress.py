"""Progress bars with ETA on the error stream: only on a terminal, never when --quiet."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

# (done, total) in any unit; may be called from worker threads
UpdateFn = Callable[[int, int], None]


@contextmanager
def progress_bar(text: str, quiet: bool = False) -> Iterator[UpdateFn]:
    """Yield a function (done, total) that moves the bar; it does nothing where nobody would see the bar."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        task = bar.add_task(text, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def say(text: str, quiet: bool = False) -> None:
    """A line for the user on standard output."""
    if not quiet:
        print(text, flush=True)
        sys.stdout.flush()
