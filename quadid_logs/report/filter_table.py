"""The filters of each axis as a table: what each costs in phase, and what it takes away at each line."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from quadid_logs.control.filters import filter_costs, lines_of, rate_crossover
from quadid_logs.data.controller import FilterPlace
from quadid_logs.data.health import LineSource
from quadid_logs.data.result import Result
from quadid_logs.report.cells import Cell, Table, estimated_cell
from quadid_logs.report.numbers import number

#: Columns of lines, the highest first: more do not fit a page.
_MOST_LINES: Final = 5
_PLACES: Final = MappingProxyType(
    {
        FilterPlace.GYRO: "gyro",
        FilterPlace.ERROR: "rate error",
        FilterPlace.PART: "one term (P or D)",
        FilterPlace.COMMAND: "command",
    }
)


def filter_tables(result: Result) -> tuple[Table, ...]:
    """Return a table of the filters for each axis whose controller is known."""
    loop, every_line = result.closed_loop, lines_of(result.health)
    if loop is None:
        return ()
    tables = []
    for axis, found in loop.axes.items():
        controller, crossover_hz = loop.controllers.axes[axis], rate_crossover(found)
        if controller.filters:
            strongest = sorted(every_line.get(axis, ()), key=lambda line: -line.height_db)[:_MOST_LINES]
            lines = sorted(strongest, key=lambda line: line.frequency_hz)
            costs = filter_costs(controller, crossover_hz, lines)
            at = "" if crossover_hz is None else f" at {number(crossover_hz.value, 3)} Hz"
            if crossover_hz is None:
                parts = ["The crossover of this axis is unknown, so no phase is given."]
            else:
                parts = [
                    "Phase lost at the crossover of the rate loop. Small: over the crossover's 95 % interval."
                ]
            if lines:
                parts.append(
                    "Gain at the lines of the gyro's spectrum. A filter of one term (P or D) acts on that "
                    "term only."
                )
                if any(len(set(cost.centre_hz)) > 1 for cost in costs):
                    parts.append(
                        "A notch that follows the rotors is assumed to stay on their line. At any other "
                        "line, its mean power counts."
                    )
            heads, rows = [], []
            for line in lines:
                of_rotor = line.source is LineSource.ROTOR and line.harmonic
                rotor = f", {line.harmonic} x rotor" if of_rotor else ""
                heads.append(f"line at {number(line.frequency_hz, 3)} Hz{rotor} [dB]")
            for cost in costs:
                gains = (Cell(text=f"{gain_db:.1f}".replace("-", "−")) for gain_db in cost.at_lines_db)
                name = cost.name or "whole path of the gyro"
                centre = ""
                if cost.centre_hz:
                    low, middle, high = (number(each, 3) for each in cost.centre_hz)
                    centre = f"{middle} Hz" if low == high else f"{middle} Hz, from {low} to {high}"
                rows.append(
                    (
                        Cell(text=name, detail=centre),
                        Cell(text=_PLACES[cost.place]),
                        estimated_cell(cost.phase_deg),
                        *gains,
                    )
                )
            tables.append(
                Table(
                    caption=f"Filters, {axis}",
                    head=("filter", "acts on", f"phase lost{at} [deg]", *heads),
                    rows=tuple(rows),
                    note=" ".join(parts),
                )
            )
    return tuple(tables)
