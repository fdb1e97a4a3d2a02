"""What a terminal shows while a verb works."""

import io

import pytest

from addon.cli import Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_terminal_sees_one_line_that_is_wiped_at_the_end(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with Progress() as progress:
        assert progress(0.0, "Reading") is True
        assert progress(0.25, "Fitting") is True
    lines = terminal.getvalue().split("\r")
    assert "Reading" in lines[1] and "0%" in lines[1]
    assert "Fitting" in lines[2] and "25%" in lines[2] and "s left" in lines[2]
    assert lines[-2].strip() == lines[-1] == ""
    assert "\n" not in terminal.getvalue()
    assert len(lines[-2]) >= max(len(line) for line in lines)


@pytest.mark.parametrize("used", [True, False])
def test_a_file_sees_nothing(used, capsys):
    with Progress() as progress:
        if used:
            assert progress(0.5, "Fitting") is True
    assert capsys.readouterr() == ("", "")
