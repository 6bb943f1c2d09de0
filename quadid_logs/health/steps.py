"""Step responses of the rates as they were flown, by deconvolution of set-point and rate.

After the way of PID-Analyzer (F. Voss, 2018): windows of both series, averages over them, a Wiener filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal, NamedTuple

import numpy as np

from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.health import AxisSteps, Level, Quantity, StepCurve, Steps
from quadid_logs.health.records import records
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.spline import finer
from quadid_logs.sentences import listed
from quadid_logs.vocabulary import AXES

_WINDOW_S: Final = 2.0
#: How much of the response is shown, and where it has settled [s].
_SHOWN_S, _SETTLED_S, _END_S = 0.5, 0.35, 0.65
#: A response is drawn so many times finer than its samples, for its highest value and its half.
_FINER: Final = 10
#: The main lobe of a Hann window [bins]: so far a residual's power is averaged.
_LOBE: Final = 2
#: PID-Analyzer's limit of what set-points hold [Hz].
_CUT_HZ: Final = 25.0
#: A slower log, but for some jitter, does not hold these frequencies [s].
_SLOWEST_S: Final = 1.1 * 0.5 / _CUT_HZ
#: Groups of windows that are left out in turn; fewer windows give no interval.
_GROUPS: Final = 10
#: Two-sided 95 % of Student's t with nine degrees of freedom.
_T: Final = 2.262
#: A set-point that explains less than half of the rate does not tell its response.
_LEAST_EXPLAINED: Final = 0.5
#: An integrator brings the rate to its set-point, 1, and nothing moves ahead of it. A response that ends or
#: begins elsewhere by more than this is that of the set-point to the rate, through the angle loop.
_OFF: Final = 0.2
#: What has less than half of its frequency's response kept is not known.
_KNOWN: Final = 0.5
#: Half of the largest set-points part the small from the large.
_LARGE: Final = 0.5


#: A loop of second order with 45 degrees of phase margin overshoots by this: exp(-pi z / sqrt(1 - z^2)) with
#: a damping ratio z of a hundredth of the margin (K. Ogata, Modern Control Engineering, 7-7).
_OVERSHOOT: Final = 0.2


#: A chirp that is silent for longer is over [s].
_APART_S: Final = 1.0
#: No log has samples closer together [s].
_LEAST_S: Final = 1e-5


#: Set-point and rate of each record, shape (n_samples,) each.
_Pairs = Sequence[tuple[FloatArray, FloatArray]]
_Size = Literal["all", "small", "large"]


class Response(NamedTuple):
    """What set-points tell of one axis: lag by cross-correlation [s], and step responses of fast logs."""

    lag: Quantity
    steps: AxisSteps | None


class _Windows(NamedTuple):
    """Products of the windows' transforms, (n_windows, n_frequencies), and their largest set-points."""

    xx: FloatArray
    xy: FloatArray
    yy: FloatArray
    peak: FloatArray
    period_s: float
    n: int


class _Curve(NamedTuple):
    response: FloatArray
    low: FloatArray
    high: FloatArray
    ideal: FloatArray
    known: bool
    overshoot: Quantity
    half_s: Quantity


def find_responses(
    rate: CleanSeries, setpoint: CleanSeries, intervals: Sequence[Interval]
) -> dict[str, Response]:
    """Deconvolve the axes whose set-points explain their rates.

    Parameters
    ----------
    intervals : sequence of (start_s, end_s)
        Of flight.

    Returns
    -------
    dict of str to Response
        By axis; without those whose set-points do not tell.
    """
    found, period_s = records([setpoint, rate], intervals)
    responses = {}
    for column, axis in enumerate(AXES):
        pairs = [(one.values[:, column], one.values[:, len(AXES) + column]) for one in found]
        response = _response(pairs, period_s)
        if response is not None:
            responses[axis] = response
    return responses


def without_chirp(intervals: Sequence[Interval], chirp: CleanSeries | None) -> tuple[Interval, ...]:
    """Return the parts of intervals in which no system-ID mode injects a signal.

    Parameters
    ----------
    intervals : sequence of (start_s, end_s)
    chirp : CleanSeries or None
        What it injects; zero, or not logged, where it does not run.
    """
    if chirp is None:
        return tuple(intervals)
    running_s = chirp.time_s[np.any(chirp.values != 0.0, axis=1)]
    if not running_s.size:
        return tuple(intervals)
    breaks = np.flatnonzero(np.diff(running_s) > _APART_S)
    begins, ends = running_s[np.append(0, breaks + 1)], running_s[np.append(breaks, -1)]
    free = list(intervals)
    for begin_s, end_s in zip(begins.tolist(), ends.tolist(), strict=True):
        free = [
            part
            for start_s, stop_s in free
            for part in ((start_s, min(stop_s, begin_s)), (max(start_s, end_s), stop_s))
            if part[1] > part[0]
        ]
    return tuple(free)


def find_angle_lags(
    angle: CleanSeries, setpoint: CleanSeries, intervals: Sequence[Interval]
) -> dict[str, Quantity]:
    """Return how late roll and pitch follow their set-points, where these tell [s].

    By how both change: what a vehicle leans all the time would be in step with anything.

    Parameters
    ----------
    angle, setpoint : CleanSeries
        Euler angles [rad].
    intervals : sequence of (start_s, end_s)
        Of flight.

    Returns
    -------
    dict of str to Quantity
        By axis. Yaw is left out: its set-point may turn at once.
    """
    found = find_responses(_changing(angle), _changing(setpoint), intervals)
    return {axis: one.lag for axis, one in found.items() if axis != "yaw"}


def _changing(angle: CleanSeries) -> CleanSeries:
    """Return how fast angles change, at the middle between samples."""
    step_s = np.diff(angle.time_s)
    change = (np.diff(angle.values, axis=0) + np.pi) % (2.0 * np.pi) - np.pi
    return replace(
        angle,
        time_s=angle.time_s[:-1] + 0.5 * step_s,
        stored=change / np.maximum(step_s, _LEAST_S)[:, np.newaxis],
    )


def find_steps(responses: dict[str, Response]) -> Steps | None:
    """Put the step responses of all axes that tell into one topic."""
    axes = {axis: one.steps for axis, one in responses.items() if one.steps is not None}
    if not axes:
        return None
    late = ", ".join(f"{axis} {1e3 * one.half_time.value:.0f} ms" for axis, one in axes.items())
    over = ", ".join(
        f"{axis} {_percent(one.overshoot)}"
        + ("" if one.overshoot_large is None else f" (large steps {_percent(one.overshoot_large)})")
        for axis, one in axes.items()
    )
    # By the whole interval; where it holds the limit, the log does not decide.
    ends = {axis: one.overshoot.ci95 or 2 * (one.overshoot.value,) for axis, one in axes.items()}
    surely = [axis for axis, (low, _) in ends.items() if low > _OVERSHOOT]
    perhaps = [axis for axis, (low, high) in ends.items() if low <= _OVERSHOOT < high]
    limit = f"{100.0 * _OVERSHOOT:.0f} %, the overshoot of a loop with 45 degrees of phase margin"

    def on(some: Sequence[str]) -> str:
        return "" if len(some) == len(axes) else f"on {listed(some)} "

    level: Level = "normal"
    judged = f"which is normal (below {limit})"
    if surely:
        level = "high"
        judged = f"{on(surely)}more than the normal {limit}"
        if perhaps:
            judged += f", and {on(perhaps)}possibly more"
    elif perhaps:
        level = "fact"
        judged = f"{on(perhaps)}possibly more than the normal {limit}"
    told = f"Time to half of a step: {late}. Overshoot: {over}, {judged}."
    return Steps(sentence=told, level=level, judged=True, axes=axes)


def _percent(overshoot: Quantity) -> str:
    value = f"{max(0.0, 100.0 * overshoot.value):.0f}"
    if overshoot.ci95 is None:
        return f"{value} %"
    return f"{value} ± {50.0 * (overshoot.ci95[1] - overshoot.ci95[0]):.0f} %"


def _windows(pairs: _Pairs, period_s: float, late: int = 0) -> _Windows | None:
    """Transform windows, those of the rate beginning `late` samples after those of the set-point."""
    n = 2 * round(0.5 * _WINDOW_S / period_s) if period_s > 0.0 else 0
    if n < 8:
        return None
    window = np.hanning(n + 1)[:-1]
    xs, ys, peaks = [], [], []
    for asked, flown in pairs:
        if asked.size < n + late:
            continue
        both = asked[: asked.size - late], flown[late:]
        x, y = (np.lib.stride_tricks.sliding_window_view(one, n)[:: n // 2] for one in both)
        peaks.append(np.abs(x).max(axis=1))
        xs.append(np.fft.rfft(x * window, axis=1))
        ys.append(np.fft.rfft(y * window, axis=1))
    if sum(map(len, xs)) < _GROUPS:
        return None
    x, y = np.concatenate(xs), np.concatenate(ys)
    y *= np.exp(-2j * np.pi * late * np.fft.rfftfreq(n))
    return _Windows(np.abs(x) ** 2, np.conj(x) * y, np.abs(y) ** 2, np.concatenate(peaks), period_s, n)


def _response(pairs: _Pairs, period_s: float) -> Response | None:
    """Return lag and step responses, None where the set-points do not tell."""
    windows = _windows(pairs, period_s)
    if windows is None:
        return None
    # Where the cross-correlation is highest [s]; None where that may not be behind the set-point.
    cross = windows.xy
    total = cross.sum(axis=0)
    value = _shift(windows, total)
    groups = np.array_split(np.arange(len(cross)), _GROUPS)
    others = [_shift(windows, total - cross[one].sum(axis=0)) for one in groups]
    found = _with_interval(value, others, "s")
    lag = found if found.ci95 is not None and found.ci95[0] > 0.0 else None
    if lag is None:
        return None
    # A window of the rate that begins as much later holds the response to all of the set-point's, not only to
    # its beginning (G. C. Carter, 1987: misalignment biases a coherence, and the response with it).
    aligned = _windows(pairs, period_s, round(lag.value / period_s))
    windows = windows if aligned is None else aligned
    everything: BoolArray = np.ones(windows.peak.size, dtype=np.bool_)
    whole = _curve(windows, everything)
    if whole is None:
        return None
    split = _LARGE * float(np.percentile(windows.peak, 99.0))
    large = windows.peak > split
    curves = [_shown("all", everything, whole)]
    some: list[tuple[_Size, BoolArray]] = [("small", ~large), ("large", large)]
    parts = [(size, chosen, _curve(windows, chosen)) for size, chosen in some if chosen.sum() >= _GROUPS]
    told = [_shown(size, chosen, curve) for size, chosen, curve in parts if curve and curve.known]
    if windows.period_s > _SLOWEST_S or not whole.known:
        return Response(lag, None)
    # Large steps meet limits, and have most of the power: they would hide what the loop does to small ones.
    small, large_ones = (
        next((curve for size, _, curve in parts if size == wanted and curve and curve.known), None)
        for wanted in ("small", "large")
    )
    differ = small is not None and large_ones is not None and _apart(small.overshoot, large_ones.overshoot)
    judged = small if small is not None and differ else whole
    steps = AxisSteps(
        time_s=_times(windows),
        ideal=whole.ideal,
        curves=tuple(told if len(told) == 2 else curves),
        split_rad_s=split,
        overshoot=judged.overshoot,
        half_time=judged.half_s,
        overshoot_large=large_ones.overshoot if large_ones is not None and differ else None,
    )
    return Response(lag, steps)


def _apart(one: Quantity, other: Quantity) -> bool:
    """Tell whether the intervals of two quantities do not overlap."""
    if one.ci95 is None or other.ci95 is None:
        return False
    return one.ci95[1] < other.ci95[0] or other.ci95[1] < one.ci95[0]


def _shown(size: _Size, chosen: BoolArray, curve: _Curve) -> StepCurve:
    return StepCurve(
        size=size, n_windows=int(chosen.sum()), response=curve.response, low=curve.low, high=curve.high
    )


def _times(windows: _Windows) -> FloatArray:
    """Return the times of the response that are shown, from just before the step."""
    ahead, behind = _ends(windows)
    # A sum of samples is what the response was in the middle between this sample and the next.
    return np.asarray(windows.period_s * (0.5 + np.arange(-ahead, behind + 1)), dtype=np.float64)


def _ends(windows: _Windows) -> tuple[int, int]:
    """Return how many samples before and after the step are shown."""
    return max(1, round(0.1 * _SHOWN_S / windows.period_s)), max(3, round(_SHOWN_S / windows.period_s))


def _curve(windows: _Windows, chosen: BoolArray) -> _Curve | None:
    """Return the step response with its interval, None where it is not one."""
    xx, xy = windows.xx[chosen], windows.xy[chosen]
    low_pass = np.fft.rfftfreq(windows.n, windows.period_s) <= _CUT_HZ
    power = xx.sum(axis=0)
    if not power.max() > 0.0:
        return None
    cross, answered = xy.sum(axis=0), windows.yy[chosen].sum(axis=0)
    explained = np.abs(cross) ** 2 / np.maximum(power, np.finfo(float).tiny)
    if not explained[low_pass].sum() >= _LEAST_EXPLAINED * answered[low_pass].sum():
        return None
    trust = _trust(power, np.maximum(answered - explained, 0.0), len(xx))
    step = _step(windows, power, cross, trust)
    before = step[: windows.n // 2 - max(2, round(0.02 / windows.period_s))]
    first, after = (windows.n // 2 + round(one / windows.period_s) for one in (_SETTLED_S, _END_S))
    end = float(step[first : after + 1].mean())
    ideal = _step(windows, power, power, trust)
    early = (before - ideal[: before.size]).max()
    if abs(end - 1.0) > _OFF or early > _OFF or before.min() < -_OFF:
        return None
    groups = np.array_split(np.arange(len(xx)), _GROUPS)
    others = np.array(
        [_step(windows, power - xx[one].sum(axis=0), cross - xy[one].sum(axis=0), trust) for one in groups]
    )
    ahead, behind = _ends(windows)
    middle = windows.n // 2
    part = slice(middle - ahead, middle + behind + 1)
    shown, left_out = step[part], others[:, part]
    unseen = NORMAL_95 * _unseen(windows, power, cross, trust)
    half = np.hypot(_T * np.sqrt((_GROUPS - 1) * left_out.var(axis=0)), unseen)
    times = _times(windows)
    # Above 1, not above a loop that follows at once: what that one overshoots lies at frequencies that are
    # not kept, where a real one responds with less.
    # Both lie between samples: those of 100 Hz are a quarter of a quick rise apart.
    between = np.linspace(times[0], times[-1], _FINER * (times.size - 1) + 1)
    curve, *without = finer(np.vstack([shown, left_out]), _FINER)
    over = float(curve.max()) - 1.0, [float(one.max()) - 1.0 for one in without]
    half_s = _half_time(between, curve)
    # How fast it rises there [1/s]; slower than over all that is shown it is no rise.
    rise = max(float(np.interp(half_s, between, np.gradient(curve, between))), 1.0 / _SHOWN_S)
    return _Curve(
        shown,
        shown - half,
        shown + half,
        ideal[part],
        float(np.median(half)) <= _OFF,
        # An integrator ends at 1: by how much the response does not, its slow part may be wrong.
        _wider(_with_interval(*over, "1", unseen), abs(end - 1.0)),
        _with_interval(half_s, [_half_time(between, one) for one in without], "s", unseen / rise),
    )


def _unseen(windows: _Windows, power: FloatArray, cross: FloatArray, trust: FloatArray) -> float:
    """Return the standard deviation of what a step response lacks of the frequencies that are not kept.

    A rate loop responds beyond its bandwidth with less and less, so that each frequency responds with no more
    than the octave below it that is known; where none is, with one as at first. A response that
    settles in time is one phase over the inverse of that time: so many neighbours count as one.
    """
    known = trust >= _KNOWN
    least = np.finfo(float).tiny
    gain = np.abs(cross / np.maximum(power, least)) ** 2 - (1.0 - trust) / np.maximum(trust, least)
    sums = np.concatenate([[0.0], np.cumsum(np.where(known, np.maximum(gain, 0.0), 0.0))])
    counts = np.concatenate([[0], np.cumsum(known)])
    after = np.arange(1, trust.size + 1)
    before = after // 2
    seen = counts[after] - counts[before]
    mean = (sums[after] - sums[before]) / np.maximum(seen, 1)
    # What is not known is as much as where it was known last.
    last = np.maximum.accumulate(np.where(seen > 0, after - 1, -1))
    size = np.where(last >= 0, np.minimum(mean[last], 1.0), 1.0)[1:]
    # What a sine adds to an integral; of both signs of the frequency.
    lost = (1.0 - trust[1:]) ** 2 * size / np.arange(1, trust.size) ** 2
    # A log holds nothing beyond half its rate. There a response falls as the inverse of the frequency or
    # faster: at first with half the power of the octave below, and a third of what stayed so adds up.
    beyond = size[-1] / 6.0 / (trust.size - 1)
    neighbours = windows.n * windows.period_s / _SETTLED_S
    return float(np.sqrt(0.5 * neighbours * (lost.sum() + beyond)) / np.pi)


def _trust(power: FloatArray, residual: FloatArray, n_windows: int) -> FloatArray:
    """Return how much of each frequency's response is kept, 0 to 1; shape (n_frequencies,).

    The response is a ratio of spectra. Its variance is the residual's power over the set-point's and over the
    number of windows. A loop responds with about one up to its bandwidth, beyond with less: at first
    the response has mean 0 and variance 1. Its mean afterwards is kept (N. Wiener, 1949).
    """
    around = np.ones(2 * _LOBE + 1) / (2 * _LOBE + 1)
    behind = np.convolve(np.pad(residual, _LOBE, mode="edge"), around, mode="valid")
    variance = behind / (max(n_windows - 1, 1) * np.maximum(power, np.finfo(float).tiny))
    return np.asarray(1.0 / (1.0 + variance), dtype=np.float64)


def _step(windows: _Windows, power: FloatArray, cross: FloatArray, trust: FloatArray) -> FloatArray:
    """Return the response to a step at the middle of the result, shape (n,)."""
    # Means over a sample add up to the integral of a response; samples of it would add up to more.
    over_sample = np.sinc(windows.period_s * np.fft.rfftfreq(windows.n, windows.period_s))
    response = over_sample * trust * cross / np.maximum(power, np.finfo(float).tiny)
    impulse = np.fft.irfft(response, windows.n)
    return np.asarray(np.cumsum(np.roll(impulse, windows.n // 2)), dtype=np.float64)


def _half_time(times: FloatArray, response: FloatArray) -> float:
    """Return when a response first passes one half [s]."""
    after = int(np.argmax(response >= 0.5))
    if after == 0:
        return float(times[0])
    below, above = float(response[after - 1]), float(response[after])
    share = (0.5 - below) / (above - below) if above > below else 0.0
    return float(times[after - 1] + share * (times[after] - times[after - 1]))


def _shift(windows: _Windows, cross: FloatArray) -> float:
    """Return the lag of the highest cross-correlation within half a second [s]."""
    correlation = np.fft.fftshift(np.fft.irfft(cross, windows.n))
    middle, reach = windows.n // 2, max(2, round(_SHOWN_S / windows.period_s))
    part = correlation[middle - reach : middle + reach + 1]
    peak = int(np.argmax(part))
    if not 0 < peak < part.size - 1:
        return float("nan")
    low, top, high = part[peak - 1 : peak + 2]
    bend = low - 2.0 * top + high
    return windows.period_s * (peak - reach + (0.5 * (low - high) / bend if bend < 0.0 else 0.0))


def _wider(quantity: Quantity, by: float) -> Quantity:
    low, high = quantity.ci95 or (quantity.value, quantity.value)
    return quantity._replace(ci95=(low - by, high + by))


def _with_interval(value: float, others: Sequence[float], unit: str, also: float = 0.0) -> Quantity:
    """Return a number with the interval of the delete-a-group jackknife (B. Efron, 1982), and another's."""
    half = float(np.hypot(_T * np.sqrt((_GROUPS - 1) * np.var(others)), also))
    return Quantity(value, unit, (value - half, value + half))
