"""``quadid-log live`` over a loopback socket: a recorded flight, and its analysis."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from quadid_logs.cli import main
from quadid_logs.link.record import RecordPatience
from tests.link.fake_logger import BLOCKS, FRAMES, FakeLogger, SocketLogger, whole_messages

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


@pytest.mark.parametrize("autopilot", [FRAMES, BLOCKS], ids=["frames", "blocks"])
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
