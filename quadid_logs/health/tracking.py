"""How the vehicle follows what was asked of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.arrays import FloatArray
from quadid_logs.data.health import AxisTracking, Quantity, Tracking
from quadid_logs.health.records import in_flight, records
from quadid_logs.maths.rotations import unwrapped
from quadid_logs.numerals import number
from quadid_logs.vocabulary import AXES


def find_tracking(
    actual: CleanSeries,
    setpoint: CleanSeries,
    intervals: Sequence[Interval],
    lags: Mapping[str, Quantity],
    *,
    of: str,
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

    Returns
    -------
    Tracking or None
        None where both are not logged together in flight.
    """
    values = _side_by_side(setpoint, actual, intervals)
    if values is None:
        return None
    angles = of == "angles"
    unit = "rad" if angles else "rad/s"
    axes = {}
    for column, axis in enumerate(AXES):
        asked, flown = values[:, column], values[:, len(AXES) + column]
        error = asked - flown
        if angles:
            error = (error + np.pi) % (2.0 * np.pi) - np.pi
            asked = unwrapped(asked[:, np.newaxis])[:, 0]
        axes[axis] = AxisTracking(
            error_rms=Quantity(_rms(error), unit),
            setpoint_rms=Quantity(float(np.std(asked)), unit),
            lag=lags.get(axis),
        )
    return Tracking(sentence=_sentence(axes, of), axes=axes)


def _side_by_side(
    setpoint: CleanSeries, actual: CleanSeries, intervals: Sequence[Interval]
) -> FloatArray | None:
    """Return the columns of both, None where they are not logged together.

    Of one message the rows themselves: between two samples of a slow log a line would take away a part of
    what is fast.
    """
    found, _ = records([setpoint, actual], intervals)
    if not found:
        return None
    if np.array_equal(setpoint.time_s, actual.time_s):
        return np.column_stack([in_flight(one, intervals).values for one in (setpoint, actual)])
    return np.concatenate([one.values for one in found])


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _sentence(axes: Mapping[str, AxisTracking], of: str) -> str:
    unit = "deg" if of == "angles" else "deg/s"
    errors, moved = (
        ", ".join(f"{axis} {number(float(np.degrees(one.value)), 2)}" for axis, one in some.items())
        for some in (
            {axis: one.error_rms for axis, one in axes.items()},
            {axis: one.setpoint_rms for axis, one in axes.items()},
        )
    )
    told = f"The {of} miss their set-points by: {errors} {unit} rms."
    if of == "rates":
        told += f" The set-points move by: {moved} {unit} rms."
    late = [f"{axis} {1e3 * one.lag.value:.0f} ms" for axis, one in axes.items() if one.lag is not None]
    return f"{told} They lag by: {', '.join(late)}." if late else told
