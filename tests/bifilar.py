"""Bifilar swings integrated from the exact equation of motion, and the logs that autopilots write of them.

Nothing here is shared with the package's estimator: the potential, the kinetic energy and their derivatives
are written out from the geometry, and integrated by an adaptive method of order 8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from quadid_logs.data.log import FlightLog, Rows, Signal

GRAVITY = 9.80665


@dataclass(frozen=True, kw_only=True)
class Hung:
    """A vehicle on two strings; drag moments are linear [N m s] and quadratic [N m s^2]."""

    moment: float = 0.0145
    mass: float = 1.6
    length: float = 0.9
    distance: float = 0.4
    linear: float = 2e-4
    quadratic: float = 2e-4


def swing_rate(
    hung: Hung, time_s: np.ndarray, amplitude_deg: float, *, pushes_s: tuple[float, ...] = (0.0,)
) -> np.ndarray:
    """Return the rate about the vertical [rad/s]; at each push the vehicle is let go at the amplitude."""
    h, d, m = hung.length, hung.distance, hung.mass

    def slope(_t: float, state: np.ndarray) -> list[float]:
        # In plain floats: this is asked ten thousand times.
        theta, rate = state.tolist()
        sine, root = math.sin(theta), math.sqrt(h**2 - d**2 * math.sin(theta / 2.0) ** 2)
        rise = d**2 * sine / (4.0 * root)
        rise_slope = d**2 * math.cos(theta) / (4.0 * root) + d**4 * sine**2 / (16.0 * root**3)
        drag = hung.linear * rate + hung.quadratic * rate * abs(rate)
        torque = -m * rise * rise_slope * rate**2 - m * GRAVITY * rise - drag
        return [rate, torque / (hung.moment + m * rise**2)]

    rates = np.zeros(time_s.size)
    for push, end in zip(pushes_s, (*pushes_s[1:], np.inf), strict=True):
        rows = np.flatnonzero((time_s >= push) & (time_s < end))
        start = (time_s[rows[0]], time_s[rows[-1]])
        found = solve_ivp(
            slope, start, [np.radians(amplitude_deg), 0.0], "DOP853", time_s[rows], rtol=1e-8, atol=1e-10
        )
        rates[rows] = found.y[1]
    return rates


def swing_log(
    rate: np.ndarray,
    time_s: np.ndarray,
    *,
    axis: int = 0,
    noise_rad_s: float = 0.003,
    seed: int = 0,
    **changes: object,
) -> FlightLog:
    """Return the log of an ArduPilot vehicle that is disarmed, its gyro with noise and bias."""
    random = np.random.default_rng(seed)
    rates = noise_rad_s * random.standard_normal((time_s.size, 3)) + np.array([0.002, -0.001, 0.003])
    rates[:, axis] += rate
    rows = Rows(time_s, np.arange(time_s.size))
    signal = Signal(name="body_rate", rows=rows, values=rates, source="RATE.R,P,Y", reason="test")
    said = {
        "path": "swing.bin",
        "format": "dataflash",
        "autopilot": "ardupilot",
        "n_bytes": 0,
        "firmware": "ArduCopter V4.5.7",
        "vehicle_type": "multirotor",
        "signals": {"body_rate": (signal,)},
    }
    return FlightLog(**(said | changes))  # type: ignore[arg-type]
