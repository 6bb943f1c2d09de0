"""Oscillations that last: one frequency in the rate and in the output of the same axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.data.health import AxisOscillation, Line, LineSource, OscillatingLoop, Oscillation
from quadid_logs.health.noise import LOOPS_END_HZ, LOWEST_HZ, is_commanded, may_be_folded
from quadid_logs.health.records import records
from quadid_logs.health.spectra import Periodograms, find_lines, periodograms
from quadid_logs.numerals import number
from quadid_logs.sentences import continued
from quadid_logs.vocabulary import AXES

#: Where the rotors' speed is known, what is near it is vibration.
_OF_ROTORS: Final = 0.5
#: What stands in less than half of the flight does not last.
_LASTS: Final = 0.5
_SAME_BINS: Final = 1.5
#: Bins on either side that hold a line's power.
_LOBES: Final = 2.5


def find_oscillation(
    rate: CleanSeries,
    setpoint: CleanSeries,
    output: CleanSeries,
    rotor_speed: CleanSeries | None,
    intervals: Sequence[Interval],
    *,
    rate_loop: bool = True,
) -> Oscillation | None:
    """Search for lines that rate and output of an axis share, and that nobody commanded.

    Parameters
    ----------
    rate, setpoint, output : CleanSeries
        Of the rate controller, three columns each.
    intervals : sequence of (start_s, end_s)
        Of flight.
    rate_loop : bool
        Whether the set-point is what a rate loop follows.

    Returns
    -------
    Oscillation or None
        None where the flight is too short for a spectrum, or logged too slowly to see the loop.
    """
    spectra = periodograms(*records([rate, output], intervals))
    if spectra is None:
        return None
    frequency_hz = spectra.frequency_hz
    highest_hz = min(
        LOOPS_END_HZ,
        _lowest_rotor_hz(rotor_speed, intervals) * _OF_ROTORS,
        # Nobody knows what was commanded faster.
        0.5 * setpoint.rate_hz,
    )
    searched = (frequency_hz >= LOWEST_HZ) & (frequency_hz <= highest_hz)
    if not searched.any():
        return None
    commanded = is_commanded(
        spectra._replace(density=spectra.density[:, :, : len(AXES)]), setpoint, intervals
    )
    step_hz = float(frequency_hz[1])
    found = []
    for column, axis in enumerate(AXES):
        free = searched & ~commanded[:, column]
        in_rate = find_lines(spectra, column, free, len(AXES))
        in_output = find_lines(spectra, len(AXES) + column, searched, len(AXES))
        found += [
            AxisOscillation(
                axis=axis,
                line=replace(line, source=LineSource.LOOP),
                setpoint_share=_share(spectra, setpoint, intervals, column, line.frequency_hz),
                power_share=_part(spectra, column, line),
                output_share=sum(_part(spectra, len(AXES) + column, one) for one in same),
                rate_loop=rate_loop,
            )
            for line in in_rate
            if line.share >= _LASTS
            and (
                same := [
                    one
                    for one in in_output
                    if abs(line.frequency_hz - one.frequency_hz) <= _SAME_BINS * step_hz
                ]
            )
        ]
    found.sort(key=lambda one: -one.line.rms)
    for place, one in enumerate(found):
        # A stronger oscillation of another axis explains it: curves in the way make multiples of that.
        line_hz = one.line.frequency_hz
        others_hz = [other.line.frequency_hz for other in found[:place] if other.axis != one.axis]
        multiples = [(round(line_hz / other_hz), other_hz) for other_hz in others_hz]
        overtone = any(n >= 2 and abs(line_hz - n * hz) <= n * _SAME_BINS * step_hz for n, hz in multiples)
        found[place] = replace(one, overtone=overtone)
    shown_hz = min(highest_hz, float(frequency_hz[-1]))
    folded = may_be_folded(rate)
    return Oscillation(
        sentence=_sentence(found, shown_hz, folded=folded, rate_hz=rate.rate_hz),
        level="high" if found and not folded else "fact",
        axes=tuple(found),
        highest_hz=shown_hz,
        may_be_folded=folded,
    )


def _part(spectra: Periodograms, column: int, line: Line) -> float:
    """Return how much of a column's power is in a line."""
    return line.rms**2 / (float(spectra.mean[:, column].sum()) * float(spectra.frequency_hz[1]))


def _share(
    spectra: Periodograms,
    setpoint: CleanSeries,
    intervals: Sequence[Interval],
    column: int,
    frequency_hz: float,
) -> float:
    """Return the size of the set-point over that of the rate around a frequency."""
    asked = periodograms(*records([setpoint], intervals))
    if asked is None:
        return 0.0
    sizes = []
    for one in (asked, spectra):
        step_hz = float(one.frequency_hz[1])
        near = np.abs(one.frequency_hz - frequency_hz) <= _LOBES * step_hz
        sizes.append(float(one.mean[near, column].sum()) * step_hz)
    return float(np.sqrt(sizes[0] / sizes[1])) if sizes[1] > 0.0 else 0.0


def _lowest_rotor_hz(series: CleanSeries | None, intervals: Sequence[Interval]) -> float:
    """Return what 95 % of the rotors' speeds are above [1/s], infinite where they are not logged."""
    if series is None or not intervals:
        return float("inf")
    speeds = np.concatenate([series.of_rows(series.within(*one)) for one in intervals])
    speeds = speeds[np.isfinite(speeds) & (speeds > 0.0)]
    return float(np.percentile(speeds, 5.0)) / (2.0 * np.pi) if speeds.size else float("inf")


def _sentence(found: Sequence[AxisOscillation], highest_hz: float, *, folded: bool, rate_hz: float) -> str:
    if not found:
        band = f"between {LOWEST_HZ:g} and {number(highest_hz, 2)} Hz"
        if folded:
            return f"The log shows no oscillation {band} in the rates and outputs."
        return f"No axis oscillates for long {band}."
    shown_of: dict[str, list[str]] = {}
    for one in found[:3]:
        # Which loop makes it.
        if one.overtone:
            why = "Its frequency is a multiple of the stronger oscillation's."
        elif not one.rate_loop:
            why = "Nothing commands it: the attitude controller oscillates, or something shakes it."
        elif one.loop is OscillatingLoop.OUTER:
            why = "The rate follows its set-point, which swings: the loop around the rate loop oscillates."
        elif one.dominates:
            why = "The rate swings more than twice its set-point: the rate loop oscillates."
        else:
            why = (
                "The rate swings more than twice its set-point: the rate loop oscillates, or something "
                "shakes it."
            )
        shown_of.setdefault(why, []).append(
            f"{one.axis.capitalize()} oscillates at {one.line.frequency_hz:.1f} Hz in "
            f"{100.0 * one.line.share:.0f} % of the flight, in its rate "
            f"({number(float(np.degrees(one.line.rms)), 2)} deg/s rms) and in its output."
        )
    told = " ".join(
        f"{' '.join(shown)} {why if len(shown) == 1 else f'On each of them {continued(why)}'}"
        for why, shown in shown_of.items()
    )
    if folded:
        told += (
            f" The log has only {number(rate_hz, 3)} samples per second: a faster vibration can appear at "
            "that frequency."
        )
    return told
