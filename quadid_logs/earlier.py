"""Combination of a flight with earlier flights of the same vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath

from quadid_logs.align.pool import copies
from quadid_logs.control.command_units import per_command
from quadid_logs.control.earlier_flights import Joined, by_earlier
from quadid_logs.control.earlier_flights import with_earlier as joined
from quadid_logs.control.guard import crosses_where_known, tells_too_little
from quadid_logs.data.closed_loop import AxisLoop, ClosedLoop
from quadid_logs.data.controller import AxisController
from quadid_logs.data.result import EarlierFlight, Result
from quadid_logs.errors import SettingsError
from quadid_logs.identify.select import most_excited
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES


def with_earlier(result: Result, earlier: Sequence[Result]) -> Result:
    """Return a result whose plant samples combine the flight with earlier flights.

    The result can be tuned like any other. Its intervals are narrower, and structural modes that an earlier
    flight rules out are omitted.

    Parameters
    ----------
    result : Result
        Result of the flight with the current gains.
    earlier : sequence of Result
        Results of the same vehicle with any gains, in order of time. A log with the same flights as another
        adds nothing. An axis that differs significantly from an earlier flight is unchanged and not tuned
        (QL626). An axis that this flight does not identify takes the plants of earlier flights, if nothing
        contradicts them (QL627).

    Raises
    ------
    SettingsError
        If a log names another vehicle.
    """
    for one in earlier:
        # Refuse a log with another autopilot, frame or board.
        for name in ("autopilot", "frame", "hardware_id"):
            own, other = getattr(result.log, name), getattr(one.log, name)
            if own and other and own != other:
                raise SettingsError(
                    f"{printable(PurePath(one.log.path).name)} is from another vehicle: its "
                    f"{name.replace('_id', '')} differs from that of "
                    f"{printable(PurePath(result.log.path).name)}.",
                    hint="Give earlier flights of the same vehicle.",
                )
    again = copies([each.data for each in (result, *earlier)])
    others = [one for place, one in enumerate(earlier, start=1) if place not in again]
    now = result.closed_loop
    if now is None or not others:
        return result
    found = {
        axis: _joined(result, now, axis, controller, others)
        for axis in now.axes
        if (controller := now.controllers.axes.get(axis)) is not None
    }
    axes = {**now.axes, **{axis: _begun(axis, one, others) for axis, one in found.items()}}
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


def _joined(
    result: Result, now: ClosedLoop, axis: str, controller: AxisController, earlier: Sequence[Result]
) -> Joined:
    """Combine an axis with earlier flights, or take it from them if this flight does not identify it."""
    loop, model = now.axes[axis], result.identification.recommended
    if loop.plants is not None:
        return joined(loop, controller, [one.loop_of(axis) or AxisLoop() for one in earlier])
    if model is None or not tells_too_little(result.diagnosis, axis):
        return Joined(loop)
    data, model = per_command(most_excited(result.data, result.settings.identify.most_samples), model)
    usable = [one.verdict.get(axis) == "usable" for one in earlier]
    told = [
        (one.loop_of(axis) if sound or tells_too_little(one.diagnosis, axis) else None) or AxisLoop()
        for sound, one in zip(usable, earlier, strict=True)
    ]
    found = by_earlier(loop, data, model, AXES.index(axis), controller, told)
    # If all flights have the verdict caution, only measured quantities count, as for a single flight.
    if any(usable[place] for place in found.used) or crosses_where_known(found.loop) or found.differ:
        return found
    return Joined(loop)


def _begun(axis: str, found: Joined, earlier: Sequence[Result]) -> AxisLoop:
    """Return the loop of an axis with the controller that the first of its flights had."""
    first = None if not found.used else earlier[min(found.used)].closed_loop
    return replace(found.loop, began=None if first is None else first.controllers.axes.get(axis))
