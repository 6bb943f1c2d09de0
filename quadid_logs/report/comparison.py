"""A comparison of two flights in words and as JSON."""

from __future__ import annotations

import math
from pathlib import PurePath
from typing import Any, Final

from quadid_logs.comparison import Comparison, Quantity
from quadid_logs.control.room import outermost
from quadid_logs.data.closed_loop import Estimated
from quadid_logs.data.promise import Decision, Held
from quadid_logs.data.result import Result
from quadid_logs.promise import checked
from quadid_logs.report.gain_files import exact
from quadid_logs.report.loop_json import margins_and_step
from quadid_logs.report.numbers import estimate, number, resolved
from quadid_logs.report.strict_json import some_fields, strict_text
from quadid_logs.report.words import pretty_unit
from quadid_logs.untrusted import printable

#: What is said of a verdict.
_HEADLINES: Final = {
    "same": "no change beyond the intervals",
    "changed": "changed beyond the intervals",
    "not comparable": "at least one axis cannot be compared",
}
#: Figures of `Margins`, in words, with their units.
_MARGINS: Final = (
    ("phase_margin_deg", "phase margin", "deg"),
    ("gain_margin_db", "gain margin", "dB"),
)


#: From here on another throttle is named: half a per cent is less than any flight leaves open.
_LEAST_THROTTLE_CHANGE: Final = 0.005
#: Lines of parameters in a terminal.
_MOST_PARAMETERS: Final = 20


def headline(comparison: Comparison) -> str:
    """Return the outcome of a comparison in words, without a full stop."""
    if set(comparison.axes.values()) == {"not comparable"}:
        return "these logs cannot be compared"
    return _HEADLINES[comparison.verdict]


def comparison_lines(before: Result, after: Result, comparison: Comparison) -> tuple[str, ...]:
    """Return the comparison as lines for people.

    Lines without control characters, whatever the logs hold.
    """
    names = [printable(PurePath(result.log.path).name, 80) for result in (before, after)]
    lines = [f"{names[0]} -> {names[1]}: {headline(comparison)}"]
    for axis, change in comparison.axes.items():
        reason = comparison.reasons.get(axis, "")
        lines.append(f"  {axis:<5}  {change}{f': {printable(reason, 400)}' if reason else ''}")
        lines += _quantity_lines(comparison, axis)
        # With all that is known to close the loop.
        both = [outermost(loop) if (loop := result.loop_of(axis)) else None for result in (before, after)]
        for name, words, unit in _MARGINS:
            figures = [None if margins is None else getattr(margins, name) for margins in both]
            if all(isinstance(figure, Estimated) for figure in figures):
                values = " -> ".join(estimate(figure.value, *figure.ci95) for figure in figures if figure)
                lines.append(f"{'':9}{words} {values} {unit}")
    if shared := _quantity_lines(comparison, ""):
        changed = any(each.changed for each in comparison.quantities if not each.axis)
        lines += [f"  actuators  {'changed' if changed else 'same'}", *shared]
    if differing := comparison.parameters:
        lines.append(f"  parameters  {len(differing)} differ")
        lines += [
            f"{'':9}{printable(one.name, 40)} {exact(one.before)} -> {exact(one.after)}"
            for one in differing[:_MOST_PARAMETERS]
        ]
        if more := len(differing[_MOST_PARAMETERS:]):
            lines.append(f"{'':9}and {more} more: --json and the page list them")
    lines += [f"  {sentence}" for sentence in promise_sentences(before, after)]
    return (*lines, *(f"  next: {printable(text, 800)}" for text in comparison.advice))


def _quantity_lines(comparison: Comparison, axis: str) -> list[str]:
    """Return a line for each quantity of an axis: the on-axis one, and the others if they changed."""
    lines = []
    for quantity in comparison.quantities:
        if quantity.axis != axis or not (quantity.changed or not axis or quantity.is_on_axis):
            continue
        # Both values, and by how much they differ or could differ unseen.
        pairs = ((quantity.before, quantity.ci95_before), (quantity.after, quantity.ci95_after))
        values = " -> ".join(estimate(value, *interval) for value, interval in pairs)
        note = throttle_note(quantity)
        told = f"no change detected (smallest detectable: {amount(quantity, quantity.margin)}{note})"
        if quantity.changed:
            told = f"changed by {change_words(quantity)}{note}"
        words = f"{printable(quantity.words, 60)} {values} {pretty_unit(quantity.unit)}"
        lines.append(f"{'':9}{words}: {told}")
    return lines


def throttle_note(quantity: Quantity) -> str:
    """Say what another mean throttle may have made of a value, "" where it was the same.

    A clause that goes on after a comma.
    """
    change = quantity.throttle_change
    if abs(change) < _LEAST_THROTTLE_CHANGE:
        return ""
    more = "higher" if change > 0.0 else "lower"
    may = amount(quantity, quantity.throttle_spread)
    return f", up to {may} of it because the throttle was {number(100.0 * abs(change), 2)} % {more}"


def change_words(quantity: Quantity) -> str:
    """Return by how much a quantity differs; one that has come nearer to zero by a negative percentage."""
    is_own = quantity.name == quantity.scale_name
    return amount(quantity, quantity.difference, towards=quantity.before if is_own else 1.0)


def amount(quantity: Quantity, difference: float, towards: float = 1.0) -> str:
    """Return a difference as a fraction of what it is to be compared with, or in its unit.

    Parameters
    ----------
    difference : float
        In the unit of the quantity.
    towards : float
        The sign that a positive percentage has.

    Returns
    -------
    str
        With the decimals that the least difference is known to which would show.
    """
    # Of a damping near zero, a difference of minus 150 % tells nothing.
    if not quantity.scale >= abs(difference) > 0.0:
        return f"{resolved(difference, -quantity.margin, quantity.margin)} {pretty_unit(quantity.unit)}"
    of = "" if quantity.name == quantity.scale_name else f" of {printable(quantity.scale_words, 60)}"
    percents = [100.0 * value / quantity.scale for value in (difference, quantity.margin)]
    return f"{resolved(math.copysign(1.0, towards) * percents[0], -percents[1], percents[1])} %{of}"


def promise_sentences(before: Result, after: Result) -> tuple[str, ...]:
    """Return whether the axes that flew with the recommended gains have the promised margins.

    One for each such axis.
    """
    sentences, units = [], {"gain_margin_db": "dB", "phase_margin_deg": "degrees"}
    for axis, one in checked(before, after).items():
        told = [
            f"{estimate(seen.value, *seen.ci95)} {units[each.name]}, promised "
            f"{estimate(said.value, *said.ci95)}"
            for each in one.figures
            if each.name in units
            for said, seen in ((each.promised, each.measured),)
        ]
        back = one.decision is Decision.BACK
        act = "load the gains that flew before" if back else "tune again from the second flight"
        kept = f"not kept: {act}" if one.held is Held.WORSE else "kept"
        sentences.append(f"promise of {axis} {kept} ({'; '.join(told)})")
    return tuple(sentences)


def comparison_text(before: Result, after: Result, comparison: Comparison) -> str:
    """Return the comparison as strict JSON in ASCII."""
    content: dict[str, Any] = {
        "schema_version": "1.0",
        "before": before.log.path,
        "after": after.log.path,
        "verdict": comparison.verdict,
        "structure": comparison.structure,
        "axes": {
            axis: {"change": change, "reason": comparison.reasons.get(axis, "")}
            for axis, change in comparison.axes.items()
        },
        "quantities": [
            {
                **some_fields(item, "name", "axis", "unit"),
                "before": {"value": item.before, "ci95": item.ci95_before},
                "after": {"value": item.after, "ci95": item.ci95_after},
                **some_fields(item, "difference", "margin", "throttle_change", "changed"),
            }
            for item in comparison.quantities
        ],
        "parameters": [one._asdict() for one in comparison.parameters],
        "closed_loop": {
            axis: {
                name: None if (loop := result.loop_of(axis)) is None else margins_and_step(loop)
                for name, result in (("before", before), ("after", after))
            }
            for axis in comparison.axes
        },
        "advice": comparison.advice,
        "promises": {
            axis: {
                "kept": one.held is not Held.WORSE,
                "way_back": one.decision is Decision.BACK,
                "margins": {
                    figure.name: {
                        "promised": figure.promised,
                        "found": figure.measured,
                    }
                    for figure in one.figures
                },
            }
            for axis, one in checked(before, after).items()
        },
    }
    return strict_text(content)
