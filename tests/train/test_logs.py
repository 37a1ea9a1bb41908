"""The log of a run: lines and events say the same, a resumed run leaves no step twice, a cut line is ignored."""

from pathlib import Path

import pytest
from tensorboardX.proto.event_pb2 import Event  # pyright: ignore[reportAttributeAccessIssue]

from gash_jax.train import logs
from gash_jax.train.logs import CLOCKS, EVENTS, LINES, MetricsLog, read_lines

PHASES = ["visibility", "coefficients"]


def _events(folder: Path) -> list[tuple[str, int, float]]:
    """(tag, step, value) of every scalar in the folder's event files; records are length, crc, bytes, crc."""
    found = []
    for path in sorted((folder / EVENTS).glob("events.*")):
        data, at = path.read_bytes(), 0
        while at < len(data):
            length = int.from_bytes(data[at : at + 8], "little")
            event = Event.FromString(data[at + 12 : at + 12 + length])
            found += [(value.tag, event.step, value.simple_value) for value in event.summary.value]
            at += 16 + length
    return found


def test_lines_and_events_agree(tmp_path: Path) -> None:
    with MetricsLog(tmp_path, PHASES) as log:
        log.write(0, 10, {"loss": 0.5})
        log.write(0, 20, {"loss": 0.25, "validation": 2.0})
        log.write(1, 10, {"loss": 0.125})
    lines = [{name: line[name] for name in line if name not in CLOCKS} for line in read_lines(tmp_path)]
    assert lines[1] == {"phase": "visibility", "step": 20, "loss": 0.25, "validation": 2.0} and len(lines) == 3
    # TensorBoard knows one axis of steps: the second phase goes on after the first
    assert _events(tmp_path) == [
        ("visibility/loss", 10, 0.5),
        ("visibility/loss", 20, 0.25),
        ("visibility/validation", 20, 2.0),
        ("coefficients/loss", 30, 0.125),
    ]


def test_a_resumed_run_drops_what_came_after_its_checkpoint(tmp_path: Path) -> None:
    with MetricsLog(tmp_path, PHASES) as log:
        for phase, step in ((0, 10), (0, 20), (1, 10), (1, 20), (1, 30)):
            log.write(phase, step, {"loss": 1.0})
    with MetricsLog(tmp_path, PHASES, 1, 20) as log:
        log.write(1, 30, {"loss": 2.0})
    kept = [(line["phase"], line["step"], line["loss"]) for line in read_lines(tmp_path)]
    assert kept == [
        ("visibility", 10, 1.0),
        ("visibility", 20, 1.0),
        ("coefficients", 10, 1.0),
        ("coefficients", 20, 1.0),
        ("coefficients", 30, 2.0),
    ]
    assert _events(tmp_path)[-1] == ("coefficients/loss", 50, 2.0)


def test_lines_say_what_the_run_has_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On two clocks that go on while nothing runs; the time of the steps that are dropped does not count."""
    now = {"wall_seconds": 100.0, "cpu_seconds": 7.0}
    for name in CLOCKS:
        monkeypatch.setitem(logs.CLOCKS, name, lambda n=name: now[n])

    def spend(wall: float, cpu: float) -> None:
        now["wall_seconds"] += wall
        now["cpu_seconds"] += cpu

    with MetricsLog(tmp_path, PHASES) as log:
        for step in (10, 20):
            spend(2.0, 3.0)
            log.write(0, step, {"loss": 1.0})
    spend(50.0, 0.0)
    with MetricsLog(tmp_path, PHASES, 0, 10) as log:
        spend(1.0, 1.5)
        log.write(1, 10, {"loss": 1.0})
    assert [(line["wall_seconds"], line["cpu_seconds"]) for line in read_lines(tmp_path)] == [(2.0, 3.0), (3.0, 4.5)]


def test_a_line_that_was_cut_is_left_out(tmp_path: Path) -> None:
    (tmp_path / LINES).write_text('{"phase": "visibility", "step": 10, "loss": 1.0}\n{"phase": "visib')
    assert [line["step"] for line in read_lines(tmp_path)] == [10]
    with MetricsLog(tmp_path, PHASES, 0, 10):
        pass
    assert (tmp_path / LINES).read_text().count("\n") == 1


def test_a_folder_without_a_log_has_no_lines(tmp_path: Path) -> None:
    assert read_lines(tmp_path) == []


@pytest.mark.parametrize("phase", [0, 1])
def test_a_new_run_starts_empty(tmp_path: Path, phase: int) -> None:
    with MetricsLog(tmp_path, PHASES) as log:
        log.write(phase, 10, {"loss": 1.0})
    with MetricsLog(tmp_path, PHASES):
        pass
    assert read_lines(tmp_path) == []


def test_damaged_lines_are_left_out(tmp_path: Path) -> None:
    lines = ['{"phase": "visibility", "step": 1}', '{"step": 2}', "[1]", '{"phase": "visi', '{"phase": 3, "step": 4}']
    (tmp_path / LINES).write_text("\n".join([*lines, '{"phase": "other", "step": 5}']))
    assert [line["step"] for line in read_lines(tmp_path)] == [1, 5]
    with MetricsLog(tmp_path, PHASES, 1, 0):
        pass
    assert [line["step"] for line in read_lines(tmp_path)] == [1]
