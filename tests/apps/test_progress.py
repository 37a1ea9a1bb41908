"""A bar where somebody sees it, silence elsewhere."""

import io

import pytest

from gash_jax.apps.progress import progress_bar


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("stream", "quiet", "seen"),
    [(Terminal, False, True), (Terminal, True, False), (io.StringIO, False, False)],
    ids=["terminal", "quiet", "file"],
)
def test_the_bar_is_drawn_on_terminals_only(
    stream: type[io.StringIO], quiet: bool, seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = stream()
    monkeypatch.setattr("sys.stderr", errors)
    monkeypatch.setenv("TERM", "xterm")
    with progress_bar("baking", quiet) as update:
        update(1, 4)
        update(4, 4)
    assert ("baking" in errors.getvalue()) == seen
    assert ("100%" in errors.getvalue()) == seen
