"""``quadid-log predict``: what it prints, as text and JSON, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from quadid_logs.cli import main
from tests.conftest import REPOSITORY

SYSID, DAMAGED = (str(REPOSITORY / "sample_logs" / f"{name}.bin") for name in ("sysid-quad-x", "damaged"))


def test_rates_ahead_are_printed_beside_rates_that_stay(capsys: pytest.CaptureFixture[str]) -> None:
    """One line a horizon: error, that of rates kept, and how often each axis' interval held."""
    assert main(["predict", SYSID, DAMAGED, "--on", SYSID, "--steps", "5,20"]) == 0
    first, head, *rows = capsys.readouterr().out.splitlines()
    assert first.startswith("sysid-quad-x.bin: ")
    assert head.split()[:2] == ["steps", "horizon"]
    assert [row.split()[0] for row in rows] == ["5", "20"]
    for row in rows:
        _, _, _, error, _, kept, _, *held = row.replace("%", "").split()
        assert float(error) < 0.2 * float(kept)
        assert all(85.0 <= float(each) <= 100.0 for each in held)


def test_json_holds_every_flight_and_axis(capsys: pytest.CaptureFixture[str]) -> None:
    """For scripts."""
    assert main(["predict", SYSID, DAMAGED, "--on", SYSID, "--on", DAMAGED, "--steps", "5", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [Path(each["log"]).name for each in found["flights"]] == ["sysid-quad-x.bin", "damaged.bin"]
    for flight in found["flights"]:
        (horizon,) = flight["horizons"]
        assert horizon["n_steps"] == 5
        assert horizon["horizon_s"] == pytest.approx(0.05)
        assert set(horizon["axes"]) == {"roll", "pitch", "yaw"}
        assert horizon["error_rad_s"] < horizon["constant_rates_error_rad_s"]
    assert {"rates", "torque"} <= found["horizons"][0]["penalties"].keys()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([SYSID, "--on", DAMAGED], "two sets"),
        ([SYSID, DAMAGED, "--on", SYSID, "--steps", "ten"], "whole numbers"),
        ([SYSID, DAMAGED, "--on", SYSID, "--steps", "0"], "one step"),
        ([SYSID, DAMAGED, "--on", SYSID, "--sets", "a"], "two sets"),
        ([SYSID, DAMAGED, "--on", SYSID, "--sets", "a,a"], "two sets"),
        ([SYSID, "nowhere.bin", "--on", SYSID], "nowhere.bin"),
        ([SYSID, DAMAGED, "--on", "nowhere.bin"], "nowhere.bin"),
    ],
)
def test_what_cannot_be_predicted_is_refused(
    given: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """With exit code 2 and a sentence."""
    assert main(["predict", *given]) == 2
    assert said in capsys.readouterr().err
