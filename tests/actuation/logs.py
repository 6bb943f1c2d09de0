"""Small logs made by hand for the tests of the torque reconstruction."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from quadid_logs.autopilots.ardupilot.frames import frame_geometry
from quadid_logs.autopilots.ardupilot.mixer import (
    MotorSettings,
    Supply,
    actuator_of_thrust,
    compensation_gain,
    mix,
    pulse_width,
)
from quadid_logs.data.log import FlightLog, Rows, Signal

GRAVITY = 9.80665
MOTORS = MotorSettings(
    expo=0.65, spin_min=0.15, spin_max=0.95, pwm_min_us=1000.0, pwm_max_us=2000.0, yaw_headroom=0.2
)
PARAMETERS: Mapping[str, float] = {
    "FRAME_CLASS": 1.0,
    "FRAME_TYPE": 1.0,
    "MOT_THST_EXPO": 0.65,
    "MOT_SPIN_MIN": 0.15,
    "MOT_SPIN_MAX": 0.95,
    "MOT_PWM_MIN": 1000.0,
    "MOT_PWM_MAX": 2000.0,
    "MOT_YAW_HEADROOM": 200.0,
    "SERVO1_FUNCTION": 33.0,
    "SERVO2_FUNCTION": 34.0,
    "SERVO3_FUNCTION": 35.0,
    "SERVO4_FUNCTION": 36.0,
}
RATE_HZ = 100.0


def supply(n: int, *, voltage: float = 1.0, density: float = 1.0, average_max: float = 0.5) -> Supply:
    """Return a constant supply for `n` rows."""
    lift_max = voltage * (1.0 - MOTORS.expo) + MOTORS.expo * voltage**2
    return Supply(
        lift_max=np.full(n, lift_max),
        voltage_ratio=np.full(n, voltage),
        gain=compensation_gain(np.full(n, lift_max), np.full(n, density)),
        throttle_limit=np.ones(n),
        throttle_average_max=np.full(n, average_max),
    )


@cache
def fast_rows(n: int) -> Rows:
    """Return the rows of the one message that holds all that is fast."""
    row = np.arange(n)
    return Rows(row / RATE_HZ, row * 1000)


def signal(name: str, values: np.ndarray, *, every: int = 1, source: str = "") -> Signal:
    """Return a signal sampled with the rows of the log, or every so many of them."""
    columns = values.reshape(len(values), -1)[::every]
    row = np.arange(0, len(values), every)
    # Rows of different messages lie between each other; the slow ones come after the fast ones.
    rows = fast_rows(len(values)) if every == 1 else Rows(row / RATE_HZ, row * 1000 + 1 + hash_of(name))
    return Signal(
        name=name,
        rows=rows,
        values=columns.astype(np.float64),
        source=source or name.upper(),
    )


def hash_of(name: str) -> int:
    """Return a small number that differs between names, the same in every run."""
    return sum(map(ord, name)) % 900 + 2


def ardupilot_log(
    *,
    parameters: Mapping[str, float] = PARAMETERS,
    size: float = 0.1,
    mass_kg: float = 2.0,
    max_thrust_n: float = 10.0,
    n: int = 4000,
    voltage: float = 0.95,
) -> FlightLog:
    """Return 40 s of flight of a quad X whose motors do exactly what the firmware computes."""
    rng = np.random.default_rng(1)
    command = rng.standard_normal((n, 3)) * size
    throttle = np.full(n, 0.45) + 0.02 * rng.standard_normal(n)
    given = supply(n, voltage=voltage)
    factors = np.column_stack([frame_geometry(1, 1).mixer, np.ones(4)])
    output = mix(command, throttle, factors, given, MOTORS.yaw_headroom)
    actuator = actuator_of_thrust(output.thrust, given, MOTORS)
    y = actuator * voltage
    thrust = (1.0 - MOTORS.expo) * y + MOTORS.expo * y**2
    force = np.zeros((n, 3))
    force[:, 2] = -thrust.sum(axis=1) * max_thrust_n / mass_kg
    signals = [
        signal("torque_command", command, source="RATE.ROut POut YOut"),
        signal("throttle", throttle, source="RATE.AOut"),
        # Swaying: a gyro that shows nothing at all stands on a bench.
        signal("body_rate", 0.05 * np.sin(np.arange(n) / RATE_HZ)[:, np.newaxis] * np.ones(3)),
        signal("specific_force", force),
        signal("attitude", np.zeros((n, 3))),
        signal("output_pwm", pulse_width(actuator, MOTORS), every=10),
        signal("lift_max", given.lift_max, every=10),
        signal("battery_ratio", given.voltage_ratio, every=10),
        signal("throttle_average_max", given.throttle_average_max, every=10),
    ]
    return FlightLog(
        path="made.bin",
        format="dataflash",
        autopilot="ardupilot",
        n_bytes=n * 1000,
        vehicle_type="multirotor",
        frame="quad X",
        signals={each.name: (each,) for each in signals},
        parameters=dict(parameters),
    )
