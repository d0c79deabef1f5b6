"""Messages and bars on one terminal."""

import io

import pytest

from safestage_eval.cli import terminal
from safestage_eval.cli.terminal import BARS, line_width, say


class Terminal(io.StringIO):
    """Keeps what is drawn; a screen that erases lines as terminals do."""

    def isatty(self):
        return True

    def screen(self):
        return [part.split("\x1b[2K")[-1] for line in self.getvalue().split("\n")
                for part in [line.replace("\r", "")]]  # fmt: skip


def test_a_message_stands_on_a_line_of_its_own_while_a_bar_is_drawn(monkeypatch):
    stream = Terminal()
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    with terminal.progress("checking") as tell:
        tell(1, 3)
        say("error: first", err=True)
        tell(2, 3)
        say("error: second", err=True)
        assert len(BARS) == 1
    assert not BARS
    assert "checking" in stream.getvalue()
    lines = [line for line in stream.screen() if "error" in line]
    assert [line.removeprefix("\x1b[?25h").lstrip("\x1b[1A") for line in lines] == [
        "error: first", "error: second",
    ]  # fmt: skip


@pytest.mark.parametrize(("columns", "width"), [("80", 80), ("", None), ("x", None)])
def test_lines_are_folded_to_a_terminal_or_to_what_columns_says(monkeypatch, columns, width):
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setattr("sys.stdout", io.StringIO())
    assert line_width() == width
