"""What to set and fly on an autopilot: the one place where a finding asks the autopilot's own folder."""

from __future__ import annotations

from typing import TYPE_CHECKING

from quadid_logs.autopilots import known, named

if TYPE_CHECKING:
    from quadid_logs.autopilots.generic.advice import Advice


def advice_for(autopilot: str) -> Advice:
    """Return what to log, set and fly.

    Parameters
    ----------
    autopilot : str
        As in `FlightLog.autopilot`.

    Returns
    -------
    Advice
        For a name that nobody has, what holds for any autopilot.
    """
    return named(autopilot).advice


def plannable() -> tuple[str, ...]:
    """Return the names of the autopilots that a flight can be planned for, in the order of the alphabet.

    Returns
    -------
    tuple of str
        As in `FlightLog.autopilot`.
    """
    return tuple(sorted(autopilot.name for autopilot in known() if autopilot.advice.logging_settings))
