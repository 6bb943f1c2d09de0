"""Caveats about the loops around the rate loop: attitude, velocity and position."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from quadid_logs.control.findings import as_evidence
from quadid_logs.control.room import Room, figures, room_of
from quadid_logs.data.closed_loop import Margins
from quadid_logs.data.diagnosis import Finding, Level
from quadid_logs.data.log import PositionRows
from quadid_logs.data.outer_loops import FEWEST_ROWS, OuterLoop, OuterLoops, Shown, shown_by
from quadid_logs.data.tuning import POOR
from quadid_logs.diagnose.findings import finding, rounded

#: An attitude that follows as a lag does, with its bandwidth at so many times the crossover of the velocity
#: loop, takes atan(1 / 2.5) = 22 degrees from it. A velocity loop has 90 less atan(I / (P w)), 76 with the
#: firmwares' gains (I = P / 2 or less, crossover at P), so that less than 45 + 9 degrees would be left.
_FASTER: Final = 2.5
#: Below, a velocity set-point rests: noise of receivers is as large [m/s].
_MOVED_M_S: Final = 0.3
_WORDS: Final = {"velocity": "velocity loop", "whole": "velocity loop inside the position loop"}
_TITLES: Final = {
    Room.UNSTABLE: "The {loop} is unstable in the model with the controllers of the parameters",
    Room.POOR: "The {loop} is close to instability",
    Room.PERHAPS_LITTLE: "The {loop} may be close to instability",
}


def find_in_outer(outer: OuterLoops | None, positions: Sequence[PositionRows]) -> Iterator[Finding]:
    """Yield the findings about the loops around the rate loop.

    Parameters
    ----------
    outer : OuterLoops or None
    positions : sequence of PositionRows
        What the log holds of the position controllers.
    """
    if outer is None:
        return
    for axis, found in outer.attitude.items():
        if found.shown is Shown.DIFFERS:
            evidence: dict[str, object] = {"relative_rms": rounded(found.relative_rms, 3)}
            if found.gain is not None:
                evidence["gain_over_parameter"] = as_evidence(found.gain)
            yield finding("QL650", "warning", evidence, axes=(axis,))
    # The gains of one direction that the log contradicts, over those of the parameters.
    differing: dict[str, object] = {}
    for direction, replay in outer.cascades.items():
        gains = {"position_gain": replay.position, "velocity_gain": replay.velocity}
        told = {
            f"{name}_over_parameter": as_evidence(gain)
            for name, gain in gains.items()
            if gain is not None and shown_by(gain) is Shown.DIFFERS
        }
        if told:
            differing[direction] = told
    if differing:
        yield finding("QL651", "info", differing)
    behind: dict[str, object] = {
        direction: {
            "velocity_error_m_s": rounded(found.velocity_error_m_s, 3),
            "set_point_moved_m_s": rounded(found.velocity_moved_m_s, 3),
        }
        for direction, found in outer.cascades.items()
        if found.velocity_moved_m_s >= _MOVED_M_S and found.velocity_error_m_s > found.velocity_moved_m_s
    }
    if behind:
        yield finding("QL654", "info", behind)
    yield from _margins(outer.loops)
    slow: dict[str, object] = {
        axis: {
            "attitude_hz": rounded(loop.attitude_hz.value, 3),
            "velocity_crossover_hz": rounded(crossover.value, 3),
        }
        for axis, loop in outer.loops.items()
        if (crossover := loop.velocity.crossover_hz) is not None
        and loop.attitude_hz.value < _FASTER * crossover.value
    }
    if slow:
        yield finding("QL653", "info", slow, axes=tuple(slow))
    # In modes that hold a height alone no velocity is commanded.
    targets = (each.values.get("velocity_target") for each in positions if each.direction != "down")
    commanded = (0 if one is None else np.count_nonzero(np.isfinite(one)) for one in targets)
    if not outer.loops and any(n_rows >= FEWEST_ROWS for n_rows in commanded):
        # What is missing for a velocity loop.
        yield finding(
            "QL655",
            "info",
            {
                "gains_known": outer.controllers.horizontal is not None,
                "rows_of_controllers": {axis: found.n_rows for axis, found in outer.cascades.items()},
            },
        )


def _margins(loops: Mapping[str, OuterLoop]) -> Iterator[Finding]:
    """Yield the finding about the velocity loop with all that is known to close it, where it lacks margin."""
    # With the default gains of firmwares 40 to 80 degrees are left, which flies well: only the
    # limits below which a loop is close to instability judge these.
    rooms = {axis: room_of(outermost(found), POOR) for axis, found in loops.items()}
    lacking = {axis: room for axis, room in rooms.items() if room is not Room.ENOUGH}
    if not lacking:
        return
    worst = min(lacking.values())
    name = "whole" if any(loops[axis].whole is not None for axis in lacking) else "velocity"
    evidence: dict[str, object] = {}
    for axis in lacking:
        margins = outermost(loops[axis])
        evidence[axis] = (
            {name: as_evidence(each) for name, (each, _) in figures(margins).items() if each is not None}
            if margins.stable
            else {"stable_fraction": rounded(margins.stable_fraction)}
        )
    title = _TITLES[worst].format(loop=_WORDS[name])
    level: Level = "warning" if worst <= Room.POOR else "info"
    yield finding("QL652", level, evidence, axes=tuple(lacking), title=title)


def outermost(found: OuterLoop) -> Margins:
    """Return the margins with the position loop where there is one."""
    return found.velocity if found.whole is None else found.whole
