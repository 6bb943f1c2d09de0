"""Betaflight's gyro filters from its settings, as far as they delay what is fitted."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import reduce
from operator import mul
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.discrete import butterworth, first_order, gyro_filter, notches_named, standing
from quadid_logs.data.controller import DiscreteFilter, FilterPlace, NamedFilter
from quadid_logs.data.log import GyroFilter, Notch, whole_number

#: `gyro_lpf1_type`: one pole, a Butterworth of second order, two and three poles that are 3 dB down together.
_ONE_POLE, _BIQUAD, _TWO_POLES, _THREE_POLES = range(4)
#: ``common/filter.c``: cut-off of each pole over that of all.
_SPREAD = {_ONE_POLE: 1.0, _TWO_POLES: 1.553773974, _THREE_POLES: 1.961459177}
_N_POLES = {_ONE_POLE: 1, _TWO_POLES: 2, _THREE_POLES: 3}


class LowPassNames(NamedTuple):
    """The settings of a low-pass: its type, cut-off, and the range and bend that the throttle moves it in."""

    kind: str
    static: str
    dynamic: str = ""
    expo: str = ""


#: As called since 4.3, and before. The first D low-pass of 4.2 has a bend that no header tells.
GYRO_LOW_PASSES = (
    LowPassNames("gyro_lpf1_type", "gyro_lpf1_static_hz", "gyro_lpf1_dyn_hz", "gyro_lpf1_dyn_expo"),
    LowPassNames("gyro_lpf2_type", "gyro_lpf2_static_hz"),
    LowPassNames("gyro_lowpass_type", "gyro_lowpass_hz", "gyro_lowpass_dyn_hz"),
    LowPassNames("gyro_lowpass2_type", "gyro_lowpass2_hz"),
)
D_LOW_PASSES = (
    LowPassNames("dterm_lpf1_type", "dterm_lpf1_static_hz", "dterm_lpf1_dyn_hz", "dterm_lpf1_dyn_expo"),
    LowPassNames("dterm_lpf2_type", "dterm_lpf2_static_hz"),
    LowPassNames("dterm_filter_type", "dterm_lowpass_hz", "dterm_lowpass_dyn_hz", "dyn_lpf_dterm_curve_expo"),
    LowPassNames("dterm_filter2_type", "dterm_lowpass2_hz"),
)
#: The bend of versions whose header does not hold it: 4.2 to 4.4.
_COMMON_BEND = 5.0
#: ``config/feature.h``: FEATURE_DYNAMIC_FILTER, before 4.3.
_DYNAMIC_FILTER = 1 << 29
#: Motion, not the vibration that the filters are there for; of so many seconds.
_DELAY_BAND_HZ = (0.5, 20.0)
_SHORTEST_S = 4.0
#: Some minutes tell a delay to microseconds.
_MOST_ROWS = 1 << 17
#: Filters that delay for longer cannot be flown at the gains that vehicles of this kind have.
_LONGEST_S = 0.03


def settings_filter(settings: Mapping[str, float], rotors_hz: Sequence[float]) -> GyroFilter:
    """Return both low-passes as one of the same delay, and static and RPM notches.

    Parameters
    ----------
    rotors_hz : sequence of float
        Mean speed of each rotor, at which the RPM filter's notches stand; none where they are not logged.

    Returns
    -------
    GyroFilter
        Far below their cut-offs the low-passes are delays, which add up; one of second order with cut-off f
        delays by sqrt(2) / (2 pi f).

    Notes
    -----
    Betaflight: ``gyro_init.c``, ``rpm_filter.c``, ``common/filter.c``.
    """
    delay_s = sum(_delay_s(settings, names) for names in GYRO_LOW_PASSES)
    cutoff_hz = math.sqrt(2.0) / (2.0 * math.pi * delay_s) if delay_s > 0.0 else math.nan
    return gyro_filter(cutoff_hz, [*_static(settings), *_rpm(settings, rotors_hz)])


def _delay_s(settings: Mapping[str, float], names: LowPassNames) -> float:
    """Return the delay of a low-pass far below its cut-off; of a dynamic one at its lowest."""
    cutoff = cutoff_hz(settings, names, 0.0)
    if cutoff == 0.0:
        return 0.0
    poles = _poles(settings, names)
    if poles == _BIQUAD:
        return math.sqrt(2.0) / (2.0 * math.pi * cutoff)
    return _N_POLES[poles] / (2.0 * math.pi * cutoff * _SPREAD[poles])


def _poles(settings: Mapping[str, float], names: LowPassNames) -> int:
    kind = settings.get(names.kind, _ONE_POLE)
    return int(kind) if kind in (*_SPREAD, _BIQUAD) else _ONE_POLE


def cutoff_hz(settings: Mapping[str, float], names: LowPassNames, throttle: float) -> float:
    """Return the cut-off of a low-pass [Hz], 0 where it is off.

    Parameters
    ----------
    throttle : float
        From 0 to 1, by which a dynamic one moves between its ends.

    Notes
    -----
    Betaflight: ``dynLpfCutoffFreq``; a gyro's before 4.3 ``dynThrottle``.
    """
    lowest, highest = (settings.get(f"{names.dynamic}[{end}]", 0.0) for end in (0, 1))
    if not lowest > 0.0:
        found = settings.get(names.static, 0.0)
    elif names.expo:
        bend = throttle * (1.0 - throttle) * settings.get(names.expo, _COMMON_BEND) / 10.0
        found = lowest + max(highest - lowest, 0.0) * (throttle + bend)
    else:
        found = max(1.5 * throttle * (1.0 - throttle**2 / 3.0) * highest, lowest)
    return found if 0.0 < found < math.inf else 0.0


def low_pass(
    settings: Mapping[str, float], names: LowPassNames, throttle: float, period_s: float
) -> tuple[DiscreteFilter, ...]:
    """Return a low-pass as it runs at a throttle; none where it is off.

    Parameters
    ----------
    settings, names, throttle
        As of `cutoff_hz`.

    Notes
    -----
    Betaflight: ``pt1FilterGain``, ``pt2FilterGain``, ``pt3FilterGain``, ``biquadFilterInitLPF``.
    """
    cutoff, poles = cutoff_hz(settings, names, throttle), _poles(settings, names)
    if cutoff == 0.0:
        return ()
    if poles == _BIQUAD:
        return (butterworth(cutoff, period_s),)
    return (first_order(cutoff * _SPREAD[poles], period_s),) * _N_POLES[poles]


def static_notch(settings: Mapping[str, float], centre: str, begin: str) -> tuple[Notch, ...]:
    """Return a notch by its centre and where it begins, which make Q = f0 fc / (f0^2 - fc^2)."""
    f0, fc = settings.get(centre, 0.0), settings.get(begin, 0.0)
    return (Notch(f0, (f0**2 - fc**2) / (f0 * fc), 0.0),) if 0.0 < fc < f0 < math.inf else ()


def loop_filters(
    settings: Mapping[str, float],
    rotors_hz: Sequence[float],
    throttle: float,
    periods_s: tuple[float, float],
) -> tuple[DiscreteFilter, ...]:
    """Return what stands between gyro and controller, as it was on the average of a flight.

    Parameters
    ----------
    rotors_hz : sequence of float
        Mean speed of each rotor; none where they are not logged.
    throttle : float
        The mean, from 0 to 1.
    periods_s : tuple of float
        Of the gyro and of the PID loop [s].

    Returns
    -------
    tuple of DiscreteFilter
        The second low-pass runs at the gyro's rate, all else at the loop's. Dynamic notches are not among
        them: no log tells where they stood.

    Notes
    -----
    Betaflight: ``gyro_filter_impl.c``, ``rpm_filter.c``.
    """
    found = [
        each
        for names in GYRO_LOW_PASSES
        for each in low_pass(settings, names, throttle, _period_s(names, periods_s))
    ]
    known = gyro_filter(math.nan, [*_static(settings), *_rpm(settings, rotors_hz)]).notches
    return (*found, *standing(known, periods_s[1]))


def _period_s(names: LowPassNames, periods_s: tuple[float, float]) -> float:
    """Return the period of a low-pass, of those of gyro and loop: the second one runs with the gyro."""
    return periods_s[0] if "2" in names.kind else periods_s[1]


def named_gyro_filters(
    settings: Mapping[str, float],
    rotors_hz: Sequence[float],
    throttle: float,
    periods_s: tuple[float, float],
) -> Iterator[NamedFilter]:
    """Yield the filters of `loop_filters` by their settings; parameters as there."""
    for names in GYRO_LOW_PASSES:
        chain = low_pass(settings, names, throttle, _period_s(names, periods_s))
        if chain:
            yield NamedFilter(name=names.static, place=FilterPlace.GYRO, filter=reduce(mul, chain))
    for name, notches in (
        ("gyro_notch", tuple(_static(settings))),
        ("rpm_filter_harmonics", tuple(_rpm(settings, rotors_hz))),
    ):
        for places in gyro_filter(math.nan, (), [(notches,)]).tracked:
            yield notches_named(name, places, periods_s[1])


def has_dynamic_notches(settings: Mapping[str, float]) -> bool:
    """Tell whether notches follow peaks of the gyro's spectrum (dyn_notch_count, once a feature)."""
    count = settings.get("dyn_notch_count")
    if count is not None:
        return count > 0.0
    return "dyn_notch_q" in settings and bool(whole_number(settings.get("features")) & _DYNAMIC_FILTER)


def has_rpm_notches(settings: Mapping[str, float]) -> bool:
    """Tell whether notches follow the rotors' speeds, by the settings' names since 4.3 or before."""
    harmonics = settings.get("rpm_filter_harmonics", settings.get("gyro_rpm_notch_harmonics", 0.0))
    return harmonics > 0.0 and settings.get("dshot_bidir", 0.0) > 0.0


def _static(settings: Mapping[str, float]) -> Iterator[Notch]:
    """Yield gyro_notch1 and 2."""
    for number in range(2):
        yield from static_notch(settings, f"gyro_notch_hz[{number}]", f"gyro_notch_cutoff[{number}]")


def _rpm(settings: Mapping[str, float], rotors_hz: Sequence[float]) -> Iterator[Notch]:
    """Yield a notch per rotor and harmonic; close to the lowest frequency they fade out."""
    quality = settings.get("rpm_filter_q", 0.0) / 100.0
    lowest_hz = settings.get("rpm_filter_min_hz", 0.0)
    harmonics = settings.get("rpm_filter_harmonics", 0.0)
    if not (quality > 0.0 and 1.0 <= harmonics <= 3.0):
        return
    fade_hz = settings.get("rpm_filter_fade_range_hz", 0.0)
    for harmonic in range(1, int(harmonics) + 1):
        weight = min(max(settings.get(f"rpm_filter_weights[{harmonic - 1}]", 100.0) / 100.0, 0.0), 1.0)
        for rotor_hz in (one for one in rotors_hz if one > 0.0):
            above_hz = harmonic * rotor_hz - lowest_hz
            faded = weight * min(max(above_hz / fade_hz, 0.0), 1.0) if fade_hz > 0.0 else weight
            yield Notch(lowest_hz + max(above_hz, 0.0), 1.0 / quality, 1.0 - faded)


def measured_filter(filtered: FloatArray, unfiltered: FloatArray, period_s: float) -> GyroFilter | None:
    """Return a low-pass with the delay of all filters, where the gyro is logged before them too.

    Parameters
    ----------
    filtered, unfiltered : ndarray, shape (n_rows, n_axes)
        Rates of the same rows, in the same unit.

    Returns
    -------
    GyroFilter or None
        None where the delay is not positive, or the rows are too few to tell.

    Notes
    -----
    The slope of the cross spectrum's phase, weighted by its size: J. S. Bendat and A. G. Piersol, *Random
    Data*, section 5.2.7. Dynamic notches, whose centres no log tells, are in it.
    """
    if not (period_s > 0.0 and len(filtered) * period_s > _SHORTEST_S):
        return None
    middle = slice(max(len(filtered) - _MOST_ROWS, 0) // 2, (len(filtered) + _MOST_ROWS) // 2)
    filtered, unfiltered = (each[middle].astype(np.float64) for each in (filtered, unfiltered))
    frequency_hz = np.fft.rfftfreq(len(filtered), period_s)
    band = (frequency_hz >= _DELAY_BAND_HZ[0]) & (frequency_hz <= _DELAY_BAND_HZ[1])
    first, second = (np.fft.rfft(each - each.mean(axis=0), axis=0)[band] for each in (unfiltered, filtered))
    cross = np.conj(first) * second
    omega = 2.0 * np.pi * frequency_hz[band][:, np.newaxis]
    weight = np.abs(cross)
    total = float(np.sum(weight * omega**2))
    delay_s = -float(np.sum(weight * omega * np.angle(cross))) / total if total > 0.0 else 0.0
    if not 0.0 < delay_s < _LONGEST_S:
        return None
    return gyro_filter(math.sqrt(2.0) / (2.0 * math.pi * delay_s), ())
