"""``--start-s`` and ``--end-s``: a part without a flight is wrong usage, and costs no report."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from quadid_logs.cli import main

LOG = Path(__file__).parents[2] / "sample_logs" / "sysid-quad-x.bin"


@pytest.mark.parametrize("chosen", [("--start-s", "5000"), ("--end-s", "-3")])
def test_a_part_without_a_flight_is_wrong_usage_that_names_the_range_of_the_log(
    chosen: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It said "fetch the whole file from the vehicle again", exit 1."""
    assert main(["analyze", str(LOG), "-o", str(tmp_path), *chosen]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "the log runs from 31.3 to 61.0 s" in line
    assert "fetch" not in line


def test_a_part_with_too_little_flight_says_how_much_it_holds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is the choice that is too short, not the flight."""
    assert main(["analyze", str(LOG), "-o", str(tmp_path), "--start-s", "40", "--end-s", "44.5"]) == 2
    assert (
        "from 40 s to 44.5 s holds 4.5 s of flight, less than the 10 s that are needed"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize("chosen", [("--start-s", "5000"), ("--start-s", "55")])
def test_a_part_without_enough_flight_leaves_the_report_that_is_there(
    chosen: tuple[str, str], tmp_path: Path
) -> None:
    """--force replaced it by a report of nothing."""
    report = tmp_path / LOG.stem / "report.html"
    report.parent.mkdir()
    report.write_text("good")
    assert main(["analyze", str(LOG), "-o", str(tmp_path), "--force", *chosen]) == 2
    assert report.read_text() == "good"
    assert [path.name for path in report.parent.iterdir()] == ["report.html"]


def test_info_tells_of_the_part_that_is_chosen(capsys: pytest.CaptureFixture[str]) -> None:
    """What analyze would make of the same part."""
    assert main(["info", str(LOG), "--json", "--start-s", "40", "--end-s", "55"]) == 0
    segments = json.loads(capsys.readouterr().out)["data"]["segments"]
    assert min(segment[0] for segment in segments) >= 40.0
    assert max(segment[1] for segment in segments) <= 55.0


def test_info_on_a_part_without_a_flight_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    """As with analyze."""
    assert main(["info", str(LOG), "--start-s", "5000"]) == 2
    assert "the log runs from 31.3 to 61.0 s" in capsys.readouterr().err


def test_the_help_says_which_clock_is_meant(capsys: pytest.CaptureFixture[str]) -> None:
    """Seconds of what."""
    assert main(["analyze", "--help"]) == 0
    assert "on the log's clock, which `info` shows" in " ".join(capsys.readouterr().out.split())
