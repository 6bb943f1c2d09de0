"""A file that holds several logs: a verb that reads one takes its number, a fleet takes all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from quadid_logs.cli import main
from quadid_logs.data.settings import Settings
from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.per_flight import analyze_flights
from quadid_logs.fleets.tasks import Task
from quadid_logs.fleets.work import work
from quadid_logs.report.next_flight import next_steps
from quadid_logs.serve.entries import Kind
from quadid_logs.serve.jobs import Job, do
from quadid_logs.vocabulary import AXES
from tests.containers import blackbox_maker as maker
from tests.synthetic_results import synthetic_prediction, usable_result


def log(n_frames: int, day: int = 1) -> bytes:
    """Return a log of some frames, too short to fly."""
    rows = [[loop, 1000 * loop + 1_000_000] + [0] * (len(maker.NAMES) - 2) for loop in range(n_frames)]
    settings = maker.SETTINGS | {"Log start datetime": f"2026-05-{day:02d}T12:00:00.000+00:00"}
    return maker.log(rows, settings=settings)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Two logs, of which the second is longer."""
    path = tmp_path / "two.bbl"
    path.write_bytes(log(64) + log(96, day=3))
    return path


@pytest.mark.parametrize(
    "verb",
    [
        ("info", "FILE", "--log", "9"),
        ("analyze", "FILE", "--log", "9"),
        ("tune", "FILE", "--log", "9"),
        ("export", "FILE", "-o", "out.csv", "--log", "9"),
        ("compare", "FILE", "FILE", "--logs", "1", "9"),
    ],
    ids=lambda verb: verb[0],
)
def test_the_number_of_a_log_is_heard(
    verb: tuple[str, ...], file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """`tune` and `compare` could not choose: they said how to, and did not know the option."""
    monkeypatch.chdir(file.parent)
    assert main([str(file) if word == "FILE" else word for word in verb]) == 2
    assert "There is no log 9" in capsys.readouterr().err


@pytest.mark.parametrize(
    "verb",
    [
        ("analyze", "FILE"),
        ("tune", "FILE"),
        ("export", "FILE", "--model", "-o", "out.mat"),
        ("compare", "FILE", "FILE"),
        ("repeat", "FILE", "FILE"),
        ("plan", "--like", "FILE"),
    ],
    ids=lambda verb: verb[0],
)
def test_every_verb_takes_the_longest_log_and_says_so(
    verb: tuple[str, ...], file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All but `analyze` ended with exit code 2."""
    monkeypatch.chdir(file.parent)
    monkeypatch.setattr("quadid_logs.planning.predict", lambda *_a: synthetic_prediction())
    main([str(file) if word == "FILE" else word for word in verb])
    assert "two.bbl holds 2 logs. The longest one, log 2" in capsys.readouterr().err


def test_the_next_commands_name_the_log_of_the_file() -> None:
    """As they stood there, `tune` and `compare` would have refused the file."""
    result = usable_result()
    steps = " ".join(next_steps(replace(result, settings=Settings(log=4))))
    assert " --log 4 --model -o model.mat" in steps
    assert " NEXT-LOG --logs 4 0`" in steps


def test_a_fleet_takes_each_log_of_a_file_as_a_flight(file: Path) -> None:
    """A dump of a flash chip gave one row: that one of its logs was to be chosen."""
    outcome = work(Task(file=LogFile(url=str(file), n_bytes=file.stat().st_size), options=Options()))
    assert outcome.status == "analyzed"
    assert [(row["flight"], row["n_flights"], row["axis"]) for row in outcome.rows] == [
        (flight, 2, axis) for flight in (0, 1) for axis in AXES
    ]
    assert outcome.rows[0]["duration_s"] < outcome.rows[3]["duration_s"]
    assert (outcome.rows[3]["started"] - outcome.rows[0]["started"]).days == 2


def test_a_flight_of_a_fleet_knows_its_log(file: Path) -> None:
    """What a flight's report proposes to run names its log."""
    flights = analyze_flights(file, Settings(), None)
    assert [flight.settings.log for flight in flights] == [1, 2]


def test_a_page_that_gets_several_logs_takes_the_longest_and_says_so(file: Path, tmp_path: Path) -> None:
    """The choice was left to the command line, which who opened a page may not know."""
    folder = tmp_path / "result"
    folder.mkdir()
    job = Job(
        kind=Kind.ANALYZE,
        logs=(str(file),),
        names=("two.bbl",),
        numbers=(0,),
        sha256=("0" * 64,),
        n_bytes=file.stat().st_size,
        options={"modified_s": 0.0},
        folder=str(folder),
    )
    done = do(job, lambda _stage, _summary: None)
    assert done.summary["flown"].endswith("log 2, the longest of 2 in the file")
    assert "This is log 2" in (folder / "report.html").read_text()
