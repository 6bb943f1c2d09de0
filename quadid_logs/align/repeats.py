"""What flights that repeat one trajectory have in common: what was commanded of each of them.

A mission, a script or an offboard computer flies the same trajectory again and again. What moves the vehicle
in the same way each time was commanded; what the air does is another in each flight. So the torque of the
other flights, aligned in time and averaged, is an instrument for this one that no gust of this one is in.
The moments of the speed are the same each time as well, so that it has to be known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.flight import FlightData
from quadid_logs.maths.normal import MEDIAN_DEVIATION
from quadid_logs.maths.spectra import WINDOW_S

#: One-sided 0.1 % of a normal distribution: chance that a flight of another trajectory is taken for this one.
_LEVEL_01 = 3.090232
#: By how much tilt and rates of two flights in disturbed air may misplace one beside the other [s].
_SEARCH_S = 0.3
#: Of the first comparison of all flights with all others, which is refined: frames turn at some hertz [s].
_COARSE_S = 0.05
#: Of the shorter flight: less than half of it beside the other one is no repeat of a trajectory.
_LEAST_OVERLAP = 0.5
#: Motion beyond so many standard deviations (a landing, a crash) counts as much as that, and no more.
_MOST_DEVIATIONS = 3.0
#: A vehicle that turns, for a second, so many times as much as it does in half of its flight has crashed.
_CRASHED = 10.0
_CRASH_S = 1.0
#: Rates of one flight that was logged twice are the same but for resampling; the air of two flights is not.
_SAME_FLIGHT = 0.99
#: Of the time from its first sample to its last: a log with longer pauses holds several flights.
_LEAST_FLOWN = 0.5
_ITERATIONS = 3
_AXES: Final = 3


class _Flown(NamedTuple):
    """A flight, or the mean of some, on one grid, in robust deviations; zero where nothing flew.

    ``motion`` (n_samples, 5) are rates and tilt, ``torque`` is (n_samples, 3).
    """

    motion: FloatArray
    torque: FloatArray
    known: BoolArray


def with_common_commands(flights: Sequence[FlightData]) -> list[FlightData]:
    """Return flights with what those that repeat one trajectory have in common as what was commanded.

    Parameters
    ----------
    flights : sequence of FlightData
        Of one sample period, none of them a copy of another.

    Returns
    -------
    list of FlightData
        With `Segment.command` (torque of the other flights, in its standard deviations) where at least one
        other flight repeats the trajectory; as they are where any log tells what was commanded, or has no
        velocity: of two flown Crazyflies the moments of the speed made the pitch effectiveness a quarter low.
    """
    found = [*flights]
    segments = [segment for flight in flights for segment in flight.segments]
    if any(each.command is not None or each.velocity_m_s is None for each in segments):
        return found
    period_s = next((flight.sample_period_s for flight in flights if flight.segments), 1.0)
    left = {place: _flown(flight) for place, flight in enumerate(flights) if _is_one_flight(flight)}
    while len(left) > 1 and (starts := _starts(left, period_s)):
        for place, start in starts.items():
            others, first = _mean_of_others(left, starts, place)
            found[place] = _with_command(flights[place], others, start - first)
        left = {place: flown for place, flown in left.items() if place not in starts}
    return found


def _is_one_flight(flight: FlightData) -> bool:
    """Say whether it lasts for two blocks, most of which are flown."""
    if not flight.segments:
        return False
    lasts_s = flight.segments[-1].end_s - flight.segments[0].start_s
    flown_s = sum(each.n_samples for each in flight.segments) * flight.sample_period_s
    return bool(flown_s >= max(2.0 * WINDOW_S, _LEAST_FLOWN * lasts_s))


def _flown(flight: FlightData) -> _Flown:
    """Put the segments of a flight on one grid."""
    rows = _rows(flight)
    known = np.zeros(int(rows[-1][-1]) + 1, dtype=np.bool_)
    motion, torque = np.zeros((known.size, _AXES + 2)), np.zeros((known.size, _AXES))
    for at, segment in zip(rows, flight.segments, strict=True):
        known[at], motion[at, :_AXES], torque[at] = True, segment.body_rate_rad_s, segment.torque
        if segment.attitude_rad is not None:
            motion[at, _AXES:] = segment.attitude_rad[:, :2]
    return _Flown(_limited(motion, known), _limited(torque, known), known)


def _rows(flight: FlightData) -> list[IntArray]:
    """Return where the samples of each segment are on one grid."""
    start_s, period_s = flight.segments[0].start_s, flight.sample_period_s
    return [
        round((segment.start_s - start_s) / period_s) + np.arange(segment.n_samples)
        for segment in flight.segments
    ]


def _limited(values: FloatArray, known: BoolArray) -> FloatArray:
    """Return what departs from the median, in robust standard deviations, limited; zero where not known."""
    away = values - np.median(values[known], axis=0)
    deviation = np.median(np.abs(away[known]), axis=0) / MEDIAN_DEVIATION
    scaled = np.divide(away, deviation, out=np.zeros_like(away), where=deviation > 0.0)
    scaled[~known] = 0.0
    return np.asarray(np.clip(scaled, -_MOST_DEVIATIONS, _MOST_DEVIATIONS))


def _starts(flown: Mapping[int, _Flown], period_s: float) -> dict[int, int]:
    """Return at which sample of a common grid each flight begins that repeats the most typical trajectory.

    Empty where no two do.
    """
    starts = _beside_typical(flown, period_s)
    while len(starts) > 1:
        for _ in range(_ITERATIONS):
            starts = {place: _beside_others(flown, starts, place, period_s) for place in starts}
        alike = {place: start for place, start in starts.items() if _is_alike(flown, starts, place, period_s)}
        if len(alike) == len(starts):
            return starts
        starts = alike
    return {}


def _beside_typical(flown: Mapping[int, _Flown], period_s: float) -> dict[int, int]:
    """Return where each flight begins beside the one that correlates most with all the others, roughly."""
    step = max(round(_COARSE_S / period_s), 1)
    coarse = {place: _slower(each, step) for place, each in flown.items()}
    alike, shifts = dict.fromkeys(coarse, 0.0), {place: {place: 0} for place in coarse}
    for one, other in combinations(coarse, 2):
        shift, correlation = _placed(coarse[one], coarse[other])
        shifts[one][other], shifts[other][one] = shift, -shift
        alike[one] += correlation
        alike[other] += correlation
    return {place: step * shift for place, shift in shifts[max(alike, key=alike.__getitem__)].items()}


def _slower(flown: _Flown, step: int) -> _Flown:
    """Return the means over each so many samples."""
    n = flown.known.size // step * step
    motion, torque = (
        each[:n].reshape(-1, step, each.shape[1]).mean(axis=1) for each in (flown.motion, flown.torque)
    )
    return _Flown(motion, torque, np.asarray(flown.known[:n].reshape(-1, step).all(axis=1), dtype=np.bool_))


def _beside_others(
    flown: Mapping[int, _Flown], starts: Mapping[int, int], place: int, period_s: float
) -> int:
    """Return where a flight begins beside the mean of the others, near where it was taken to begin."""
    others, first = _mean_of_others(flown, starts, place)
    near = starts[place] - first
    within = round(_SEARCH_S / period_s)
    return first + _placed(others, flown[place], (near - within, near + within))[0]


def _placed(one: _Flown, other: _Flown, between: tuple[int, int] | None = None) -> tuple[int, float]:
    """Return at which sample of one flight the other begins, and how their motions correlate there."""
    columns = one.motion.shape[1]
    of_one, of_other = (np.repeat(each.known[:, np.newaxis], columns, axis=1) for each in (one, other))
    both = _sums_of_products(one.motion, other.motion)
    size = _sums_of_products(one.motion**2, of_other) * _sums_of_products(of_one, other.motion**2)
    shifts = np.concatenate([np.arange(1 - len(of_other), 0), np.arange(len(of_one))])
    overlap = np.minimum(len(of_one), shifts + len(of_other)) - np.maximum(shifts, 0)
    enough = overlap >= _LEAST_OVERLAP * min(len(of_one), len(of_other))
    near = enough if between is None else (shifts >= between[0]) & (shifts <= between[1])
    shifts = shifts[near]
    # Where both are at rest there is nothing to divide by but rounding.
    correlation = both[shifts] / np.sqrt(np.maximum(size[shifts], 1e-6 * float(size.max()) + 1e-300))
    best = int(np.argmax(correlation))
    return int(shifts[best]), float(correlation[best])


def _sums_of_products(one: FloatArray | BoolArray, other: FloatArray | BoolArray) -> FloatArray:
    """Return the sums of one times the other, shifted later by each number of samples."""
    from scipy.fft import irfft, rfft

    n_lines = 1 << (len(one) + len(other) - 1).bit_length()
    of_one, of_other = (rfft(np.asarray(each, dtype=np.float64), n_lines, axis=0) for each in (one, other))
    return np.asarray(irfft((of_one * of_other.conj()).sum(axis=1), n_lines), dtype=np.float64)


def _mean_of_others(flown: Mapping[int, _Flown], starts: Mapping[int, int], place: int) -> tuple[_Flown, int]:
    """Return the mean of all flights but one, and the sample of the common grid that it begins at."""
    first = min(starts.values())
    n_samples = max(start - first + flown[each].known.size for each, start in starts.items())
    count, motion, torque = (np.zeros((n_samples, columns)) for columns in (1, _AXES + 2, _AXES))
    for other, start in starts.items():
        if other != place:
            rows = slice(start - first, start - first + flown[other].known.size)
            count[rows, 0] += flown[other].known
            motion[rows] += flown[other].motion
            torque[rows] += flown[other].torque
    flew = np.maximum(count, 1.0)
    return _Flown(motion / flew, torque / flew, count[:, 0] > 0.0), first


def _is_alike(flown: Mapping[int, _Flown], starts: Mapping[int, int], place: int, period_s: float) -> bool:
    """Say whether a flight turns as the others do by more than chance, and is none of them."""
    others, first = _mean_of_others(flown, starts, place)
    at = starts[place] - first
    rates = [each.motion[:, :_AXES] for each in (others, flown[place])]
    n_rows = round(WINDOW_S / period_s)
    n_blocks = flown[place].known.size // n_rows
    a, b = (
        each[begin : begin + n_blocks * n_rows].reshape(n_blocks, n_rows, _AXES)
        for each, begin in zip(rates, (at, 0), strict=True)
    )
    size = np.sqrt(np.sum(a**2, axis=1) * np.sum(b**2, axis=1))
    alike = np.sum(a * b, axis=1)[size > 0.0] / size[size > 0.0]
    if alike.size < 2:
        return False
    chance = float(np.std(alike, ddof=1)) / np.sqrt(alike.size)
    return bool(_LEVEL_01 * chance < alike.mean() < _SAME_FLIGHT)


def _with_command(flight: FlightData, others: _Flown, at: int) -> FlightData:
    """Return a flight with the mean torque of others, of which it begins at a sample, as its command."""
    torque = np.where(others.known[:, np.newaxis], others.torque, np.nan)
    crashed_s = _crashed_s(flight)
    segments = tuple(
        replace(
            segment,
            command=np.where(segment.time_s[:, np.newaxis] < crashed_s, torque[at + rows], np.nan),
            planned=True,
            repeated=True,
        )
        for rows, segment in zip(_rows(flight), flight.segments, strict=True)
    )
    return replace(flight, segments=segments)


def _crashed_s(flight: FlightData) -> float:
    """Return when a flight begins to end in a crash; infinite where it does not."""
    turning = np.concatenate([np.sum(each.body_rate_rad_s**2, axis=1) for each in flight.segments])
    time_s = np.concatenate([each.time_s for each in flight.segments])
    n_rows = max(round(_CRASH_S / flight.sample_period_s), 1)
    power = np.convolve(turning, np.full(n_rows, 1.0 / n_rows), "same")
    beyond = np.flatnonzero(power > _CRASHED**2 * np.median(power))
    return float(time_s[beyond[0]]) - _CRASH_S if beyond.size else float("inf")
