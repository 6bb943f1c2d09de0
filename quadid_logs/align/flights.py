"""When the vehicle flew: from arming, land detector, motor output and motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from quadid_logs.align.held import is_held, stayed_on_the_ground
from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.arrays import BoolArray, FloatArray, runs
from quadid_logs.vocabulary import GRAVITY_M_S2

#: Take-off and touch-down push on the vehicle with forces that no model of free flight has.
_GROUND_MARGIN_S = 1.0
#: Motors of a multirotor in the air never rest below this fraction of full throttle.
_IDLE_THROTTLE = 0.05
#: Two flights lie at least this far apart; a shorter dip of the evidence is a bounce.
_MIN_PAUSE_S = 1.0
#: From arming to leaving the ground takes this long: a shorter log shows nothing about a flight.
_SHORT_LOG_S = 10.0
#: Between two samples of slow evidence (1 Hz land detector) its value is held.
_GRID_S = 0.1
#: So few points cost nothing, however few the samples are.
_FEWEST_POINTS = 20_000
#: Rotors that turn at all give a tenth of the largest thrust, of which a few samples may be outliers.
_RUNNING, _LARGEST = 0.1, 0.99
#: With less than half its weight carried for half a second a vehicle is half a metre lower and falls at
#: 2 m/s: that is a landing.
_LIFTING, _LIFT_S = 0.5, 0.5
#: Averages over a fifth of a second leave under a tenth of this of a gyro's noise on a bench; a vehicle
#: that hovers by itself turns three times as much and more [deg/s rms].
_STILL_DEG_S, _STILL_S = 0.3, 0.2
_TOO_SHORT = "the vehicle was never in the air for two seconds without a break"
_BENCH = "the rotors ran, but the vehicle did not move, as on a bench"
_ON_GROUND = "the vehicle stayed on the ground (the throttle moved, and its acceleration did not)"
_HELD = "something held the vehicle, as a test rig does (its accelerometer tilted with gravity)"


class Flights(NamedTuple):
    """Intervals of flight (start_s, end_s), and why there is none or what they rest on.

    ``hops`` are the same with take-off and touch-down, where arming or a land detector tells them.
    """

    intervals: tuple[Interval, ...]
    reason: str
    hops: tuple[Interval, ...] = ()


def find_flights(series: Mapping[str, CleanSeries], span: Interval) -> Flights:
    """Find the intervals between take-off and landing.

    Every kind of evidence that the log holds must agree: armed, not landed,
    motors turning. A throttle cut in mid-air ends no flight: that takes a
    vehicle that rests. Without any of these (a bare table), the vehicle is
    taken to fly while its torque is not constant.

    Parameters
    ----------
    series : mapping of str to CleanSeries
        By canonical name.
    span : (start_s, end_s)
        Of the whole log.

    Returns
    -------
    Flights
        Trimmed by a second at both ends, where the ground still pushes.
    """
    if not span[1] > span[0]:
        return Flights((), "all rows of the log have the same time")
    # Times at which the clock jumped far ahead hold no samples, and shall cost no more than those that do:
    # slow evidence comes once a second, which is ten points a sample.
    n_samples = max((each.n_samples for each in series.values()), default=0)
    n_points = int((span[1] - span[0]) / _GRID_S) + 2
    grid = np.linspace(*span, min(n_points, max(10 * n_samples, _FEWEST_POINTS), 1_000_000))
    aloft = np.ones(grid.shape, dtype=np.bool_)
    stated, evidence = aloft, 0
    for name, believe, failure in (
        ("armed", _state, "the motors were never armed"),
        ("landed", lambda landed, grid: ~_state(landed, grid), "the land detector saw no take-off"),
        ("throttle", _above_idle, "the throttle never left idle"),
    ):
        if name not in series:
            continue
        evidence += 1
        aloft = aloft & believe(series[name], grid)
        stated = stated if name == "throttle" else aloft
        if not aloft.any():
            return Flights((), f"{failure}{_in_so_short(span)}")
    if not {"armed", "landed"} & series.keys() and (lifted := _lifted(series, grid)) is not None:
        evidence += 1
        aloft = aloft & lifted
        if not aloft.any():
            return Flights((), f"the thrust never lifted the vehicle{_in_so_short(span)}")
    if not evidence:
        found = _from_motion(series)
        flown = _turning(series, found.intervals)
        return _free(series, Flights(flown, found.reason if flown or not found.intervals else _BENCH))
    aloft = _until_it_rests(series, grid, powered=aloft, stated=stated)
    # The intervals where the mask holds, bridging short dips.
    intervals: list[Interval] = []
    for first, after in runs(aloft):
        start, end = float(grid[first]), float(grid[after - 1])
        if intervals and start - intervals[-1][1] < _MIN_PAUSE_S:
            intervals[-1] = (intervals[-1][0], end)
        else:
            intervals.append((start, end))
    trimmed = tuple((a + _GROUND_MARGIN_S, b - _GROUND_MARGIN_S) for a, b in intervals)
    lasting = tuple((a, b) for a, b in trimmed if b > a)
    if lasting and not {"armed", "landed"} & series.keys():
        lasting = _turning(series, lasting)
        return _free(series, Flights(lasting, "" if lasting else _BENCH))
    return _free(series, Flights(lasting, "" if lasting else _TOO_SHORT, tuple(intervals)))


def _free(series: Mapping[str, CleanSeries], found: Flights) -> Flights:
    """Return the flights in which neither the ground carried the vehicle nor anything else held it."""
    force, rate, throttle = (series.get(name) for name in ("specific_force", "body_rate", "throttle"))
    flown, reason = found.intervals, found.reason
    if force is not None and throttle is not None and flown:
        flown = tuple(each for each in flown if not stayed_on_the_ground(force, throttle, *each))
        reason = reason if flown else _ON_GROUND
    if force is not None and rate is not None and flown:
        flown = tuple(each for each in flown if not is_held(force, rate, *each))
        reason = reason if flown else _HELD
    return found if flown == found.intervals else Flights(flown, reason, found.hops if flown else ())


def _until_it_rests(
    series: Mapping[str, CleanSeries], grid: FloatArray, *, powered: BoolArray, stated: BoolArray
) -> BoolArray:
    """Return where the vehicle flies: through throttle cuts and dives, but not where it lies on the ground.

    ``stated`` is what arming and land detector say. Before the first and after the last power inside it,
    the vehicle is on the ground whether it moves or not.
    """
    rests = _rests(series, grid)
    if rests is None:
        return powered
    aloft = powered.copy()
    # At once, not for each run: the means are of sums over the whole log.
    # Only with an accelerometer: a vehicle that rests does not climb.
    thrust = series.get("motor_thrust")
    if thrust is None or "specific_force" not in series:
        at_full = np.zeros(grid.shape, dtype=np.bool_)
    else:
        mean = _mean_after(thrust, grid, _MIN_PAUSE_S)
        at_full = np.asarray((mean > 1.0 - _IDLE_THROTTLE).any(axis=1), dtype=np.bool_)
    stuck = rests & at_full
    for first, after in runs(powered):
        held = np.flatnonzero(stuck[first:after])
        if held.size:
            aloft[first + held[0] : after] = False
    for first, after in runs(stated & ~aloft):
        between = first > 0 and after < grid.size and aloft[first - 1] and aloft[after]
        aloft[first:after] = between and not rests[first:after].any()
    return aloft


def _rests(series: Mapping[str, CleanSeries], grid: FloatArray) -> BoolArray | None:
    """Say from which points on the vehicle rests for as long as a pause lasts; None without rates.

    Its gyro is still, and its accelerometer, where one is logged, shows what carries it: in a fall it
    shows nothing. Where samples are too rare to tell, the vehicle may rest.
    """
    rate, force = series.get("body_rate"), series.get("specific_force")
    if rate is None or not rate.n_samples:
        return None
    n_cells = round(_MIN_PAUSE_S / _STILL_S)
    total, squares = np.zeros((2, grid.size, 3))
    for cell in range(n_cells):
        mean = _mean_after(rate, grid + cell * _STILL_S, _STILL_S)
        total += mean
        squares += mean**2
    variance = squares / n_cells - (total / n_cells) ** 2
    rests = ~(variance > np.radians(_STILL_DEG_S) ** 2).any(axis=1)
    if force is not None and force.n_samples:
        carried = np.linalg.norm(_mean_after(force, grid, _MIN_PAUSE_S), axis=1) / GRAVITY_M_S2
        rests &= ~(np.abs(carried - 1.0) > _LIFTING)
    return np.asarray(rests, dtype=np.bool_)


def _mean_after(series: CleanSeries, start_s: FloatArray, length_s: float) -> FloatArray:
    """Return means over a time from each start on, shape (n_starts, n_columns); NaN where no sample is."""
    total = np.concatenate([np.zeros((1, series.n_columns)), np.cumsum(series.values, axis=0)])
    first, after = (np.searchsorted(series.time_s, start_s + shift) for shift in (0.0, length_s))
    count = (after - first)[:, np.newaxis].astype(np.float64)
    return np.asarray((total[after] - total[first]) / np.where(count > 0.0, count, np.nan))


def _lifted(series: Mapping[str, CleanSeries], grid: FloatArray) -> BoolArray | None:
    """Say where thrust is near that of hovering, which tells a table's landing.

    None where neither thrust nor throttle was logged.
    """
    thrust = series.get("thrust_n") or series.get("throttle")
    if thrust is None or thrust.time_s.size < 2:
        return None
    values = thrust.values[:, 0]
    running = values[values > _RUNNING * np.quantile(values, _LARGEST)]
    if running.size == 0:
        return None
    # A mean: in a manoeuvre, thrust falls away for a moment.
    time_s = thrust.time_s
    total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time_s))])
    first, last = (np.clip(grid + shift, time_s[0], time_s[-1]) for shift in (-_LIFT_S / 2, _LIFT_S / 2))
    carried = np.interp(last, time_s, total) - np.interp(first, time_s, total)
    return np.asarray(carried > _LIFTING * np.median(running) * (last - first), dtype=np.bool_)


def _turning(series: Mapping[str, CleanSeries], intervals: tuple[Interval, ...]) -> tuple[Interval, ...]:
    """Return the intervals in which the vehicle turned; all of them where no rates were logged."""
    rate = series.get("body_rate")
    if rate is None:
        return intervals
    return tuple(each for each in intervals if _turns(rate, *each))


def _turns(rate: CleanSeries, start_s: float, end_s: float) -> bool:
    """Say whether some axis turned by more than noise; True where a fifth of a second holds no sample."""
    near = rate.within(start_s, end_s)
    time_s, values = rate.time_s[near], rate.of_rows(near)
    n_cells = int((end_s - start_s) / _STILL_S)
    if not 2 <= n_cells <= time_s.size:
        # Asked first: a clock that jumped far ahead must not cost memory.
        return True
    cell = ((time_s - start_s) / _STILL_S).astype(int)
    count = np.bincount(cell, minlength=n_cells)[:n_cells]
    if not count.all():
        return True
    mean = [np.bincount(cell, column, minlength=n_cells)[:n_cells] / count for column in values.T]
    return bool(np.degrees(np.std(mean, axis=1)).max() > _STILL_DEG_S)


def _in_so_short(span: Interval) -> str:
    """Say how little the log holds where that may be why it shows no flight."""
    length_s = span[1] - span[0]
    return f" in the {length_s:.2g} s that the log holds" if length_s < _SHORT_LOG_S else ""


def _from_motion(series: Mapping[str, CleanSeries]) -> Flights:
    """Without any other evidence, take the span over which the torque changes."""
    torque = series.get("torque_n_m") or series.get("torque_command") or series.get("motor_thrust")
    if torque is None:
        return Flights((), "the log shows neither arming, nor landing, nor throttle, nor torque")
    moving = np.flatnonzero(np.any(np.diff(torque.values, axis=0) != 0.0, axis=1))
    if moving.size == 0:
        return Flights((), "the torque never changes")
    return Flights(((float(torque.time_s[moving[0]]), float(torque.time_s[moving[-1] + 1])),), "")


def _held(series: CleanSeries, grid: FloatArray, before: float) -> FloatArray:
    """Return the last known value at each grid point, `before` ahead of the first one."""
    index = np.searchsorted(series.time_s, grid + 1e-9, side="right")
    return np.concatenate([[before], series.stored[:, 0]])[index]


def _state(series: CleanSeries, grid: FloatArray) -> BoolArray:
    """Return a switch's state; an event says that the state was the opposite before."""
    first = float(series.stored[0, 0])
    return _held(series, grid, before=float(first < 0.5)) > 0.5


def _above_idle(series: CleanSeries, grid: FloatArray) -> BoolArray:
    return _held(series, grid, before=float(series.stored[0, 0])) > _IDLE_THROTTLE
