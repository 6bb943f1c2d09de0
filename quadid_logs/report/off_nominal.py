"""The margins of a vehicle otherwise than it flew, in words, in a table, and for programs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from quadid_logs.control.room import whole
from quadid_logs.data.closed_loop import Estimated, Margins
from quadid_logs.data.off_nominal import Condition, ConditionKind
from quadid_logs.data.tuning import AxisTuning, Tuning
from quadid_logs.report.cells import Cell, Table
from quadid_logs.report.loop_json import loops_dict
from quadid_logs.report.numbers import interval, number, resolved
from quadid_logs.report.strict_json import some_fields

_BATTERIES: Final = (ConditionKind.BATTERY_FULL, ConditionKind.BATTERY_EMPTY)


def condition_words(condition: Condition) -> str:
    """Name a condition.

    Examples
    --------
    >>> from quadid_logs.data.off_nominal import Condition, ConditionKind
    >>> condition_words(Condition(ConditionKind.HEAVIER, mass=1.2, inertia=1.2))
    '20 % heavier'
    """
    kinds = ConditionKind
    match condition.kind:
        case kinds.BATTERY_FULL:
            return f"battery full ({number(condition.voltage_v, 3)} V)"
        case kinds.BATTERY_EMPTY:
            return f"battery empty ({number(condition.voltage_v, 3)} V)"
        case kinds.LIGHTER:
            return f"{_percent(condition.mass)} lighter"
        case kinds.HEAVIER:
            return f"{_percent(condition.mass)} heavier"
        case kinds.PAYLOAD:
            return f"{_percent(condition.mass)} heavier by a load at the centre"
        case kinds.THIN_AIR | kinds.DENSE_AIR:
            return f"air at {number(100.0 * condition.density, 3)} % of its density"
        case kinds.SMALLER_PROPELLER:
            return f"propellers {_percent(condition.propeller)} smaller"
        case kinds.LARGER_PROPELLER:
            return f"propellers {_percent(condition.propeller)} larger"


def _percent(factor: float) -> str:
    return f"{number(100.0 * abs(factor - 1.0), 2)} %"


def off_nominal_tables(tuning: Tuning) -> Iterator[Table]:
    """Yield the margins in each condition, a table for each axis."""
    for axis, found in tuning.axes.items():
        if not found.off_nominal:
            continue
        changes = found.verdict == "change"
        rows = []
        for one in found.off_nominal:
            words = condition_words(one.condition)
            turns = f"effectiveness ×{number(one.effectiveness.value, 3)}"
            head = Cell(text=f"{words} (worst case)" if one.worst else words, detail=turns)
            flown = _figures(whole(one.now))
            pairs = zip(flown, _figures(whole(one.next)), strict=True) if changes and one.next else None
            cells = pairs or ((None, figure) for figure in flown)
            rows.append((head, *(_cell(*each) for each in cells)))
        yield Table(
            caption=f"{axis.capitalize()}, {'flown → next gains' if changes else 'flown gains'}",
            head=("condition", "gain [dB]", "phase [deg]", "disk"),
            rows=tuple(rows),
        )


def off_nominal_note(tuning: Tuning) -> str:
    """Say what the tables hold."""
    kinds = {one.condition.kind for found in tuning.axes.values() for one in found.off_nominal}
    without = "" if kinds.intersection(_BATTERIES) else " The log does not hold the battery's voltage."
    return (
        "Each row changes one condition of this flight. The factor multiplies the control effectiveness. "
        "Margins include the angle loop if it is known. Small: the 95 % interval with the gains named last."
        + without
    )


def _figures(margins: Margins) -> tuple[Estimated | None, ...]:
    return margins.gain_margin_db, margins.phase_margin_deg, margins.disk_margin


def _cell(flown: Estimated | None, figure: Estimated | None) -> Cell:
    before = "" if flown is None else f"{resolved(flown.value, *flown.ci95)} → "
    if figure is None:
        return Cell(text=f"{before}–")
    return Cell(text=before + resolved(figure.value, *figure.ci95), detail=interval(*figure.ci95))


def off_nominal_dict(found: AxisTuning) -> list[dict[str, Any]]:
    """Return ``off_nominal`` of an axis: one entry for each condition.

    Values not yet `plain`.
    """
    return [
        {
            "condition": one.condition.kind.value,
            **some_fields(one.condition, "mass", "inertia", "density", "propeller", "voltage_v"),
            "effectiveness": one.effectiveness,
            "lag": one.lag,
            "now": loops_dict(one.now),
            "next": loops_dict(one.next),
            "part_of_limits": one.spare,
            "worst": one.worst,
        }
        for one in found.off_nominal
    ]
