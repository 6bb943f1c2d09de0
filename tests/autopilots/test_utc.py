"""The date and time that a log's receiver tells."""

import datetime

import numpy as np
import pytest

from quadid_logs.autopilots.utc import gps_utc_s, utc_offset_s
from quadid_logs.load import read_log

OFFSET_S = 1.7e9


def test_late_and_damaged_rows_do_not_move_the_date():
    """The median of what is plausible counts."""
    log_s = np.arange(20.0)
    utc_s = OFFSET_S + log_s
    utc_s[3] += 40.0
    utc_s[7:10] = [0.0, np.nan, 1e300]
    assert utc_offset_s(utc_s, log_s) == OFFSET_S


def test_a_receiver_without_a_fix_tells_no_date():
    """Weeks since 1980 begin at zero where nothing was received."""
    week, time_s = np.zeros(5), np.arange(5.0)
    assert np.isnan(utc_offset_s(gps_utc_s(week, time_s), time_s))


@pytest.mark.corpus
@pytest.mark.parametrize(
    ("name", "date"),
    [
        ("real/ac364-quadx-RATE1Hz-700s.bin", datetime.date(2019, 3, 27)),
        ("real/px4-1.9-quad-escstatus-39s.ulg", datetime.date(2019, 5, 13)),
        ("real/ac457-quadx-noATT-noRATE-50s.bin", datetime.date(2025, 1, 13)),
    ],
)
def test_flown_logs_know_their_date(corpus, name, date):
    """As flown: each lies in the life of its firmware's version."""
    log = read_log(corpus / name)
    assert datetime.datetime.fromtimestamp(log.utc_offset_s, datetime.UTC).date() == date


@pytest.mark.corpus
def test_telemetry_and_card_tell_the_same_date(corpus):
    """Two logs of one flight, by two ways, agree within the delay of the radio."""
    card = read_log(corpus / "firmware" / "ac47_quadx_doublets.BIN")
    radio = read_log(corpus / "firmware" / "ac47_quadx_doublets.tlog")
    assert radio.utc_offset_s == pytest.approx(card.utc_offset_s, abs=0.5)


def test_gps_time_is_ahead_of_utc_by_the_leap_seconds():
    """Week 2200 began at midnight of 2022-03-06 by the satellites, 18 s earlier by UTC."""
    (utc_s,) = gps_utc_s(np.array([2200.0]), np.array([0.0]))
    midnight = datetime.datetime(2022, 3, 6, tzinfo=datetime.UTC)
    assert datetime.datetime.fromtimestamp(utc_s, datetime.UTC) == midnight - datetime.timedelta(seconds=18)
