"""What to set and fly on an autopilot: the one place where a finding asks the autopilot's own folder."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final

from quadid_logs.autopilots import known, named
from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.sentences import listed
from quadid_logs.vocabulary import AXES, TABLE_FORMAT

if TYPE_CHECKING:
    from quadid_logs.autopilots.generic.advice import Advice
    from quadid_logs.data.catalogue import Step
    from quadid_logs.data.diagnosis import Diagnosis, Finding
    from quadid_logs.data.log import FlightLog

_TOO_SHORT: Final = "QL402"
_NO_MULTIROTOR: Final = "QL201"


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
    return tuple(
        sorted(
            autopilot.name
            for autopilot in known()
            if autopilot.advice.plans_by_hand
            or autopilot.advice.logging_settings
            or autopilot.advice.whole_files(AXES)
        )
    )


def next_steps(
    found: Iterable[tuple[FlightLog, Finding]], again: Iterable[tuple[FlightLog, str]] = ()
) -> tuple[str, ...]:
    """Return what to do next, each thing once and in the order of doing it.

    What is to be set comes before what is to be flown: a flight that is logged as
    the last one would be for nothing. The manoeuvres of all axes are one step. Where an error asks
    for another way of logging, the next flight takes the place of this one: it moves every axis. What
    else a warning advises on an axis that is refused anyway can wait until it is not.

    Parameters
    ----------
    found : iterable of (FlightLog, Finding)
        Errors and warnings count; of several logs where they are compared.
    again : iterable of (FlightLog, str)
        Axes that the next flight is to move, whatever was found.

    Returns
    -------
    tuple of str
        As the findings say it; it may quote the log.
    """
    found = list(found)
    # Nothing else is said of a log of another kind of vehicle.
    others = {id(log) for log, one in found if one.code == _NO_MULTIROTOR}
    listed = [(log, one) for log, one in found if one.code == _NO_MULTIROTOR or id(log) not in others]
    grave = [each for level in ("error", "warning") for each in listed if each[1].level == level]
    needed = [(log, finding.axes or AXES) for log, finding in grave if _step(finding) == "fly"]
    # Another flight is needed because of how this one was logged; a table is made anew.
    needed += [
        (log, AXES)
        for log, finding in grave
        if is_to_set(finding) and finding.level == "error" and log.format != TABLE_FORMAT
    ]
    to_fly = [*needed, *((log, (axis,)) for log, axis in again)]
    errors = [each for each in grave if each[1].level == "error"]
    # One manoeuvre for all axes that need one; several only where autopilots differ.
    wanted: dict[tuple[str, tuple[int, ...] | None], set[str]] = {}
    for log, axes in to_fly:
        wanted.setdefault((log.autopilot, log.version), set()).update(axes)
    texts = (
        *_advice_of(grave, "set"),
        *_advice_of(_without_manoeuvre(_of_long_flights(errors), to_fly), "other"),
        *(
            advice_for(autopilot).excitation([axis for axis in AXES if axis in axes], version)
            for (autopilot, version), axes in wanted.items()
        ),
        *_advice_of(_without_manoeuvre(_of_axes_to_be_used(grave), to_fly), "other"),
    )
    return tuple(dict.fromkeys(filter(None, texts)))


def _of_long_flights(errors: Sequence[tuple[FlightLog, Finding]]) -> list[tuple[FlightLog, Finding]]:
    """Leave out what else is said of a flight that is too short to say it."""
    short = {id(log) for log, one in errors if one.code == _TOO_SHORT}
    return [(log, one) for log, one in errors if one.code == _TOO_SHORT or id(log) not in short]


def _of_axes_to_be_used(grave: Sequence[tuple[FlightLog, Finding]]) -> list[tuple[FlightLog, Finding]]:
    """Leave out what is said only of axes that an error of the same log refuses."""
    refused = {(id(log), axis) for log, one in grave if one.level == "error" for axis in one.axes or AXES}
    return [
        (log, one)
        for log, one in grave
        if not one.axes or any((id(log), axis) not in refused for axis in one.axes)
    ]


def _advice_of(found: Sequence[tuple[FlightLog, Finding]], step: Step) -> list[str]:
    """Return the advice of one kind, each once; in a list of steps "this axis" has a name."""
    axes_of: dict[str, set[str]] = {}
    for _log, finding in found:
        if _step(finding) == step:
            axes_of.setdefault(finding.advice, set()).update(finding.axes or AXES)
    said = []
    for advice, axes in axes_of.items():
        names = listed([axis for axis in AXES if axis in axes])
        said.append(advice.replace("this axis", names).replace("This axis", names.capitalize()))
    return said


def _without_manoeuvre(
    found: Sequence[tuple[FlightLog, Finding]], to_fly: Sequence[tuple[FlightLog, Sequence[str]]]
) -> list[tuple[FlightLog, Finding]]:
    """Leave out what is said in place of a manoeuvre of axes that fly one, as for another log."""
    flown = {axis for _log, axes in to_fly for axis in axes}
    return [
        (log, one)
        for log, one in found
        if not (
            one.code in CATALOGUE
            and CATALOGUE[one.code].step == "fly"
            and _step(one) == "other"
            and one.axes
            and flown.issuperset(one.axes)
        )
    ]


def to_a_usable_axis(diagnosis: Diagnosis, axis: str) -> tuple[Finding, ...]:
    """Return the findings whose advice an axis lacks to be usable.

    Parameters
    ----------
    diagnosis : Diagnosis
    axis : str

    Returns
    -------
    tuple of Finding
        Those that decided its verdict, and what is to be set before it is flown again.
    """
    reasons = diagnosis.axes[axis].reasons if axis in diagnosis.axes else ()
    return tuple(
        one
        for one in diagnosis.findings
        if (not one.axes or axis in one.axes)
        and (one.code in reasons or (one.level != "info" and is_to_set(one)))
    )


def is_to_set(finding: Finding) -> bool:
    """Return whether its advice is to set something before the next flight.

    Parameters
    ----------
    finding : Finding

    Returns
    -------
    bool
    """
    return _step(finding) == "set"


def _step(finding: Finding) -> Step:
    if finding.step is not None:
        return finding.step
    return CATALOGUE[finding.code].step if finding.code in CATALOGUE else "other"
