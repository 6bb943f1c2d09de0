"""Flights of a known loop, stepped through in plain Python, and the controllers that flew them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg, signal

from quadid_logs.autopilots.discrete import butterworth, derivative, first_order, gain, integrator
from quadid_logs.data.controller import AxisController, FlownControllers
from quadid_logs.data.flight import FlightData, InputDescription, Segment
from quadid_logs.data.log import GyroFilter
from tests.control.flown_controller import motion

PERIOD_S = 1.0 / 400.0


@dataclass(frozen=True)
class Vehicle:
    """One axis behind lag and delay, with its rate loop; the delay is of whole steps, without the hold."""

    B: float = 300.0
    A: float = -2.0
    lag_s: float = 0.03
    delay_steps: int = 1
    P: float = 0.08
    I: float = 0.1  # noqa: E741
    D: float = 0.001
    cutoff_hz: float = 40.0
    gyro_hz: float = 40.0
    extra_lag_s: float = 0.0

    @property
    def controller(self) -> AxisController:
        """The same, as the package describes a controller."""
        slope = derivative(PERIOD_S) * first_order(self.cutoff_hz, PERIOD_S)
        terms = gain(self.P, PERIOD_S) + integrator(PERIOD_S).scaled(self.I) + slope.scaled(self.D)
        return AxisController(
            period_s=PERIOD_S,
            error=terms,
            target=first_order(self.cutoff_hz, PERIOD_S),
            gyro=(butterworth(self.gyro_hz, PERIOD_S),),
            angle_gain_per_s=4.0,
        )


AXES = {"roll": Vehicle(), "pitch": Vehicle(B=250.0), "yaw": Vehicle(B=60.0, P=0.2, I=0.1, D=0.0)}


def controllers(vehicles: dict[str, Vehicle] = AXES) -> FlownControllers:
    """Return what the parameters of such a log would say."""
    axes = {axis: vehicle.controller for axis, vehicle in vehicles.items()}
    return FlownControllers(name="PID", firmware="", version_read="read", version_note="", axes=axes)


def flight(
    vehicles: dict[str, Vehicle] = AXES, seconds: float = 60.0, gust: float = 0.0, chirp_hz: float = 0.0
) -> FlightData:
    """Fly all axes on broadband set-points; or, with a chirp at roll's mixer, on hardly any."""
    n = int(seconds / PERIOD_S)
    time_s = PERIOD_S * np.arange(n)
    setpoint = motion(n, 1, cutoff_hz=6.0) * (0.02 if chirp_hz else 1.0)
    chirp = np.zeros(n)
    if chirp_hz:
        chirp = 0.03 * signal.chirp(time_s, 0.5, seconds, chirp_hz, method="logarithmic")
    disturbance = gust * motion(n, 2, cutoff_hz=3.0)
    flown = [
        fly(vehicle, setpoint[:, k], disturbance[:, k], chirp if k == 0 else np.zeros(n))
        for k, vehicle in enumerate(vehicles.values())
    ]
    segment = Segment(
        time_s=time_s,
        body_rate_rad_s=np.column_stack([rate for rate, _ in flown]),
        torque=np.column_stack([torque for _, torque in flown]),
        attitude_rad=None,
        throttle=None,
        saturated=np.zeros(n, dtype=bool),
        reference=np.column_stack([setpoint, chirp]) if chirp_hz else setpoint,
    )
    return FlightData(
        sample_period_s=PERIOD_S,
        segments=(segment,),
        flights=((0.0, seconds),),
        sources={},
        input=InputDescription(kind="torque_command", unit="1", source="", every_step=True),
        start_s=0.0,
        duration_s=seconds,
        gyro_filter=GyroFilter(vehicles["roll"].gyro_hz),
    )


def fly(
    vehicle: Vehicle, setpoint: np.ndarray, disturbance: np.ndarray, chirp: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Step through one axis; return rate behind the gyro's filter and torque, as they would be logged."""
    v, h = vehicle, PERIOD_S
    # Exact for a held command: rate, actuator, a second lag that the model does not know, and the command
    # itself.
    second = 1.0 / v.extra_lag_s if v.extra_lag_s else 1e4
    matrix = np.array(
        [[v.A, v.B, 0, 0], [0, -1 / v.lag_s, 1 / v.lag_s, 0], [0, 0, -second, second], [0, 0, 0, 0]]
    )
    step = linalg.expm(matrix * h)
    (b0, b1, b2), (_, a1, a2) = (each.tolist() for each in signal.butter(2, v.gyro_hz, fs=1 / h))
    alpha = h / (h + 1 / (2 * np.pi * v.cutoff_hz))
    state, once, twice, queue = np.zeros(4), 0.0, 0.0, [0.0] * (v.delay_steps + 1)
    target = error = integral = slope = wanted = excited = 0.0
    rates, torques = [], []
    # In plain floats, which cost a tenth of numpy's.
    series = (setpoint.tolist(), disturbance.tolist(), chirp.tolist())
    for following, disturbed, injected in zip(*series, strict=True):
        sample = float(state[0])
        rate = b0 * sample + once
        once, twice = b1 * sample - a1 * rate + twice, b2 * sample - a2 * rate
        # The set-point logged with one loop is used in the next.
        target += alpha * (wanted - target)
        before, error = error, target - rate
        integral += error * v.I * h
        slope += alpha * ((error - before) / h - slope)
        # An excitation that is logged with one loop is part of the next one's command, too.
        torque = v.P * error + integral + v.D * slope + excited
        rates.append(rate)
        torques.append(torque)
        queue = [*queue[1:], torque]
        state[3] = queue[0]
        state = step @ state
        state[0] += disturbed * h
        wanted, excited = following, injected
    return np.array(rates), np.array(torques)
