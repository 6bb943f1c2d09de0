"""Progress: a bar with the time left for eyes, plain lines for pipes, nothing for what is quick."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from quadid_logs.cli import progress as progress_module
from quadid_logs.cli.progress import Part, Progress, parts, time_left
from tests.terminal import Terminal


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Show every stage at once."""
    monkeypatch.setattr("quadid_logs.cli.progress._PATIENCE_S", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")


@pytest.mark.usefixtures("hasty")
def test_a_terminal_shows_the_stage_and_the_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """And the bar is wiped in the end."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with Progress("flight.bin", part=Part(0.5, 1.0, 0.0)) as progress:
        progress("read")
        progress("identify")
    shown = terminal.getvalue()
    assert "flight.bin: identify" in shown
    assert " left" in shown
    assert shown.rstrip().endswith("\x1b[2K")


@pytest.mark.usefixtures("hasty")
def test_a_stage_of_unknown_length_promises_no_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a simulation."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with Progress("plan") as progress:
        progress("simulating the flight")
    assert "simulating the flight" in terminal.getvalue()
    assert " left" not in terminal.getvalue()


@pytest.mark.usefixtures("hasty")
def test_a_pipe_gets_plain_lines(capsys: pytest.CaptureFixture[str]) -> None:
    """One per stage, without control characters."""
    with Progress("flight.bin") as progress:
        progress("read")
        progress("align")
    assert {line.split(" (")[0] for line in capsys.readouterr().err.splitlines()} == {
        "flight.bin: read", "flight.bin: align",
    }  # fmt: skip


def test_what_is_quick_says_nothing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second of patience; a busy machine may need longer for what is quick elsewhere."""
    assert progress_module._PATIENCE_S == 1.0
    monkeypatch.setattr(progress_module, "_PATIENCE_S", 60.0)
    with Progress("flight.bin") as progress:
        progress("read")
    assert capsys.readouterr().err == ""


def test_each_log_takes_its_part_by_size(tmp_path: Path) -> None:
    """Missing ones take none."""
    small, large, none = tmp_path / "a", tmp_path / "b", tmp_path / "c"
    small.write_bytes(bytes(100))
    large.write_bytes(bytes(300))
    assert [(part.before, part.after) for part in parts([small, none, large])] == [
        (0.0, 0.25), (0.25, 0.25), (0.25, 1.0),
    ]  # fmt: skip
    assert [(part.before, part.after) for part in parts([none])] == [(0.0, 0.0)]


@pytest.mark.parametrize(
    ("left_s", "words"), [(-3.0, "nearly done"), (17.2, "about 17 s left"), (400.0, "about 7 min left")]
)
def test_the_time_left_is_told_no_finer_than_it_is_known(left_s: float, words: str) -> None:
    """Seconds below a hundred, minutes above."""
    assert time_left(left_s) == words
