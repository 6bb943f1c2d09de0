"""What differs where a replayed controller is not the one that flew; explanations are tried in turn."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.controller import AxisRows, Replay, ReplayInput, ReplayReason
from quadid_logs.vocabulary import AXES

#: As many rows tell one explanation from another: 15 s at 400 Hz.
_ROWS: Final = 6_000
#: Rows this much slower than the loop are thinned ones: nothing can be replayed on them.
THINNED: Final = 1.5
_SHIFTS: Final = (-1, 1, -2, 2)
#: By which the stamps' clock may run wrong: units, and loops counted as halves or doubles.
_CLOCK_FACTORS: Final = (0.5, 2.0, 0.25, 4.0)
#: Cut-offs that are tried [Hz], 0 for none; between them the best is refined.
_CUTOFFS_HZ: Final = (0.0, 1.25, 2.5, 5.0, 10.0, 20.0, 40.0, 80.0, 160.0)
_CHUNKS: Final = 4
#: Fewer could not be told from chance by their signs.
_JUDGES: Final = 10
#: Of taking a right gain for a wrong one, and any of all steps for a jump.
_CHANCE: Final = 0.01
#: The integrator's state is told again from so much of the log [s], slower than a rate loop answers, and so
#: many times in it.
_STATE_S, _STATES_PER_S = 1.0, 10
#: A set-point a row less often is missing often enough to matter.
_MISSING: Final = 0.02
#: A notch is believed where it explains most of what differs.
_EXPLAINED: Final = 1.0 / 3.0
#: Residuals beyond so many standard deviations are outliers of a regression: loops with another set-point.
_OUTLIER: Final = 5.0
_SD_OF_MAD: Final = 1.4826


class _Explanation(NamedTuple):
    reason: ReplayReason
    parameter: str = ""
    numbers: Mapping[str, float] = {}


def explain(result: Replay, axis: str, inputs: Mapping[str, ReplayInput]) -> Replay:
    """Name what differs, by the first explanation with which the replay agrees.

    Parameters
    ----------
    result : Replay
        That disagrees.
    axis : str
    inputs : mapping of str to ReplayInput
        Of all axes.

    Returns
    -------
    Replay
        With reason, parameter and numbers.
    """
    given = inputs[axis]
    # The rows in which the replay differs most.
    part = _busiest(_output(given, given.rows) - given.rows.output)
    if "I" not in given.as_logged:
        # Where the log does not say when the integrator stopped, each stop that is missed moves all that
        # follows, and no gain.
        if given.rows.limited is None and _agrees_but_for_stops(given):
            return replace(result, agrees=True, reason=ReplayReason.LIMIT_FLAGS_MISSING)
        if _error(given, given.rows.part(part)) <= given.tolerance:
            return replace(result, reason=ReplayReason.INTEGRATOR_RESET)
    swapped = _swapped(axis, inputs)
    for attempt in (
        _one_gain,
        _shifted,
        swapped,
        _clock,
        _thinned,
        _filtered,
        _regained,
        _slew,
        _notch,
        _missing,
        # Rows that no other cause explains are some of the loop's steps, where it may be that fast.
        lambda given, _: _of_loop(given, given.shortest_period_s),
    ):
        found = attempt(given, part)
        if found is not None:
            return replace(
                result, reason=found.reason, parameter=found.parameter, numbers=dict(found.numbers)
            )
    return replace(result, reason=ReplayReason.NOT_EXPLAINED)


def _agrees_but_for_stops(given: ReplayInput) -> bool:
    """Tell whether the parameters flew, wherever the integrator stopped or was set without a word in the log.

    Its state is told again by the log, at each jump and second by second: what is left is compared with what
    the output does within seconds, and no gain may differ in the steps of the output, which know of no state.
    """
    rows = given.rows
    usable = usable_rows(rows)
    n_rows = max(round(_STATE_S / float(np.median(rows.step_s))), 1)
    off = _without_state(_output(given, rows) - rows.output, n_rows)[usable]
    size = _without_state(rows.output, n_rows)[usable]
    if not np.sum(off**2) <= given.tolerance**2 * np.sum(size**2):
        return False
    return not any(_differs(factors, given.tolerance) for factors in _gain_factors(given).values())


def _without_state(values: FloatArray, n_rows: int) -> FloatArray:
    """Return values less the jumps that stand alone, and less the running median of the rest."""
    # Not scipy.stats: importing it takes longer than all that is done here.
    from scipy.special import ndtri

    steps = np.diff(values, prepend=values[:1])
    # Logs are in single precision: a jump is no rounding.
    rounding = float(np.finfo(np.float32).eps) * float(np.abs(values).max(initial=0.0))
    spread = max(_SD_OF_MAD * float(np.median(np.abs(steps))), rounding)
    far = np.abs(steps) > spread * -ndtri(0.5 * _CHANCE / values.size)
    # An integral is set once in a while: what jumps again and again is another controller.
    n_far = np.cumsum(np.pad(far, (n_rows + 1, n_rows)))
    alone = far & (n_far[2 * n_rows + 1 :] - n_far[: values.size] == 1)
    jumps = np.where(alone, steps, 0.0)
    values = values - np.cumsum(jumps)
    if values.size <= n_rows:
        return np.asarray(values - np.median(values))
    every = max(n_rows // _STATES_PER_S, 1)
    padded = np.pad(values, n_rows // 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, n_rows)[::every]
    return np.asarray(values - np.repeat(np.median(windows, axis=1), every)[: values.size])


def _gain_factors(given: ReplayInput) -> dict[str, list[float]]:
    """Return what flown over the parameters' gains is, by chunk, where the integrator did not stand still."""
    rows = given.rows
    stood = given.law(rows, given.parameters).limited
    found: dict[str, list[float]] = {}
    edges = np.linspace(0, rows.n_rows, _JUDGES + 1).astype(int).tolist()
    for quarter in itertools.starmap(slice, itertools.pairwise(edges)):
        busiest = _busiest(rows.output[quarter])
        here = slice(quarter.start + busiest.start, quarter.start + busiest.stop)
        steps = _steps(given, rows.part(here))
        steps = steps._replace(usable=steps.usable & ~stood[here])
        for name, gain in (_fitted(given, steps, tuple(given.gains.values())) or {}).items():
            in_file = given.parameters.get(name, 0.0)
            if in_file:
                found.setdefault(name, []).append(gain / in_file)
    return found


def _differs(factors: Sequence[float], tolerance: float) -> bool:
    """Tell whether most factors lie beyond what a right replay may differ by, on one side (sign test).

    However the errors of single chunks are distributed, each lies beyond a middle that is within with a
    probability of a half at most; stops that were missed in some of the chunks change nothing.
    """
    from scipy.special import bdtrc

    above, below = (sum(sign * (factor - 1.0) > tolerance for factor in factors) for sign in (1.0, -1.0))
    n_beyond = max(above, below)
    return bool(2.0 * bdtrc(n_beyond - 1, len(factors), 0.5) < _CHANCE)


def _busiest(values: FloatArray) -> slice:
    """Return the `_ROWS` rows in which values move most, all of fewer."""
    if values.size <= _ROWS:
        return slice(0, values.size)
    summed = np.concatenate([[0.0], np.cumsum(np.diff(values, prepend=values[0]) ** 2)])
    starts = np.arange(0, values.size - _ROWS + 1, _ROWS // 4)
    start = int(starts[np.argmax(summed[starts + _ROWS] - summed[starts])])
    return slice(start, start + _ROWS)


def _output(given: ReplayInput, rows: AxisRows, changed: Mapping[str, float] | None = None) -> FloatArray:
    return given.law(rows, {**given.parameters, **(changed or {})}).values["output"]


def _error(given: ReplayInput, rows: AxisRows, changed: Mapping[str, float] | None = None) -> float:
    """Return the relative rms difference of the output."""
    usable = usable_rows(rows)
    if not usable.any():
        return float("inf")
    off = _output(given, rows, changed) - rows.output
    size = float(np.sqrt(np.mean(rows.output[usable] ** 2)))
    return float(np.sqrt(np.mean(off[usable] ** 2))) / size if size > 0.0 else float("inf")


def usable_rows(rows: AxisRows) -> BoolArray:
    """Mark the rows in which a replay can be held against the log: settled, with a set-point of their own."""
    usable = rows.known.copy()
    usable[: rows.settled()] = False
    return usable


def _one_gain(given: ReplayInput, part: slice) -> _Explanation | None:  # noqa: ARG001
    """Hold each logged term against a multiple of the replayed one, where terms are logged."""
    rows, usable = given.rows, usable_rows(given.rows)
    found = given.law(rows, given.parameters).values
    allowed = given.tolerance * float(np.sqrt(np.mean(rows.output[usable] ** 2)))
    for term, name in given.gains.items():
        size = float(np.sum(found[term][usable] ** 2))
        if term not in rows.logged or not size > 0.0:
            continue
        if float(np.sqrt(np.mean((found[term] - rows.logged[term])[usable] ** 2))) <= allowed:
            continue  # this gain flew
        factor = float(np.sum(found[term][usable] * rows.logged[term][usable])) / size
        change = (factor - 1.0) * found[term]
        left = (found["output"] + change - rows.output, found[term] + change - rows.logged[term])
        if all(float(np.sqrt(np.mean(one[usable] ** 2))) <= allowed for one in left):
            in_file = given.parameters.get(name, 0.0)
            return _Explanation(
                ReplayReason.GAIN_DIFFERS, name, {"in_file": in_file, "flown": factor * in_file}
            )
    return None


def _shifted(given: ReplayInput, part: slice) -> _Explanation | None:
    # In a log of every fourth step a row is no step of the loop, and a late row may fit by chance.
    if given.thinned or _thinned(given, part) is not None:
        return None
    rows = given.rows.part(part)
    for shift in _SHIFTS:
        known = rows.known.copy()
        known[-abs(shift) :] = False
        moved = replace(rows, target=np.roll(rows.target, shift), known=known)
        if _error(given, moved) <= given.tolerance:
            return _Explanation(ReplayReason.SETPOINT_SHIFTED, numbers={"rows": float(shift)})
    return None


def _swapped(
    axis: str, inputs: Mapping[str, ReplayInput]
) -> Callable[[ReplayInput, slice], _Explanation | None]:
    """Return the attempt to explain a replay by another axis' set-point and rate."""

    def attempt(given: ReplayInput, part: slice) -> _Explanation | None:
        for other in (name for name in inputs if name != axis):
            foreign = inputs[other].rows
            if foreign.n_rows != given.rows.n_rows:
                continue
            rows = replace(
                given.rows, target=foreign.target, rate=foreign.rate, derivative=foreign.derivative
            )
            if _error(given, rows.part(part)) <= given.tolerance:
                numbers = {"axis": float(AXES.index(other))}
                return _Explanation(ReplayReason.AXES_SWAPPED, numbers=numbers)
        return None

    return attempt


def _clock(given: ReplayInput, part: slice) -> _Explanation | None:
    if given.thinned:
        return None
    rows = given.rows.part(part)
    for factor in _CLOCK_FACTORS:
        if _error(given, replace(rows, step_s=factor * rows.step_s)) <= given.tolerance:
            logged_hz = 1.0 / float(np.median(rows.step_s))
            numbers = {"logged_hz": logged_hz, "flown_hz": logged_hz / factor}
            return _Explanation(ReplayReason.LOOP_RATE_DIFFERS, numbers=numbers)
    return None


def _thinned(given: ReplayInput, part: slice) -> _Explanation | None:  # noqa: ARG001
    return _of_loop(given, given.loop_period_s)


def _of_loop(given: ReplayInput, period_s: float) -> _Explanation | None:
    logged_hz, loop_hz = 1.0 / float(np.median(given.rows.step_s)), 1.0 / period_s
    # A period that is not known is NaN.
    if not loop_hz > THINNED * logged_hz:
        return None
    return _Explanation(ReplayReason.NO_ROWS, numbers={"logged_hz": logged_hz, "in_file_hz": loop_hz})


def _filtered(given: ReplayInput, part: slice) -> _Explanation | None:
    """Try other cut-offs of each filter."""
    from scipy.optimize import minimize_scalar

    rows = given.rows.part(part)
    for name in given.cutoffs:
        errors = [_error(given, rows, {name: cutoff_hz}) for cutoff_hz in _CUTOFFS_HZ]
        best = int(np.argmin(errors))
        flown_hz, error = _CUTOFFS_HZ[best], errors[best]
        if error > given.tolerance and best > 0:
            # The best one within a factor of two.
            found = minimize_scalar(
                lambda log_hz, name=name: _error(given, rows, {name: float(np.exp(log_hz))}),
                bounds=(np.log(0.5 * flown_hz), np.log(2.0 * flown_hz)),
                method="bounded",
                options={"xatol": 1e-3},
            )
            flown_hz, error = float(np.exp(found.x)), float(found.fun)
        if error <= given.tolerance:
            numbers = {"in_file_hz": given.parameters.get(name, 0.0), "flown_hz": flown_hz}
            return _Explanation(ReplayReason.FILTER_DIFFERS, name, numbers)
    return None


def _slew(given: ReplayInput, part: slice) -> _Explanation | None:  # noqa: ARG001
    """Take a slew limiter for the cause where its factor on P and D was not logged."""
    limits = {name: given.parameters.get(name, 0.0) for name in given.slew_limits}
    name = next((name for name, value in limits.items() if value > 0.0), "")
    if not name or given.rows.scale is not None:
        return None
    return _Explanation(ReplayReason.SLEW_LIMITED, name, {"limit_per_s": limits[name]})


def _regained(given: ReplayInput, part: slice) -> _Explanation | None:  # noqa: ARG001
    """Fit the gains to the steps of the output, over all rows and over chunks of them."""
    rows = given.rows
    edges = np.linspace(0, rows.n_rows, _CHUNKS + 1).astype(int)
    quarters = (rows.part(slice(a, b)) for a, b in itertools.pairwise(edges.tolist()))
    chunks = [one.part(_busiest(one.output)) for one in quarters]
    steps = [_steps(given, chunk) for chunk in chunks]
    # First one gain alone: where all may differ, the fit tells noise too.
    for names in (*((name,) for name in given.gains.values()), tuple(given.gains.values())):
        fits = [_fitted(given, each, names) for each in steps]
        told = [
            (chunk, fit)
            for chunk, fit in zip(chunks, fits, strict=True)
            if fit and _error(given, chunk, fit) <= given.tolerance
        ]
        # Of one change in flight, one chunk holds gains of both sides.
        if len(told) < _CHUNKS - 1 or all(_are_of_file(given, fit, chunk) for chunk, fit in told):
            continue
        middle = {name: float(np.median([fit[name] for _, fit in told])) for name in told[0][1]}
        name = names[0] if len(names) == 1 else ""
        in_file = given.parameters.get(name, 0.0)
        if all(_error(given, chunk, middle) <= given.tolerance for chunk, _ in told):
            numbers = {"in_file": in_file, "flown": middle[name]} if name else {}
            return _Explanation(ReplayReason.GAIN_DIFFERS, name, numbers)
        numbers = {"before": told[0][1][name], "after": told[-1][1][name]} if name else {}
        return _Explanation(ReplayReason.GAINS_CHANGED, name, numbers)
    return None


def _are_of_file(given: ReplayInput, gains: Mapping[str, float], rows: AxisRows) -> bool:
    """Tell whether gains are nearer to the file's than a right replay need be: then they explain nothing."""
    for name, flown in gains.items():
        in_file = given.parameters.get(name, 0.0)
        if in_file and abs(flown - in_file) > given.tolerance * abs(in_file):
            return False
        if not in_file and _error(given, rows) > given.tolerance:
            return False
    return True


class _Steps(NamedTuple):
    """Steps of the output, and of it with one gain 1 and the others 0, by the gain's parameter."""

    output: FloatArray
    by_gain: dict[str, FloatArray]
    usable: BoolArray


def _steps(given: ReplayInput, rows: AxisRows) -> _Steps:
    usable = usable_rows(rows)
    usable[1:] &= usable[:-1]
    # Rows whose integrator never stops, where the log does not say: other gains cannot tell.
    free = replace(rows, limited=np.zeros(rows.n_rows, np.bool_)) if rows.limited is None else rows
    by_gain = {}
    for name in given.gains.values():
        only = {one: float(one == name) for one in given.gains.values()}
        column = np.diff(_output(given, free, only) - rows.added, prepend=0.0)
        if np.any(column[usable] != 0.0):
            by_gain[name] = column
    return _Steps(np.diff(rows.output - rows.added, prepend=0.0), by_gain, usable)


def _fitted(given: ReplayInput, steps: _Steps, names: tuple[str, ...]) -> dict[str, float] | None:
    """Return what the steps show of some gains, the others as in the file; None where too few rows tell."""
    free = [name for name in names if name in steps.by_gain]
    if not free or np.count_nonzero(steps.usable) < steps.usable.size // 4:
        return None
    kept = (name for name in steps.by_gain if name not in free)
    known = sum((given.parameters.get(name, 0.0) * steps.by_gain[name] for name in kept), np.zeros(1))
    columns = np.column_stack([steps.by_gain[name] for name in free])
    # Least squares without the rows that lie far off.
    output, here, found = steps.output - known, steps.usable, np.zeros(columns.shape[1])
    for _ in range(4):
        scale = np.sqrt(np.mean(columns[here] ** 2, axis=0))
        scale[scale == 0.0] = 1.0
        found = np.linalg.lstsq(columns[here] / scale, output[here], rcond=None)[0] / scale
        off = np.abs(output - columns @ found)
        spread = _SD_OF_MAD * float(np.median(off[steps.usable]))
        here = steps.usable & (off <= _OUTLIER * spread)
        if np.count_nonzero(here) < columns.shape[1] + 1:
            break
    return dict(zip(free, found.tolist(), strict=True))


def _missing(given: ReplayInput, part: slice) -> _Explanation | None:  # noqa: ARG001
    fraction = 1.0 - min(given.rows.setpoints_per_row, float(np.mean(given.rows.known)))
    if fraction <= _MISSING:
        return None
    return _Explanation(ReplayReason.SETPOINT_MISSING, numbers={"missing_fraction": fraction})


def _notch(given: ReplayInput, part: slice) -> _Explanation | None:
    """Look for a notch between the error and the output that the parameters do not tell."""
    from scipy import signal

    rows = given.rows.part(part)
    rate_hz = 1.0 / float(np.median(rows.step_s))
    begin = rows.settled()
    replayed, logged = (np.diff(one[begin:]) for one in (_output(given, rows), rows.output))
    n = min(2048, replayed.size // 4)
    frequency_hz, power = signal.welch(replayed, rate_hz, nperseg=n)
    ratio = signal.csd(replayed, logged, rate_hz, nperseg=n)[1] / np.maximum(power, 1e-300)
    before = _error(given, rows)

    def misfit(notch: tuple[float, float]) -> float:
        response = signal.freqz(*signal.iirnotch(*notch, fs=rate_hz), worN=frequency_hz, fs=rate_hz)[1]
        return float(np.sum(power * np.abs(response - ratio) ** 2))

    # A digital notch cannot be wider than half of the sample rate.
    notches = (
        (centre_hz, q)
        for centre_hz in np.geomspace(3.0, 0.4 * rate_hz, 60).tolist()
        for q in (0.5, 1.0, 2.0, 4.0)
        if centre_hz < 0.4 * rate_hz * q
    )
    best = min(notches, key=misfit)
    numerator, denominator = signal.iirnotch(*best, fs=rate_hz)
    target, rate = (signal.lfilter(numerator, denominator, one) for one in (rows.target, rows.rate))
    after = _error(given, replace(rows, target=target, rate=rate))
    if after > _EXPLAINED * before:
        return None
    return _Explanation(ReplayReason.HIDDEN_NOTCH, numbers={"frequency_hz": best[0], "q": best[1]})
