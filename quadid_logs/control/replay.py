"""Whether the controller of the parameters is the one that flew: replayed from the log, term by term."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from quadid_logs.control.disagreement import THINNED, explain, usable_rows
from quadid_logs.data.controller import (
    TERMS,
    AxisRows,
    FlownControllers,
    Replay,
    ReplayedTerms,
    ReplayInput,
    ReplayReason,
    Term,
)
from quadid_logs.data.log import ParameterChange

#: By a scheduler's jitter the loop's period may differ from that of the parameters, not by more.
_SAME_PERIOD: Final = 0.1
#: A slow flight replays roughly even on thinned rows; where they are the loop's own, it does so closely.
_EXACT: Final = 0.1
#: With P and D scaled down in more of the rows, the gains of the parameters are not those that flew.
_RARELY: Final = 0.05


def replay(
    controllers: FlownControllers,
    inputs: Mapping[str, ReplayInput],
    changes: Sequence[ParameterChange] = (),
) -> dict[str, Replay]:
    """Replay every axis' controller and compare it with what the log holds.

    Parameters
    ----------
    controllers : FlownControllers
    inputs : mapping of str to ReplayInput
        By axis; an axis without rows is not in it.
    changes : sequence of ParameterChange
        Of the log.

    Returns
    -------
    dict of str to Replay
        By axis of the controllers.
    """
    found = {
        axis: _replayed(axis, controllers.axes[axis].gains, inputs, changes) for axis in controllers.axes
    }
    exact = (
        each.agrees
        and (error := each.relative_rms.get("output")) is not None
        and error <= _EXACT * inputs[axis].tolerance
        for axis, each in found.items()
        if axis in inputs
    )
    if not any(exact):
        return found
    # What replays exactly on one axis was logged at each step: then no other was thinned.
    return {
        axis: replace(each, reason=ReplayReason.NOT_EXPLAINED)
        if _perhaps_thinned(each, inputs.get(axis))
        else each
        for axis, each in found.items()
    }


def thinned_from(replays: Mapping[str, Replay]) -> float | None:
    """Return the period of the loop [s] where the rows turned out to be some of its steps only.

    Returns
    -------
    float or None
        None where no axis says so.
    """
    rates_hz = [
        each.numbers["in_file_hz"]
        for each in replays.values()
        if each.reason is ReplayReason.NO_ROWS and "in_file_hz" in each.numbers
    ]
    return 1.0 / max(rates_hz) if rates_hz else None


def _perhaps_thinned(result: Replay, given: ReplayInput | None) -> bool:
    """Tell whether thinned rows are but the explanation that was left."""
    return (
        given is not None
        and result.reason is ReplayReason.NO_ROWS
        and bool(result.numbers)
        and given.loop_period_s > THINNED * given.shortest_period_s
    )


def _replayed(
    axis: str,
    gains: Mapping[str, float],
    inputs: Mapping[str, ReplayInput],
    changes: Sequence[ParameterChange],
) -> Replay:
    given = inputs.get(axis)
    if given is None or not usable_rows(given.rows).any():
        return _nothing(ReplayReason.NO_ROWS)
    if math.isnan(given.tolerance):
        return _nothing(ReplayReason.ROUNDED)
    rows = given.rows
    found = given.law(rows, given.parameters)
    errors = compared(found, rows)
    # Tell whether no term is off by more than the tolerance times the output's rms.
    usable = usable_rows(rows)
    output = float(np.sqrt(np.mean(rows.output[usable] ** 2)))
    logged = {**rows.logged, "output": rows.output}
    sizes = {term: float(np.sqrt(np.mean(logged[term][usable] ** 2))) for term in logged}
    off = (
        error * sizes[term] if sizes[term] else error for term, error in errors.items() if error is not None
    )
    agrees = all(one <= given.tolerance * output for one in off)
    result = Replay(relative_rms=errors, agrees=agrees, n_rows=rows.n_rows, as_logged=given.as_logged)
    told = (
        _other_rate(result, given)
        or _changed(result, given, gains, changes)
        or _slew_limited(result, rows)
        or _gains_scaled(result, rows)
    )
    if told is not None:
        return told
    if not agrees:
        # Of coarse rows only what was found counts, not that nothing was.
        result = explain(result, axis, inputs)
        unknown = given.coarse and result.reason is ReplayReason.NOT_EXPLAINED
        return replace(result, reason=ReplayReason.ROUNDED) if unknown else result
    # Where the integrator's stops had to be taken from the output itself.
    fraction = float(found.limited.mean()) if rows.limited is None else 0.0
    if fraction == 0.0:
        return result
    return replace(result, reason=ReplayReason.LIMIT_FLAGS_MISSING, numbers={"inferred_fraction": fraction})


def _nothing(reason: ReplayReason) -> Replay:
    """Return a replay that could not be made."""
    return Replay(relative_rms=dict.fromkeys(TERMS), agrees=False, reason=reason)


def compared(found: ReplayedTerms, rows: AxisRows) -> dict[Term, float | None]:
    """Return by term the rms of the difference over that of the logged one.

    Returns
    -------
    dict of str to (float or None)
        None where the log does not hold the term, or holds nothing but zeros that are rightly so.
    """
    usable = usable_rows(rows)
    logged = {**rows.logged, "output": rows.output}
    errors: dict[Term, float | None] = dict.fromkeys(TERMS)
    for term in (term for term in TERMS if term in logged):
        both = (logged[term], found.values[term] - logged[term])
        size, off = (float(np.sqrt(np.mean(one[usable] ** 2))) for one in both)
        if size != 0.0 or off != 0.0:
            errors[term] = off / size if size > 0.0 else float("inf")
    return errors


def _other_rate(result: Replay, given: ReplayInput) -> Replay | None:
    """Tell where the controller ran, and was replayed, at another rate than that of the parameters."""
    period_s = float(np.median(given.rows.step_s))
    ratio = period_s / given.loop_period_s
    if not result.agrees or abs(ratio - 1.0) <= _SAME_PERIOD:
        return None
    error = result.relative_rms["output"]
    if ratio > THINNED and error is not None and error > _EXACT * given.tolerance:
        numbers = {"logged_hz": 1.0 / period_s, "in_file_hz": 1.0 / given.loop_period_s}
        return replace(result, agrees=False, reason=ReplayReason.NO_ROWS, numbers=numbers)
    numbers = {"in_file_hz": 1.0 / given.loop_period_s, "flown_hz": 1.0 / period_s}
    return replace(result, agrees=False, reason=ReplayReason.LOOP_RATE_DIFFERS, numbers=numbers)


def _changed(
    result: Replay, given: ReplayInput, gains: Mapping[str, float], changes: Sequence[ParameterChange]
) -> Replay | None:
    """Name the first of the controller's parameters that was changed between the rows."""
    first, last = int(given.rows.positions[0]), int(given.rows.positions[-1])
    here = [one for one in changes if first < one.position < last]
    shape = (one for one in here if one.name in gains or one.name.startswith(given.filters))
    change = next(shape, None)
    if change is None:
        return None
    numbers = {"time_s": change.time_s, "before": change.before, "after": change.value}
    return replace(
        result, agrees=False, reason=ReplayReason.GAINS_CHANGED, parameter=change.name, numbers=numbers
    )


def _slew_limited(result: Replay, rows: AxisRows) -> Replay | None:
    """Tell where P and D were scaled down by the logged factor: then the parameters' gains did not fly."""
    if rows.scale is None or not (rows.scale < 1.0).any():
        return None
    fraction = float(np.mean(rows.scale < 1.0))
    return replace(
        result,
        agrees=result.agrees and fraction <= _RARELY,
        reason=ReplayReason.SLEW_LIMITED,
        numbers={"fraction": fraction, "lowest_scale": float(rows.scale.min())},
    )


def _gains_scaled(result: Replay, rows: AxisRows) -> Replay | None:
    """Tell where P and D were scaled by throttle or for landing in more than some of the rows."""
    if rows.gain_scale is None:
        return None
    scaled = rows.gain_scale != 1.0
    fraction = float(np.mean(scaled))
    if fraction <= _RARELY:
        return None
    low, high = float(rows.gain_scale.min()), float(rows.gain_scale.max())
    return replace(
        result,
        agrees=False,
        reason=ReplayReason.GAINS_SCALED,
        numbers={"fraction": fraction, "lowest_scale": low, "highest_scale": high},
    )
