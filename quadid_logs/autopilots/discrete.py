"""The filters of gyros and controllers: which ones parameters tell, and how the code runs them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import Final

import numpy as np

from quadid_logs.data.controller import DiscreteFilter, Filter, FilterPlace, MeanFilter, NamedFilter
from quadid_logs.data.log import GyroFilter, Notch, Places

#: A notch below is no vibration's, and one above moves nothing that is fitted.
_RANGE_HZ: Final = (5.0, 2000.0)
#: One narrower than this fraction of its frequency delays what is slower by less than a microsecond.
_LEAST_INVERSE_Q: Final = 1e-6


def unit(period_s: float) -> DiscreteFilter:
    """Return the filter that changes nothing."""
    return gain(1.0, period_s)


def gain(value: float, period_s: float) -> DiscreteFilter:
    """Return a factor as a filter."""
    return _of((value,), (1.0,), period_s)


def first_order(cutoff_hz: float, period_s: float) -> DiscreteFilter:
    """Return y += alpha (x - y) with alpha = T / (T + 1 / (2 pi f)).

    Parameters
    ----------
    cutoff_hz : float
        What is not positive switches the filter off.

    Notes
    -----
    ArduPilot: AP_Math.cpp, calc_lowpass_alpha_dt; PX4: AlphaFilter.hpp.
    """
    if not cutoff_hz > 0.0:
        return unit(period_s)
    alpha = period_s / (period_s + 1.0 / (2.0 * math.pi * cutoff_hz))
    return _of((alpha,), (1.0, alpha - 1.0), period_s)


def integrator(period_s: float, *, late: bool = False) -> DiscreteFilter:
    """Return the sum of x T; without the present x where `late`."""
    return _of((0.0, period_s) if late else (period_s,), (1.0, -1.0), period_s)


def derivative(period_s: float) -> DiscreteFilter:
    """Return (x - x_before) / T."""
    return _of((1.0 / period_s, -1.0 / period_s), (1.0,), period_s)


def butterworth(cutoff_hz: float, period_s: float) -> DiscreteFilter:
    """Return a low-pass of second order by the bilinear transform, exact at its cut-off.

    Parameters
    ----------
    cutoff_hz : float
        At most 0.4 of the sample rate is used.

    Notes
    -----
    LowPassFilter2p.cpp of both autopilots.
    """
    o = math.tan(math.pi * min(cutoff_hz * period_s, 0.4))
    c = 1.0 + math.sqrt(2.0) * o + o * o
    b = o * o / c
    a = (1.0, 2.0 * (o * o - 1.0) / c, (1.0 - math.sqrt(2.0) * o + o * o) / c)
    return _of((b, 2.0 * b, b), a, period_s)


def notch(wanted: Notch, period_s: float) -> DiscreteFilter:
    """Return a notch of second order.

    Notes
    -----
    NotchFilter.cpp of ArduPilot, with A^2 the gain at the centre; with 0 that of PX4.
    """
    w = 2.0 * math.pi * wanted.frequency_hz * period_s
    alpha = 0.5 * math.sin(w) * wanted.inverse_q
    scale, middle = 1.0 / (1.0 + alpha), -2.0 * math.cos(w)
    depth = wanted.depth
    return _of(
        ((1.0 + alpha * depth) * scale, middle * scale, (1.0 - alpha * depth) * scale),
        (1.0, middle * scale, (1.0 - alpha) * scale),
        period_s,
    )


def gyro_filter(low_pass_hz: float, notches: Iterable[Notch], tracked: Iterable[Places] = ()) -> GyroFilter:
    """Return the filters that change anything.

    Parameters
    ----------
    low_pass_hz : float
        Cut-off of a low-pass of second order; what is not positive and finite counts as none.
    notches : iterable of Notch
        Of any numbers: parameters hold NaN, infinities and negative widths.
    tracked : iterable of Places
        Groups of notches that moved, of any numbers too.
    """

    def felt(of_parameters: Iterable[Notch]) -> tuple[Notch, ...]:
        return tuple(
            one
            for one in of_parameters
            if _RANGE_HZ[0] <= one.frequency_hz <= _RANGE_HZ[1]
            and _LEAST_INVERSE_Q <= one.inverse_q < math.inf
            and one.depth < 1.0
        )

    groups = (tuple(map(felt, instants)) for instants in tracked)
    return GyroFilter(
        float(low_pass_hz) if 0.0 < low_pass_hz < math.inf else math.nan,
        felt(notches),
        tuple(instants for instants in groups if any(instants)),
    )


def gyro_filters(known: GyroFilter, period_s: float) -> tuple[Filter, ...]:
    """Return the filters between a gyro and the controller.

    Parameters
    ----------
    period_s : float
        Of the gyro [s]; a notch above half of its rate is none.
    """
    tracked = [moving(instants, period_s) for instants in known.tracked]
    low_pass = [butterworth(known.low_pass_hz, period_s)] if known.low_pass_hz > 0.0 else []
    return (*standing(known.notches, period_s), *tracked, *low_pass)


def standing(notches: Iterable[Notch], period_s: float) -> tuple[DiscreteFilter, ...]:
    """Return notches that do not move; one above half of the sample rate is none."""
    return tuple(notch(one, period_s) for one in notches if one.frequency_hz * period_s < 0.5)


@lru_cache(maxsize=8)
def moving(instants: Places, period_s: float) -> MeanFilter:
    """Return notches that moved; of the same ones the same filter, which remembers its response."""
    return MeanFilter(tuple(standing(each, period_s) for each in instants))


def notches_named(name: str, places: Places, period_s: float) -> NamedFilter:
    """Return a group of notches of the gyro by its name.

    Parameters
    ----------
    places : Places
        One instant for notches that did not move.
    period_s : float
        Of the gyro [s].
    """
    lowest_hz = np.array([min((one.frequency_hz for one in each), default=math.nan) for each in places])
    known = lowest_hz[np.isfinite(lowest_hz)]
    middle_hz = float(np.median(known)) if known.size else math.nan
    speed = np.where(np.isfinite(lowest_hz), lowest_hz / middle_hz, 1.0)
    return NamedFilter(
        name=name,
        place=FilterPlace.GYRO,
        filter=moving(places, period_s),
        speed=tuple(speed.tolist()) if len(places) > 1 else (),
        centre_hz=(float(known.min()), middle_hz, float(known.max())) if known.size else (),
    )


def _of(numerator: tuple[float, ...], denominator: tuple[float, ...], period_s: float) -> DiscreteFilter:
    return DiscreteFilter(numerator, denominator, period_s)  # type: ignore[arg-type]
