"""Spectra of the gyro before and after its filters, and what their lines come from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.health import GyroSpectrum, Line, LineSource, Map, Noise
from quadid_logs.data.log import GyroFilter
from quadid_logs.health.records import records
from quadid_logs.health.spectra import FALSE_ALARM, Periodograms, find_lines, periodograms
from quadid_logs.numerals import number
from quadid_logs.sentences import some
from quadid_logs.vocabulary import AXES

#: Without set-points a line below this may be a command: there autopilots' filters of set-points end, by
#: default (docs/health.md) [Hz].
COMMANDED_HZ: Final = 20.0
#: Rotors are expected to shake here: the default centre of a firmware's notch (docs/health.md) [Hz].
_ROTOR_HZ: Final = 80.0
#: With set-points, slower motion than this is that of the angle and position loops [Hz].
LOWEST_HZ: Final = 1.5
#: No loop of a multirotor can hold an oscillation above: the fastest published rotors (lag 15 ms), a delay of
#: 3 ms and 45 degrees of lead by D leave no phase above 30 Hz; 40 with some room [Hz].
LOOPS_END_HZ: Final = 40.0
#: A rate loop with 30 degrees of phase margin or more makes no more than this of its set-point:
#: 1 / (2 sin(15 deg)) (K. J. Astrom and R. M. Murray, Feedback Systems, section 10.4).
_MOST_OF_SETPOINT: Final = 2.0
#: An oscillation comes back into the set-point by the gain of the angle loop over its frequency. Gains end at
#: 12 1/s (docs/health.md); what moves the set-point by more than twice as much comes from it [1/s].
_ANGLE_GAIN: Final = 24.0
#: Harmonics of the rotors that lines are named by.
_HARMONICS: Final = (1, 2, 3, 4)
#: A line is followed within this fraction of its frequency, and lies on a rotor's speed within that one: as
#: much as speed changes in some seconds of hover.
_NEAR, _SAME_SPEED = 0.25, 0.02
#: What goes with the rotors.
_TURNING: Final = (LineSource.ROTOR, LineSource.FOLLOWS_THROTTLE)
#: Cells of the pictures.
_MOST_X, _MOST_Y, _MOST_LEVELS = 140, 120, 20
#: Windows at one level of throttle, below which their mean says little.
_FEWEST_AT_LEVEL: Final = 3
#: A low-pass of second order lets pass a quarter at twice its cut-off.
_CUT_OFFS: Final = 2.0
#: Gyros of flight controllers end by a low-pass of their own: 256 Hz (MPU-6000), 532 Hz (BMI088), 258 or
#: 536 Hz (ICM-42688-P, as firmware sets it), by their data sheets [Hz].
_SENSOR_HZ: Final = 536.0
#: A line is as wide as a third of an octave where rotor speeds change.
_OCTAVE_PARTS: Final = 3
#: Samples of a window that tell its median.
_MOST_PER_WINDOW: Final = 400
#: Samples of a gyro that may come in batches, which are shorter than the windows of a spectrum.
_BATCHED: Final = "gyro_samples"
#: A shorter one, or what is left of one, resolves nothing below this frequency's inverse [s].
_SHORTEST_BATCH_S: Final = 0.1
#: Named in one sentence.
_MOST_NAMED: Final = 3


def find_noise(
    rates: Sequence[CleanSeries],
    setpoint: CleanSeries | None,
    throttle: CleanSeries | None,
    rotor_speed: CleanSeries | None,
    intervals: Sequence[Interval],
    oscillations_hz: Mapping[str, Sequence[float]] = MappingProxyType({}),
    *,
    of_gyro: bool = True,
) -> Noise | None:
    """Take the fastest gyro behind the filters and the fastest before them, and find the lines.

    Parameters
    ----------
    rates : sequence of CleanSeries
        Every source of the body rates.
    intervals : sequence of (start_s, end_s)
        Of flight.
    oscillations_hz : mapping of str to sequence of float
        What is known to oscillate, by axis.
    of_gyro : bool
        Whether a gyro measured the rates; a table does not say.

    Returns
    -------
    Noise or None
        None where no source is long enough for a spectrum.
    """
    after, before = (
        max(
            (one for one in rates if one.raw is raw and one.n_samples >= 2),
            key=lambda one: one.rate_hz,
            default=None,
        )
        for raw in (False, True)
    )
    spectra = {name: _spectra(one, intervals) for name, one in (("after", after), ("before", before)) if one}
    shown = {name: one for name, one in spectra.items() if one is not None}
    if not shown:
        return None
    # Lines are looked for where the filters have not yet taken them away, if that is as fast.
    best = max(shown, key=lambda name: (float(shown[name].frequency_hz[-1]), name == "before"))
    series, main = (before if best == "before" else after), shown[best]
    if series is None:
        return None
    searched = main.frequency_hz > COMMANDED_HZ
    if setpoint is not None:
        # Nobody knows what was commanded faster than half the rate of the logged set-points.
        searched |= (main.frequency_hz > LOWEST_HZ) & (main.frequency_hz < 0.5 * setpoint.rate_hz)
    commanded = np.zeros((main.frequency_hz.size, len(AXES)), dtype=np.bool_)
    if setpoint is not None:
        commanded = is_commanded(main, setpoint, intervals)
    means = _in_windows(throttle, main)
    level = None if means is None else means[:, 0]
    # The speed of every rotor in each window [1/s], shape (n_windows, n_rotors).
    turns = _in_windows(rotor_speed, main)
    if turns is None:
        speeds = None
    else:
        turning = np.nan_to_num(turns).max(axis=0) > 0.0
        speeds = turns[:, turning] / (2.0 * np.pi) if turning.any() else None
    notches = after.gyro_filter if after is not None else series.gyro_filter
    lines = {
        axis: _named(
            find_lines(main, column, searched & ~commanded[:, column], len(AXES)),
            _Flown(main, column, level, speeds),
            notches,
            oscillations_hz.get(axis, ()),
        )
        for column, axis in enumerate(AXES)
    }
    lines = _alike(lines, float(main.frequency_hz[1]))
    folded = may_be_folded(series)
    # Which part of the gyro's power above commands' frequencies its lines hold there.
    fast = main.frequency_hz > COMMANDED_HZ
    power = float(main.mean[fast].sum()) * float(main.frequency_hz[1])
    held = sum(line.rms**2 for found in lines.values() for line in found if line.frequency_hz > COMMANDED_HZ)
    in_lines = min(held / power, 1.0) if power > 0.0 else 0.0
    return Noise(
        sentence=_sentence(lines, folded, main.frequency_hz, bool(searched.any()), in_lines, of_gyro=of_gyro)
        + _strongest(shown, main),
        judged=bool(searched.any())
        and in_lines <= 0.5
        and (any(lines.values()) or float(main.frequency_hz[-1]) >= _ROTOR_HZ),
        after=_shown(after, shown.get("after")),
        before=_shown(before, shown.get("before")),
        lines=lines,
        over_time=_over_time(main),
        over_throttle=_over_throttle(main, level),
        rotor_hz=np.zeros(0) if speeds is None else speeds.mean(axis=1),
        may_be_folded=folded,
    )


def is_commanded(spectra: Periodograms, setpoint: CleanSeries, intervals: Sequence[Interval]) -> BoolArray:
    """Tell where the set-point moves enough to be what the rate shows; shape (n_frequencies, 3)."""
    step_hz = float(spectra.frequency_hz[1])
    found = _spectra(setpoint, intervals)
    if found is None:
        return np.zeros((spectra.frequency_hz.size, len(AXES)), dtype=np.bool_)
    rate = spectra.mean
    asked = np.stack(
        [np.interp(spectra.frequency_hz, found.frequency_hz, column, right=0.0) for column in found.mean.T],
        axis=1,
    )
    # The bins beside a line hold some of it too.
    wide = max(1, round(float(found.frequency_hz[1]) / step_hz))
    for shift in range(1, 2 + wide):
        asked[shift:] = np.maximum(asked[shift:], asked[:-shift])
        asked[:-shift] = np.maximum(asked[:-shift], asked[shift:])
    most = np.maximum(_MOST_OF_SETPOINT, 2.0 * np.pi * spectra.frequency_hz / _ANGLE_GAIN)
    most[spectra.frequency_hz > LOOPS_END_HZ] = _MOST_OF_SETPOINT
    return np.asarray(asked * most[:, np.newaxis] ** 2 >= rate, dtype=np.bool_)


def may_be_folded(series: CleanSeries) -> bool:
    """Tell whether vibration above half the log's rate can stand below it: no filter known to end it."""
    cutoff_hz = np.fmin(series.gyro_filter.low_pass_hz, _SENSOR_HZ)
    return not 0.5 * series.rate_hz > _CUT_OFFS * cutoff_hz


def _strongest(shown: Mapping[str, Periodograms], searched: Periodograms) -> str:
    """Say how much the axis vibrates that does so most, and where; "" where the log shows too little."""
    if searched.frequency_hz[-1] < _ROTOR_HZ:
        return ""
    fast = searched.frequency_hz > COMMANDED_HZ
    frequency_hz, density = searched.frequency_hz[fast], searched.mean[fast]
    if not density.any():
        return ""
    column = int(np.argmax(density.sum(axis=0)))
    band = np.floor(_OCTAVE_PARTS * np.log2(frequency_hz / COMMANDED_HZ)).astype(np.intp)
    power = density[:, column]
    loudest = band == int(np.argmax(np.bincount(band, weights=power)))
    # Where the middle of that band's power is.
    middle_hz = float(np.average(frequency_hz[loudest], weights=power[loudest]))
    sizes: list[str] = []
    for name in ("before", "after"):
        if name in shown:
            one = shown[name]
            total = float(one.mean[one.frequency_hz > COMMANDED_HZ, column].sum() * one.frequency_hz[1])
            where = "after them" if sizes else f"{name} the filters"
            sizes.append(f"{number(float(np.degrees(np.sqrt(total))), 2)} deg/s rms {where}")
    told = f"{AXES[column].capitalize()} vibrates most above {COMMANDED_HZ:.0f} Hz: {' and '.join(sizes)}, "
    return f" {told}most of it around {_hertz(middle_hz, 2, float(searched.frequency_hz[1]))} Hz."


def _hertz(frequency_hz: float, digits: int, step_hz: float) -> str:
    """Write a frequency to no more than windows resolve: batches of a tenth of a second tell 13 Hz apart."""
    ten = 10.0 ** math.floor(math.log10(2.0 * step_hz))
    return number(ten * round(frequency_hz / ten) if ten > 1.0 else frequency_hz, digits)


def _spectra(series: CleanSeries, intervals: Sequence[Interval]) -> Periodograms | None:
    found = periodograms(*records([series], intervals))
    if found is not None or series.name != _BATCHED:
        return found
    # A batch is a window of its own, if nothing of it was lost.
    batches, period_s = records([series], intervals, shortest_s=_SHORTEST_BATCH_S)
    if not batches:
        return None
    length_s = period_s * float(np.median([one.time_s.size for one in batches]))
    return periodograms(batches, period_s, (length_s, 0.5 * length_s))


def _shown(series: CleanSeries | None, spectra: Periodograms | None) -> GyroSpectrum | None:
    if series is None or spectra is None:
        return None
    return GyroSpectrum(
        source=series.source,
        rate_hz=series.rate_hz,
        frequency_hz=spectra.frequency_hz[1:],
        density=spectra.mean[1:],
    )


def _in_windows(series: CleanSeries | None, spectra: Periodograms) -> FloatArray | None:
    """Return the median of each column in each window, NaN without samples; None without a series.

    The median: a line stands where a rotor's speed is most of the time.
    """
    if series is None or series.n_samples < 2:
        return None
    half_s = 0.5 / float(spectra.frequency_hz[1])
    first, after = (np.searchsorted(series.time_s, spectra.time_s + shift) for shift in (-half_s, half_s))
    medians = np.full((spectra.time_s.size, series.n_columns), np.nan)
    for window, (begin, end) in enumerate(zip(first.tolist(), after.tolist(), strict=True)):
        if end > begin:
            step = max(1, (end - begin) // _MOST_PER_WINDOW)
            medians[window] = np.median(series.of_rows(slice(begin, end, step)), axis=0)
    return medians


class _Flown(NamedTuple):
    """Windows of one axis, and in each of them the throttle and every rotor's speed [1/s]."""

    spectra: Periodograms
    column: int
    throttle: FloatArray | None
    speeds: FloatArray | None


def _named(
    lines: Sequence[Line], flown: _Flown, known: GyroFilter, oscillations_hz: Sequence[float]
) -> tuple[Line, ...]:
    """Say of each line of an axis which notch stands on it, and what it comes from."""
    all_hz = [line.frequency_hz for line in lines]
    return tuple(
        _sourced(
            replace(
                line,
                notch_hz=next(
                    (
                        notch.frequency_hz
                        for notch in known.notches
                        if abs(line.frequency_hz - notch.frequency_hz)
                        <= 0.5 * notch.inverse_q * notch.frequency_hz
                    ),
                    float("nan"),
                ),
            ),
            all_hz,
            flown,
            oscillations_hz,
        )
        for line in lines
    )


def _alike(lines: Mapping[str, tuple[Line, ...]], step_hz: float) -> dict[str, tuple[Line, ...]]:
    """Return the lines with one name for what stands at one frequency about several axes."""
    known = [one for found in lines.values() for one in found if one.source in _TURNING]

    def named(line: Line) -> Line:
        near = [one for one in known if abs(one.frequency_hz - line.frequency_hz) <= step_hz]
        if line.source is not LineSource.UNKNOWN or not near:
            return line
        best = min(near, key=lambda one: abs(one.frequency_hz - line.frequency_hz))
        return replace(line, source=best.source, harmonic=best.harmonic)

    return {axis: tuple(named(line) for line in found) for axis, found in lines.items()}


def _sourced(line: Line, all_hz: Sequence[float], flown: _Flown, oscillations_hz: Sequence[float]) -> Line:
    """Say what a line comes from: an oscillation of the loop, a rotor, what follows the throttle."""
    spectra = flown.spectra
    for oscillation_hz in oscillations_hz:
        harmonic = round(line.frequency_hz / oscillation_hz)
        # The error of a frequency grows with the harmonic.
        error_hz = max(harmonic, 1) * float(spectra.frequency_hz[1])
        if abs(line.frequency_hz - harmonic * oscillation_hz) <= error_hz:
            return replace(line, source=LineSource.LOOP, harmonic=harmonic)
    # The places where a line is followed: no further than halfway to the next one, stronger there.
    line_hz = line.frequency_hz
    low = max([(1.0 - _NEAR) * line_hz, *(0.5 * (one + line_hz) for one in all_hz if one < line_hz)])
    high = min([(1.0 + _NEAR) * line_hz, *(0.5 * (one + line_hz) for one in all_hz if one > line_hz)])
    near = np.flatnonzero((spectra.frequency_hz > low) & (spectra.frequency_hz < high))
    density = spectra.density[:, near, flown.column]
    peaks = spectra.frequency_hz[near[np.argmax(density, axis=1)]]
    if flown.speeds is not None:
        # Half of the windows, with the stronger peaks: in a manoeuvre a line is smeared.
        power = density.max(axis=1)
        strong = power >= np.median(power)
        harmonic = _harmonic(
            line.frequency_hz, peaks[strong], spectra.frequency_hz[near], flown.speeds[strong]
        )
        return replace(line, source=LineSource.ROTOR, harmonic=harmonic) if harmonic else line
    # By rank correlation whether it rises with the throttle, as a rotor's does.
    throttle, source = flown.throttle, LineSource.UNKNOWN
    if throttle is not None and line.frequency_hz >= COMMANDED_HZ:
        there = np.isfinite(throttle) & (throttle > 0.0)
        moves = np.count_nonzero(there) >= 12 and np.ptp(throttle[there]) > 0.0 and np.ptp(peaks[there]) > 0.0
        if moves and _rising_by_chance(throttle[there], peaks[there]) < FALSE_ALARM:
            source = LineSource.FOLLOWS_THROTTLE
    return replace(line, source=source)


def _harmonic(line_hz: float, peaks: FloatArray, near_hz: FloatArray, speeds: FloatArray) -> int:
    """Return the multiple of a rotor's speed on which a line's peaks lie window by window, 0 where on none.

    A binomial test: as often on any rotor's multiple as this does not happen to peaks anywhere near the line.
    A line stands where a rotor's multiple was in some window: a part of the frame that rings beside it
    is none of the rotors', however often their stronger line is the peak that is found.
    """
    from scipy.special import betainc

    known = np.isfinite(speeds).all(axis=1)
    # Power in windows that overlap by half is correlated by 1/36 only: each counts.
    peaks, speeds = peaks[known], speeds[known]
    least, found = FALSE_ALARM / len(_HARMONICS), 0
    for harmonic in _HARMONICS:
        places = harmonic * speeds
        wide = np.maximum(_SAME_SPEED * places, 1.5 * float(near_hz[1] - near_hz[0]))
        if not np.any(np.abs(line_hz - places) <= wide):
            continue
        hits = (np.abs(peaks[:, np.newaxis] - places) <= wide).any(axis=1)
        covered = (np.abs(near_hz[:, np.newaxis, np.newaxis] - places) <= wide).any(axis=2).mean()
        n_hits = int(np.count_nonzero(hits))
        # So many hits or more, by the binomial distribution.
        chance = float(betainc(n_hits, hits.size - n_hits + 1, min(float(covered), 1.0))) if n_hits else 1.0
        if n_hits > 0.5 * hits.size and chance < least:
            least, found = chance, harmonic
    return found


def _rising_by_chance(x: FloatArray, y: FloatArray) -> float:
    """Return the chance of a rank correlation as high as that of two series (C. Spearman), by Student's t."""
    from scipy.special import stdtr

    ranks = [np.unique(one, return_inverse=True, return_counts=True)[1:] for one in (x, y)]
    # Equal values share the mean of their places.
    first, second = (((np.cumsum(counts) - 0.5 * counts)[inverse]) for inverse, counts in ranks)
    if not (first.std() > 0.0 and second.std() > 0.0):
        return 1.0
    rho = float(np.clip(np.corrcoef(first, second)[0, 1], -1.0 + 1e-12, 1.0 - 1e-12))
    left = x.size - 2
    return float(stdtr(left, -rho * np.sqrt(left / (1.0 - rho**2))))


def _decibels(density: FloatArray) -> FloatArray:
    """Return (deg/s)^2/Hz in decibels."""
    floor = np.finfo(np.float64).tiny
    return np.asarray(10.0 * np.log10(np.maximum(density * np.degrees(1.0) ** 2, floor)), dtype=np.float64)


def _coarser(density: FloatArray, frequency_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the highest of neighbouring frequencies, at most as many as a picture shows; axis 1."""
    width = -(-frequency_hz.size // _MOST_Y)
    starts = np.arange(0, frequency_hz.size, width)
    return np.maximum.reduceat(density, starts, axis=1), frequency_hz[starts] + 0.5 * (width - 1) * float(
        frequency_hz[1] - frequency_hz[0]
    )


def _over_time(spectra: Periodograms) -> Map | None:
    """Return the spectrum over time, all axes together."""
    total = spectra.density[:, 1:].sum(axis=2)
    width = -(-len(total) // _MOST_X)
    starts = np.arange(0, len(total), width)
    counts = np.diff(np.append(starts, len(total)))
    mean = np.add.reduceat(total, starts, axis=0) / counts[:, np.newaxis]
    time_s = np.add.reduceat(spectra.time_s, starts) / counts
    if len(time_s) < 2:
        return None
    coarse, frequency_hz = _coarser(mean, spectra.frequency_hz[1:])
    return Map(x=time_s, frequency_hz=frequency_hz, level_db=_decibels(coarse).T)


def _over_throttle(spectra: Periodograms, throttle: FloatArray | None) -> Map | None:
    """Return the spectrum over the throttle, all axes together; None where that hardly changes."""
    if throttle is None or not np.isfinite(throttle).any():
        return None
    low, high = np.nanpercentile(throttle, [2.5, 97.5])
    if not high > low:
        return None
    edges = np.linspace(low, high, _MOST_LEVELS + 1)
    place = np.digitize(throttle, edges) - 1
    total = spectra.density[:, 1:].sum(axis=2)
    rows = np.full((_MOST_LEVELS, total.shape[1]), np.nan)
    for level in range(_MOST_LEVELS):
        here = place == level
        if np.count_nonzero(here) >= _FEWEST_AT_LEVEL:
            rows[level] = total[here].mean(axis=0)
    if np.count_nonzero(np.isfinite(rows[:, 0])) < _FEWEST_AT_LEVEL:
        return None
    coarse, frequency_hz = _coarser(rows, spectra.frequency_hz[1:])
    return Map(x=0.5 * (edges[1:] + edges[:-1]), frequency_hz=frequency_hz, level_db=_decibels(coarse).T)


def source_words(line: Line) -> str:
    """Say what a line comes from, "" where nothing tells."""
    times = "" if line.harmonic == 1 else f"{line.harmonic} times "
    words = {
        LineSource.LOOP: f"{times}the frequency of the oscillation",
        LineSource.ROTOR: f"{times}the rotors' speed",
        LineSource.FOLLOWS_THROTTLE: "rises with the throttle, like a rotor's speed",
    }
    return words.get(line.source, "")


def _sentence(
    lines: Mapping[str, tuple[Line, ...]],
    folded: bool,
    frequency_hz: FloatArray,
    searched: bool,
    in_lines: float,
    *,
    of_gyro: bool,
) -> str:
    """Say which lines there are, and how much of the vibration they are.

    No published figure says how high one may be; one half is where lines are more than all else.
    """
    highest_hz = float(frequency_hz[-1])
    seen, shows, power = ("the gyro", "The gyro shows", "the gyro's power")
    if not of_gyro:
        seen, shows, power = ("the body rates", "The body rates show", "the power of the rates")
    if not searched:
        return (
            f"The log shows {seen} only up to {number(highest_hz, 3)} Hz, and holds no set-points: "
            "vibration cannot be separated from commands."
        )
    named = sorted(
        ((axis, line) for axis, found in lines.items() for line in found), key=lambda one: -one[1].height_db
    )
    if not named:
        told = f"{shows} no distinct line up to {number(highest_hz, 3)} Hz"
        told += ", which is normal" if highest_hz >= _ROTOR_HZ else ""
    else:
        words = []
        for axis, line in named[:_MOST_NAMED]:
            source = source_words(line)
            size = f"{line.height_db:.0f} dB, {number(float(np.degrees(line.rms)), 2)} deg/s rms"
            at = _hertz(line.frequency_hz, 3, float(frequency_hz[1]))
            words.append(f"{axis} {at} Hz ({size}{', ' if source else ''}{source})")
        told = f"{shows} distinct lines: {some(words, len(named))}"
        if highest_hz > COMMANDED_HZ:
            more = "more than" if in_lines > 0.5 else "less than"
            part = number(100.0 * in_lines, 2)
            told += f". Above {COMMANDED_HZ:.0f} Hz, lines hold {part} % of {power}, {more} the rest"
    note = (
        ". Faster vibration can also appear at these frequencies, because the log is slow"
        if folded and named
        else ""
    )
    if folded and not named:
        what = "Faster" if highest_hz >= _ROTOR_HZ else "Most rotors turn faster: their"
        note = f". {what} vibration is not visible at this logging rate"
    return f"{told}{note}."
