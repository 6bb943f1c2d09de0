"""PX4's legacy log format, which begins like DataFlash."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from quadid_logs.autopilots.px4.sdlog2 import read
from quadid_logs.containers import dataflash, sdlog2
from quadid_logs.containers.dataflash import read_messages
from quadid_logs.data.log import FlightLog

from .dataflash_files import flight, fmt, row

LOG = "real/sdlog2-quad-70s.px4log"
DEFINITIONS = fmt(129, "TIME", "Q", "StartTime") + fmt(
    2, "ATT", "ffffff", "Roll,Pitch,Yaw,RollRate,PitchRate,YawRate"
)


@pytest.fixture(scope="module")
def log(corpus: Path) -> FlightLog:
    """Return the corpus' sdlog2 log."""
    return read(corpus / LOG)


@pytest.mark.corpus
def test_it_is_told_apart_from_dataflash(corpus: Path) -> None:
    """Each format claims its own files only."""
    head = (corpus / LOG).read_bytes()[:65_536]
    assert (sdlog2.is_mine(head), dataflash.is_mine(head)) == (True, False)
    assert (sdlog2.is_mine(flight(3)), dataflash.is_mine(flight(3))) == (False, True)


@pytest.mark.corpus
def test_rows_take_the_time_record_before_them(corpus: Path, log: FlightLog) -> None:
    """In this log every cycle writes TIME first, then one ATT: their times pair up in order."""
    start_us = read_messages(corpus / LOG, {"TIME"})["TIME"].columns["StartTime"]
    np.testing.assert_array_equal(log.candidates("body_rate")[0].time_s, start_us / 1e6)


@pytest.mark.corpus
def test_the_estimator_s_rates_agree_with_the_gyro(log: FlightLog) -> None:
    """Both sources are in rad/s with the same signs."""
    estimate, gyro = log.candidates("body_rate")[:2]
    assert np.abs(estimate.values - gyro.values).mean() < 0.02 < estimate.values.std()


@pytest.mark.corpus
def test_identity_is_read_from_version_and_parameters(log: FlightLog) -> None:
    """The file says PX4, a multirotor, an octo coaxial airframe."""
    assert (log.format, log.dialect, log.autopilot) == ("dataflash", "sdlog2", "px4")
    assert (log.vehicle_type, log.frame, log.firmware[:5]) == ("multirotor", "octo coaxial", "PX4 4")
    assert [mode.name for mode in log.modes] == ["MANUAL", "AUTO_MISSION", "MANUAL"]


def test_rows_before_the_first_time_record_have_no_time(tmp_path: Path) -> None:
    """A made-up time would be worse than none."""
    att = row(2, "ffffff", *range(6))
    path = tmp_path / "a.px4log"
    path.write_bytes(DEFINITIONS + att + row(129, "Q", 2_000_000) + att + att)
    time_s = read(path).candidates("body_rate")[0].time_s
    np.testing.assert_array_equal(time_s, [np.nan, 2.0, 2.0])
