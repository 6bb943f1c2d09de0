"""A notch that follows what no log holds: its delay is in the rates that were logged behind it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from quadid_logs import tuning
from quadid_logs.align import cut
from quadid_logs.control.scaled_loop import scaled_loops
from quadid_logs.data.closed_loop import Margins
from quadid_logs.data.log import NO_GYRO_FILTER
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.load import prepare
from quadid_logs.pipeline import judge
from quadid_logs.simulator import fly, plan_flights
from quadid_logs.simulator.closed_loop import Setup
from quadid_logs.simulator.control import TrackingNotch
from quadid_logs.simulator.logger import log_flights
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.tuning import recommend
from quadid_logs.vocabulary import AXES
from study.tuning import resting_truth
from tests.tuned_flights import RATE_HZ, SCENARIO

#: Between crossover and phase crossover of the rate loops: lower than anyone has one.
NOTCH = TrackingNotch(lowest_hz=15.0, width_hz=10.0, stands=True)
#: The file names a notch on the rotors' speed, and holds no speed.
HIDDEN = {"INS_HNTCH_ENABLE": 1.0, "INS_HNTCH_MODE": 3.0, "INS_HNTCH_REF": 1.0, "INS_HNTCH_FREQ": 15.0}


@cache
def hidden() -> tuple[Setup, Result]:
    """Return a flight with the notch, and its analysis without."""
    (plain,) = plan_flights(SCENARIO, seed=1, duration_s=30.0, rate_hz=RATE_HZ, autopilot="ardupilot")
    setup = replace(plain, tuning=replace(plain.tuning, notch=NOTCH))
    record = fly(setup)
    log = log_flights((record,), replace(SCENARIO.logging, rate_hz=RATE_HZ))
    prepared = prepare(replace(log, parameters={**log.parameters, **HIDDEN}))
    settings = Settings()
    found = judge(
        prepared.log, cut(prepared, settings.align), settings, vehicle=None, published=False, timings_s={}
    )
    return setup, found


def true_margins(axis: str, *, notched: bool) -> Margins:
    """Return those of the true rate loop."""
    setup, _ = hidden()
    number = AXES.index(axis)
    controller = true_controller(setup, number, rotors_hz=0.0 if notched else None)
    plant = true_plant(setup, resting_truth(setup), number)
    return scaled_loops(controller, plant, float("inf")).margins().rate


@pytest.mark.thorough
@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_margins_hold_the_phase_of_a_notch_that_nobody_knows(axis: str) -> None:
    """The vehicle's delay was measured behind it; without it the loop would have several degrees more."""
    loop = hidden()[1].closed_loop
    assert loop is not None
    low, high = loop.margins[axis].rate.phase_margin_deg.ci95
    assert low <= true_margins(axis, notched=True).phase_margin_deg.value <= high
    assert true_margins(axis, notched=False).phase_margin_deg.value > high + 2.0


@pytest.mark.thorough
def test_a_notch_that_nobody_knows_forbids_no_gains() -> None:
    codes = [one.code for one in recommend(hidden()[1], axes=["roll"]).axes["roll"].reasons]
    assert "QL620" not in codes


@pytest.mark.thorough
def test_it_does_where_the_rates_were_logged_before_the_filters() -> None:
    """Then its phase is nowhere."""
    found = hidden()[1]
    before = replace(found, data=replace(found.data, gyro_filter=NO_GYRO_FILTER))
    codes = [one.code for one in recommend(before, axes=["roll"]).axes["roll"].reasons]
    assert "QL620" in codes


@pytest.mark.thorough
def test_filters_stay_beside_a_notch_that_nobody_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its delay is in the vehicle's: a search behind other filters would keep it."""
    monkeypatch.setattr(tuning, "_filter_wishes", lambda *_: pytest.fail("filters were looked for"))
    found = recommend(hidden()[1], axes=["roll"], filters=True).axes["roll"]
    assert not found.filters
    assert ("QL674" in [one.code for one in found.reasons]) == (found.verdict != "refused")
