"""The recommended gains as files that a ground station loads: the next ones, and those that flew."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePath
from typing import Final

import numpy as np

from quadid_logs.autopilots import known, named
from quadid_logs.control.room import whole
from quadid_logs.data.flight import flown_parameters
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import AxisTuning, Tuning
from quadid_logs.report.numbers import number
from quadid_logs.sentences import continued
from quadid_logs.untrusted import printable

NEXT, BACK = "next", "back"
_LONGEST_NAME: Final = 80


def file_names(autopilot: str) -> tuple[str, str]:
    """Return the names of the files of the next gains and of those that flew.

    Parameters
    ----------
    autopilot : str
        As in `FlightLog.autopilot`.
    """
    suffix = named(autopilot).advice.parameter_suffix
    return f"{NEXT}{suffix}", f"{BACK}{suffix}"


def tunable_autopilots() -> tuple[str, ...]:
    """Return the names of the autopilots that gains are recommended for."""
    return tuple(one.name for one in known() if one.tunable({}) is not None)


def gain_files(result: Result, tuning: Tuning) -> dict[str, str]:
    """Return the text of each file by its name.

    Empty where no gain changes.
    """
    changes = tuning.changes
    if not changes:
        return {}
    advice = named(result.log.autopilot).advice
    parameters = flown_parameters(result.log, result.data)
    log = printable(PurePath(result.log.path).name, _LONGEST_NAME)
    forth = [*advice.beside_gains(parameters, changes)]
    lines = [line for axis, found in tuning.axes.items() for line in _lines(axis, found)]
    # Filters that all axes share stand in each of them, and once in a file.
    first = {line[1]: line for line in reversed(lines)}
    forth += [line for line in lines if first[line[1]] is line]
    # What the log does not hold is switched off by what it does hold.
    known = {name: change.now for name, change in changes.items() if np.isfinite(change.now)}
    # Every gain that could be changed, as it flew, so that one flight has one way back.
    tunable = named(result.log.autopilot).tunable(parameters)
    axes = () if tunable is None else tunable.axes.values()
    gain_names = (name for one in axes for name in one.every)
    every = {name: parameters[name] for name in gain_names if np.isfinite(parameters.get(name, np.nan))}
    flown = every | known
    back = [("as flown", name, exact(value)) for name, value in flown.items()]
    back += advice.beside_gains(parameters, changes, back=True)
    names = file_names(result.log.autopilot)
    return {
        names[0]: advice.gain_text(
            (f"The next gains to fly, from {log}", f"The gains that flew: {names[1]}"),
            forth,
            parameters,
        ),
        names[1]: advice.gain_text((f"The gains that flew in {log}",), back, parameters),
    }


def _lines(axis: str, found: AxisTuning) -> Iterator[tuple[str, str, str]]:
    for name, change in found.changes.items():
        was = f"was {exact(change.now)}" if np.isfinite(change.now) else "not in the log"
        towards = "" if change.target == change.next else f", target {exact(change.target)}"
        why = f"{axis}: {reason_text(found)}; {was}{towards}"
        yield why, name, exact(change.next)


def reason_text(found: AxisTuning) -> str:
    """Return in a few words why an axis changes."""
    title = found.reasons[0].title if found.reasons else ""
    outer = None if found.next is None else whole(found.next)
    figures = []
    if outer is not None and outer.gain_margin_db is not None:
        figures.append(f"{number(outer.gain_margin_db.ci95[0], 2)} dB")
    if outer is not None and outer.phase_margin_deg is not None:
        figures.append(f"{number(outer.phase_margin_deg.ci95[0], 2)} deg")
    promise = f" (at least {' and '.join(figures)} promised)" if figures else ""
    return f"{continued(title)}{promise}"


def exact(value: float) -> str:
    """Return the shortest text that an autopilot, which holds single precision, reads as this value.

    Examples
    --------
    >>> exact(0.13500000536441803), exact(1.0), exact(0.0036)
    ('0.135', '1', '0.0036')
    """
    return np.format_float_positional(np.float32(value), unique=True, trim="-")
