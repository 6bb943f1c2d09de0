"""Caveats about the loops around the rate loop: attitude, velocity and position."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from quadid_logs.control.room import Room, figures, room_of
from quadid_logs.data.closed_loop import Estimated, Margins
from quadid_logs.data.diagnosis import Finding, Level
from quadid_logs.data.log import PositionRows
from quadid_logs.data.outer_loops import FEWEST_ROWS, CascadeReplay, OuterLoop, OuterLoops, Shown, shown_by
from quadid_logs.data.tuning import POOR
from quadid_logs.diagnose.findings import finding, rounded

#: An attitude that follows as a lag does, with its bandwidth at so many times the crossover of the velocity
#: loop, takes atan(1 / 2.5) = 22 degrees from it. A velocity loop has 90 less atan(I / (P w)), 76 with the
#: firmwares' gains (I = P / 2 or less, crossover at P), so that less than 45 + 9 degrees would be left.
_FASTER: Final = 2.5
#: Below, a velocity set-point rests: noise of receivers is as large [m/s].
_MOVED_M_S: Final = 0.3
_WORDS: Final = {"velocity": "velocity loop", "whole": "velocity loop with the position loop around it"}
_TITLES: Final = {
    Room.UNSTABLE: "With the controllers of the parameters, the {loop} is unstable in this model",
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

    Yields
    ------
    Finding
    """
    if outer is None:
        return
    yield from _attitude(outer)
    yield from _cascades(outer)
    yield from _margins(outer.loops)
    slow = {axis: found for axis, found in outer.loops.items() if _slow(found)}
    if slow:
        evidence: dict[str, object] = {
            axis: {
                "attitude_hz": rounded(found.attitude_hz.value, 3),
                "velocity_crossover_hz": _crossover(found),
            }
            for axis, found in slow.items()
        }
        yield finding("QL653", "info", evidence, axes=tuple(slow))
    level = [each for each in positions if each.direction != "down"]
    if not outer.loops and any(_commanded_rows(each) >= FEWEST_ROWS for each in level):
        # What is missing for a velocity loop.
        yield finding(
            "QL655",
            "info",
            {
                "gains_known": outer.controllers.horizontal is not None,
                "rows_of_controllers": {axis: found.n_rows for axis, found in outer.cascades.items()},
            },
        )


def _commanded_rows(rows: PositionRows) -> int:
    """Count the rows in which a velocity was commanded: in modes that hold a height alone there is none."""
    target = rows.values.get("velocity_target")
    return 0 if target is None else int(np.count_nonzero(np.isfinite(target)))


def _attitude(outer: OuterLoops) -> Iterator[Finding]:
    """Yield that an angle controller is not the one that flew."""
    for axis, found in outer.attitude.items():
        if found.shown is Shown.DIFFERS:
            evidence: dict[str, object] = {"relative_rms": rounded(found.relative_rms, 3)}
            if found.gain is not None:
                evidence["gain_over_parameter"] = _evidence(found.gain)
            yield finding("QL650", "warning", evidence, axes=(axis,))


def _cascades(outer: OuterLoops) -> Iterator[Finding]:
    """Yield that a position or velocity controller is not the one that flew, or that it did not follow."""
    differing = {
        direction: told for direction, found in outer.cascades.items() if (told := _differing(found))
    }
    if differing:
        yield finding("QL651", "info", dict(differing))
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


def _differing(found: CascadeReplay) -> dict[str, object]:
    """Return the gains of one direction that the log contradicts, over those of the parameters."""
    gains = {"position_gain": found.position, "velocity_gain": found.velocity}
    return {
        f"{name}_over_parameter": _evidence(gain)
        for name, gain in gains.items()
        if gain is not None and shown_by(gain) is Shown.DIFFERS
    }


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
    evidence: dict[str, object] = {axis: _figures(outermost(loops[axis])) for axis in lacking}
    title = _TITLES[worst].format(loop=_WORDS[name])
    level: Level = "warning" if worst <= Room.POOR else "info"
    yield finding("QL652", level, evidence, axes=tuple(lacking), title=title)


def outermost(found: OuterLoop) -> Margins:
    """Return the margins with the position loop where there is one.

    Parameters
    ----------
    found : OuterLoop

    Returns
    -------
    Margins
    """
    return found.velocity if found.whole is None else found.whole


def _figures(margins: Margins) -> dict[str, object]:
    """Return the limited figures of a loop for people."""
    if not margins.stable:
        return {"stable_fraction": rounded(margins.stable_fraction)}
    return {name: _evidence(each) for name, (each, _) in figures(margins).items() if each is not None}


def _slow(found: OuterLoop) -> bool:
    crossover = found.velocity.crossover_hz
    return crossover is not None and found.attitude_hz.value < _FASTER * crossover.value


def _crossover(found: OuterLoop) -> float | None:
    crossover = found.velocity.crossover_hz
    return None if crossover is None else rounded(crossover.value, 3)


def _evidence(figure: Estimated) -> dict[str, object]:
    """Return a figure and its interval, each by its name."""
    return {"value": rounded(figure.value, 3), "ci95": [rounded(end, 3) for end in figure.ci95]}
