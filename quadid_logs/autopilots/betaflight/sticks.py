"""Rate set-points from the sticks, for logs that do not hold them: before 4.0.

Source: ``fc_rc.c`` (``calculateSetpointRate``, ``applyBetaflightRates`` and its siblings) of 3.1.3, 3.1.5,
3.4.0, 4.2.8, 4.3.1 and 2025.12.2; ``pid.c`` (``accelerationLimit``). The logged ``rcCommand`` is the stick
behind its dead band, from -500 to 500, in the log's own signs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray

#: `rates_type`: the numbers of ``RATES_TYPE_BETAFLIGHT`` and so on.
_BETAFLIGHT, _RACEFLIGHT, _KISS, _ACTUAL, _QUICK = range(5)
#: ``SETPOINT_RATE_LIMIT`` [deg/s], and what the logged stick is at its end.
_FASTEST: Final = 1998.0
STICK_END: Final = 500.0
#: RC_RATE_INCREMENTAL: above 2, so much more of the rate.
_STEEP_ABOVE, _STEEPER = 2.0, 14.54
_LEAST_REST: Final = 0.01
#: Until 3.1.3 the curve of expo was in the factor of the rates too.
_BEFORE_EXPO_SINCE: Final = (3, 1, 4)
#: The dead band is no part of the stick's range since 4.2.
_DEAD_BAND_SINCE: Final = (4, 2)
#: From then on sticks are no whole numbers where they are interpolated, and were cut to whole ones until 4.0.
_CUT: Final = ((3, 2), (4, 0))
#: Versions that knew RaceFlight's rates too, and did not say so in the header.
_TWO_KINDS: Final = ((3, 3), (4, 0))
#: Limits of the set-point's slope count in hundreds of deg/s^2.
_SLOPE_UNIT: Final = 100.0
#: Three numbers by so many rows. Rounding, throttle attenuation and yaw's low-pass leave some hundredths of
#: P's variance, a mode that levels leaves most of it.
_FEWEST_ROWS, _UNEXPLAINED = 100, 0.05
#: P of yaw has a limit that no header holds: rows near the largest tell nothing.
_UNLIMITED: Final = 0.9


class Sticks(NamedTuple):
    """The curves from sticks to rates.

    Attributes
    ----------
    kind : int
        `rates_type`.
    rates : tuple of (float, float, float)
        By axis the settings ``rc_rates``, ``rc_expo`` and ``rates``.
    limits : tuple of float
        Of the rate, by axis [deg/s].
    ends : tuple of float
        The logged stick at its end, by axis.
    slopes : tuple of float
        Limits of the set-point's slope, by axis [deg/s^2]; 0 for none.
    cut : tuple of bool
        Whether the logged stick was cut towards zero, by axis.
    expo_in_factor : bool
    """

    kind: int
    rates: tuple[tuple[float, float, float], ...]
    limits: tuple[float, ...]
    ends: tuple[float, ...]
    slopes: tuple[float, ...]
    cut: tuple[bool, ...]
    expo_in_factor: bool

    def set_points(self, command: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return the rate set-points of logged sticks.

        Parameters
        ----------
        command : ndarray, shape (n, 3)
            `rcCommand`, not in tenths.
        time_s : ndarray, shape (n,)

        Returns
        -------
        ndarray, shape (n, 3)
            In degrees per second, in the log's own signs.
        """
        found = np.empty(command.shape)
        for axis, slope in enumerate(self.slopes):
            logged = command[:, axis]
            rate = self.rate(axis, logged + 0.5 * np.sign(logged) if self.cut[axis] else logged)
            found[:, axis] = _slowed(rate, time_s, slope) if slope > 0.0 else rate
        return found

    def rate(self, axis: int, command: FloatArray) -> FloatArray:
        """Return the rate that a stick asks for on one axis [deg/s], shape of `command`."""
        stick = np.clip(command / self.ends[axis], -1.0, 1.0)
        return np.clip(self._curve(stick, *self.rates[axis]), -self.limits[axis], self.limits[axis])

    def rounding(self, axis: int, set_points: FloatArray) -> float:
        """Return what a whole number of the stick leaves unknown of set-points [deg/s], rms."""
        command = np.arange(STICK_END + 1.0)
        rate = self.rate(axis, command)
        slope = np.interp(np.abs(set_points), np.maximum.accumulate(rate), np.gradient(rate))
        return float(np.sqrt(np.mean(slope**2) / 12.0)) if slope.size else 0.0

    def _curve(self, stick: FloatArray, centre: float, expo: float, full: float) -> FloatArray:
        """Return the rate of a stick from -1 to 1."""
        away = np.abs(stick)
        if self.kind == _RACEFLIGHT:
            curved = (1.0 + 0.01 * expo * (stick**2 - 1.0)) * stick
            return np.asarray(10.0 * centre * curved * (1.0 + 0.01 * full * away))
        if self.kind == _ACTUAL:
            middle = 10.0 * centre
            bent = away * (stick**5 * 0.01 * expo + stick * (1.0 - 0.01 * expo))
            return np.asarray(stick * middle + max(10.0 * full - middle, 0.0) * bent)
        bent = stick * (1.0 + 0.01 * expo * (away**3 - 1.0))
        if self.kind == _QUICK:
            middle = 2.0 * centre
            super_rate = 1.0 - middle / max(10.0 * full, middle) if middle > 0.0 else 0.0
            curve = away * (1.0 + 0.01 * expo * (away**2 - 1.0))
            return np.asarray(stick * middle * _super(curve, super_rate))
        if self.kind == _KISS:
            bent = stick * (1.0 + 0.01 * expo * (away**2 - 1.0))
            return np.asarray(2.0 * centre * bent * _super(away, 0.01 * full))
        steep = 0.01 * centre
        steep += _STEEPER * max(steep - _STEEP_ABOVE, 0.0)
        return np.asarray(
            200.0 * steep * bent * _super(np.abs(bent) if self.expo_in_factor else away, 0.01 * full)
        )


def _super(away: FloatArray, rate: float) -> FloatArray:
    """Return the factor of the super rate."""
    return np.asarray(1.0 / np.clip(1.0 - away * rate, _LEAST_REST, 1.0))


def _slowed(rate: FloatArray, time_s: FloatArray, slope: float) -> FloatArray:
    """Return a rate that follows with a limited slope; the firmware steps loop by loop."""
    most = slope * np.clip(np.diff(time_s, prepend=time_s[:1]), 0.0, None)
    if not np.any(np.abs(np.diff(rate, prepend=rate[:1])) > most):
        return rate
    found, now = rate.tolist(), float(rate[0])
    for row, (wanted, step) in enumerate(zip(found, most.tolist(), strict=True)):
        now = min(max(wanted, now - step), now + step)
        found[row] = now
    return np.array(found)


def sticks_of(settings: Mapping[str, float], version: tuple[int, ...] | None) -> Sticks | None:
    """Return the curves of a header's rates.

    Parameters
    ----------
    settings : mapping of str to float
        By the names of `header_names`.

    Returns
    -------
    Sticks or None
        None where one of the rates is missing, or is no number that the firmware holds.
    """
    lists = [
        [settings.get(f"{name}[{axis}]", math.nan) for name in ("rc_rates", "rc_expo", "rates")]
        for axis in range(3)
    ]
    # Of eight bits each, and of sixteen in the versions that hold more.
    if not all(0.0 <= one < 2.0**16 for each in lists for one in each):
        return None
    kind = settings.get("rates_type", float(_BETAFLIGHT))
    if kind not in range(5):
        return None
    recent = version is None or version >= _DEAD_BAND_SINCE
    bands = (settings.get("deadband", 0.0), settings.get("deadband", 0.0), settings.get("yaw_deadband", 0.0))
    slopes = (
        settings.get("acc_limit", 0.0),
        settings.get("acc_limit", 0.0),
        settings.get("acc_limit_yaw", 0.0),
    )
    smooth = settings.get("rc_interpolation", 0.0) > 0.0 or settings.get("rc_smoothing_type", 0.0) > 0.0
    cut = smooth and version is not None and _CUT[0] <= version < _CUT[1]
    limits = (settings.get(f"rate_limits[{axis}]", _FASTEST) for axis in range(3))
    return Sticks(
        kind=int(kind),
        rates=tuple((centre, expo, full) for centre, expo, full in lists),
        limits=tuple(limit if 0.0 < limit < _FASTEST else _FASTEST for limit in limits),
        ends=tuple(STICK_END - band if recent and 0.0 < band < STICK_END else STICK_END for band in bands),
        slopes=tuple(_SLOPE_UNIT * max(one, 0.0) for one in slopes),
        # Yaw is not interpolated by default.
        cut=(cut, cut, False),
        expo_in_factor=version is not None and version < _BEFORE_EXPO_SINCE,
    )


def told_by_p(
    sticks: Sticks, version: tuple[int, ...], command: FloatArray, rate: FloatArray, p: FloatArray
) -> Sticks:
    """Return the curves whose set-points P is made of, where the header does not tell their kind.

    Parameters
    ----------
    command, rate, p : ndarray, shape (n, 3)
        Logged sticks, the gyro [deg/s], and the terms P, of rows in which sticks command rates.
    """
    if not _TWO_KINDS[0] <= version < _TWO_KINDS[1]:
        return sticks
    kinds = [sticks._replace(kind=kind) for kind in (_BETAFLIGHT, _RACEFLIGHT)]
    return min(kinds, key=lambda one: _left_of_p(one, command, rate, p))


def _left_of_p(sticks: Sticks, command: FloatArray, rate: FloatArray, p: FloatArray) -> float:
    """Return what a gain on the error leaves of P, as a fraction of its variance, the sum of all axes."""
    left = 0.0
    for axis in range(3):
        error = sticks.rate(axis, command[:, axis]) - rate[:, axis]
        whole, of_error = float(np.var(p[:, axis])), float(np.var(error))
        if whole > 0.0 and of_error > 0.0:
            left += 1.0 - float(np.mean((error - error.mean()) * p[:, axis])) ** 2 / (whole * of_error)
    return left


def straight_sticks(highest: Sequence[float]) -> Sticks | None:
    """Return sticks that ask for rates in proportion, as behind a curve that is in the logged ones already.

    Parameters
    ----------
    highest : sequence of float
        Rate of the stick's end, by axis [deg/s].

    Returns
    -------
    Sticks or None
        None where one of them is no rate.
    """
    if not all(0.0 < one < 2.0**16 for one in highest):
        return None
    return Sticks(
        kind=_RACEFLIGHT,
        rates=tuple((0.1 * one, 0.0, 0.0) for one in highest),
        limits=(_FASTEST,) * 3,
        ends=(STICK_END,) * 3,
        slopes=(0.0,) * 3,
        cut=(False,) * 3,
        expo_in_factor=False,
    )


def straight_by_p(command: FloatArray, rate: FloatArray, p: FloatArray, rows: BoolArray) -> FloatArray | None:
    """Return what a unit of the stick asks for [unit of `rate`], by what P is made of both.

    Parameters
    ----------
    command, rate, p : ndarray, shape (n, 3)
        Logged sticks behind their curve of expo, the gyro, and the terms P.
    rows : ndarray of bool, shape (n,)
        In which sticks command rates.

    Returns
    -------
    ndarray, shape (3,), or None
        None where P is not a straight line of both on each axis, as it is not in modes that level.

    Notes
    -----
    Cleanflight of 2016, ``pid.c``: P is a gain times (a factor by the rates times the stick, minus the gyro),
    and the header holds neither.
    """
    found = []
    for axis in range(3):
        of_p = p[:, axis].astype(np.float64)
        used = rows & (np.abs(of_p) < _UNLIMITED * np.abs(of_p[rows]).max(initial=0.0))
        if np.count_nonzero(used) < _FEWEST_ROWS:
            return None
        both = np.column_stack([command[used, axis], rate[used, axis], np.ones(np.count_nonzero(used))])
        slopes, *_ = np.linalg.lstsq(both, of_p[used], rcond=None)
        rest, whole = float(np.var(of_p[used] - both @ slopes)), float(np.var(of_p[used]))
        if not (rest < _UNEXPLAINED * whole and slopes[0] > 0.0 > slopes[1]):
            return None
        found.append(-slopes[0] / slopes[1])
    return np.array(found)
