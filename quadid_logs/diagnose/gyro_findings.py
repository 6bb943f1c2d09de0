"""Caveats about scale, sign, place and time of the body rates, from the attitude in the same log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.diagnosis import Finding, Level
from quadid_logs.data.flight import FlightData, GyroCheck, Overview
from quadid_logs.diagnose.findings import finding, rounded
from quadid_logs.identify.torque_products import MAX_DELAY_S
from quadid_logs.maths.intervals import inside
from quadid_logs.vocabulary import AXES

#: Attitude at 10 Hz and gaps leave 1.5 % on flights of known truth, rates smoothed over 0.2 s up to 4 %.
_SCALE_WARNING = 0.04
#: Control effectiveness that is wrong by this much is no longer caution but refused, as between bands.
_SCALE_ERROR = 0.25
#: An axis that explains less than this of its own motion is noise, or turned too little to be judged.
_MIN_EXPLAINED = 0.9
#: Turned by 45 degrees or more, an axis lies nearer to another one than to its own.
_SWAPPED = 0.5
#: Above 90 degrees by more than rounding, in more samples than damage explains.
_STEEPEST_RAD = np.radians(91.0)
_MOST_TOO_STEEP = 0.01
#: Turning by this much about an axis moves any angle that is measured [rad/s rms].
_TURNS_RAD_S = np.radians(2.0)
#: Fewer rates than two in an interval do not show what the vehicle does within it.
_LEAST_RATES = 2.0
#: From one attitude to the next, half a turn to the right is half a turn to the left.
_MOST_TURN_RAD = np.pi
#: A few samples may repeat one value.
_FEWEST_SAMPLES = 20


def find_in_gyro(data: FlightData) -> Iterator[Finding]:
    """Yield what body rates and attitude contradict each other in.

    Parameters
    ----------
    data : FlightData

    Yields
    ------
    Finding
        QL310.
    """
    attitude = data.overview.get("attitude")
    if attitude is not None and attitude.values.size:
        too_steep = float(np.mean(np.abs(attitude.values[:, 1]) > _STEEPEST_RAD))
        if too_steep > _MOST_TOO_STEEP:
            title = "The logged pitch angle exceeds 90 degrees, which is impossible"
            yield finding("QL310", "warning", {"fraction_of_samples": rounded(too_steep)}, title=title)
        yield from _stuck(data, attitude)
    if data.gyro_check is not None and _shows_turning(data, data.gyro_check):
        yield from _scales(data.gyro_check)
        yield from _lag(data.gyro_check)


def _shows_turning(data: FlightData, check: GyroCheck) -> bool:
    """Return whether rates and attitude were logged fast enough to tell how far the vehicle turns.

    Telemetry at 4 Hz shows one rate in a quarter of a second, and a vehicle that spins by more than half a
    turn from one attitude to the next seems to turn the other way.
    """
    rate, attitude, turned = (
        data.sources.get("body_rate"),
        data.sources.get("attitude"),
        data.overview.get("body_rate"),
    )
    if rate is None or attitude is None or turned is None:
        return True
    if rate.rate_hz * check.length_s < _LEAST_RATES:
        return False
    fastest = np.abs(_in_flight(turned, data.flights)).max(axis=1, initial=0.0)
    too_fast = fastest > _MOST_TURN_RAD * attitude.rate_hz
    return not too_fast.size or float(np.mean(too_fast)) <= _MOST_TOO_STEEP


def _stuck(data: FlightData, attitude: Overview) -> Iterator[Finding]:
    """Say which angles keep one value to the last digit while the vehicle turns about their axes."""
    rate = data.overview.get("body_rate")
    if rate is None:
        return
    angles, rates = (_in_flight(each, data.flights) for each in (attitude, rate))
    if min(angles.shape[0], rates.shape[0]) < _FEWEST_SAMPLES:
        return
    still = (np.ptp(angles, axis=0) == 0.0) & (np.std(rates, axis=0) > _TURNS_RAD_S)
    axes = tuple(axis for axis, is_still in zip(AXES, still, strict=True) if is_still)
    if axes:
        evidence = {
            "angle_deg": {axis: rounded(np.degrees(angles[0, AXES.index(axis)])) for axis in axes},
            "rate_rms_deg_s": {
                axis: rounded(np.degrees(np.std(rates[:, AXES.index(axis)]))) for axis in axes
            },
        }
        title = f"The logged {', '.join(axes)} angle never changes while the vehicle turns"
        yield finding("QL310", "warning", evidence, axes=axes, title=title)


def _in_flight(series: Overview, flights: Sequence[tuple[float, float]]) -> FloatArray:
    """Return the samples (n, 3) that lie in a flight."""
    return np.asarray(series.stored[inside(series.time_s, flights)], dtype=np.float64)


def _scales(check: GyroCheck) -> Iterator[Finding]:
    """Judge scale, sign and place of each axis that turned enough."""
    low, high = check.interval
    for number, axis in enumerate(AXES):
        # The axis that the attitude turns about when this rate is logged, "" if it is its own.
        column, explained = check.matrix[:, number], check.explained[:, number]
        strong = (np.abs(column) - check.half_width[:, number] > _SWAPPED) & (explained > _MIN_EXPLAINED)
        strong[number] = False
        swapped = AXES[int(np.argmax(strong))] if strong.any() else ""
        if swapped:
            yield _finding(
                check, number, "error", f"By the logged attitude, the {axis} rate is the rate of {swapped}"
            )
            continue
        if check.explained[number, number] < _MIN_EXPLAINED:
            continue
        off = max(low[number, number] - 1.0, 1.0 - high[number, number])
        if off > _SCALE_WARNING:
            level: Level = "error" if off > _SCALE_ERROR else "warning"
            scale = float(check.matrix[number, number])
            if scale < 0.0:
                title = f"By the logged attitude, the {axis} rate has the wrong sign"
            else:
                title = f"By the logged attitude, {axis} turns {scale:.3g} times as far as its rate says"
            yield _finding(check, number, level, title)


def _finding(check: GyroCheck, number: int, level: Level, title: str) -> Finding:
    low, high = check.interval
    evidence = {
        "attitude_over_rate": rounded(check.matrix[number, number]),
        "range": [rounded(low[number, number]), rounded(high[number, number])],
        "intervals": int(check.start_s.size),
        "interval_s": check.length_s,
    }
    return finding("QL310", level, evidence, axes=(AXES[number],), title=title)


def _lag(check: GyroCheck) -> Iterator[Finding]:
    """Say that the two clocks differ by more than the filters of a gyro."""
    if abs(check.lag_s) - check.lag_half_width_s <= MAX_DELAY_S:
        return
    lag_ms = 1e3 * check.lag_s
    title = f"The body rates come {abs(lag_ms):.0f} ms {'after' if lag_ms > 0.0 else 'before'} the attitude"
    evidence = {"lag_ms": rounded(lag_ms), "ci95_half_width_ms": rounded(1e3 * check.lag_half_width_s)}
    yield finding("QL310", "info", evidence, title=title)
