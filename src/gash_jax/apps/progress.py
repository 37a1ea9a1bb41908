"""Progress bars with ETA on the error stream: only on a terminal, never when --quiet."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# (done, total) in any unit; may be called from worker threads
UpdateFn = Callable[[int, int], None]


@contextmanager
def progress_bar(text: str, quiet: bool = False) -> Iterator[UpdateFn]:
    """Yield a function (done, total) that moves the bar; it does nothing where nobody would see the bar."""
    if quiet or not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.console import Console  # a bar that nobody sees need not be imported
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(text, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
