"""``quadid-log info``: the verdict first, lines as wide as the terminal."""

from __future__ import annotations

import os
import sys

import pytest

from quadid_logs.cli import main
from tests.terminal import Terminal

LOG = "sample_logs/default-logging.bin"


def test_whether_analyze_can_work_with_it_is_said_first(capsys: pytest.CaptureFixture[str]) -> None:
    """Before any fact about the log; each line is whole, for grep."""
    assert main(["info", LOG]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "  analyze will refuse it: 1 thing missing"
    assert lines[2].startswith("    missing: ")
    assert "[QL303]" in lines[2]
    assert any(len(line) > 120 for line in lines)


def test_lines_end_where_the_terminal_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """On 50 columns, and no column of words is narrower than 30."""
    shown = Terminal()
    monkeypatch.setattr(sys, "stdout", shown)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("shutil.get_terminal_size", lambda *_: os.terminal_size((50, 40)))
    assert main(["info", LOG]) == 0
    lines = shown.getvalue().splitlines()
    assert max(map(len, lines)) <= 50
    assert max(len(line) - len(line.lstrip()) for line in lines) <= 20
