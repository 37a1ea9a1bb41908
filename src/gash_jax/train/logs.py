"""What a run measured, as lines of JSON and as TensorBoard events: the only file that imports tensorboardX.

A resumed run first drops the lines after its checkpoint, so that every step is logged once. Events cannot be cut; a
resumed run starts another event file in the same folder, whose later steps TensorBoard prefers.

Every line says what the run has taken so far, compilation and validation included: `wall_seconds`, and `cpu_seconds` of
all cores together, which are fair where other work runs beside it. A resumed run counts on from its last line.
"""

import json
import time
from pathlib import Path
from types import TracebackType
from typing import Any

from tensorboardX import SummaryWriter

LINES, EVENTS = "metrics.jsonl", "events"
CLOCKS = {"wall_seconds": time.perf_counter, "cpu_seconds": time.process_time}


class MetricsLog:
    """Open log of a run folder; a context manager. `phase` and `step`: where the run continues (0, 0: a new run)."""

    def __init__(self, folder: Path, names: list[str], phase: int = 0, step: int = 0) -> None:
        self._path, self._first = folder / LINES, {}
        kept = []
        for line in read_lines(folder):
            if line["phase"] not in names:
                continue
            number = names.index(line["phase"])
            if (number, line["step"]) <= (phase, step):
                kept.append(line)
                self._first[number] = max(self._first.get(number, 0), line["step"])
        last = kept[-1] if kept else {}
        self._before = {name: float(last.get(name, 0.0)) for name in CLOCKS}
        self._started = {name: clock() for name, clock in CLOCKS.items()}
        self._path.write_text("".join(json.dumps(line) + "\n" for line in kept))
        self._names, self._file = names, open(self._path, "a", encoding="utf-8")
        self._events = SummaryWriter(str(folder / EVENTS), purge_step=self._global(phase, step) + 1, flush_secs=30)

    def _global(self, phase: int, step: int) -> int:
        """Steps over all phases: TensorBoard knows one axis."""
        return sum(self._first.get(number, 0) for number in range(phase)) + step

    def write(self, phase: int, step: int, values: dict[str, float]) -> None:
        """One line; values by name, such as "loss" or "validation"."""
        line = {"phase": self._names[phase], "step": step, **values, **self._seconds()}
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()
        self._first[phase] = max(self._first.get(phase, 0), step)
        for name, value in values.items():
            self._events.add_scalar(f"{self._names[phase]}/{name}", value, self._global(phase, step))

    def _seconds(self) -> dict[str, float]:
        """What the run has taken so far, by each clock."""
        return {name: self._before[name] + clock() - self._started[name] for name, clock in CLOCKS.items()}

    def __enter__(self) -> "MetricsLog":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._file.close()
        self._events.close()


def whole_lines(path: Path) -> list[dict[str, Any]]:
    """The JSON objects of a file of lines; a line that an interruption cut, or that is damaged, is left out."""
    lines = []
    for text in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            line = json.loads(text)
        except json.JSONDecodeError:
            continue
        if isinstance(line, dict):
            lines.append(line)
    return lines


def read_lines(folder: Path) -> list[dict[str, Any]]:
    """The logged lines of a run, oldest first, those that are whole."""
    lines = whole_lines(folder / LINES)
    return [line for line in lines if isinstance(line.get("phase"), str) and isinstance(line.get("step"), int)]
