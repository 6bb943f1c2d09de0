"""The expo of the thrust curve, and the effectiveness against thrust, as a table."""

from __future__ import annotations

from typing import Final

from quadid_logs.data.model import ThrustCurve
from quadid_logs.report.cells import Cell, Table
from quadid_logs.report.numbers import estimate, interval, number, percent, resolved
from quadid_logs.untrusted import printable

_BY_SPEED: Final = "from the measured rotor speeds"


def thrust_table(curve: ThrustCurve) -> Table:
    """Return how the effectiveness per unit of command changes over the thrust that was flown."""
    levels = zip(curve.thrust_over_mean, curve.effectiveness, curve.effectiveness_ci95, strict=True)
    rows = tuple(
        (
            Cell(text=percent(float(thrust))),
            Cell(
                text=resolved(float(value), float(low), float(high)),
                detail=interval(float(low), float(high)),
                weak=not curve.identifiable,
            ),
        )
        for thrust, value, (low, high) in levels
    )
    unnamed = "assumed, because no parameter holds it"
    name = printable(curve.parameter, 40) or (_BY_SPEED if curve.measured else unnamed)
    if not curve.identifiable:
        sentence = (
            f"This flight does not identify the expo of the thrust curve: {printable(curve.reason)}. The "
            f"value {number(curve.assumed, 2)} was used ({name}). The intervals allow for an error in it."
        )
    else:
        value, assumed = estimate(curve.expo, *curve.ci95), f"{number(curve.assumed, 2)} ({name})"
        told = f"not {assumed}. The torque was computed with the identified expo"
        sentence = (
            f"The propellers' expo is {value}, {told if curve.corrected else f'which agrees with {assumed}'}."
        )
    return Table(
        caption="Effectiveness per unit of command against thrust",
        head=(
            "thrust divided by its mean during the manoeuvres",
            "effectiveness divided by that at the mean thrust",
        ),
        rows=rows,
        note=f"{sentence} Thrust beyond these rows was not flown.",
    )
