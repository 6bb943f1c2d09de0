"""What is in a log, and what is missing for an analysis: the content of ``quadid-log info``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from quadid_logs.autopilots import named
from quadid_logs.counting import counted
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.flight import FlightData
from quadid_logs.data.health import Health
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification
from quadid_logs.diagnose import remedied
from quadid_logs.diagnose.advice import next_steps
from quadid_logs.diagnose.data_findings import find_in_data
from quadid_logs.diagnose.file_findings import find_in_file
from quadid_logs.diagnose.gyro_findings import find_in_gyro
from quadid_logs.identify.slow_yaw import may_tell_yaw
from quadid_logs.report.airframe_facts import airframe_facts
from quadid_logs.report.commands import like_log
from quadid_logs.report.health_json import health_dict
from quadid_logs.report.json import SCHEMA_VERSION, data_dict, finding_dict, log_dict, strict_text
from quadid_logs.report.log_tables import flights_text, spans_text
from quadid_logs.report.numbers import number, size
from quadid_logs.sentences import some
from quadid_logs.untrusted import printable

_MOST_TYPES = 14
_NAME_WIDTH = 11


def missing_for_analysis(log: FlightLog, data: FlightData) -> tuple[Finding, ...]:
    """Return what `analyze` would complain about before it has looked at the motion.

    Errors first, then warnings. Whether the flight excited every axis only `analyze` can tell.
    """
    told = (
        *find_in_file(log, data),
        *find_in_data(log, data, Identification(only_yaw=may_tell_yaw(data))),
        *find_in_gyro(data),
    )
    found = list(remedied(told, log.autopilot, log.version))
    return tuple(finding for level in ("error", "warning") for finding in found if finding.level == level)


def inventory_text(log: FlightLog, data: FlightData, health: Health) -> str:
    """Return the inventory as JSON."""
    content: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "log": log_dict(log, data),
        "data": data_dict(data),
        "messages": [
            {"name": count.name, "count": count.count, "rate_hz": count.rate_hz} for count in log.counts
        ],
        "modes": [{"time_s": mode.time_s, "name": mode.name} for mode in data.modes],
        "n_parameters": len(log.parameters),
        "health": health_dict(health),
        "missing_for_analysis": [finding_dict(finding) for finding in missing_for_analysis(log, data)],
    }
    return strict_text(content)


class Line(NamedTuple):
    """A line for people; where it is broken, what follows is indented by ``hang`` columns."""

    text: str
    hang: int = 0


def inventory_lines(log: FlightLog, data: FlightData) -> Iterator[Line]:
    """Yield the inventory: whether analyze can work with it, then what the log is, then its signals.

    Yields
    ------
    Line
        Without control characters, whatever the log holds.
    """
    yield Line(
        f"{printable(log.path)}  {size(log.n_bytes)}, {log.format} {printable(log.dialect, 40)}".rstrip()
    )
    # Whether `analyze` can work with the log, what it will complain about, and what to fly then.
    found = missing_for_analysis(log, data)
    missing = [finding for finding in found if finding.level == "error"]
    if any(not finding.axes for finding in missing):
        yield Line(f"  analyze will refuse it: {counted(len(missing), 'obstacle')}")
    elif missing:
        axes = " and ".join(dict.fromkeys(axis for finding in missing for axis in finding.axes))
        yield Line(f"  analyze will refuse {axes}: {counted(len(missing), 'obstacle')}")
    else:
        yield Line(
            "  analyze can work with it" + (", with caveats" if found else ": nothing is missing in the log")
        )
    for finding in found:
        word = "obstacle" if finding.level == "error" else "caution"
        yield Line(f"    {word}: {printable(finding.title)} [{finding.code}]", 6)
        if finding.advice:
            yield Line(f"      {like_log(printable(finding.advice, 600), log.path)}", 6)
    told = {finding.advice for finding in found}
    for step in next_steps((log, finding) for finding in found):
        if step not in told:
            yield Line(f"    then: {like_log(printable(step, 800), log.path)}", 6)
    yield Line("")
    for name, value in (*_facts(log, data), *((name.lower(), value) for name, value in airframe_facts(log))):
        if value:
            yield Line(f"  {name:<{_NAME_WIDTH}}{value}", 2 + _NAME_WIDTH)
    yield Line("")
    yield Line(f"  {'signal':<21}{'true rate':>10}{'longest gap':>13}  source")
    for choice in data.sources.values():
        # The source of one signal, why it was taken, and those not taken.
        sampled = choice.rate_hz > 0.0
        rate = f"{number(choice.rate_hz, 4)} Hz" if sampled else "events"
        gap = (
            f"{number(choice.longest_gap_s, 3)} s" if sampled and math.isfinite(choice.longest_gap_s) else "–"
        )
        yield Line(
            f"  {printable(choice.signal, 20):<21}{rate:>10}{gap:>13}  {printable(choice.source, 80)}", 4
        )
        if choice.reason:
            yield Line(f"    {printable(choice.reason, 240)}", 4)
        for source, other_hz in choice.others[:4]:
            yield Line(f"    not taken: {printable(source, 80)} at {number(other_hz, 4)} Hz", 4)
    for remark in log.remarks[:20]:
        yield Line(f"  Note: {printable(remark)}", 4)


def _facts(log: FlightLog, data: FlightData) -> tuple[tuple[str, str], ...]:
    """Return what the log is, name and value; empty where it says nothing."""
    most = sorted(log.counts, key=lambda count: -count.count)[:_MOST_TYPES]
    shown = ", ".join(f"{printable(count.name, 60)} {count.count}" for count in most)
    more = f" and {len(log.counts) - len(most)} more types" if len(log.counts) > len(most) else ""
    systems = [
        f"{system.system_id}/{system.component_id} {printable(system.vehicle_type, 30)}"
        f" {counted(system.n_messages, 'message')}" + (" (chosen)" if system.chosen else "")
        for system in log.systems
    ]
    return (
        ("autopilot", named(log.autopilot).title),
        ("firmware", printable(log.firmware, 120)),
        ("vehicle", ", ".join(filter(None, map(printable, (log.vehicle_type, log.frame, log.vehicle_name))))),
        (
            "time",
            f"{data.start_s:.1f} to {data.start_s + data.duration_s:.1f} s, "
            f"{counted(data.clock_resets, 'clock reset')}"
            if log.has_time
            else "not logged",
        ),
        ("flights", flights_text(log, data)),
        ("analyzable", spans_text((part.start_s, part.end_s) for part in data.segments) or "nothing"),
        (
            "lost",
            f"{size(log.corrupt_bytes)} unreadable, "
            f"{counted(log.n_dropped, 'message')} dropped by the autopilot",
        ),
        ("modes", ", ".join(dict.fromkeys(printable(mode.name, 24) for mode in data.modes[:200]))),
        ("systems", some(systems, log.n_systems)),
        ("messages", shown + more),
    )
