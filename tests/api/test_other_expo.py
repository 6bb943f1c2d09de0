"""A model of a flight whose thrust curve was found predicts flights that assume another one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.data.flight import FlightData, InputDescription, Segment
from quadid_logs.data.torque import AssumedExpo, HeldScale
from quadid_logs.identify.thrust_curve import with_expo

EXPO = 0.6
THROTTLE = 0.5 + 0.1 * np.random.default_rng(0).standard_normal((400, 4))
MIXER = np.array([[-1.0, 1.0, 1.0, -1.0], [1.0, -1.0, 1.0, -1.0], [0.1, 0.1, -0.1, -0.1]])


@pytest.fixture
def flight() -> FlightData:
    """Return rotors at varying throttle, their thrust by an expo of 0.4 although it is `EXPO`."""
    thrust = 0.6 * THROTTLE + 0.4 * THROTTLE**2
    segment = Segment(
        time_s=0.01 * np.arange(400),
        body_rate_rad_s=np.zeros((400, 3)),
        torque=thrust @ MIXER.T,
        attitude_rad=None,
        throttle=None,
        saturated=np.zeros(400, dtype=bool),
        rotor_thrust=thrust,
        thrust_by_expo=THROTTLE**2 - THROTTLE,
    )
    return FlightData(
        sample_period_s=0.01,
        segments=(segment,),
        flights=((0.0, 4.0),),
        sources={},
        input=InputDescription(
            kind="torque_command",
            unit="1",
            source="",
            torque_per_thrust=MIXER,
            expo=AssumedExpo(value=0.4, parameter="EXPO", held=HeldScale.FULL),
        ),
        start_s=0.0,
        duration_s=4.0,
    )


def test_the_torque_is_that_of_the_expo_that_was_found(flight: FlightData) -> None:
    """Thrust and torque are those of the true curve, (1 - e) y + e y^2."""
    rebuilt = with_expo(flight, EXPO).segments[0]
    thrust = (1.0 - EXPO) * THROTTLE + EXPO * THROTTLE**2
    np.testing.assert_allclose(rebuilt.rotor_thrust, thrust)
    np.testing.assert_allclose(rebuilt.torque, thrust @ MIXER.T, atol=1e-12)


def test_where_the_weight_holds_the_scale_the_mean_thrust_stays(flight: FlightData) -> None:
    """The shape is that of the true curve all the same."""
    assert flight.input is not None
    expo = AssumedExpo(value=0.4, parameter="EXPO", held=HeldScale.WEIGHT)
    rebuilt = with_expo(replace(flight, input=replace(flight.input, expo=expo)), EXPO).segments[0]
    thrust = (1.0 - EXPO) * THROTTLE + EXPO * THROTTLE**2
    before = flight.segments[0].rotor_thrust
    assert before is not None
    np.testing.assert_allclose(rebuilt.rotor_thrust, thrust * (before.mean() / thrust.mean()))


def test_a_flight_with_that_expo_already_stays_as_it_is(flight: FlightData) -> None:
    """And so does one without any."""
    assert with_expo(flight, 0.4) is flight
    assert flight.input is not None
    without = replace(flight, input=replace(flight.input, expo=None))
    assert with_expo(without, EXPO) is without
