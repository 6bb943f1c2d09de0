"""What to set and fly on an autopilot: the one place where a finding asks the autopilot's own folder."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from quadid_logs.autopilots import known, named
from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.vocabulary import AXES

if TYPE_CHECKING:
    from quadid_logs.autopilots.generic.advice import Advice
    from quadid_logs.data.catalogue import Step
    from quadid_logs.data.diagnosis import Finding
    from quadid_logs.data.log import FlightLog


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


def next_steps(found: Iterable[tuple[FlightLog, Finding]]) -> tuple[str, ...]:
    """Return what to do next, each thing once and in the order of doing it.

    What is to be set comes before what is to be flown: a flight that is logged as
    the last one would be for nothing. The manoeuvres of all axes are one step. What else a warning
    advises on an axis that is refused anyway can wait until it is not.

    Parameters
    ----------
    found : iterable of (FlightLog, Finding)
        Errors and warnings count; of several logs where they are compared.

    Returns
    -------
    tuple of str
        As the findings say it; it may quote the log.
    """
    listed = list(found)
    grave = [each for level in ("error", "warning") for each in listed if each[1].level == level]
    texts = (
        *_advice_of(grave, "set"),
        *_advice_of([each for each in grave if each[1].level == "error"], "other"),
        *_manoeuvres(grave),
        *_advice_of(_of_axes_to_be_used(grave), "other"),
    )
    return tuple(dict.fromkeys(filter(None, texts)))


def _of_axes_to_be_used(grave: Sequence[tuple[FlightLog, Finding]]) -> list[tuple[FlightLog, Finding]]:
    """Leave out what is said only of axes that an error of the same log refuses."""
    refused = {(id(log), axis) for log, one in grave if one.level == "error" for axis in one.axes or AXES}
    return [
        (log, one)
        for log, one in grave
        if not one.axes or any((id(log), axis) not in refused for axis in one.axes)
    ]


def _advice_of(found: Sequence[tuple[FlightLog, Finding]], step: Step) -> list[str]:
    return [finding.advice for _log, finding in found if _step(finding) == step]


def _manoeuvres(found: Sequence[tuple[FlightLog, Finding]]) -> list[str]:
    """Return one manoeuvre for all axes that need one; several only where autopilots differ."""
    wanted: dict[tuple[str, tuple[int, ...] | None], set[str]] = {}
    for log, finding in found:
        if _step(finding) == "fly":
            wanted.setdefault((log.autopilot, log.version), set()).update(finding.axes or AXES)
    return [
        advice_for(autopilot).excitation([axis for axis in AXES if axis in axes], version)
        for (autopilot, version), axes in wanted.items()
    ]


def _step(finding: Finding) -> Step:
    if finding.step is not None:
        return finding.step
    return CATALOGUE[finding.code].step if finding.code in CATALOGUE else "other"
