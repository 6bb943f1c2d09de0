"""``quadid-log live`` over a loopback socket: a recorded flight, and its analysis."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from quadid_logs.cli import main
from quadid_logs.link.record import RecordPatience
from quadid_logs.live import LiveFigures
from quadid_logs.report.live_page import live_page
from tests.link.fake_logger import BLOCKS, FRAMES, FakeLogger, SocketLogger, whole_messages
from tests.marks import thorough
from tests.synthetic_results import usable_result

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
FLIGHTS = {FRAMES: SAMPLES / "products-of-inertia.ulg", BLOCKS: SAMPLES / "sysid-quad-x.bin"}


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write where nothing else is, and wait for no vehicle for long."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("quadid_logs.cli.live._PATIENCE", RecordPatience(command_s=2.0, gone_s=3.0))


def models(folder: Path) -> object:
    """Return what the analysis found, without names and times."""
    return json.loads((folder / "result.json").read_text())["models"]


@pytest.mark.thorough
@pytest.mark.parametrize("autopilot", [FRAMES, thorough(BLOCKS)], ids=["frames", "blocks"])
def test_the_result_is_that_of_the_log(autopilot: int, tmp_path: Path) -> None:
    """As if the card had been read."""
    original = FLIGHTS[autopilot].read_bytes()
    with SocketLogger(FakeLogger(original, autopilot)) as vehicle:
        code = main(["live", vehicle.address])
    (path,) = (tmp_path / "logs").iterdir()
    expected = whole_messages(original, autopilot)
    assert path.read_bytes() == expected
    same = tmp_path / f"same{path.suffix}"
    same.write_bytes(expected)
    assert main(["analyze", str(same), "--no-report"]) == code == 0
    assert models(tmp_path / "quadid-report" / path.stem) == models(tmp_path / "quadid-report" / "same")


def test_updates_are_lines_of_json_and_shrink(capsys: pytest.CaptureFixture[str]) -> None:
    """At last every axis is known, and the pilot is told to land; what is unknown is null."""
    original = FLIGHTS[BLOCKS].read_bytes()
    with SocketLogger(FakeLogger(original, BLOCKS), frames_per_s=1000.0) as vehicle:
        assert main(["live", vehicle.address, "--json", "--no-analyze", "--target", "10"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    updates = [line for line in lines if line["kind"] == "update"]
    widths = [update["axes"]["roll"]["half_width"] for update in updates]
    assert widths[0] is None
    assert widths[-1] < 0.1
    assert "land" in updates[-1]["hint"]
    assert lines[-1]["kind"] == "recorded"
    assert lines[-1]["bytes"] == len(whole_messages(original, BLOCKS))


def test_figures_that_fail_leave_the_recording_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A flight is not flown twice for a mistake of ours."""

    def fail(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("quadid_logs.live.LiveEstimate.append", fail)
    original = FLIGHTS[FRAMES].read_bytes()
    with SocketLogger(FakeLogger(original, FRAMES)) as vehicle:
        assert main(["live", vehicle.address, "--no-analyze"]) == 0
    assert "recording goes on" in capsys.readouterr().err
    assert next((tmp_path / "logs").iterdir()).read_bytes() == original


@pytest.mark.thorough
def test_the_page_shows_the_figures_and_stands_still_after_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It renews itself without a script while the vehicle flies; it is opened once, and then the report."""
    opened, pages = [], []

    def open_page(address: str) -> bool:
        opened.append(address)
        pages.append((tmp_path / "logs" / "live.html").read_text())
        return True

    monkeypatch.setattr("webbrowser.open", open_page)
    # No page that is opened shows them, and which result the report shows is no matter here.
    monkeypatch.setattr("quadid_logs.figures.png.write_png", lambda *_a: None)
    monkeypatch.setattr("quadid_logs.pipeline.analyze", lambda log, *_a, **_k: usable_result(8.0, str(log)))
    with SocketLogger(FakeLogger(FLIGHTS[BLOCKS].read_bytes(), BLOCKS), frames_per_s=2000.0) as vehicle:
        main(["live", vehicle.address, "--open"])
    assert [Path(address).name for address in opened] == ["live.html", "report.html"]
    assert 'http-equiv="refresh"' in pages[0]
    last = (tmp_path / "logs" / "live.html").read_text()
    assert 'http-equiv="refresh"' not in last
    assert "<script" not in last
    assert "Ended at" in last


def test_what_a_vehicle_says_is_text_on_the_page() -> None:
    """A reason, an event, a name: nothing of them is markup."""
    figures = LiveFigures(missing="<img src=x onerror=alert(1)>")
    page = live_page(figures, log="<b>log</b>", clock="10:00:00", sentences=["<i>lost</i>"])
    assert "<img" not in page
    assert "<b>" not in page
    assert "<i>" not in page
