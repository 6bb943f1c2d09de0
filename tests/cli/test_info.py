"""``quadid-log info``: the verdict first, lines as wide as the terminal."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from quadid_logs.cli import main
from tests.terminal import Terminal

LOG = "sample_logs/default-logging.bin"


def test_whether_analyze_can_work_with_it_is_said_first(capsys: pytest.CaptureFixture[str]) -> None:
    """Before any fact about the log; each line is whole, for grep."""
    assert main(["info", LOG]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "  analyze will refuse roll and pitch: 1 obstacle"
    assert lines[2].startswith("    obstacle: ")
    assert "[QL303]" in lines[2]
    assert any(len(line) > 120 for line in lines)


def test_of_a_slow_log_only_what_is_too_slow_is_said_to_be_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """10 Hz with set-points: analyze tells yaw, so that "anything" was false."""
    assert main(["info", LOG]) == 0
    assert "too slowly to identify roll or pitch [QL303]" in capsys.readouterr().out


def test_what_to_do_is_that_of_the_autopilot(corpus: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As analyze says it; and a log without times has no span of time."""
    assert main(["info", str(corpus / "real" / "ac30-quadV-underpowered.log")]) == 0
    out = capsys.readouterr().out
    assert "Update the firmware to 4.0 or later" in out
    assert "  Clock           not logged" in out


def test_lines_end_where_the_terminal_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """On 50 columns, and no column of words is narrower than 30; a command alone is longer, and whole."""
    shown = Terminal()
    monkeypatch.setattr(sys, "stdout", shown)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("shutil.get_terminal_size", lambda *_: os.terminal_size((50, 40)))
    assert main(["info", LOG]) == 0
    lines = shown.getvalue().splitlines()
    wide = [line for line in lines if len(line) > 50]
    assert [line.strip().rstrip(".").strip("`").split()[0] for line in wide] == ["quadid-log"]
    assert max(len(line) - len(line.lstrip()) for line in lines) <= 20


def test_of_a_rover_no_rotors_are_told(corpus: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its rotors were said to have run as on a bench, and its airframe to be told with [[rotor]] tables."""
    assert main(["info", str(corpus / "real" / "rover246-real-61.bin")]) == 0
    out = capsys.readouterr().out
    assert "  Flights         this is not a multirotor" in out
    assert "rotor" not in out.replace("multirotor", "")
