"""What the log is, where each signal comes from, and how it was really sampled."""

from __future__ import annotations

import math
from collections.abc import Iterable

from quadid_logs.align.clock import EVENTS
from quadid_logs.autopilots import formats, named
from quadid_logs.counting import counted
from quadid_logs.data.flight import FlightData, SourceChoice
from quadid_logs.data.log import FlightLog
from quadid_logs.data.result import Result
from quadid_logs.report.airframe_facts import airframe_facts
from quadid_logs.report.cells import Cell, Table
from quadid_logs.report.numbers import number, percent, seconds, size
from quadid_logs.report.words import pretty_unit, signal_name
from quadid_logs.sentences import some
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import NOT_A_MULTIROTOR, SIGNALS

#: What a model rests on; the other signals say when the vehicle flew and what the mixer did.
_MAIN_SIGNALS = frozenset({"torque_n_m", "torque_command", "body_rate", "attitude", "throttle"})


MOST_ROWS = 60


def log_facts(log: FlightLog, data: FlightData, *, analyzed: bool) -> tuple[tuple[str, str], ...]:
    """Return what the log is, name and value: for the report and for ``info``.

    Parameters
    ----------
    analyzed : bool
        Whether a model was fitted to what has no gaps.
    """
    period_s = data.sample_period_s
    lost = f"{size(log.corrupt_bytes)} in {counted(len(log.lost), 'block')}"
    dropped = f"{counted(log.n_dropped, 'message')} dropped by the autopilot"
    torque = "none found"
    if data.input is not None:
        unit = "in N m" if data.input.unit == "N m" else "normalised command, not N m"
        saturated = percent(data.input.saturated_fraction)
        torque = f"{printable(data.input.source, 120)}, {unit}; {saturated} of the samples saturated"
    # The dialect, too, where it has no title of its own.
    titles = {(one.name, one.dialect): one.title for one in formats()}
    plain = titles.get((log.format, ""), printable(log.format, 40))
    title = titles.get((log.format, log.dialect), f"{plain} {printable(log.dialect, 40)}".rstrip())
    clock = "covers no time" if log.has_time else "not logged"
    if log.has_time and data.duration_s > 0.0:
        resets = counted(data.clock_resets, "reset") if data.clock_resets else "no resets"
        ends = f"{data.start_s:.1f} to {data.start_s + data.duration_s:.1f} s on the log's clock"
        clock = f"{seconds(data.duration_s)}, {ends}; {resets}"
    facts = [
        ("File", f"{printable(log.path)} ({size(log.n_bytes)})"),
        ("Format", title),
        ("Autopilot", named(log.autopilot).title),
        ("Firmware", printable(log.firmware, 120) or "not stated"),
        (
            "Vehicle",
            ", ".join(filter(None, (printable(log.vehicle_type, 40), printable(log.vehicle_name, 60)))),
        ),
        ("Frame", printable(log.frame, 80) or "not stated"),
        ("Clock", clock),
        ("Torque", torque),
        ("Flights", flights_text(log, data)),
        (
            "Analyzed" if analyzed else "Without gaps",
            spans_text((item.start_s, item.end_s) for item in data.segments) or "nothing",
        ),
        ("Resampled to", f"{1.0 / period_s:.4g} Hz" if math.isfinite(period_s) and period_s > 0 else "–"),
        ("Missing", "; ".join([lost] * bool(log.lost) + [dropped] * bool(log.n_dropped)) or "nothing"),
    ]
    facts += airframe_facts(log)
    if log.systems:
        systems = [
            f"{system.system_id}/{system.component_id} {printable(system.vehicle_type, 30)}"
            f" {counted(system.n_messages, 'message')}" + (" (chosen)" if system.chosen else "")
            for system in log.systems
        ]
        facts.append(("MAVLink systems", some(systems, log.n_systems)))
    return tuple(facts)


def flights_text(log: FlightLog, data: FlightData) -> str:
    """Return the flights in words, or why there is none; a rover's drives are none either."""
    if not log.may_be_multirotor:
        return NOT_A_MULTIROTOR
    return spans_text(data.flights) or printable(data.on_ground_reason) or "none"


def spans_text(spans: Iterable[tuple[float, float]]) -> str:
    """Return intervals of time in words, the first few in full."""
    listed = list(spans)
    shown = ", ".join(f"{start:.1f} to {end:.1f} s" for start, end in listed[:6])
    return shown + (f" and {len(listed) - 6} more" if len(listed) > 6 else "")


def main_signals(result: Result) -> Table:
    """Return each signal with its source, true rate, gaps and losses."""
    return _signal_table("Signals, where they come from, and how they were really sampled", result, main=True)


def other_signals(result: Result) -> Table:
    """Return the same for the signals that the model does not rest on."""
    return _signal_table("Other signals", result, main=False)


def _signal_table(caption: str, result: Result, *, main: bool) -> Table:
    """Return a table of the signals that the model rests on, or of the others."""
    found = [choice for choice in result.data.sources.values() if (choice.signal in _MAIN_SIGNALS) == main]
    return Table(
        caption=caption,
        head=("signal", "source and why", "true rate [Hz]", "longest gap [s]", "gaps", "rows skipped"),
        rows=tuple(_signal(choice) for choice in found[:MOST_ROWS]),
    )


def _signal(choice: SourceChoice) -> tuple[Cell, ...]:
    """Return one row of the table of signals."""
    name = signal_name(choice.signal)
    why = printable(choice.reason, 240)
    if choice.others:
        others = ", ".join(
            f"{printable(source, 60)} ({number(rate, 3)} Hz)" for source, rate in choice.others[:4]
        )
        why += f". Not taken: {others}"
    aside = {
        "repeated": choice.n_duplicate,
        "reordered": choice.n_out_of_order,
        "impossible time": choice.n_outliers,
        "without a possible value": choice.n_not_finite,
    }
    return (
        Cell(text=name, detail=_unit(choice.signal)),
        Cell(text=printable(choice.source, 120), detail=why),
        Cell(text=number(choice.rate_hz), detail=f"mean {number(choice.mean_rate_hz)}")
        if choice.rate_hz > 0.0
        else Cell(text="events"),
        Cell(text=number(choice.longest_gap_s, 3) if choice.rate_hz > 0.0 else "–"),
        Cell(text=str(choice.n_gaps)),
        Cell(text=", ".join(f"{count} {word}" for word, count in aside.items() if count) or "none"),
    )


def _unit(signal: str) -> str:
    """Return the unit of a canonical signal as people read it."""
    if signal in EVENTS:
        return "on or off"
    unit = SIGNALS[signal].unit if signal in SIGNALS else ""
    return "normalised" if unit == "1" else pretty_unit(unit).replace("us", "µs")


def lost_blocks(result: Result) -> tuple[str, ...]:
    """Return what could not be read, each block of bytes in a line."""
    lost = result.log.lost
    lines = [
        f"{block.n_bytes} bytes at offset {block.offset}: {printable(block.reason, 160)}"
        for block in lost[:MOST_ROWS]
    ]
    if len(lost) > MOST_ROWS:
        lines.append(f"and {len(lost) - MOST_ROWS} more")
    return tuple(lines)
