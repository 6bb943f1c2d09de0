"""Flights of one manoeuvre whose logs hold no set-points tell each other what was commanded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs import analyze_pooled
from quadid_logs.data.log import FlightLog, Signal
from quadid_logs.data.result import Result
from quadid_logs.simulator import find_scenario, fly, plan_flights
from quadid_logs.simulator.logger import log_flights

#: What a table of rates, attitude and torque commands holds, and the velocity beside them.
LOGGED = {"body_rate", "attitude", "torque_command", "throttle"}
#: Effectiveness of the simulated vehicle [rad/s^2 per unit of torque command], roll, pitch, yaw.
TRUTH = (269.5, 241.2, 20.97)


def repeated(air: int, manoeuvre: int = 3) -> FlightLog:
    """Return a log of a pilot's sticks, the same each time, in rough air of its own."""
    scenario = find_scenario("no-setpoints")
    (setup,) = plan_flights(scenario, seed=manoeuvre, duration_s=25.0, rate_hz=100.0, autopilot="px4")
    record = fly(replace(setup, seed=air))
    log = log_flights((record,), replace(scenario.logging, rate_hz=100.0))
    rows = log.signals["body_rate"][0].rows
    since_boot_s = rows.time_s - scenario.logging.boot_s
    velocity = [np.interp(since_boot_s, record.time_s, each) for each in record.channels["velocity"].T]
    along = Signal(
        name="velocity", rows=rows, values=np.column_stack(velocity), source="velocity", reason="by hand"
    )
    return replace(
        log,
        signals={name: found for name, found in log.signals.items() if name in LOGGED}
        | {"velocity": (along,)},
        path=f"{air}.csv",
        format="table",
        autopilot="other",
        parameters={},
        modes=(),
    )


@pytest.fixture(scope="module")
def pooled() -> Result:
    return analyze_pooled([repeated(air) for air in (41, 42, 43)])


@pytest.mark.thorough
def test_the_intervals_of_repeated_flights_hold_the_truth(pooled: Result) -> None:
    """All axes, to a quarter or better."""
    model = pooled.identification.recommended
    assert model is not None
    for truth, name in zip(TRUTH, (("p_dot", "L"), ("q_dot", "M"), ("r_dot", "N")), strict=True):
        low, high = model.entries[name].ci95
        assert low <= truth <= high
        assert high - low < 0.5 * truth
    assert "refused" not in pooled.verdict.values()


@pytest.mark.thorough
def test_the_report_says_that_repeated_flights_tell_it(pooled: Result) -> None:
    """And that such a number is to be used with caution."""
    titles = [one.title for one in pooled.diagnosis.findings if one.code == "QL535"]
    told = "roll effectiveness comes from what several flights of one trajectory"
    assert any(told in title for title in titles)
    assert set(pooled.verdict.values()) == {"caution"}


@pytest.mark.thorough
def test_flights_of_different_manoeuvres_tell_nothing_of_commands() -> None:
    """Three flights with sticks of their own."""
    result = analyze_pooled([repeated(air, manoeuvre=air) for air in (41, 42, 43)])
    assert not result.identification.spectral
    assert all(np.isnan(each.command).all() for each in result.data.segments if each.command is not None)
