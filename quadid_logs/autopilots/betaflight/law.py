"""The law of Betaflight's rate loop: gains per unit, throttle attenuation, and the filters of P and D.

Source: ``pid.c``, ``pid_init.c`` and ``pid.h``. The log's own units are deg/s and thousandths of the mixer's
range; here they are rad/s and 1.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from functools import reduce
from operator import mul
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.betaflight.filters import D_LOW_PASSES, low_pass, static_notch
from quadid_logs.autopilots.discrete import derivative, first_order, notch, unit
from quadid_logs.autopilots.versions import finite
from quadid_logs.data.controller import DiscreteFilter
from quadid_logs.vocabulary import AXES

#: The gyro before its filters is in the fields of a debug mode, and then in one of its own.
GYRO_SCALED_SINCE: Final = (3, 4)
UNFILTERED_SINCE: Final = (4, 5)
#: The first version whose law counts in degrees per second.
OLDEST_LAW: Final = (3, 1)
#: PTERM_SCALE, ITERM_SCALE, DTERM_SCALE and FEEDFORWARD_SCALE, per deg/s and thousandth.
_SCALES: Final = (0.032029, 0.244381, 0.000529, 0.013754 * 0.01)
_UNIT: Final = math.degrees(1.0) * 1e-3
#: ``pid_init.c`` gives yaw's I so many times its scale, since 4.0.
_YAW_INTEGRAL: Final = 2.5
_YAW_INTEGRAL_SINCE: Final = (4, 0)
#: TPA_MODE_PD: P is attenuated like D.
_WITH_P: Final = 0.0
_STICK_LOW, _STICK_RANGE = 1000.0, 1000.0
#: The first version whose TPA goes by the throttle of the mixer.
_MIXER_THROTTLE_SINCE: Final = (4, 3)
#: Points of the curve from the stick to the throttle.
_CURVE_POINTS: Final = 201
#: pid[PID_LEVEL] is tenths of a rate per angle. Since 4.5 horizon mode fades the law of angle mode in, by
#: hundredths of I at most; before, I took P's place.
_LEVEL_UNIT: Final = 0.1
_DEFAULT_LEVEL, _DEFAULT_LIMIT_DEG = 50.0, 55.0
_HORIZON_FADES_SINCE: Final = (4, 5)
#: TASK_ATTITUDE at 100 Hz: what is held for its period is half of that old in the mean [s].
_ATTITUDE_AGE_S: Final = 0.005
#: ATTITUDE_CUTOFF_HZ of three equal poles, each by 1 / sqrt(2^(1/3) - 1) quicker, since 4.4.
_ANGLE_FILTER_SINCE: Final = (4, 4)
_ANGLE_FILTER_S: Final = 3.0 * (2.0 ** (1.0 / 3.0) - 1.0) ** 0.5 / (2.0 * math.pi * 50.0)
#: What the command line calls the entries of the header's lists, p_roll or d_max_yaw; feed-forward's list has
#: had its name since 4.3.
_LISTS: Final = (("d_min", "d_min"), ("d_max", "d_max"), ("f", "feedforward_weight"), ("f", "ff_weight"))


def angle_gain_per_s(
    settings: Mapping[str, float], modes: Collection[str], version: tuple[int, ...] | None = None
) -> float | None:
    """Return the gain from the angle of roll or pitch to its rate set-point, the largest of the modes flown.

    Parameters
    ----------
    modes : collection of str
        "Angle", "Horizon", or both. Horizon mode levels by less, the more the sticks ask for.
    version : tuple of int or None
        Of the firmware; None counts as a recent one.

    Returns
    -------
    float or None
        [1/s]; None where the header does not hold it.

    Notes
    -----
    ``pid.c``, `pidLevel` and `calcHorizonLevelStrength`; ``pid_init.c``.
    """
    in_angle, in_horizon = (finite(settings.get(f"levelPID[{place}]")) for place in (0, 1))
    if in_angle is None or in_horizon is None:
        return None
    fades = version is None or version >= _HORIZON_FADES_SINCE
    by_mode = {
        "Angle": in_angle,
        "Horizon": in_angle * min(0.01 * in_horizon, 1.0) if fades else in_horizon,
    }
    return _LEVEL_UNIT * max(by_mode[mode] for mode in modes)


def full_stick_rad_s(settings: Mapping[str, float]) -> float:
    """Return the rate set-point of roll or pitch that a full stick makes of a level copter in angle mode.

    Parameters
    ----------
    settings : mapping of str to float
        The header's; headers before 4.5 do not hold the limit.

    Returns
    -------
    float
        [rad/s].

    Notes
    -----
    ``pid.c``, `pidLevel`: the gain times the angle that the stick asks for. Defaults are those of
    ``resetPidProfile``: 50 of ``levelPID``, 55 degrees before 4.5 and 60 since.
    """
    gain = finite(settings.get("levelPID[0]"))
    limit_deg = finite(settings.get("angle_limit"))
    gain_per_s = _LEVEL_UNIT * (_DEFAULT_LEVEL if gain is None else gain)
    return gain_per_s * math.radians(_DEFAULT_LIMIT_DEG if limit_deg is None else limit_deg)


def angle_delay_s(version: tuple[int, ...] | None = None) -> float:
    """Return how old the angle is that a rate set-point is made of, its smoothing included.

    Returns
    -------
    float
        [s]
    """
    smoothed = version is None or version >= _ANGLE_FILTER_SINCE
    return _ATTITUDE_AGE_S + (_ANGLE_FILTER_S if smoothed else 0.0)


def named_gains(settings: Mapping[str, float]) -> dict[str, float]:
    """Return the gains of a header by the names that they have on the command line.

    Parameters
    ----------
    settings : mapping of str to float
        Lists by name and place: ``rollPID[0]``, ``d_max[1]``.

    Returns
    -------
    dict of str to float
        ``p_roll``, ``i_roll``, ``d_roll``, ``d_min_roll``, ``d_max_roll``, ``f_roll``; those that are there.
    """
    places = {f"{short}_{axis}": f"{axis}PID[{place}]" for place, short in enumerate("pid") for axis in AXES}
    found = {name: settings[place] for name, place in places.items() if place in settings}
    for short, of_header in _LISTS:
        listed = {f"{short}_{axis}": f"{of_header}[{k}]" for k, axis in enumerate(AXES)}
        found |= {name: settings[place] for name, place in listed.items() if place in settings}
    return found


class RateGains(NamedTuple):
    """Gains of one axis: command [1] per rad/s, per rad, per rad/s^2 twice, and per rad/s^2.

    D lies between ``derivative`` and ``most_derivative``, and moves up while stick or vehicle do.
    """

    proportional: float
    integral: float
    derivative: float
    most_derivative: float
    feed_forward: float

    def between(self, part: float) -> float:
        """Return D so far on its way from the lower to the higher one, from 0 to 1."""
        return self.derivative + part * (self.most_derivative - self.derivative)


def rate_gains(settings: Mapping[str, float], axis: str, version: tuple[int, ...] | None = None) -> RateGains:
    """Return the gains of one axis.

    Parameters
    ----------
    settings : mapping of str to float
        By the names of `named_gains`.
    version : tuple of int or None
        Of the firmware; None for a recent one.

    Raises
    ------
    KeyError
        If P, I or D is missing.
    """
    p, i, d = (settings[f"{short}_{axis}"] for short in "pid")
    # Up to 4.5 the header holds the higher of both D and d_min beside it, since 2025.12 the lower and d_max.
    low = settings.get(f"d_min_{axis}", 0.0)
    least = low if 0.0 < low < d else d
    most = max(settings.get(f"d_max_{axis}", 0.0), d) if d > 0.0 else 0.0
    recent = version is None or version >= _YAW_INTEGRAL_SINCE
    factor = _YAW_INTEGRAL if axis == "yaw" and recent else 1.0
    forward = finite(settings.get(f"f_{axis}")) or 0.0
    of_p, of_i, of_d, of_f = (scale * _UNIT for scale in _SCALES)
    return RateGains(of_p * p, of_i * factor * i, of_d * least, of_d * most, of_f * forward)


def attenuation(
    settings: Mapping[str, float], throttle: FloatArray | float, version: tuple[int, ...] | None = None
) -> FloatArray:
    """Return the factor on D by the throttle (TPA).

    Parameters
    ----------
    throttle : ndarray or float
        Of the mixer, from 0 to 1.
    version : tuple of int or None
        Of the firmware; None counts as a recent one.

    Returns
    -------
    ndarray, same shape
    """
    begin = (settings.get("tpa_breakpoint", 2000.0) - _STICK_LOW) / _STICK_RANGE
    rate = min(max(settings.get("tpa_rate", 0.0) / 100.0, 0.0), 1.0)
    if not 0.0 <= begin < 1.0 or settings.get("tpa_curve_type", 0.0) != 0.0:
        return np.ones_like(np.asarray(throttle, dtype=np.float64))
    throttle = throttle_stick(settings, np.asarray(throttle, dtype=np.float64), version)
    return np.asarray(1.0 - rate * np.clip((throttle - begin) / (1.0 - begin), 0.0, 1.0))


def throttle_stick(
    settings: Mapping[str, float], throttle: FloatArray, version: tuple[int, ...] | None
) -> FloatArray:
    """Return the throttle that TPA goes by: since 4.3 the mixer's own, before that of the stick.

    Parameters
    ----------
    throttle : ndarray
        Of the mixer, from 0 to 1.
    version : tuple of int or None
        Of the firmware; None counts as a recent one.

    Returns
    -------
    ndarray, same shape
        From 0 to 1.

    Notes
    -----
    ``fc_rc.c``, `updateRcCommands` and `generateThrottleCurve`: ``thr_mid`` and ``thr_expo`` bend the stick's
    way to the mixer.
    """
    middle, bend = settings.get("thr_mid", 50.0) / 100.0, settings.get("thr_expo", 0.0) / 100.0
    recent = version is None or version >= _MIXER_THROTTLE_SINCE
    if recent or not (0.0 < middle < 1.0 and 0.0 <= bend <= 1.0):
        return throttle
    stick = np.linspace(0.0, 1.0, _CURVE_POINTS)
    off = stick - middle
    part = off / np.where(off > 0.0, 1.0 - middle, middle)
    return np.asarray(np.interp(throttle, middle + off * (1.0 - bend + bend * part**2), stick))


def derives_set_points(settings: Mapping[str, float]) -> bool:
    """Tell whether the logged D holds the slope of the set-points too, as it could before 3.5."""
    return settings.get("dterm_setpoint_weight", 0.0) > 0.0


def attenuates_p(settings: Mapping[str, float]) -> bool:
    """Tell whether P is attenuated with D."""
    return settings.get("tpa_mode") == _WITH_P


def p_filter(settings: Mapping[str, float], axis: str, loop_s: float) -> DiscreteFilter:
    """Return the filter behind P: yaw's low-pass."""
    cutoff_hz = finite(settings.get("yaw_lowpass_hz")) or 0.0
    return first_order(cutoff_hz, loop_s) if axis == "yaw" else unit(loop_s)


def d_filter(settings: Mapping[str, float], throttle: float, loop_s: float) -> DiscreteFilter:
    """Return the filters from the body rate to the slope that D acts on.

    Parameters
    ----------
    throttle : float
        By which the first low-pass moves.
    """
    return reduce(mul, d_filters(settings, throttle, loop_s).values(), derivative(loop_s))


def d_filters(settings: Mapping[str, float], throttle: float, loop_s: float) -> dict[str, DiscreteFilter]:
    """Return the filters on D's slope by their settings; parameters as of `d_filter`."""
    notches = static_notch(settings, "dterm_notch_hz", "dterm_notch_cutoff")
    found = {"dterm_notch_hz": [notch(one, loop_s) for one in notches if one.frequency_hz * loop_s < 0.5]}
    for names in D_LOW_PASSES:
        found[names.static] = [*low_pass(settings, names, throttle, loop_s)]
    return {name: reduce(mul, chain) for name, chain in found.items() if chain}


def loop_period_us(settings: Mapping[str, float]) -> float:
    """Return the PID loop's period as set [us], `looptime` of the gyro times `pid_process_denom`; or NaN."""
    return settings.get("looptime", math.nan) * settings.get("pid_process_denom", 1.0)


def loop_period_s(settings: Mapping[str, float]) -> float:
    """Return the period of the PID loop [s], NaN where none is set that a loop can have."""
    period_us = loop_period_us(settings)
    return 1e-6 * period_us if 0.0 < period_us < 1e5 else math.nan
