"""How far a job is and how long it takes: never backwards, never done before it is, never too sure."""

from __future__ import annotations

import pytest

from quadid_logs.serve.estimate import Pace, Progress

STAGES = {
    "read": 1.0,
    "align": 1.5,
    "identify": 2.0,
    "writing the report": 9.0,
    "adding it to the history": 10.0,
}


@pytest.fixture
def course() -> list[tuple[float, float, float]]:
    """Return time, fraction and time left of a job of 20 s, from which 8 s were expected."""
    progress, found = Progress(began_s=0.0, expected_s=8.0), []
    for tenth in range(200):
        now_s = 0.1 * tenth
        for stage, begins_s in STAGES.items():
            if abs(now_s - begins_s) < 0.05:
                progress.begin_stage(stage, now_s)
        found.append((now_s, progress.fraction(now_s), progress.left_s(now_s)))
    return found


def test_the_bar_never_goes_back(course: list[tuple[float, float, float]]) -> None:
    """Not even where a stage begins that nobody expected."""
    fractions = [fraction for _, fraction, _ in course]
    assert fractions == sorted(fractions)


def test_nothing_is_done_before_it_is(course: list[tuple[float, float, float]]) -> None:
    """A job that takes thrice as long as expected still has time left."""
    assert all(0.0 <= fraction < 1.0 for _, fraction, _ in course)
    assert all(left_s > 0.0 for _, _, left_s in course)


def test_the_time_left_goes_with_the_time_that_was_taken() -> None:
    """What has taken long so far is not nearly done."""
    progress = Progress(began_s=0.0, expected_s=1.0)
    progress.begin_stage("identify", 1.0)
    assert progress.left_s(10.0) > 1.0


def test_the_next_job_is_expected_to_take_what_the_last_ones_took() -> None:
    """On a slow machine, and by its size."""
    pace = Pace()
    for _ in range(30):
        pace.learn(10_000_000, 40.0)
    assert pace.expected_s(10_000_000) == pytest.approx(40.0, rel=0.01)
    assert pace.expected_s(40_000_000) > 60.0


def test_one_absurd_time_does_not_spoil_the_pace() -> None:
    """A machine that slept over it, say."""
    pace = Pace()
    before = pace.expected_s(1_000_000)
    pace.learn(1_000_000, 1e6)
    assert pace.expected_s(1_000_000) < 3.0 * before
