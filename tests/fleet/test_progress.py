"""What a run of hours says meanwhile."""

from __future__ import annotations

from collections import Counter

import pytest

from quadid_logs.cli.fleet import FleetProgress
from quadid_logs.fleets.run import KNOWN, Tally
from tests.terminal import Terminal


@pytest.fixture
def tally(monkeypatch):
    """Ten of forty logs after five seconds, two of them known before."""
    monkeypatch.setattr("quadid_logs.fleets.run.time.monotonic", lambda: 105.0)
    return Tally(
        n_logs=40,
        began_s=100.0,
        counts=Counter({"analyzed": 8, KNOWN: 2}),
        dashboard="http://127.0.0.1:8787/status",
    )


def test_rate_and_time_left_follow_from_what_is_done(tally):
    """Known logs cost no time, so that they do not count for the rate."""
    assert tally.rate_hz == 8 / 5.0
    assert tally.left_s == 15.0


def test_before_the_first_log_nobody_knows_the_time_left():
    """No division by zero."""
    assert Tally(n_logs=3).left_s == float("inf")


def test_a_pipe_gets_few_whole_lines(tally, capsys):
    """The dashboard once, and not a line per log."""
    progress = FleetProgress(quiet=False)
    for _ in range(50):
        progress(tally)
    assert capsys.readouterr().err.splitlines() == [
        "dashboard while this runs: http://127.0.0.1:8787/status",
        "10 of 40 logs, 1.6/s, 15 s left",
    ]


def test_a_terminal_gets_one_line_that_is_wiped(tally, monkeypatch):
    """Written again and again at its place."""
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    progress = FleetProgress(quiet=False)
    progress(tally)
    progress.end()
    assert terminal.getvalue().endswith("10 of 40 logs, 1.6/s, 15 s left\r\x1b[2K")


def test_quiet_is_quiet(tally, capsys):
    """Only problems are said then."""
    progress = FleetProgress(quiet=True)
    progress(tally)
    progress.notice("the scheduler does not answer")
    assert capsys.readouterr().err == "quadid-log: the scheduler does not answer\n"
