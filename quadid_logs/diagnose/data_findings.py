"""Doubts about what was logged, how fast, and whether the vehicle flew."""

from __future__ import annotations

from collections.abc import Iterator

from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.flight import FlightData, SourceChoice
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification
from quadid_logs.data.settings import Settings
from quadid_logs.diagnose.advice import logging_advice
from quadid_logs.diagnose.findings import finding
from quadid_logs.diagnose.torque_findings import not_in_newton_metres

#: A signal that is this much slower on average than between typical samples is not what it seems.
_RATE_SHORTFALL = 0.7
#: Angles interpolated over more than this say little about their own rate of change.
_MIN_ATTITUDE_HZ = 20.0


def find_in_data(
    log: FlightLog, data: FlightData, identification: Identification, settings: Settings
) -> Iterator[Finding]:
    """Yield the findings about signals, rates and flight."""
    if not log.has_time:
        return
    advice = logging_advice(log.autopilot, log.format, log.parameters)
    rate = data.sources.get("body_rate")
    torque = data.sources.get("torque_n_m") or data.sources.get("torque_command")
    logged = ", ".join(sorted(data.sources)) or "nothing usable"
    if rate is None:
        yield finding("QL301", "error", {"found": logged}, advice=advice)
    if torque is None:
        yield finding("QL302", "error", {"found": logged}, advice=advice)
    for source in (rate, torque):
        if source is not None:
            yield from _rate(source, advice, settings)
    yield from _attitude(data)
    yield from _flight(data, identification, settings)
    if data.input is not None and data.input.unit == "1":
        yield not_in_newton_metres(log, data.input)


def _rate(source: SourceChoice, advice: str, settings: Settings) -> Iterator[Finding]:
    evidence = {
        "signal": source.signal,
        "source": source.source,
        "rate_hz": round(source.rate_hz, 2),
        "mean_rate_hz": round(source.mean_rate_hz, 2),
        "longest_gap_s": round(source.longest_gap_s, 3),
    }
    if source.rate_hz < settings.min_rate_hz:
        yield finding(
            "QL303",
            "error",
            {**evidence, "needed_hz": settings.min_rate_hz},
            advice=advice,
            title=f"{_spoken(source.signal)} was logged at {source.rate_hz:.3g} Hz, "
            "too slowly to identify anything",
        )
    elif source.rate_hz < settings.caution_rate_hz:
        yield finding("QL304", "warning", {**evidence, "better_hz": settings.caution_rate_hz}, advice=advice)
    if source.mean_rate_hz < _RATE_SHORTFALL * source.rate_hz:
        yield finding("QL305", "info", {**evidence, "gaps": source.n_gaps})


def _too_slow(data: FlightData, settings: Settings) -> bool:
    """Return whether a rate is the reason that nothing was identified."""
    return any(
        source.rate_hz < settings.min_rate_hz
        for name, source in data.sources.items()
        if name in ("body_rate", "torque_command", "torque_n_m")
    )


def _spoken(signal: str) -> str:
    return {"body_rate": "The body rate", "torque_command": "The torque", "torque_n_m": "The torque"}[signal]


def _attitude(data: FlightData) -> Iterator[Finding]:
    attitude = data.sources.get("attitude")
    if attitude is None:
        yield finding("QL306", "info", {"attitude": "not logged"})
    elif attitude.rate_hz < _MIN_ATTITUDE_HZ:
        yield finding("QL306", "info", {"source": attitude.source, "rate_hz": round(attitude.rate_hz, 2)})


def _flight(data: FlightData, identification: Identification, settings: Settings) -> Iterator[Finding]:
    airborne_s = sum(end - start for start, end in data.flights)
    if not data.flights:
        yield finding(
            "QL401",
            "error",
            {"reason": data.on_ground_reason},
            title=f"No flight in this log: {data.on_ground_reason or 'nothing tells of one'}",
        )
        return
    usable_s = data.n_samples * data.sample_period_s if data.segments else 0.0
    if airborne_s < settings.min_flight_s:
        yield finding(
            "QL402", "error", {"airborne_s": round(airborne_s, 2), "needed_s": settings.min_flight_s}
        )
    elif data.input is not None and "body_rate" in data.sources and usable_s < settings.min_flight_s:
        yield finding(
            "QL402",
            "error",
            {
                "airborne_s": round(airborne_s, 2),
                "gap_free_s": round(usable_s, 2),
                "needed_s": settings.min_flight_s,
            },
            title="The flight without gaps is too short",
        )
    elif data.segments and identification.skipped and not _too_slow(data, settings):
        yield finding("QL402", "error", {"reason": identification.skipped, "gap_free_s": round(usable_s, 2)})
