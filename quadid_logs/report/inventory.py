"""What is in a log, and what is missing for an analysis: the content of ``quadid-log info``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

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
from quadid_logs.report.commands import like_log
from quadid_logs.report.health_json import health_dict
from quadid_logs.report.json import SCHEMA_VERSION, data_dict, log_dict
from quadid_logs.report.log_tables import log_facts
from quadid_logs.report.numbers import number
from quadid_logs.report.strict_json import strict_text
from quadid_logs.untrusted import printable

_MOST_TYPES = 14
_NAME_WIDTH = 16


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
        "missing_for_analysis": missing_for_analysis(log, data),
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
    (_, file), *facts = _facts(log, data)
    yield Line(file)
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
    for name, value in facts:
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


def _facts(log: FlightLog, data: FlightData) -> Iterator[tuple[str, str]]:
    """Yield what the log is as the report says it, and what is in it."""
    yield from log_facts(log, data, analyzed=False)
    yield "Modes", ", ".join(dict.fromkeys(printable(mode.name, 24) for mode in data.modes[:200]))
    most = sorted(log.counts, key=lambda count: -count.count)[:_MOST_TYPES]
    shown = ", ".join(f"{printable(count.name, 60)} {count.count}" for count in most)
    more = f" and {len(log.counts) - len(most)} more types" if len(log.counts) > len(most) else ""
    yield "Messages", shown + more
