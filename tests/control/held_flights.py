"""Flights that hold a position in the simulator, and their controllers as the package describes them."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np

from quadid_logs.control.outer_loops import close_outer
from quadid_logs.data.log import FlightLog
from quadid_logs.data.outer_loops import AttitudeCommand, CascadeController, OuterLoop
from quadid_logs.simulator import SCENARIOS, plan_flights
from quadid_logs.simulator.closed_loop import Noise, Record, Setup, fly
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.position_hold import PositionHold
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.simulator.truth import flight_truth

ARDUPILOT: Final = PositionHold()
PX4: Final = PositionHold(
    position_per_s=0.95,
    proportional_per_s=1.8,
    integral_per_s2=0.4,
    derivative=0.2,
    error_hz=0.0,
    slope_of_error=False,
    lag_s=0.0,
    period_s=0.02,
)
HOLDS: Final = {"ardupilot": ARDUPILOT, "px4": PX4}
_QUIET: Final = Noise(
    gyro_rad_s_per_rthz=0.0, gyro_bias_rad_s=(0.0, 0.0, 0.0), accelerometer_m_s2_per_rthz=0.0
)


def setup(autopilot: str, hold: PositionHold, *, seconds: float = 20.0, scenario: str = "hover") -> Setup:
    """Return a flight of a path in calm air without noise."""
    first = plan_flights(SCENARIOS[scenario], seed=3, duration_s=seconds, rate_hz=400, autopilot=autopilot)[0]
    return dataclasses.replace(first, position=hold, noise=_QUIET)


def flown(autopilot: str, hold: PositionHold, *, seconds: float = 20.0, scenario: str = "hover") -> Record:
    return fly(setup(autopilot, hold, seconds=seconds, scenario=scenario))


def logged(record: Record) -> FlightLog:
    return log_flights((record,), Logging())


def log_of(autopilot: str, *, scenario: str = "hover", seconds: float = 20.0) -> FlightLog:
    """Return the log of a flight with the firmware's own gains."""
    return logged(flown(autopilot, HOLDS[autopilot], scenario=scenario, seconds=seconds))


def cascade(hold: PositionHold) -> CascadeController:
    """Return the controllers of a hold as the package describes them."""
    return CascadeController(
        position_per_s=hold.position_per_s,
        proportional_per_s=hold.proportional_per_s,
        integral_per_s2=hold.integral_per_s2,
        derivative=hold.derivative,
        error_hz=hold.error_hz,
        derivative_hz=hold.derivative_hz,
        slope_of_error=hold.slope_of_error,
        period_s=hold.period_s,
        gains={},
    )


def true_loop(record: Record) -> OuterLoop:
    """Return the loop of the simulator's own vehicle and controllers, at the voltage that it flew with.

    The effectiveness sags with the battery where the firmware does not make up for it: PX4 by 3.7 % here.
    """
    flight = record.setup
    hold, truth = flight.position, flight_truth((record,), scenario="", boot_s=0.0)
    assert hold is not None
    command = AttitudeCommand(lags_s=(hold.lag_s,) if hold.lag_s else (), forward=hold.lag_s > 0.0)
    plant = true_plant(flight, truth, 1)
    found = close_outer(true_controller(flight, 1), plant, command, cascade(hold), np.inf)
    assert found is not None
    return found
