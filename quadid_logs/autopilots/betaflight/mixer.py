"""What Betaflight's mixer makes of PID sums and throttle on their way to the outputs; source: ``mixer.c``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from quadid_logs.actuation.airframe import Airframe
from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import FlightLog, whole_number
from quadid_logs.data.off_nominal import AS_COMMANDED, ThrustLaw

#: ``config/feature.h``: FEATURE_AIRMODE.
_AIRMODE: Final = 1 << 22
#: Without it, sums count less at low throttle since then.
_LESS_SINCE: Final = (4, 4)
#: Points of the inverse of a smooth curve: interpolated to 1e-6.
_CURVE_POINTS: Final = 1001
#: The first version with another curve of ``thrust_linear``, which may be as large as this since then.
_SECOND_CURVE_SINCE: Final = (2026, 6)
_MOST_LINEAR: Final = 1.5
#: ``CELL_VOLTAGE_FULL_CV`` [V]; `vbatcellvoltage` is in hundredths of a volt.
_CELL_FULL_V: Final = 4.2
_HUNDREDTHS: Final = 0.01
#: The most cells that the firmware counts.
_MOST_CELLS: Final = 8.0


def unmixed(outputs: FloatArray, throttle: FloatArray, airframe: Airframe, log: FlightLog) -> FloatArray:
    """Return the PID sums that the mixer makes outputs of, while no motor is at a stop.

    Parameters
    ----------
    outputs : ndarray, shape (n_samples, n_rotors)
        From idle, 0, to where the mixer stops the motors, 1.
    throttle : ndarray, shape (n_samples,)
    log : FlightLog
        Whose settings and version these are.

    Returns
    -------
    ndarray, shape (n_samples, 3)
    """
    linear = before_linearisation(outputs, log.parameters.get("thrust_linear", 0.0) / 100.0, log.version)
    mixed = linear @ airframe.command_per_thrust.T
    if log.autopilot != "betaflight" or (log.version is not None and log.version < _LESS_SINCE):
        return np.asarray(mixed)
    return np.asarray(mixed / mix_factor(throttle, log.parameters)[:, np.newaxis])


def mix_factor(throttle: FloatArray, settings: Mapping[str, float]) -> FloatArray:
    """Return what the mixer multiplies the PID sums with, for each throttle.

    Parameters
    ----------
    throttle : ndarray, shape (n,)

    Returns
    -------
    ndarray, shape (n,)
        1 with airmode; without, 0.5 to 1.
    """
    if has_airmode(settings):
        return np.ones_like(throttle)
    return np.clip(0.5 + throttle, 0.5, 1.0)


def has_airmode(settings: Mapping[str, float]) -> bool:
    """Tell whether airmode is always on, whatever its switch says."""
    return bool(whole_number(settings.get("features"), _AIRMODE) & _AIRMODE)


def before_linearisation(output: FloatArray, amount: float, version: tuple[int, ...] | None) -> FloatArray:
    """Return the outputs as they were before ``thrust_linear``, which raises low ones.

    Parameters
    ----------
    output : ndarray
        From 0 to 1.
    amount : float
        ``thrust_linear`` as a fraction; headers hold it since 4.5.
    version : tuple of int or None
        Of the firmware; None is taken for a recent one.

    Returns
    -------
    ndarray
        The x of output = x (1 + e (1 - x)^2), and of x (1 + e (1 - x) (1 + e (1 - 2 x))) since 2026.6,
        `pidApplyThrustLinearization`.
    """
    if not 0.0 < amount <= _MOST_LINEAR:
        return output
    x = np.linspace(0.0, 1.0, _CURVE_POINTS)
    return np.asarray(np.interp(output, linearised(x, amount, version), x), dtype=np.float64)


def linearised(x: FloatArray, amount: float, version: tuple[int, ...] | None) -> FloatArray:
    """Return the outputs that ``thrust_linear`` makes: the inverse of `before_linearisation`.

    Parameters
    ----------
    x : ndarray
        From 0 to 1, rising.
    amount, version
        As of `before_linearisation`.

    Returns
    -------
    ndarray
        Shape of `x`.
    """
    if not 0.0 < amount <= _MOST_LINEAR:
        return x
    rest = 1.0 - x
    if version is not None and version < _SECOND_CURVE_SINCE:
        curve = x * (1.0 + amount * rest**2)
    else:
        curve = x * (1.0 + amount * rest * (1.0 + amount * (rest - x)))
    return np.maximum.accumulate(curve)


def highest_output(voltage: FloatArray, settings: Mapping[str, float]) -> FloatArray:
    """Return the output (0 to 1) at which ``vbat_sag_compensation`` stops the motors, for each voltage.

    Parameters
    ----------
    voltage : ndarray
        Of the battery [V].

    Returns
    -------
    ndarray
        Shape of `voltage`. A part of the range is kept for a battery that is less than full; 1 without it, or
        where the header does not tell the cells.
    """
    amount = settings.get("vbat_sag_compensation", 0.0) / 100.0
    warning_v, most_v = (_HUNDREDTHS * settings.get(f"vbatcellvoltage[{place}]", 0.0) for place in (1, 2))
    at_start_v = _HUNDREDTHS * settings.get("vbatref", 0.0)
    range_v = _CELL_FULL_V - warning_v
    if not (0.0 < amount <= 1.0 and warning_v > 0.0 and range_v > 0.0 and most_v > 0.0 and at_start_v > 0.0):
        return np.ones_like(voltage)
    cells = min(np.floor(at_start_v / most_v) + 1.0, _MOST_CELLS)
    fallen = np.clip((_CELL_FULL_V - voltage / cells) / range_v, 0.0, 1.0)
    return np.asarray(1.0 - amount * range_v / _CELL_FULL_V * (1.0 - fallen))


def thrust_law(log: FlightLog, parameters: Mapping[str, float]) -> ThrustLaw:
    """Return what Betaflight makes of a command of thrust; see `Autopilot.thrust_law`.

    Parameters
    ----------
    log : FlightLog
        Whose version it is.

    Returns
    -------
    ThrustLaw
        ``vbat_sag_compensation`` keeps a part of the outputs' range for an emptier battery; nothing makes
        up for thin air.
    """
    amount = parameters.get("thrust_linear", 0.0) / 100.0

    def output(command: FloatArray) -> FloatArray:
        return linearised(command, amount, log.version)

    def behind(voltage_v: float, n_cells: int) -> float:
        if not math.isfinite(voltage_v):
            return 1.0
        return float(highest_output(np.array([voltage_v]), parameters)[0])

    return AS_COMMANDED._replace(output=output, behind=behind)
