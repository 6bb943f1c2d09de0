"""compare.html: whether the vehicle changed, by axis, with every number of both flights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import PurePath
from types import MappingProxyType
from typing import Final

from quadid_logs.comparison import Comparison, Quantity
from quadid_logs.data.result import Result
from quadid_logs.figures import Figure
from quadid_logs.report.cells import Cell, Table, interval_cell
from quadid_logs.report.comparison import amount, change_words, headline, promise_sentences, throttle_note
from quadid_logs.report.gain_files import exact
from quadid_logs.report.html import charts
from quadid_logs.report.pages import environment
from quadid_logs.report.verdict import flown_sentence
from quadid_logs.report.words import pretty_unit
from quadid_logs.untrusted import printable

#: The style of each outcome: a change is neither good nor bad, but it must be seen.
_STYLES: Final = MappingProxyType({"same": "usable", "changed": "caution", "not comparable": "refused"})


def comparison_page(
    before: Result, after: Result, comparison: Comparison, figures: Sequence[Figure] = ()
) -> str:
    """Return the page; every text is escaped by the template.

    Parameters
    ----------
    figures : sequence of Figure
        Shown below the table, in their order.

    Returns
    -------
    str
        A complete HTML document that asks no host for anything.
    """
    # Those first that changed.
    ordered = sorted(comparison.quantities, key=lambda quantity: not quantity.changed)
    table = None
    if ordered:
        table = Table(
            caption=f"Every number that was compared (structure {printable(comparison.structure, 40)})",
            head=("", "before", "after", "difference", "smallest detectable"),
            rows=tuple(_row(quantity) for quantity in ordered),
            note=(
                "Small: 95 % intervals. A difference counts as a change if it is larger than the smallest "
                "detectable one. That follows from the intervals and the typical spread between flights of "
                "one vehicle."
            ),
        )
    page: str = (
        environment()
        .get_template("compare.html")
        .render(
            names=[printable(PurePath(result.log.path).name, 80) for result in (before, after)],
            flown=[flown_sentence(result) for result in (before, after)],
            headline=headline(comparison),
            style=_STYLES[comparison.verdict],
            axes=[*(_axis(comparison, axis) for axis in comparison.axes), *_actuators(comparison)],
            table=table,
            parameters=None
            if not comparison.parameters
            else Table(
                caption="Parameters of the autopilot that differ",
                head=("", "before", "after"),
                rows=tuple(
                    (
                        Cell(text=printable(one.name, 40)),
                        Cell(text=exact(one.before)),
                        Cell(text=exact(one.after)),
                    )
                    for one in comparison.parameters
                ),
                note=(
                    "The last values in each log. Calibrations, counters and parameters that only one log "
                    "holds are left out."
                ),
            ),
            promises=[f"{one[:1].upper()}{one[1:]}." for one in promise_sentences(before, after)],
            steps=[printable(step, 800) for step in comparison.advice],
            figures=figures,
            **charts(figures),
        )
    )
    return page


def _axis(comparison: Comparison, axis: str) -> dict[str, str]:
    """Return what became of an axis in one sentence."""
    change = comparison.axes[axis]
    changed = [each for each in comparison.quantities if each.axis == axis and each.changed]
    if axis in comparison.reasons:
        reason = printable(comparison.reasons[axis], 400)
        sentence = f"{reason[:1].upper()}{reason[1:]}."
    elif changed:
        sentence = "; ".join(f"{each.words} by {change_words(each)}{throttle_note(each)}" for each in changed)
        sentence = f"Changed: {sentence}."
    else:
        own = [each for each in comparison.quantities if each.axis == axis and each.is_on_axis]
        shows = (f"{amount(each, each.margin)}{throttle_note(each)}" for each in own)
        seen = "".join(f" Smallest detectable change of effectiveness: {one}." for one in shows)
        sentence = f"No change detected.{seen}"
    return {"axis": axis, "change": change, "style": _STYLES[change], "sentence": sentence}


def _actuators(comparison: Comparison) -> Iterator[dict[str, str]]:
    """Yield what became of lag and delay, which belong to all axes, where both flights tell them."""
    shared = [each for each in comparison.quantities if not each.axis]
    if not shared:
        return
    changed = [f"{each.words} by {change_words(each)}" for each in shared if each.changed]
    change = "changed" if changed else "same"
    seen = ", ".join(f"{amount(each, each.margin)} of {each.name}" for each in shared)
    sentence = f"No change detected. Smallest detectable change: {seen}."
    if changed:
        sentence = f"Changed: {'; '.join(changed)}."
    yield {"axis": "actuators", "change": change, "style": _STYLES[change], "sentence": sentence}


def _row(quantity: Quantity) -> tuple[Cell, ...]:
    values = (
        interval_cell(value, ci95)
        for value, ci95 in ((quantity.before, quantity.ci95_before), (quantity.after, quantity.ci95_after))
    )
    difference = change_words(quantity)
    return (
        Cell(text=quantity.words, detail=pretty_unit(quantity.unit)),
        *values,
        Cell(text=difference, detail="changed" if quantity.changed else "", weak=not quantity.changed),
        Cell(text=amount(quantity, quantity.margin)),
    )
