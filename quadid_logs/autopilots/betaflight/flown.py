"""What a flight was like on average: throttle, rotor speeds, and the delay of the gyro's filters."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.autopilots.betaflight.filters import measured_filter
from quadid_logs.autopilots.betaflight.flight_modes import SELF_LEVELLING
from quadid_logs.autopilots.loop_rows import in_step
from quadid_logs.data.log import FlightLog
from quadid_logs.data.once import once

#: With less throttle a quadrotor stands on the ground, where the PID is reset, or falls.
LEAST_THROTTLE: Final = 0.05
#: Means over so many rows are those of all.
_MOST_ROWS: Final = 50_000


class Flown(NamedTuple):
    """Means over the rows with throttle.

    Attributes
    ----------
    throttle : float
        From 0 to 1.
    highest_throttle : float
        Exceeded in 1 % of the rows.
    rotors_hz : tuple of float
        Speed of each rotor; empty where it is not logged.
    gyro_delay_s : float
        Between the gyro before its filters and behind them [s]; NaN where one of them is not logged.
    levelling : tuple of str
        Which of angle and horizon mode were on at some time.
    """

    throttle: float
    highest_throttle: float
    rotors_hz: tuple[float, ...]
    gyro_delay_s: float
    levelling: tuple[str, ...]


@once
def flown(log: FlightLog) -> Flown:
    """Return what a flight was like on average."""
    throttle = next(iter(log.candidates("throttle")), None)
    if throttle is None:
        return Flown(0.0, 0.0, (), _gyro_delay_s(log), _levelling(log))
    given = np.clip(np.nan_to_num(throttle.values[:, 0]), 0.0, 1.0)
    rows = np.flatnonzero(given > LEAST_THROTTLE)
    rows = rows[:: max(1, rows.size // _MOST_ROWS)]
    if not rows.size:
        return Flown(0.0, 0.0, (), _gyro_delay_s(log), _levelling(log))
    speed = in_step(log, "rotor_speed", throttle)
    rotors_hz = np.zeros(0) if speed is None else speed.values[rows].mean(axis=0) / (2.0 * math.pi)
    return Flown(
        float(given[rows].mean()),
        float(np.quantile(given[rows], 0.99)),
        tuple(rotors_hz.tolist()),
        _gyro_delay_s(log),
        _levelling(log),
    )


def _levelling(log: FlightLog) -> tuple[str, ...]:
    flown_modes = {one.name for one in log.modes}
    return tuple(name for name in SELF_LEVELLING if name in flown_modes)


def _gyro_delay_s(log: FlightLog) -> float:
    """Return the delay of all filters, the dynamic ones too, NaN where it cannot be measured."""
    sources = log.candidates("body_rate")
    filtered = next((one for one in sources if one.source == "main.gyroADC"), None)
    unfiltered = next((one for one in sources if one.raw), None)
    if filtered is None or unfiltered is None or filtered.n_samples < 2:
        return math.nan
    found = measured_filter(filtered.values, unfiltered.values, float(np.median(np.diff(filtered.time_s))))
    return math.nan if found is None else math.sqrt(2.0) / (2.0 * math.pi * found.low_pass_hz)
