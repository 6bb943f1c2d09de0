"""The verdict in words: over all axes, and per axis with its main number."""

from __future__ import annotations

import math

from quadid_logs.data.result import Result
from quadid_logs.report.calibration_parts import calibration_half_width, flight_interval
from quadid_logs.report.numbers import estimate, number, seconds
from quadid_logs.report.words import pretty_unit
from quadid_logs.sentences import listed
from quadid_logs.vocabulary import AXES, ON_AXIS, vehicle_words

_HEADLINES = {
    "usable": "The model can be used on all three axes.",
    "caution": "The model can be used with caution: see the caveats below.",
    "refused": "This log gives no model that can be trusted.",
}


def headline(result: Result) -> str:
    """Return the verdict over all axes in one sentence."""
    refused, found = refused_names(result), result.diagnosis.axes
    others = [axis for axis in AXES if axis not in refused]
    if not (refused and others):
        return _HEADLINES[overall(result)]
    careful = [axis for axis in others if axis in found and found[axis].verdict == "caution"]
    good = [axis for axis in others if axis not in careful]
    told = f"{listed(good or careful)} can be used" + ("" if good else " with caution")
    if good and careful:
        told += f", {listed(careful)} with caution"
    return f"{told[0].upper()}{told[1:]}; {listed(refused)} must not be trusted."


def overall(result: Result) -> str:
    """Return the worst verdict of the axes."""
    verdicts = {axis.verdict for axis in result.diagnosis.axes.values()}
    return next((level for level in ("refused", "caution") if level in verdicts), "usable")


def refused_axes(result: Result) -> tuple[bool, ...]:
    """Return whether each of roll, pitch and yaw is refused."""
    found = result.diagnosis.axes
    return tuple(axis in found and found[axis].verdict == "refused" for axis in AXES)


def refused_names(result: Result) -> tuple[str, ...]:
    """Return the names of the axes that are refused."""
    return tuple(axis for axis, no in zip(AXES, refused_axes(result), strict=True) if no)


def input_unit(result: Result) -> str:
    """Return "N m" or "1"."""
    return result.data.input.unit if result.data.input else "1"


def flown_sentence(result: Result) -> str:
    """Say how much of the log was analyzed, or flown where nothing could be identified."""
    if not result.log.has_time:
        return "nothing identified: the log has no time stamps"
    length = seconds(result.data.duration_s)
    if not result.log.may_be_multirotor:
        return f"{vehicle_words(result.log.vehicle_type)}, nothing identified in {length} of log"
    if result.identification.recommended is not None:
        # Say between which edges the fit was made if a person set them.
        settings = result.settings.identify
        if not settings.smoothing_hz:
            band_by_hand = ""
        else:
            band_by_hand = (
                f" in the band from {settings.high_pass_hz:g} to {settings.smoothing_hz:g} Hz, set by hand"
            )
        return f"{seconds(result.data.used_s)} of {length} analyzed{band_by_hand}"
    if not result.data.flights:
        return f"no flight in {length} of log"
    flown_s = sum(end - start for start, end in result.data.flights)
    return f"{seconds(flown_s)} of flight in {length} of log, nothing identified"


def effect_sentence(result: Result, axis: str) -> str:
    """Return the axis' torque effectiveness with its interval, "" where there is none to be trusted."""
    model, verdict = result.identification.recommended, result.diagnosis.axes.get(axis)
    gain = None if model is None else model.entries.get(ON_AXIS[axis])
    if gain is None or not math.isfinite(gain.value) or verdict is None or verdict.verdict == "refused":
        return ""
    per = " per unit command" if input_unit(result) == "1" else ""
    effect = f"effectiveness {estimate(gain.value, *gain.ci95)} {pretty_unit(gain.unit)}{per}"
    spread = calibration_half_width(gain, result.data.input)
    if not spread:
        return effect
    low, high = flight_interval(gain, result.data.input)
    both = 0.5 * (high - low), spread
    flight, calibration = (number(100.0 * half / abs(gain.value), 2) for half in both)
    return f"{effect} (uncertain by {flight} % from the flight, {calibration} % from the calibration to N m)"
