"""The figure of two flights side by side."""

from __future__ import annotations

import numpy as np

from quadid_logs.comparison import Comparison, Quantity
from quadid_logs.figures.spec import Axis, Curve, Figure, LeftOut, Panel

_TITLE = "Before and after"
#: More panels than this are read by nobody.
_MOST_PANELS = 12


def comparison_figure(comparison: Comparison) -> Figure | LeftOut:
    """Show every compared quantity with its two intervals, those that changed first."""
    if not comparison.quantities:
        return LeftOut(key="compare", title=_TITLE, reason="Nothing could be compared.")
    ordered = sorted(comparison.quantities, key=lambda quantity: not quantity.changed)
    shown = ordered[:_MOST_PANELS]
    hidden = len(ordered) - len(shown)
    return Figure(
        key="compare",
        title=f"{_TITLE}: {comparison.structure}",
        caption=(
            "Points: values with 95 % intervals. A difference counts as a change if intervals, throttle "
            "and the typical spread between flights do not explain it."
        )
        + (f" {hidden} more quantities did not change and are not drawn." if hidden else ""),
        panels=tuple(_panel(quantity) for quantity in shown),
        columns=3,
    )


def _panel(quantity: Quantity) -> Panel:
    """Return the two points of one quantity."""
    points = (
        ("before", quantity.before, quantity.ci95_before, "series-1"),
        ("after", quantity.after, quantity.ci95_after, "series-2"),
    )
    curves = tuple(
        Curve(
            label=label,
            x=np.array([float(place)]),
            y=np.array([value]),
            low=np.array([low]),
            high=np.array([high]),
            role=role,
            mark="bars",
        )
        for place, (label, value, (low, high), role) in enumerate(points)
    )
    return Panel(
        title=f"{quantity.words.capitalize()}: {'changed' if quantity.changed else 'no change'}",
        x=Axis(label="", ticks=((0.0, "before"), (1.0, "after")), low=-0.6, high=1.6),
        y=Axis(label="value", unit=quantity.unit.replace("^2", "²")),
        curves=curves,
    )
