"""How the vehicle follows what was asked of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from quadid_logs.align.series import GAP_PERIODS, CleanSeries, Interval
from quadid_logs.arrays import BoolArray, FloatArray, runs
from quadid_logs.data.health import AxisTracking, Level, Quantity, Tracking
from quadid_logs.health.records import in_flight, records
from quadid_logs.maths.intervals import inside
from quadid_logs.maths.rotations import unwrapped
from quadid_logs.numerals import number
from quadid_logs.sentences import listed
from quadid_logs.vocabulary import AXES

#: Roll or pitch further than this from its set-point for longer than that: a published analyzer of logs
#: warns, and at the second angle fails (source: docs/health.md) [rad, s].
_WARN_RAD, _FAIL_RAD, _LASTS_S = (*np.radians((5.0, 10.0)), 0.25)
#: Who follows late follows: three time constants of an attitude loop (5 % of a step are left then) at the
#: lowest angle gain of firmwares' defaults, 4.5 1/s (docs/health.md) [s].
_LATE_S: Final = 3.0 / 4.5
#: What turns the vehicle against a set-point by more than this, for longer than it may be late, is no gust:
#: the largest heading error that a firmware's attitude controller acts on (docs/health.md) [rad].
_AGAINST_RAD: Final = float(np.radians(45.0))
#: Roll and pitch are judged; the nose may lag far behind a turn that was commanded at once.
_TILTING: Final = 2


def find_tracking(
    actual: CleanSeries,
    setpoint: CleanSeries,
    intervals: Sequence[Interval],
    lags: Mapping[str, Quantity],
    *,
    of: str,
    undisturbed: Sequence[Interval] | None = None,
) -> Tracking | None:
    """Compare set-points with what was flown.

    Parameters
    ----------
    actual, setpoint : CleanSeries
        Both in rad/s, or both in rad.
    intervals : sequence of (start_s, end_s)
        Of flight.
    lags : mapping of str to Quantity
        By axis, where the flight tells.
    of : {"rates", "angles"}
        Angles are compared modulo a turn.
    undisturbed : sequence of (start_s, end_s), optional
        Where no system-ID mode moves the vehicle past its set-points; all of the flight by default.

    Returns
    -------
    Tracking or None
        None where both are not logged together in flight.
    """
    together, _ = records([setpoint, actual], intervals)
    if not together:
        return None
    if np.array_equal(setpoint.time_s, actual.time_s):
        together = [in_flight(one, intervals) for one in (setpoint, actual)]
        time_s, values = together[0].time_s, np.column_stack([one.values for one in together])
    else:
        time_s, values = (np.concatenate(parts) for parts in zip(*together, strict=True))
    angles = of == "angles"
    unit = "rad" if angles else "rad/s"
    axes, distances = {}, []
    for column, axis in enumerate(AXES):
        asked, flown = values[:, column], values[:, len(AXES) + column]
        error = asked - flown
        if angles:
            error = (error + np.pi) % (2.0 * np.pi) - np.pi
            asked = unwrapped(asked[:, np.newaxis])[:, 0]
            distances.append(_not_asked(time_s, asked, asked - error))
        axes[axis] = AxisTracking(
            error_rms=Quantity(float(np.sqrt(np.mean(error**2))), unit),
            setpoint_rms=Quantity(float(np.std(asked)), unit),
            lag=lags.get(axis),
        )
    if not angles:
        return _rates(axes, time_s, values, intervals if undisturbed is None else undisturbed)
    # For how much of the flight roll or pitch stays off what was asked, by how much.
    worst = np.maximum.reduce(distances[:_TILTING])
    if not np.ptp(values[:, :_TILTING], axis=0).any():
        return Tracking(
            sentence=f"{_sentence(axes, of)} {_fixed(float(worst.max()))}", axes=axes, judged=True
        )
    step_s = float(np.median(np.diff(time_s)))
    off_s, largest, at_s = 0.0, 0.0, np.nan
    for first, after in _unbroken(time_s, worst > _WARN_RAD, step_s):
        length_s = float(time_s[after - 1] - time_s[first]) + step_s
        if length_s >= _LASTS_S:
            off_s += length_s
            place = first + int(np.argmax(worst[first:after]))
            if worst[place] > largest:
                largest, at_s = float(worst[place]), float(time_s[place])
    share = min(off_s / (step_s * time_s.size), 1.0)
    warn, fail, most = (float(np.degrees(one)) for one in (_WARN_RAD, _FAIL_RAD, largest))
    level: Level = "normal" if not off_s else "severe" if largest >= _FAIL_RAD else "high"
    if not off_s:
        judged = (
            f"Roll and pitch follow their set-points: apart from delays of up to {_LATE_S:.1f} s, they "
            f"never miss them by more than {warn:.0f} deg for longer than {_LASTS_S:g} s. That is normal."
        )
    else:
        limit = (
            f"above {fail:.0f} deg the vehicle does not follow"
            if level == "severe"
            else "in a normal flight that never happens"
        )
        judged = (
            f"Roll or pitch misses its set-points by more than {warn:.0f} deg in {number(100.0 * share, 2)} "
            f"% of the flight, by up to {most:.0f} deg (at {at_s:.1f} s): {limit}. Delays of up to "
            f"{_LATE_S:.1f} s and misses shorter than {_LASTS_S:g} s do not count."
        )
    off = Quantity(share, "1", normal=(0.0, 0.0))
    return Tracking(sentence=f"{_sentence(axes, of)} {judged}", axes=axes, level=level, off=off)


def _fixed(largest_rad: float) -> str:
    """Say what set-points that stay the same all the time tell: those that no log holds are zero."""
    told = "The set-points of roll and pitch never change in the flight"
    if largest_rad <= _WARN_RAD:
        return f"{told}, so the log does not show whether the vehicle follows."
    return (
        f"{told}, and the vehicle is up to {np.degrees(largest_rad):.0f} deg away from them. Either these "
        "are not the set-points that it flew by, or it does not follow them."
    )


def _rates(
    axes: Mapping[str, AxisTracking],
    time_s: FloatArray,
    values: FloatArray,
    undisturbed: Sequence[Interval],
) -> Tracking:
    """Judge rates by how much they miss, and whether one turned against its set-point."""
    little = [
        axis for axis, one in axes.items() if not 2.0 * one.error_rms.value**2 < one.setpoint_rms.value**2
    ]
    beyond = [axis for axis in little if not axes[axis].error_rms.value < axes[axis].setpoint_rms.value]
    against = {axis: told for axis in beyond if (told := _against(axis, time_s, values, undisturbed))}
    judged = list(against.values())
    missing = [axis for axis in beyond or little if axis not in against]
    if missing:
        told, too = (
            ("the set-points by as much as these move, or more", "instead")
            if beyond
            else ("more than half of the set-points' power", "as well")
        )
        judged.append(
            f"{listed(missing).capitalize()} {'misses' if len(missing) == 1 else 'miss'} {told}: gusts, "
            f"vibration, an oscillation or a limit move the vehicle {too}. That is normal only in a hover "
            "without commands, or during a system-ID run."
        )
    if not judged:
        judged = ["Every axis follows more of its set-points than it misses (in power), which is normal."]
    return Tracking(
        sentence=" ".join([_sentence(axes, "rates"), *judged]),
        level="severe" if against else "fact",
        findings=("QL437",) if against else (),
        axes=axes,
        judged=True,
    )


def _against(axis: str, time_s: FloatArray, values: FloatArray, undisturbed: Sequence[Interval]) -> str:
    """Say when an axis turned furthest against its set-point; "" where it only was late or was pushed."""
    asked, flown = values[:, AXES.index(axis)], values[:, len(AXES) + AXES.index(axis)]
    step_s = float(np.median(np.diff(time_s)))
    furthest, told = _AGAINST_RAD, ""
    for first, after in _unbroken(time_s, (asked * flown < 0.0) & inside(time_s, undisturbed), step_s):
        length_s = float(time_s[after - 1] - time_s[first]) + step_s
        turned = float(np.abs(flown[first:after].mean())) * length_s
        if length_s > _LATE_S and turned > furthest:
            furthest = turned
            told = (
                f"From {time_s[first]:.1f} s on, {axis} turned against its set-points for {length_s:.1f} s, "
                f"at {np.degrees(turned / length_s):.0f} deg/s on average: the motors could not give the "
                "torque that it needs, turned it the wrong way, or gave it too slowly. That is never normal."
            )
    return told


def _not_asked(time_s: FloatArray, asked: FloatArray, flown: FloatArray) -> FloatArray:
    """Return how far each angle is from all that was asked in the last moments, both unwrapped."""
    n_rows = 1 + int(np.ceil(_LATE_S / float(np.median(np.diff(time_s)))))
    low, high = (_over_last(which, asked, n_rows) for which in (np.minimum, np.maximum))
    return np.asarray(np.maximum(np.maximum(low - flown, flown - high), 0.0), dtype=np.float64)


def _over_last(which: np.ufunc, values: FloatArray, n_rows: int) -> FloatArray:
    """Return the least or the largest of so many rows up to each, of fewer at the beginning.

    Not scipy.ndimage: importing it takes longer than all of this module.
    """
    found = np.concatenate([np.full(n_rows - 1, values[0]), values])
    width = 1
    while width < n_rows:
        more = min(width, n_rows - width)
        found = which(found[more:], found[:-more])
        width += more
    return np.asarray(found, dtype=np.float64)


def _unbroken(time_s: FloatArray, mask: BoolArray, step_s: float) -> list[tuple[int, int]]:
    """Return first index and index after the last of each run without a pause of the log."""
    pauses = np.flatnonzero(np.diff(time_s) > GAP_PERIODS * step_s) + 1
    found = []
    for first, after in runs(mask):
        inside = pauses[(pauses > first) & (pauses < after)].tolist()
        found += list(pairwise([first, *inside, after]))
    return found


def _sentence(axes: Mapping[str, AxisTracking], of: str) -> str:
    unit = "deg" if of == "angles" else "deg/s"
    errors, moved = (
        ", ".join(f"{axis} {number(float(np.degrees(one.value)), 2)}" for axis, one in some.items())
        for some in (
            {axis: one.error_rms for axis, one in axes.items()},
            {axis: one.setpoint_rms for axis, one in axes.items()},
        )
    )
    told = f"Error against the set-points (rms): {errors} {unit}."
    if of == "rates":
        told += f" Motion of the set-points (rms): {moved} {unit}."
    late = [f"{axis} {1e3 * one.lag.value:.0f} ms" for axis, one in axes.items() if one.lag is not None]
    return f"{told} Lag: {', '.join(late)}." if late else told
