"""A flight, and what earlier ones of the same vehicle tell of it as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath

from quadid_logs.align.pool import copies
from quadid_logs.control.earlier_flights import with_earlier as joined
from quadid_logs.data.closed_loop import AxisLoop
from quadid_logs.data.result import EarlierFlight, Result
from quadid_logs.errors import SettingsError
from quadid_logs.untrusted import printable


def with_earlier(result: Result, earlier: Sequence[Result]) -> Result:
    """Return a result whose loops are closed around the vehicles that it and earlier flights allow together.

    Gains are recommended from it as from any other: with narrower intervals, and without the modes of the
    frame that an earlier flight rules out.

    Parameters
    ----------
    result : Result
        Of the flight with the gains that are set now.
    earlier : sequence of Result
        Of the same vehicle, whatever its gains were. A log that holds the flights of another adds nothing. An
        axis that differs from any of them by more than chance stays as it is, and is not tuned (QL626).

    Returns
    -------
    Result

    Raises
    ------
    SettingsError
        If a log says that it is of another vehicle.
    """
    for one in earlier:
        _check_same_vehicle(result, one)
    again = copies([each.data for each in (result, *earlier)])
    others = [one for place, one in enumerate(earlier, start=1) if place not in again]
    now = result.closed_loop
    if now is None or not others:
        return result
    found = {
        axis: joined(loop, controller, [_loop(one, axis) for one in others])
        for axis, loop in now.axes.items()
        if (controller := now.controllers.axes.get(axis)) is not None
    }
    axes = {**now.axes, **{axis: one.loop for axis, one in found.items()}}
    return replace(
        result,
        closed_loop=replace(now, axes=axes),
        earlier=tuple(
            EarlierFlight(
                path=one.log.path,
                axes=tuple(axis for axis, each in found.items() if place in each.used),
                differ=tuple(axis for axis, each in found.items() if place in each.differ),
            )
            for place, one in enumerate(others)
        ),
    )


def _loop(result: Result, axis: str) -> AxisLoop:
    loops = {} if result.closed_loop is None else result.closed_loop.axes
    return loops.get(axis, AxisLoop())


def _check_same_vehicle(result: Result, earlier: Result) -> None:
    """Refuse a log of another autopilot, frame or board."""
    for name in ("autopilot", "frame", "hardware_id"):
        own, other = getattr(result.log, name), getattr(earlier.log, name)
        if own and other and own != other:
            raise SettingsError(
                f"{printable(PurePath(earlier.log.path).name)} is of another vehicle: its "
                f"{name.replace('_id', '')} is not that of {printable(PurePath(result.log.path).name)}.",
                hint="Give earlier flights of the same vehicle.",
            )
