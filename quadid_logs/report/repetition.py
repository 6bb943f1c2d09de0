"""Whether several flights agree, in words and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import PurePath
from typing import Any, Final

from quadid_logs.counting import counted
from quadid_logs.repetition import FlightEstimate, Repeatability, RepeatedQuantity
from quadid_logs.report.numbers import number, plus_minus
from quadid_logs.report.strict_json import some_fields, strict_text
from quadid_logs.report.words import pretty_unit
from quadid_logs.sentences import listed
from quadid_logs.untrusted import printable

#: Which quantities are told in one line each; the others are in the table and in the JSON.
_FIRST: Final = "effectiveness"


def name_of(found: Repeatability, flight: int) -> str:
    """Return what a flight is called: the name of its log.

    Parameters
    ----------
    flight : int
        Its place among the logs.
    """
    return printable(PurePath(found.flights[flight]).name, 60)


def headline(found: Repeatability) -> str:
    """Return the outcome in words, without a full stop."""
    flights = counted(len(found.flights), "flight")
    if found.strangers:
        strangers = (
            f"{name_of(found, flight)} has {printable(why, 200)}" for flight, why in found.strangers.items()
        )
        return f"these are not flights of one vehicle: {'; '.join(strangers)}"
    outliers = []
    for each in found.quantities:
        if each.outliers:
            (one,) = each.outliers
            (own,) = (item for item in each.estimates if item.flight == one.flight)
            others = own.value - one.difference
            if each.axis and others:
                size = f"{number(100.0 * abs(one.difference / others), 2)} %"
            else:
                size = f"{number(abs(one.difference), 2)} {pretty_unit(each.unit)}"
            which = f"{each.axis} {each.kind}" if each.axis else each.words
            more = "more" if abs(own.value) > abs(others) else "less"
            outliers.append(
                f"{name_of(found, one.flight)} is the outlier: {size} {more} {which} than the others"
            )
    if outliers:
        return "; ".join(outliers)
    differing = []
    for each in (one for one in found.quantities if one.differs):
        # The two flights that differ most.
        pair = max(each.pairs, key=lambda one: abs(one.z))
        values = " and ".join(
            f"{plus_minus(one.value, one.half_width)} in {name_of(found, one.flight)}"
            for one in each.estimates
            if one.flight in pair.flights
        )
        which = f"{each.axis} {each.kind}" if each.axis else each.words
        differing.append(f"{which} is {values} ({pretty_unit(each.unit)})")
    if differing:
        return f"the flights differ, and no single flight is the outlier: {'; '.join(differing)}"
    told = [each for each in found.quantities if each.kind == _FIRST]
    if not told:
        return f"no axis is identified by two or more of {flights}"
    values = listed([f"{each.axis} {mean_words(each)}" for each in told])
    n = max(len(each.estimates) for each in told)
    of = "" if n == len(found.flights) else f" of {len(found.flights)}"
    return f"{n}{of} flights agree: {values}; no flight is an outlier"


def mean_words(quantity: RepeatedQuantity) -> str:
    """Return the mean of all flights with its interval."""
    return f"{plus_minus(quantity.mean.value, quantity.mean.half_width)} {pretty_unit(quantity.unit)}"


def between_words(quantity: RepeatedQuantity) -> str:
    """Return how far flights differ beyond their own errors, as a standard deviation with its interval.

    In per cent of the mean; in the unit of lag and delay.
    """
    mean = quantity.mean
    is_relative = bool(quantity.axis) and mean.value != 0.0
    scale, unit = (100.0 / abs(mean.value), "%") if is_relative else (1.0, pretty_unit(quantity.unit))
    sd, low, high = (scale * each for each in (mean.sd, *mean.sd_ci95))
    return f"{number(sd, 2)} {unit} ({number(low, 2)} to {number(high, 2)})"


def repetition_lines(found: Repeatability) -> tuple[str, ...]:
    """Return the outcome as lines for people.

    Lines without control characters, whatever the logs hold.
    """
    lines = [headline(found)]
    for axis, outcome in found.axes.items():
        why_not = ""
        if outcome == "not comparable":
            known = [place for place, each in enumerate(found.reasons) if axis not in each]
            which = f"only {name_of(found, known[0])} identifies it" if known else "no flight identifies it"
            first = next(
                ((place, each[axis]) for place, each in enumerate(found.reasons) if axis in each), None
            )
            why = "" if first is None else f" ({name_of(found, first[0])}: {printable(first[1], 300)})"
            why_not = f": {which}{why}"
        lines.append(f"  {axis:<5}  {outcome}{why_not}")
        lines += [f"{'':9}{text}" for each in _own(found, axis) for text in _quantity_lines(found, each)]
    if shared := _own(found, ""):
        lines += [
            "  actuators",
            *(f"{'':9}{text}" for each in shared for text in _quantity_lines(found, each)),
        ]
    return (*lines, *(f"  next: {printable(text, 800)}" for text in found.advice))


def held_words(quantity: RepeatedQuantity) -> str:
    """Say how many flights lie where the others predict them, "" where too few tell."""
    held = [each.held for each in quantity.estimates if each.held is not None]
    return f"the others predict {sum(held)} of {counted(len(held), 'flight')}" if held else ""


def unknown_words(found: Repeatability, flight: int) -> str:
    """Say why a flight does not tell its axes, "" where it tells all."""
    reasons = found.reasons[flight]
    if len(set(reasons.values())) == 1 and len(reasons) == len(found.axes):
        return printable(next(iter(reasons.values())), 300)
    return printable("; ".join(f"{axis}: {reason}" for axis, reason in reasons.items()), 400)


def _own(found: Repeatability, axis: str) -> list[RepeatedQuantity]:
    return [each for each in found.quantities if each.axis == axis]


def _quantity_lines(found: Repeatability, quantity: RepeatedQuantity) -> Iterator[str]:
    """Yield the mean of a quantity, and what each flight tells of an effectiveness."""
    parts = [
        f"{printable(quantity.words, 60)} {mean_words(quantity)}",
        f"between flights {between_words(quantity)}",
    ]
    parts += filter(None, [held_words(quantity)])
    yield "; ".join(parts)
    if quantity.kind != _FIRST and not quantity.differs:
        return
    for each in quantity.estimates:
        value = plus_minus(each.value, each.half_width)
        yield f"  {name_of(found, each.flight)}: {value}{mark(quantity, each)}"


def mark(quantity: RepeatedQuantity, each: FlightEstimate) -> str:
    """Return what is to be said of one flight: an outlier, or not where the others predict it.

    Begins with a comma, or is empty.
    """
    if any(one.flight == each.flight for one in quantity.outliers):
        return ", outlier"
    if each.held is False:
        return f", predicted {plus_minus(each.predicted, each.predicted_half_width)}"
    return ""


def repetition_text(found: Repeatability) -> str:
    """Return the outcome as strict JSON in ASCII.

    What is not known is null.
    """
    held, n_left_out = found.left_out
    content: dict[str, Any] = {
        "schema_version": "1.0",
        "verdict": found.verdict,
        "sentence": headline(found),
        "structure": found.structure,
        "flights": [
            {
                "path": path,
                "reasons": dict(found.reasons[place]),
                "other_vehicle": found.strangers.get(place),
            }
            for place, path in enumerate(found.flights)
        ],
        "axes": dict(found.axes),
        "left_out": {"held": held, "of": n_left_out},
        "quantities": [_quantity_dict(each) for each in found.quantities],
        "advice": found.advice,
    }
    return strict_text(content)


def _quantity_dict(quantity: RepeatedQuantity) -> dict[str, Any]:
    mean = quantity.mean
    return {
        **some_fields(quantity, "name", "kind", "axis", "unit"),
        "mean": {"value": mean.value, "ci95": (mean.value - mean.half_width, mean.value + mean.half_width)},
        "between_flights": {"sd": mean.sd, "ci95": mean.sd_ci95, "p_value": quantity.p_value},
        "differs": quantity.differs,
        "estimates": [
            {
                "flight": each.flight,
                "value": each.value,
                "half_width": each.half_width,
                "allowed_half_width": each.allowed,
                "left_out": None
                if each.held is None or not math.isfinite(each.predicted)
                else {
                    "predicted": each.predicted,
                    "half_width": each.predicted_half_width,
                    "held": each.held,
                },
            }
            for each in quantity.estimates
        ],
        "pairs": [some_fields(each, "flights", "z", "p_value", "differs") for each in quantity.pairs],
        "outliers": quantity.outliers,
    }
