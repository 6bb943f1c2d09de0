"""Betaflight's gyro filters from its settings, as far as they delay what is fitted."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.filters import gyro_filter
from quadid_logs.data.log import GyroFilter, Notch

#: `gyro_lpf1_type`: one pole, a Butterworth of second order, two and three poles that are 3 dB down together.
_ONE_POLE, _BIQUAD, _TWO_POLES, _THREE_POLES = range(4)
#: ``common/filter.c``: cut-off of each pole over that of all.
_SPREAD = {_ONE_POLE: 1.0, _TWO_POLES: 1.553773974, _THREE_POLES: 1.961459177}
_N_POLES = {_ONE_POLE: 1, _TWO_POLES: 2, _THREE_POLES: 3}
#: Type, cut-off and range of the two low-passes, as called since 4.3 and before.
_LOW_PASSES = (
    ("gyro_lpf1_type", "gyro_lpf1_static_hz", "gyro_lpf1_dyn_hz"),
    ("gyro_lpf2_type", "gyro_lpf2_static_hz", "gyro_lpf2_dyn_hz"),
    ("gyro_lowpass_type", "gyro_lowpass_hz", "gyro_lowpass_dyn_hz"),
    ("gyro_lowpass2_type", "gyro_lowpass2_hz", "gyro_lowpass2_dyn_hz"),
)
#: Motion, not the vibration that the filters are there for; of so many seconds.
_DELAY_BAND_HZ = (0.5, 20.0)
_SHORTEST_S = 4.0
#: Some minutes tell a delay to microseconds.
_MOST_ROWS = 1 << 17
#: Filters that delay for longer cannot be flown at the gains that vehicles of this kind have.
_LONGEST_S = 0.03


def settings_filter(settings: Mapping[str, float], rotor_hz: float) -> GyroFilter:
    """Return both low-passes as one of the same delay, and static and RPM notches.

    Parameters
    ----------
    settings : mapping of str to float
        Of the log's header.
    rotor_hz : float
        Mean speed of the rotors, at which the RPM filter's notches stand; NaN where it is not logged.

    Returns
    -------
    GyroFilter
        Far below their cut-offs the low-passes are delays, which add up; one of second order with cut-off f
        delays by sqrt(2) / (2 pi f).

    Notes
    -----
    Betaflight: ``gyro_init.c``, ``rpm_filter.c``, ``common/filter.c``.
    """
    delay_s = sum(_delay_s(settings, names) for names in _LOW_PASSES)
    cutoff_hz = math.sqrt(2.0) / (2.0 * math.pi * delay_s) if delay_s > 0.0 else math.nan
    return gyro_filter(cutoff_hz, [*_static(settings), *_rpm(settings, rotor_hz)])


def _delay_s(settings: Mapping[str, float], names: tuple[str, str, str]) -> float:
    """Return the delay of a low-pass far below its cut-off; of a dynamic one at its lowest."""
    kind_name, static_name, dynamic_name = names
    dynamic = settings.get(f"{dynamic_name}[0]", 0.0)
    cutoff_hz = dynamic if dynamic > 0.0 else settings.get(static_name, 0.0)
    kind = settings.get(kind_name, _ONE_POLE)
    if not 0.0 < cutoff_hz < math.inf:
        return 0.0
    if kind == _BIQUAD:
        return math.sqrt(2.0) / (2.0 * math.pi * cutoff_hz)
    poles = int(kind) if kind in _SPREAD else _ONE_POLE
    return _N_POLES[poles] / (2.0 * math.pi * cutoff_hz * _SPREAD[poles])


def _static(settings: Mapping[str, float]) -> Iterator[Notch]:
    """Yield gyro_notch1 and 2: Q = f0 fc / (f0^2 - fc^2), fc where it begins."""
    for number in range(2):
        centre = settings.get(f"gyro_notch_hz[{number}]", 0.0)
        begin = settings.get(f"gyro_notch_cutoff[{number}]", 0.0)
        if 0.0 < begin < centre:
            yield Notch(centre, (centre**2 - begin**2) / (centre * begin), 0.0)


def _rpm(settings: Mapping[str, float], rotor_hz: float) -> Iterator[Notch]:
    """Yield a notch per motor and harmonic."""
    quality = settings.get("rpm_filter_q", 0.0) / 100.0
    lowest_hz = settings.get("rpm_filter_min_hz", 0.0)
    harmonics = settings.get("rpm_filter_harmonics", 0.0)
    if not (rotor_hz > 0.0 and quality > 0.0 and 1.0 <= harmonics <= 3.0):
        return
    for harmonic in range(1, int(harmonics) + 1):
        weight = min(max(settings.get(f"rpm_filter_weights[{harmonic - 1}]", 100.0) / 100.0, 0.0), 1.0)
        for _ in range(4):
            yield Notch(max(harmonic * rotor_hz, lowest_hz), 1.0 / quality, 1.0 - weight)


def measured_filter(filtered: FloatArray, unfiltered: FloatArray, period_s: float) -> GyroFilter | None:
    """Return a low-pass with the delay of all filters, where the gyro is logged before them too.

    Parameters
    ----------
    filtered, unfiltered : ndarray, shape (n_rows, n_axes)
        Rates of the same rows, in the same unit.
    period_s : float

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
