"""repeat.html: whether several flights agree, by axis, with every number of every flight."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import MappingProxyType
from typing import Final

from quadid_logs.counting import counted
from quadid_logs.figures import Figure
from quadid_logs.repetition import FlightEstimate, Repeatability, RepeatedQuantity
from quadid_logs.report.cells import Cell, Table
from quadid_logs.report.html import charts
from quadid_logs.report.numbers import number, plus_minus
from quadid_logs.report.pages import environment
from quadid_logs.report.repetition import (
    between_words,
    headline,
    held_words,
    mark,
    mean_words,
    name_of,
    unknown_words,
)
from quadid_logs.report.words import pretty_unit
from quadid_logs.untrusted import printable

_STYLES: Final = MappingProxyType({"agree": "usable", "differ": "caution", "not comparable": "refused"})
#: Pairs shown of each quantity, those that differ most.
_MOST_PAIRS: Final = 10


def repetition_page(found: Repeatability, figures: Sequence[Figure] = ()) -> str:
    """Return the page; every text is escaped by the template.

    Parameters
    ----------
    figures : sequence of Figure
        Shown below the tables, in their order.

    Returns
    -------
    str
        A complete HTML document that asks no host for anything.
    """
    axes = []
    for axis, outcome in found.axes.items():
        own = [each for each in found.quantities if each.axis == axis and each.kind == "effectiveness"]
        if own:
            parts = (
                f"Effectiveness {mean_words(own[0])}",
                f"between flights {between_words(own[0])}",
                held_words(own[0]),
            )
            sentence = f"{'; '.join(filter(None, parts))}."
        else:
            sentence = "Fewer than two flights identify the effectiveness."
        axes.append({"axis": axis, "outcome": outcome, "style": _STYLES[outcome], "sentence": sentence})
    page: str = (
        environment()
        .get_template("repeat.html")
        .render(
            n_flights=counted(len(found.flights), "flight"),
            headline=headline(found),
            style=_STYLES[found.verdict],
            axes=axes,
            tables=[
                _flights(found),
                *(
                    [
                        Table(
                            caption="Pairs that differ most",
                            head=("quantity", "flights", "z", "p (Holm)"),
                            rows=tuple(_pair_rows(found)),
                            note=(
                                "z is the difference divided by its standard deviation. p is corrected for "
                                "all pairs of all quantities. If p is below 0.05, the two flights differ."
                            ),
                        )
                    ]
                    if any(each.pairs for each in found.quantities)
                    else []
                ),
            ],
            steps=[printable(step, 800) for step in found.advice],
            figures=figures,
            **charts(figures),
        )
    )
    return page


def _flights(found: Repeatability) -> Table:
    """Return a row for each flight, and one for their mean."""
    quantities = found.quantities
    rows = [
        (
            Cell(text=f"{flight + 1}  {name_of(found, flight)}", detail=_remark(found, flight)),
            *(_cell(each, flight) for each in quantities),
        )
        for flight in range(len(found.flights))
    ]
    mean = (
        Cell(text="mean"),
        *(
            Cell(text=mean_words(each), detail=f"between flights {between_words(each)}")
            for each in quantities
        ),
    )
    return Table(
        caption="Every flight"
        + (f" (structure {printable(found.structure, 40)})" if found.structure else ""),
        head=(
            "flight",
            *(f"{each.axis} {each.kind} [{pretty_unit(each.unit)}]".strip() for each in quantities),
        ),
        rows=(*rows, mean),
        note=(
            "± is half of the 95 % interval. Between flights: the standard deviation that the flights' own "
            "errors do not explain, with its 95 % interval."
        ),
    )


def _remark(found: Repeatability, flight: int) -> str:
    stranger = found.strangers.get(flight)
    told = [f"other vehicle: {printable(stranger, 200)}"] if stranger else []
    return "; ".join([*told, *filter(None, [unknown_words(found, flight)])])


def _cell(quantity: RepeatedQuantity, flight: int) -> Cell:
    found: FlightEstimate | None = next((each for each in quantity.estimates if each.flight == flight), None)
    if found is None:
        return Cell(text="–", weak=True)
    text = plus_minus(found.value, found.half_width)
    return Cell(text=text, detail=mark(quantity, found).removeprefix(", "))


def _pair_rows(found: Repeatability) -> Iterator[tuple[Cell, ...]]:
    every = [(quantity, pair) for quantity in found.quantities for pair in quantity.pairs]
    every.sort(key=lambda each: -abs(each[1].z))
    for quantity, pair in every[:_MOST_PAIRS]:
        yield (
            Cell(text=f"{quantity.axis} {quantity.kind}".strip()),
            Cell(text=" and ".join(name_of(found, flight) for flight in pair.flights)),
            Cell(text=number(pair.z, 3)),
            Cell(
                text=number(pair.p_value, 2), detail="differ" if pair.differs else "", weak=not pair.differs
            ),
        )
