"""The figures of several flights of one vehicle: each with its interval, and the funnel."""

from __future__ import annotations

from pathlib import PurePath

import numpy as np

from quadid_logs.figures.spec import Axis, Curve, Figure, Label, LeftOut, Level, Panel, Ribbon
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.repetition import Repeatability, RepeatedQuantity
from quadid_logs.untrusted import printable

_TITLE = "Flights of one vehicle"
#: Names of logs along an axis; more become numbers.
_MOST_NAMES, _LONGEST_NAME = 8, 14
_FUNNEL_POINTS = 60


def repetition_figures(found: Repeatability) -> tuple[Figure | LeftOut, ...]:
    """Return the funnel and the estimates by flight."""
    told = [each for each in found.quantities if each.kind == "effectiveness"]
    if not told:
        reason = "No axis is identified by two flights or more."
        return tuple(LeftOut(key=key, title=_TITLE, reason=reason) for key in ("funnel", "flights"))
    return (
        Figure(
            key="funnel",
            title="Estimate of each flight against its interval",
            caption=(
                "Each dot is a flight. Less precise flights are higher up. 95 % of the flights of one "
                "vehicle lie between the lines. The lines allow for each flight's error and for the "
                "difference between flights. Flights outside are labelled with their number in the table."
            ),
            panels=tuple(_funnel(each) for each in told),
            columns=len(told),
        ),
        Figure(
            key="flights",
            title="Effectiveness by flight",
            caption=(
                "Dots: each flight with its 95 % interval. Band: the mean of all flights with its 95 % "
                "interval. Dots in the other colour: the prediction for this flight from all others."
            ),
            panels=tuple(_by_flight(found, each) for each in told),
            columns=1,
        ),
    )


def _unit(quantity: RepeatedQuantity) -> str:
    return quantity.unit.replace("^2", "²")


def _funnel(quantity: RepeatedQuantity) -> Panel:
    """Return the dots and the lines that hold 95 % of flights of one vehicle."""
    value = np.array([each.value for each in quantity.estimates])
    width = np.array([each.allowed for each in quantity.estimates])
    height = np.linspace(0.0, 1.15 * float(width.max()), _FUNNEL_POINTS)
    reach = np.hypot(height, NORMAL_95 * quantity.mean.sd)
    mean = quantity.mean.value
    inside = np.abs(value - mean) <= np.hypot(width, NORMAL_95 * quantity.mean.sd)
    outliers = np.isin(
        [each.flight for each in quantity.estimates], [one.flight for one in quantity.outliers]
    )
    curves = [
        Curve(label="95 % of flights", x=mean + sign * reach, y=height, role="muted", mark="dashed")
        for sign in (-1.0, 1.0)
    ]
    for label, which, role in (
        ("flights", inside & ~outliers, "series-1"),
        ("beyond the lines", ~inside & ~outliers, "series-2"),
        ("outlier", outliers, "saturated"),
    ):
        if which.any():
            curves.append(Curve(label=label, x=value[which], y=width[which], role=role, mark="bars"))
    return Panel(
        title=quantity.axis.capitalize(),
        x=Axis(label="effectiveness", unit=_unit(quantity)),
        y=Axis(label="half of the 95 % interval", unit=_unit(quantity), low=0.0),
        curves=tuple(curves),
        levels=(Level(value=mean, role="ink", along="x"),),
        labels=tuple(
            Label(
                text=str(each.flight + 1),
                x=each.value,
                y=each.allowed + 0.07 * float(width.max()),
                role="ink",
            )
            for each, is_inside in zip(quantity.estimates, inside, strict=True)
            if not is_inside
        ),
    )


def _by_flight(found: Repeatability, quantity: RepeatedQuantity) -> Panel:
    """Return each flight with its interval, and what the others predict of it."""
    n = len(found.flights)
    names = [
        printable(PurePath(path).name, _LONGEST_NAME) if n <= _MOST_NAMES else str(place + 1)
        for place, path in enumerate(found.flights)
    ]
    place = np.array([float(each.flight) for each in quantity.estimates])
    value = np.array([each.value for each in quantity.estimates])
    half = np.array([each.half_width for each in quantity.estimates])
    predicted = np.array([each.predicted for each in quantity.estimates])
    reach = np.array([each.predicted_half_width for each in quantity.estimates])
    known = np.isfinite(reach)
    curves = [
        Curve(
            label="flight",
            x=place,
            y=value,
            low=value - half,
            high=value + half,
            role="series-1",
            mark="bars",
        )
    ]
    if known.any():
        curves.append(
            Curve(
                label="predicted from the others",
                x=place[known] + 0.2,
                y=predicted[known],
                low=(predicted - reach)[known],
                high=(predicted + reach)[known],
                role="series-2",
                mark="bars",
            )
        )
    mean, own = quantity.mean.value, quantity.mean.half_width
    ends = np.array([-0.5, n - 0.5])
    return Panel(
        title=quantity.axis.capitalize(),
        x=Axis(
            label="", ticks=tuple((float(k), name) for k, name in enumerate(names)), low=-0.5, high=n - 0.5
        ),
        y=Axis(label="effectiveness", unit=_unit(quantity)),
        curves=tuple(curves),
        ribbons=(
            Ribbon(
                label="mean", x=ends, low=np.full(2, mean - own), high=np.full(2, mean + own), role="interval"
            ),
        ),
    )
