"""What needs neither set-points nor motor outputs: rates, tilt, throttle, thrust and steady torque."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.arrays import FloatArray
from quadid_logs.data.health import Course, Level, Quantity
from quadid_logs.health.records import Record, averaged, in_flight, records
from quadid_logs.maths.rotations import tilt_from_rates
from quadid_logs.numerals import number
from quadid_logs.vocabulary import AXES, GRAVITY_M_S2

#: Fewer samples show no course.
_FEWEST: Final = 10
#: What gyros measure on flight controllers, as firmware sets them (sources: docs/health.md) [deg/s].
_GYRO_DEG_S: Final = 2000.0
#: Calibrated scales differ from one by about this.
_SAME_RANGE: Final = 0.02
#: Autopilots' detectors of a failure act beyond, by default (source: docs/health.md) [deg].
_FAILING_TILT_DEG: Final = 60.0
#: Hover throttle is usually in this range (source: docs/health.md); a published analyzer of logs calls a
#: vehicle underpowered that does not climb above the third.
_HOVER: Final = (0.2, 0.6)
_UNDERPOWERED: Final = 0.7
#: A throttle that is shown as 100 %.
_AT_END: Final = 0.995
#: 99 % of the flight: a few samples of a log may be anything.
_NEARLY_ALL: Final = 99.0


def find_rates(rate: CleanSeries, intervals: Sequence[Interval]) -> Course | None:
    """Say how fast the vehicle turns, and whether a gyro still measures that.

    Parameters
    ----------
    rate : CleanSeries
        Body rates [rad/s].
    intervals : sequence of (start_s, end_s)
        Of flight.

    Returns
    -------
    Course or None
        None where it was hardly logged in flight.
    """
    record = _flown(rate, intervals)
    if record is None:
        return None
    size = np.degrees(np.abs(record.values))
    fast = np.percentile(size, _NEARLY_ALL, axis=0)
    highest = float(size.max())
    clipped = highest >= (1.0 - _SAME_RANGE) * _GYRO_DEG_S
    beyond = highest > (1.0 + _SAME_RANGE) * _GYRO_DEG_S
    told = f"In 99 % of the flight the rates stay below these values: {_by_axis(fast, 2)} deg/s. "
    told += f"The fastest is {highest:.0f} deg/s, "
    told += (
        f"more than most gyros measure ({_GYRO_DEG_S:.0f} deg/s). Such numbers may be wrong."
        if beyond
        else "close to the end of most gyros' range."
        if clipped
        else f"which most gyros measure (up to {_GYRO_DEG_S:.0f} deg/s)."
    )
    return _course(
        record,
        sentence=told,
        level="high" if clipped else "normal",
        label="body rate",
        unit="deg/s",
        columns=AXES,
        scale=float(np.degrees(1.0)),
        figures={
            **{axis: Quantity(float(np.radians(one)), "rad/s") for axis, one in zip(AXES, fast, strict=True)},
            "highest": Quantity(
                float(np.radians(highest)), "rad/s", normal=(0.0, float(np.radians(_GYRO_DEG_S)))
            ),
        },
    )


def find_tilt(attitude: CleanSeries, intervals: Sequence[Interval]) -> Course | None:
    """Say how far the vehicle leans from the vertical.

    Parameters
    ----------
    attitude : CleanSeries
        Euler angles [rad].
    intervals : sequence of (start_s, end_s)
        Of flight.

    Returns
    -------
    Course or None
        None where it was hardly logged in flight.
    """
    record = _flown(attitude, intervals)
    if record is None:
        return None
    record = _tilt_deg(record.time_s, record.values)
    most = float(np.percentile(record.values, _NEARLY_ALL))
    within = most <= _FAILING_TILT_DEG
    told = f"In 99 % of the flight the vehicle tilts by less than {number(most, 2)} deg, "
    told += (
        f"which is normal (below {_FAILING_TILT_DEG:.0f})."
        if within
        else (
            f"more than the {_FAILING_TILT_DEG:.0f} deg of normal flight. The cause is acrobatics, a loss of "
            "control, or a vehicle that is carried."
        )
    )
    return _course(
        record,
        sentence=told,
        level="normal" if within else "fact",
        judged=True,
        label="tilt",
        unit="deg",
        columns=("tilt",),
        limits=((_FAILING_TILT_DEG, "above this: acrobatics or a loss of control"),),
        figures={"p99": _below_failing(most)},
    )


def find_tumble(rate: CleanSeries, hops: Sequence[Interval]) -> Course | None:
    """Say how far the vehicle leans right after a take-off that no flight follows, by its gyro alone.

    An estimator that was shaken, or restarted, says little of such moments.

    Parameters
    ----------
    rate : CleanSeries
        Body rates [rad/s].
    hops : sequence of (start_s, end_s)
        From take-off, where the vehicle stands level, to touch-down.

    Returns
    -------
    Course or None
        None where it was hardly logged.
    """
    # However short: a small quad reaches 1000 rad/s^2, and leans by 60 degrees in 0.05 s.
    found, period_s = records([rate], hops, shortest_s=_FEWEST * rate.period_s)
    if not found:
        return None
    angles = [tilt_from_rates(one.values, period_s, math.inf) for one in found]
    record = _tilt_deg(np.concatenate([one.time_s for one in found]), np.concatenate(angles))
    most, hop_s = float(record.values.max()), sum(end_s - start_s for start_s, end_s in hops)
    told = f"The vehicle may have been in the air for {number(hop_s, 2)} s. By its gyro it tilted by up to "
    told += f"{number(most, 2)} deg, "
    if most <= _FAILING_TILT_DEG:
        told += f"which is normal (below {_FAILING_TILT_DEG:.0f})."
    else:
        first = int(np.argmax(record.values[:, 0] > _FAILING_TILT_DEG))
        begun = max(start_s for start_s, _ in hops if start_s <= record.time_s[first])
        told += (
            f"{_FAILING_TILT_DEG:.0f} deg {number(float(record.time_s[first]) - begun, 2)} s after leaving "
            "the ground: it turned over. Before the next take-off check the order and the direction of the "
            "motors, the propellers, and how the flight controller is mounted."
        )
    return _course(
        record,
        sentence=told,
        level="normal" if most <= _FAILING_TILT_DEG else "severe",
        label="tilt by the gyro",
        unit="deg",
        columns=("tilt",),
        limits=((_FAILING_TILT_DEG, "beyond, it turns over"),),
        figures={"highest": _below_failing(most)},
    )


def find_throttle(throttle: CleanSeries, intervals: Sequence[Interval]) -> Course | None:
    """Say how much of its power the vehicle needs.

    Parameters
    ----------
    throttle : CleanSeries
        0 to 1.
    intervals : sequence of (start_s, end_s)
        Of flight.

    Returns
    -------
    Course or None
        None where it was hardly logged in flight, or never changes.
    """
    record = _flown(throttle, intervals)
    if record is None:
        return None
    # More than all is no throttle: tables hold extrapolated rows.
    possible = record.values[:, 0] <= 2.0 - _AT_END
    record = Record(record.time_s[possible], record.values[possible, :1])
    if not 2 * np.count_nonzero(possible) > possible.size or not np.ptp(record.values) > 0.0:
        return None
    # As it is shown: a limit is not passed by what is rounded away.
    half, most = (round(float(one), 2) for one in np.percentile(record.values, [50.0, _NEARLY_ALL]))
    low, high = _HOVER
    told = f"The median throttle is {_percent(half)}, "
    level: Level = "normal"
    cut = record.values <= 1.0 - _AT_END
    rest = float(np.median(record.values[~cut])) if cut.any() and not cut.all() else half
    if half < low <= rest:
        level = "fact"
        told += (
            f"and {_percent(rest)} without the {number(100.0 * float(np.mean(cut)), 2)} % of the flight at "
            "its lower end. It does not show the hover throttle."
        )
    elif half < low:
        told += f"less than the {_percent(low)} of most vehicles in hover: there is power in reserve."
    elif half <= high:
        told += f"which is normal (most vehicles hover at {_percent(low)} to {_percent(high)})."
    else:
        level = "high" if half <= _UNDERPOWERED else "severe"
        told += (
            f"more than the {_percent(high)} of most vehicles in hover: little is left for climbing and "
            "correcting."
        )
    if most < 1.0:
        told += f" The throttle stays below {_percent(most)} in 99 % of the flight."
    else:
        at_end = 100.0 * float(np.mean(record.values >= _AT_END))
        told += f" The throttle is at its upper end in {number(at_end, 2)} % of the flight."
    return _course(
        record,
        sentence=told,
        level=level,
        label="throttle",
        unit="%",
        columns=("throttle",),
        scale=100.0,
        limits=((100.0 * high, "most vehicles hover below"),),
        figures={"median": Quantity(half, "1", normal=_HOVER), "p99": Quantity(most, "1")},
    )


def find_thrust(
    thrust: CleanSeries, attitude: CleanSeries | None, intervals: Sequence[Interval]
) -> Course | None:
    """Say what mass the logged newtons carry: that of the vehicle, if they are newtons.

    Parameters
    ----------
    thrust : CleanSeries
        Collective [N].
    attitude : CleanSeries or None
        Euler angles [rad]; without them the vehicle is taken to be level.
    intervals : sequence of (start_s, end_s)
        Of flight.

    Returns
    -------
    Course or None
        None where it was hardly logged in flight.

    Notes
    -----
    Over a flight the vertical acceleration has a mean of nearly zero, so that the mean of the thrust's
    vertical part is the weight.
    """
    record = _flown(thrust, intervals)
    if record is None:
        return None
    lifted = record.values[:, 0]
    if attitude is not None:
        upright = _upright(attitude.values)
        lifted = lifted * np.interp(record.time_s, attitude.time_s, upright, left=np.nan, right=np.nan)
    mass_kg = float(np.mean(lifted[np.isfinite(lifted)])) / GRAVITY_M_S2
    if not mass_kg > 0.0:
        return None
    words = f"{number(1e3 * mass_kg, 3)} g" if mass_kg < 1.0 else f"{number(mass_kg, 3)} kg"
    return _course(
        record,
        sentence=(
            f"The logged thrust carries {words} on average. If the vehicle's mass differs, the newtons and "
            "newton metres of this log are wrong by the same factor."
        ),
        judged=True,
        label="thrust",
        unit="N",
        columns=("thrust",),
        limits=((mass_kg * GRAVITY_M_S2, f"weight of {words}"),),
        figures={"mass": Quantity(mass_kg, "kg")},
    )


def find_torque(
    torque: CleanSeries, thrust: CleanSeries | None, intervals: Sequence[Interval]
) -> Course | None:
    """Say how much torque the controller holds all the time, which a balanced vehicle does not need.

    Parameters
    ----------
    torque : CleanSeries
        Commanded, in any unit.
    thrust : CleanSeries or None
        In the unit of the torque over metres.
    intervals : sequence of (start_s, end_s)
        Of flight.

    Returns
    -------
    Course or None
        None where it was hardly logged in flight, or an axis never changes.

    Notes
    -----
    Rotors whose thrust T acts off the centre of mass by x forward and y to the right need the torques T x
    in pitch and -T y in roll (body axes FRD).
    """
    record = _flown(torque, intervals)
    if record is None:
        return None
    mean, moved = record.values.mean(axis=0), record.values.std(axis=0)
    if not (moved > 0.0).all():
        return None
    share = mean / moved
    told = f"Steady part of the torque, relative to its rms variation: {_by_axis(100.0 * share, 2)} %. "
    told += "A balanced vehicle in still air needs none."
    figures = {axis: Quantity(float(one), "1") for axis, one in zip(AXES, share, strict=True)}
    lift = None if thrust is None else _flown(thrust, intervals)
    if lift is not None and float(lift.values[:, 0].mean()) > 0.0:
        ahead, right = mean[[1, 0]] / float(lift.values[:, 0].mean()) * (1.0, -1.0)
        along, across = "ahead" if ahead > 0.0 else "behind", "right" if right > 0.0 else "left"
        told += (
            " If all rotors are alike, this holds a centre of mass that lies "
            f"{number(1000.0 * abs(ahead), 2)} mm {along} and {number(1000.0 * abs(right), 2)} mm to the "
            f"{across} of the rotors' middle."
        )
        figures |= {"ahead": Quantity(float(ahead), "m"), "right": Quantity(float(right), "m")}
    unit = "1" if torque.name == "torque_command" and torque.normalised else "N m"
    return _course(
        record, sentence=told, judged=True, label="torque", unit=unit, columns=AXES, figures=figures
    )


def _course(
    record: Record,
    *,
    sentence: str,
    label: str,
    unit: str,
    columns: tuple[str, ...],
    figures: dict[str, Quantity],
    level: Level = "fact",
    judged: bool = False,
    scale: float = 1.0,
    limits: tuple[tuple[float, str], ...] = (),
) -> Course:
    short = averaged(record)
    return Course(
        sentence=sentence,
        level=level,
        judged=judged,
        label=label,
        unit=unit,
        columns=columns,
        figures=figures,
        limits=limits,
        time_s=short.time_s,
        values=scale * short.values,
    )


def _flown(series: CleanSeries, intervals: Sequence[Interval]) -> Record | None:
    """Return what was logged in flight, without what is no number; None where that is too little."""
    record = in_flight(series, intervals)
    good = np.isfinite(record.values).all(axis=1)
    if np.count_nonzero(good) < _FEWEST:
        return None
    return Record(record.time_s[good], record.values[good])


def _upright(angles: FloatArray) -> FloatArray:
    """Return the cosine of the angle between the body's and the Earth's vertical."""
    return np.asarray(np.clip(np.cos(angles[:, 0]) * np.cos(angles[:, 1]), -1.0, 1.0), dtype=np.float64)


def _tilt_deg(time_s: FloatArray, angles: FloatArray) -> Record:
    """Return the angle between the body's and the Earth's vertical over time [deg]."""
    return Record(time_s, np.degrees(np.arccos(_upright(angles)))[:, np.newaxis])


def _below_failing(tilt_deg: float) -> Quantity:
    """Return a tilt beside what is normal."""
    return Quantity(float(np.radians(tilt_deg)), "rad", normal=(0.0, float(np.radians(_FAILING_TILT_DEG))))


def _by_axis(values: FloatArray, digits: int) -> str:
    return ", ".join(f"{axis} {number(float(one), digits)}" for axis, one in zip(AXES, values, strict=True))


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.0f} %"
