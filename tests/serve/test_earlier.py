"""The next gains of a log rest on the earlier flights of its vehicle that are in the list."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from quadid_logs.data.result import Result
from quadid_logs.serve import jobs
from quadid_logs.serve.entries import Entry, Kind, State, earlier_of
from quadid_logs.serve.jobs import Job, do
from tests.tuned_flights import flown, of_axes


def log(number: int, *, added_s: float = 0.0, state: State = State.DONE, **summary: str) -> Entry:
    """Return a log that was analyzed, of the vehicle "kite" unless it says otherwise."""
    return Entry(
        id=f"{number:064x}",
        kind=Kind.ANALYZE,
        name=f"{number}.bin",
        added_s=added_s,
        state=state,
        summary={"vehicle": "kite", **summary},
    )


def dated(number: int, day: int, **more: Any) -> Entry:
    return log(number, started=f"2026-05-{day:02d}T10:00:00+00:00", started_from="log", **more)


def numbers(found: tuple[Entry, ...]) -> list[int]:
    return [int(one.id, 16) for one in found]


def test_flights_before_are_earlier_in_whatever_order_they_came() -> None:
    logs = [dated(1, 3, added_s=1.0), dated(2, 1, added_s=3.0), dated(3, 2, added_s=2.0), dated(4, 4)]
    assert numbers(earlier_of(logs[0], logs)) == [2, 3]


def test_another_vehicle_tells_nothing() -> None:
    assert earlier_of(dated(1, 3), [dated(2, 1, vehicle="swift")]) == ()


def test_a_log_that_was_not_analyzed_tells_nothing() -> None:
    assert earlier_of(dated(1, 3), [dated(2, 1, state=State.FAILED)]) == ()


def test_the_date_of_a_copied_file_says_nothing_of_the_order() -> None:
    copied = log(1, added_s=5.0, started="2020-01-01T00:00:00+00:00", started_from="modification")
    assert numbers(earlier_of(copied, [copied, log(2, added_s=4.0), log(3, added_s=6.0)])) == [2]


def test_the_last_flights_are_asked_of_many() -> None:
    logs = [dated(number, number) for number in range(1, 10)]
    assert numbers(earlier_of(logs[-1], logs)) == [5, 6, 7, 8]


def test_a_question_for_gains_asks_the_earlier_flights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that tells of a vehicle twice as effective contradicts the log: its gains are refused."""
    now = of_axes(flown("ardupilot"), "roll")
    results = [now, twice_as_effective(now)]
    monkeypatch.setattr(jobs, "_result_of", lambda _job, which, _tell: (results[which], {}))
    do(tune_job(tmp_path, "a", "b"), lambda *_: None)
    (told,) = json.loads((tmp_path / "tune.json").read_text())["earlier"]
    assert told["differ"] == ["roll"]


def twice_as_effective(result: Result) -> Result:
    loop = result.closed_loop
    assert loop is not None
    roll = loop.axes["roll"]
    assert roll.plants is not None
    rows = tuple(replace(one, torque=0.5 * one.torque) for one in result.data.segments)
    axes = {"roll": replace(roll, plants=roll.plants.times(2.0))}
    return replace(result, data=replace(result.data, segments=rows), closed_loop=replace(loop, axes=axes))


def test_the_page_of_a_tuning_lets_one_try_other_gains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As that of the verb does."""
    now = of_axes(flown("ardupilot"), "roll")
    monkeypatch.setattr(jobs, "_result_of", lambda *_: (now, {}))
    do(tune_job(tmp_path, "a"), lambda *_: None)
    assert 'id="what-if-data"' in (tmp_path / "report.html").read_text()


def tune_job(folder: Path, *logs: str) -> Job:
    return Job(
        kind=Kind.TUNE,
        logs=logs,
        names=tuple(f"{log}.bin" for log in logs),
        numbers=(0,) * len(logs),
        sha256=tuple(f"{number:064x}" for number in range(len(logs))),
        n_bytes=2,
        options={},
        folder=str(folder),
    )
