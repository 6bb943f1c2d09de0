"""A change of effectiveness in flight where commands tell the axis."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import ChangeCheck
from quadid_logs.data.settings import Settings
from quadid_logs.identify.spectral import AxisMoments, solve_flight
from quadid_logs.identify.spectral_change import answered, with_answers
from quadid_logs.load import prepare
from quadid_logs.simulator import Scenario, fly, manoeuvres, plan_flights
from quadid_logs.simulator.airframes import quad_x
from quadid_logs.simulator.closed_loop import torque_gain
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.vocabulary import ON_AXIS
from tests.synthetic_results import usable_result

RATE_HZ = 200.0


@pytest.fixture(scope="module")
def flight() -> FlightData:
    """Doublets for a minute, in gusts as a flown quadrotor leaves them."""
    plain = Scenario(name="", sentence="")
    scenario = dataclasses.replace(
        plain,
        airframe=quad_x,
        manoeuvre=partial(manoeuvres.doublets, amplitude_rad_s=1.5),
        effects=dataclasses.replace(plain.effects, disturbance_rad_s2=(1.3, 1.3, 0.6)),
    )
    (setup,) = plan_flights(scenario, seed=3, duration_s=70.0, rate_hz=RATE_HZ)
    return cut(prepare(log_flights((fly(setup),), Logging(rate_hz=RATE_HZ))), Settings().align)


def told(data: FlightData) -> ChangeCheck:
    """Return what commands tell of a change that a fit in time shows in the middle of the flight."""
    solution = solve_flight(data)
    assert solution is not None
    axes: list[AxisMoments] = solution.axes
    (segment,) = data.segments
    middle_s = float(segment.time_s[segment.n_samples // 2])
    shown = ChangeCheck(
        time_s=np.full(3, middle_s),
        before=np.full(3, 100.0),
        after=np.full(3, 150.0),
        statistic=np.full(3, 30.0),
    )
    return answered(shown, axes, solution.fits)


def test_gusts_that_move_a_fit_in_time_are_no_change(flight: FlightData) -> None:
    """The vehicle is the same throughout."""
    assert not told(flight).seen.any()


def weaker_later(flight: FlightData) -> FlightData:
    """Return a flight in whose second half every torque moves the vehicle by a third less."""
    (segment,) = flight.segments
    torque = segment.torque.copy()
    torque[segment.n_samples // 2 :] *= 1.5
    return dataclasses.replace(
        flight, segments=(dataclasses.replace(segment, torque=torque, rotor_thrust=None),)
    )


def test_a_vehicle_that_changes_is_seen_in_gusts_and_by_how_much(flight: FlightData) -> None:
    """Every torque moves it by a third less in the second half."""
    found = told(weaker_later(flight))
    assert found.seen[:2].all()
    np.testing.assert_allclose(found.after[:2] / found.before[:2], 1.0 / 1.5, rtol=0.15)


def test_what_no_answer_tells_of_both_parts_is_no_change(flight: FlightData) -> None:
    """The change lies before the first block."""
    solution = solve_flight(flight)
    assert solution is not None
    early = ChangeCheck(
        time_s=np.zeros(3), before=np.full(3, 1.0), after=np.full(3, 2.0), statistic=np.full(3, 99.0)
    )
    assert not answered(early, solution.axes, solution.fits).seen.any()


def test_an_axis_that_is_fitted_in_time_keeps_its_change(flight: FlightData) -> None:
    """Nothing is known of it that is better."""
    solution = solve_flight(flight)
    assert solution is not None
    shown = ChangeCheck(
        time_s=np.full(3, 20.0), before=np.full(3, 1.0), after=np.full(3, 2.0), statistic=np.full(3, 99.0)
    )
    assert answered(shown, (), solution.fits).seen.all()


def test_the_interval_holds_the_vehicle_before_and_after(flight: FlightData) -> None:
    """Of one effectiveness there is none."""
    changed = weaker_later(flight)
    solution = solve_flight(changed)
    model = usable_result().identification.recommended
    assert solution is not None
    assert model is not None
    shown = ChangeCheck(
        time_s=told(changed).time_s,
        before=np.full(3, 1.0),
        after=np.full(3, 2.0),
        statistic=np.full(3, 99.0),
    )
    frame = quad_x()
    true = np.linalg.solve(frame.inertia_kg_m2, torque_gain(frame, "ardupilot"))[0, 0]
    low, high = (
        with_answers(dataclasses.replace(model, change=shown), solution.axes, solution.fits)
        .entries[ON_AXIS["roll"]]
        .ci95
    )
    assert low < true / 1.5
    assert high > true
