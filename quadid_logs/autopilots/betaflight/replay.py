"""Betaflight's PID on the rows of the log: P and D anew, I and feed-forward as logged.

The log holds every n-th loop. P has no memory, but for yaw's low-pass. D is filtered and differenced at the
loop's rate, on rates interpolated between rows. Iterm relax, limits and anti-gravity, and the smoothing of
the sticks, act between the rows on what is not logged: I and feed-forward cannot be made anew.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.betaflight.filters import D_LOW_PASSES
from quadid_logs.autopilots.betaflight.flown import LEAST_THROTTLE
from quadid_logs.autopilots.betaflight.law import (
    attenuates_p,
    attenuation,
    d_filter,
    derives_set_points,
    loop_period_s,
    p_filter,
    rate_gains,
)
from quadid_logs.autopilots.betaflight.mixer import has_airmode
from quadid_logs.autopilots.betaflight.signals import PID_SCALE, PID_SUM_LIMITS, STICK, cuts_terms
from quadid_logs.autopilots.betaflight.sticks import sticks_of
from quadid_logs.autopilots.loop_rows import Interval, in_step, longest_run, possible, within
from quadid_logs.data.controller import (
    AxisRows,
    DiscreteFilter,
    FlownControllers,
    ReplayedTerms,
    ReplayInput,
    Term,
)
from quadid_logs.data.log import ControllerTerms, FlightLog, Signal
from quadid_logs.data.once import once
from quadid_logs.maths.recurrence import linear_filter
from quadid_logs.vocabulary import AXES

#: Of P and of D. Anti-gravity raises P by some per cent where the throttle moves, which moves the cut-off of
#: D's filter too: on the firmware's logs P is off by 1 to 2 %, beside the rounding.
_TOLERANCE: Final = 0.05
#: D amplifies what slower rows alias: from them it is not made anew [s].
_SLOWEST_FOR_D_S: Final = 1.1e-3
_DEGREE: Final = math.radians(1.0)
#: Loops of 32 kHz between rows of 1 kHz; more are no matter for a filter of some 100 Hz.
_MOST_LOOPS: Final = 32

#: Of what is made anew: where rounding is more of it, a gain wrong by a third would not be seen.
_MOST_ROUNDING: Final = 0.25
#: Rounding leaves more than it does on average in half of all flights, and in 1 % more than so many standard
#: deviations beyond; the square of a uniform error has 0.8 of its squared mean as variance.
_UNLUCKY: Final = 2.326348
_OF_SQUARE: Final = 0.8
#: Throttles between which the answer of a low-pass that moves with it lies straight, and a range of throttles
#: in which it hardly moves.
_LEVELS: Final = 5
_SAME_THROTTLE: Final = 0.05
#: Frequencies that tell the mean of a smooth response.
_POINTS: Final = 65


class _Logged(NamedTuple):
    """What one frame holds of the controller, and the frames that follow each other."""

    setpoint: Signal
    rate: Signal
    throttle: Signal
    run: slice

    @property
    def thinned_for_d(self) -> bool:
        """Tell whether the rows are too slow for D."""
        return float(np.median(np.diff(self.rate.time_s[self.run]))) > _SLOWEST_FOR_D_S


def replay_inputs(
    log: FlightLog, controllers: FlownControllers, intervals: Sequence[Interval]
) -> dict[str, ReplayInput]:
    """Return by axis the rows and the law to replay them with; see `Autopilot.replay_inputs`.

    Without axes whose terms were not logged.
    """
    held = {each.axis: each for each in log.controller_terms if "P" in each.values}
    axes = [axis for axis in controllers.axes if axis in held]
    logged = _logged(log, intervals)
    found = {} if logged is None else {axis: _input(log, axis, logged, held[axis]) for axis in axes}
    silent = [axis for axis in axes if axis not in found or math.isnan(found[axis].tolerance)]
    # In airmode the PID works on without throttle, as in flips; but a throttle that is cut boosts P. So those
    # rows are taken where the others say nothing.
    more = _logged(log, intervals, without_throttle=True) if silent and has_airmode(log.parameters) else None
    return found if more is None else found | {axis: _input(log, axis, more, held[axis]) for axis in silent}


def _input(log: FlightLog, axis: str, logged: _Logged, terms_: ControllerTerms) -> ReplayInput:
    settings = log.parameters
    anew = not (logged.thinned_for_d or derives_set_points(settings))
    rows = _rows(axis, logged, terms_, settings, d_too=anew)
    # What is unknown of set-points that are made of sticks [rad/s], rms: the stick is a whole number, and one
    # of limited slope is behind by anything from none to all of what it moves in a row, in some loop of which
    # the stick moved.
    sticks = sticks_of(log.parameters, log.version) if logged.setpoint.source.endswith(STICK) else None
    by_sticks = 0.0
    if sticks is not None:
        number = AXES.index(axis)
        set_points = np.degrees(logged.setpoint.values[logged.run, number].astype(np.float64))
        limited = sticks.slopes[number] > 0.0
        behind = float(np.sqrt(np.mean(np.diff(set_points) ** 2) / 3.0)) if limited else 0.0
        by_sticks = _DEGREE * math.hypot(sticks.rounding(number, set_points), behind)
    tolerance = _tolerance(rows, settings, axis, by_sticks)
    # Whole degrees per second make more of D than of P: where they hide both, P alone may be seen.
    coarse = math.isnan(tolerance) and "D" in rows.logged
    if coarse:
        rows = _rows(axis, logged, terms_, settings, d_too=False)
        tolerance = _tolerance(rows, settings, axis, by_sticks)
    d_too = "D" in rows.logged
    gains: dict[Term, str] = {"P": f"p_{axis}"}
    if d_too:
        gains["D"] = f"d_{axis}"
    law = partial(terms, axis=axis, part=d_parts(log)[axis] if d_too else None, version=log.version)
    first = next((names for names in D_LOW_PASSES if settings.get(f"{names.dynamic}[0]", 0.0) > 0.0), None)
    of_d = (*(f"{first.dynamic}[{end}]" for end in (0, 1)),) if first else ("dterm_lpf1_static_hz",)
    return ReplayInput(
        rows=rows,
        law=law,
        parameters=settings,
        gains=gains,
        cutoffs=("yaw_lowpass_hz",) if axis == "yaw" else (*of_d, "dterm_lpf2_static_hz") if d_too else (),
        tolerance=tolerance,
        loop_period_s=float(np.median(rows.step_s)),
        coarse=coarse,
        thinned=True,
        as_logged=("I", "FF") if d_too or axis == "yaw" else ("I", "D", "FF"),
    )


def _logged(
    log: FlightLog, intervals: Sequence[Interval], *, without_throttle: bool = False
) -> _Logged | None:
    """Return what is needed of the frames, None where it is missing or too short."""
    setpoint = next(iter(log.candidates("body_rate_setpoint")), None)
    rate = setpoint and in_step(log, "body_rate", setpoint)
    throttle = setpoint and in_step(log, "throttle", setpoint)
    if setpoint is None or rate is None or throttle is None or setpoint.n_samples < 2:
        return None
    usable = within(setpoint.time_s, intervals) & possible(setpoint.values, rate.values, throttle.values)
    works = (throttle.values[:, 0] > LEAST_THROTTLE) | without_throttle
    run = longest_run(setpoint.time_s, usable & works)
    return None if run is None else _Logged(setpoint, rate, throttle, run)


def _rows(
    axis: str, logged: _Logged, terms_: ControllerTerms, settings: Mapping[str, float], *, d_too: bool
) -> AxisRows:
    """Return the rows of one axis, to make P anew, and D; what is not made anew stands in ``added``."""
    number, run = AXES.index(axis), logged.run
    now = slice(run.start + 1, run.stop)
    of_terms = {term: terms_.values[term][now] for term in terms_.values}
    if "D" in of_terms and d_too:
        anew: dict[Term, FloatArray] = {"P": of_terms["P"], "D": of_terms["D"]}
    else:
        anew = {"P": of_terms["P"]}
    nothing = np.zeros(run.stop - run.start - 1)
    return AxisRows(
        start_s=float(logged.rate.time_s[now.start]),
        positions=logged.rate.position[now],
        step_s=np.diff(logged.rate.time_s[run]),
        target=logged.setpoint.values[now, number].astype(np.float64),
        rate=logged.rate.values[now, number].astype(np.float64),
        output=_limited(sum(of_terms.values(), nothing), settings, axis),
        added=sum((each for term, each in of_terms.items() if term not in anew), nothing),
        known=np.ones(nothing.size, np.bool_),
        logged=anew,
        throttle=np.clip(logged.throttle.values[now, 0].astype(np.float64), 0.0, 1.0),
    )


def _limited(total: FloatArray, settings: Mapping[str, float], axis: str) -> FloatArray:
    """Return a sum of terms as the mixer takes it."""
    limit = PID_SCALE * abs(settings.get(*PID_SUM_LIMITS[axis]))
    return np.clip(total, -limit, limit)


def _tolerance(rows: AxisRows, settings: Mapping[str, float], axis: str, by_sticks: float) -> float:
    """Return by how much a right replay may differ, relative to the output; NaN where rounding hides it.

    Set-points made of sticks are known to `by_sticks` [rad/s].
    """
    settled = slice(rows.settled(), None)
    nothing = np.zeros(rows.n_rows)
    size, anew, of_p, of_d = (
        float(np.sqrt(np.mean(one[settled] ** 2))) if one[settled].size else 0.0
        for one in (
            rows.output,
            rows.output - rows.added,
            rows.logged["P"],
            rows.logged.get("D", nothing),
        )
    )
    of_numbers, at_most = _rounding(rows, settings, axis)
    of_sticks = rate_gains(settings, axis).proportional * by_sticks
    rounding = math.hypot(of_numbers, of_sticks)
    if not 0.0 < rounding <= _MOST_ROUNDING * anew or not size > 0.0:
        return math.nan
    # Between the rows what is fast passes D's filters, and yaw's low-pass, unseen.
    loop_s, _ = loops_of(float(np.median(rows.step_s)), settings)
    passes = {"P": p_filter(settings, axis, loop_s).denominator.size > 1, "D": True}
    fast = math.hypot(*(_fast_part(values[settled]) for term, values in rows.logged.items() if passes[term]))
    # P and D differ on their own, whatever of both cancels in their sum.
    return math.hypot(_TOLERANCE * of_p, _TOLERANCE * of_d, at_most, of_sticks, fast) / size


def _fast_part(values: FloatArray) -> float:
    """Return the rms of what is faster than a quarter of the rows' rate: its way between them is unknown."""
    power = np.abs(np.fft.rfft(values)[1:]) ** 2
    return math.sqrt(2.0 * float(power[power.size // 2 :].sum())) / max(values.size, 1)


def _rounding(rows: AxisRows, settings: Mapping[str, float], axis: str) -> tuple[float, float]:
    """Return what rounding of rates and terms leaves of a right replay, rms [1]: on average, and in 99 %.

    A number that stays the same for many rows is rounded once: in a calm or short flight chance leaves more.
    """
    tenths = settings.get("blackbox_high_resolution", 0.0) > 0.0
    of_rate = (0.1 if tenths else 1.0) * _DEGREE / math.sqrt(12.0)
    gains = rate_gains(settings, axis)
    # A rounded set-point is in P alone, a rounded rate in P and in D at once: they add with their phases.
    found = [gains.proportional * of_rate, gains.proportional * of_rate]
    numbers = [rows.target, rows.rate, *rows.logged.values()]
    if "D" in rows.logged:
        period_s = float(np.median(rows.step_s))
        used = d_filter(settings, float(_throttle(rows).mean()), loops_of(period_s, settings)[0])
        of_d = gains.most_derivative * used.response(np.linspace(0.0, 0.5 / period_s, _POINTS))
        power = max(float(np.mean(np.abs(each) ** 2)) for each in (of_d, gains.proportional + of_d))
        found[1] = of_rate * math.sqrt(power)
    for logged in rows.logged.values():
        # Known to half a unit; one that was cut towards zero to a whole one there.
        of_term = np.where((logged == 0.0) & cuts_terms(settings), 1.0 / 3.0, 1.0 / 12.0)
        found.append(PID_SCALE * float(np.sqrt(np.mean(of_term))))
    settled = slice(rows.settled(), None)
    spread = math.hypot(
        *(
            rms**2 * math.sqrt(_OF_SQUARE) * _held(one[settled])
            for rms, one in zip(found, numbers, strict=True)
        )
    )
    average = math.hypot(*found)
    return average, math.sqrt(average**2 + _UNLUCKY * spread)


def _held(values: FloatArray) -> float:
    """Return the standard deviation of a mean of errors that last as long as a number stays the same.

    Of one error it is 1.
    """
    if not values.size:
        return 0.0
    edges = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan) != 0.0)
    return float(np.sqrt(np.sum((np.diff(edges) / values.size) ** 2)))


def terms(
    rows: AxisRows,
    parameters: Mapping[str, float],
    *,
    axis: str,
    part: float | None,
    version: tuple[int, ...] | None = None,
) -> ReplayedTerms:
    """Replay P and D of pidController.

    Parameters
    ----------
    part : float or None
        Of the way from the lower to the higher D, on average; None where D stands in ``added``.
    version : tuple of int or None
        Of the firmware; None counts as a recent one.

    Returns
    -------
    ReplayedTerms
        I and feed-forward are zero: they stand in ``added``, as logged. Where D moves between two gains, D is
        the logged one as far as it lies between what both gains make.
    """
    gains, factor = rate_gains(parameters, axis), attenuation(parameters, _throttle(rows), version)
    error = (rows.target - rows.rate) * (factor if attenuates_p(parameters) else 1.0)
    period_s = float(np.median(rows.step_s))
    loop_s, n_loops = loops_of(period_s, parameters)
    proportional = gains.proportional * (
        _at_rows(p_filter(parameters, axis, loop_s), error, n_loops) if axis == "yaw" else error
    )
    derivative = np.zeros(rows.n_rows)
    if part is not None:
        slope = _slope(rows, parameters, version)
        derivative = gains.between(part) * slope
        if "D" in rows.logged and gains.most_derivative > gains.derivative:
            ends = (gains.derivative * slope, gains.most_derivative * slope)
            derivative = np.clip(rows.logged["D"], np.minimum(*ends), np.maximum(*ends))
    none = np.zeros(rows.n_rows)
    values: dict[Term, FloatArray] = {"P": proportional, "I": none, "D": derivative, "FF": none}
    values["output"] = _limited(proportional + derivative + rows.added, parameters, axis)
    return ReplayedTerms(values, np.zeros(rows.n_rows, np.bool_))


def _slope(rows: AxisRows, parameters: Mapping[str, float], version: tuple[int, ...] | None) -> FloatArray:
    """Return what a D of 1 makes of the rates, with low-passes that move with the throttle."""
    loop_s, n_loops = loops_of(float(np.median(rows.step_s)), parameters)
    throttle = _throttle(rows)

    def behind(level: float) -> FloatArray:
        return _at_rows(d_filter(parameters, level, loop_s), rows.rate, n_loops)

    moves = any(parameters.get(f"{names.dynamic}[0]", 0.0) > 0.0 for names in D_LOW_PASSES)
    ends = (float(throttle.min(initial=1.0)), float(throttle.max(initial=0.0)))
    if not moves or ends[1] - ends[0] < _SAME_THROTTLE:
        slope = behind(float(throttle.mean()))
    else:
        # A low-pass that moves keeps its state: it goes from the answer at one throttle to that at the next.
        levels = np.linspace(*ends, _LEVELS)
        place = (throttle - ends[0]) / (levels[1] - levels[0])
        slope = np.zeros(rows.n_rows)
        for number, level in enumerate(levels):
            slope += np.maximum(1.0 - np.abs(place - number), 0.0) * behind(float(level))
    return -attenuation(parameters, throttle, version) * slope


def _throttle(rows: AxisRows) -> FloatArray:
    return np.zeros(rows.n_rows) if rows.throttle is None else rows.throttle


def loops_of(period_s: float, parameters: Mapping[str, float]) -> tuple[float, int]:
    """Return the loop's period [s] and how many loops there are from row to row."""
    promised_s = loop_period_s(parameters)
    n_loops = max(round(period_s / promised_s), 1) if promised_s > 0.0 else 1
    n_loops = min(n_loops, _MOST_LOOPS)
    return period_s / n_loops, n_loops


def _at_rows(used: DiscreteFilter, values: FloatArray, n_loops: int) -> FloatArray:
    """Filter values at the loop's rate, straight between the rows, and return those of the rows."""
    if not values.size:
        return values
    loops = np.arange((values.size - 1) * n_loops + 1)
    between = np.interp(loops / n_loops, np.arange(values.size), values)
    numerator, denominator = (one / used.denominator[0] for one in (used.numerator, used.denominator))
    # From rest at the first value, whose answer lasts.
    at_rest = float(between[0] * np.sum(numerator) / np.sum(denominator))
    return (linear_filter(numerator, denominator, between - between[0]) + at_rest)[::n_loops]


@once
def d_parts(log: FlightLog) -> Mapping[str, float]:
    """Return by axis how far D-max moved D from the lower to the higher one, on the average of the flight.

    From 0 to 1, by least squares of the logged D on that of the lower gain; half-way where the log does not
    show it.
    """
    logged = _logged(log, ())
    return {axis: _part(log, axis, logged) for axis in AXES}


def _part(log: FlightLog, axis: str, logged: _Logged | None) -> float:
    try:
        gains = rate_gains(log.parameters, axis)
    except KeyError:
        return 0.0
    if not gains.most_derivative > gains.derivative > 0.0:
        return 0.0
    found = next((one for one in log.controller_terms if one.axis == axis and "D" in one.values), None)
    if logged is None or found is None or logged.thinned_for_d:
        return 0.5
    rows = _rows(axis, logged, found, log.parameters, d_too=True)
    lowest = gains.derivative * _slope(rows, log.parameters, log.version)
    size = float(lowest @ lowest)
    more = float(lowest @ rows.logged["D"]) / size - 1.0 if size > 0.0 else 0.0
    return min(max(more / (gains.most_derivative / gains.derivative - 1.0), 0.0), 1.0)
