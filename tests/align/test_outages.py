"""A logger that loses some tens of milliseconds at a time costs rows, not the flight."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs import pipeline
from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.data.settings import AlignSettings
from quadid_logs.load import read_log
from quadid_logs.vocabulary import AXES, ON_AXIS
from tests.marks import thorough

from .flights import align, flown

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
STEADY = np.arange(10.0, 40.0, 0.0025)


def _with_outages(log: FlightLog, every_s: float, length_s: float) -> FlightLog:
    """Return a log without the rows of outages; rare rows, such as arming, are kept."""
    rows: dict[int, tuple[Rows, np.ndarray]] = {}

    def without(signal: Signal) -> Signal:
        time_s = signal.rows.time_s
        if time_s.size < 100:
            return signal
        keep = np.mod(time_s, every_s) >= length_s
        kept = Rows(time_s[keep], signal.rows.position[keep])
        kept, _ = rows.setdefault(id(signal.rows), (kept, keep))
        return replace(signal, rows=kept, values=signal.values[keep])

    signals = {name: tuple(without(one) for one in sources) for name, sources in log.signals.items()}
    return replace(log, signals=signals)


@pytest.mark.thorough
@pytest.mark.parametrize("sample", [thorough("sysid-quad-x.bin"), "betaflight-doublets.bbl"])
def test_outages_of_44_ms_refuse_nothing_and_leave_the_truth_inside_the_intervals(sample: str) -> None:
    """5 % of the rows are missing."""
    found = pipeline.analyze(_with_outages(read_log(SAMPLES / sample), 0.9, 0.044))
    stored = json.loads((SAMPLES / sample).with_suffix(".truth.json").read_text(encoding="utf-8"))
    truth = stored["models"]["quadrotor-6"]["B"]
    model = found.identification.recommended
    assert model is not None
    for number, axis in enumerate(AXES):
        low, high = model.entries[ON_AXIS[axis]].ci95
        assert low < np.array(truth)[number, number] < high
        assert found.diagnosis.axes[axis].verdict != "refused"


def test_an_outage_as_short_as_half_a_cycle_of_10_hz_does_not_split_a_flight() -> None:
    """What is between is on a straight line in rate and torque alike."""
    time_s = STEADY[(STEADY < 25.0) | (STEADY >= 25.05)]
    (segment,) = align(flown(time_s), AlignSettings()).segments
    inside = (segment.time_s > 25.0) & (segment.time_s < 25.045)
    assert np.count_nonzero(inside) > 10
    bend = np.diff(segment.torque[inside], n=2, axis=0)
    np.testing.assert_allclose(bend, 0.0, atol=1e-3 * float(np.ptp(segment.torque)))


def test_outages_of_more_than_a_tenth_of_the_flight_split_it() -> None:
    """40 ms of each 200 ms: a fifth of the torque is a guess."""
    time_s = STEADY[np.mod(STEADY, 0.2) >= 0.04]
    assert not align(flown(time_s), AlignSettings()).segments
