"""Caveats about what was logged, how fast, and whether the vehicle flew."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.flight import LEAST_FLIGHT_S, FlightData, SourceChoice
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification
from quadid_logs.diagnose.advice import advice_for
from quadid_logs.diagnose.findings import finding, rounded
from quadid_logs.diagnose.torque_findings import not_in_newton_metres
from quadid_logs.identify import MIN_RATE_HZ
from quadid_logs.numerals import number
from quadid_logs.vocabulary import AXES

#: A signal that is this much slower on average than between typical samples is not what it seems.
_RATE_SHORTFALL = 0.7
#: Angles interpolated over more than this say little about their own rate of change.
_MIN_ATTITUDE_HZ = 20.0
#: By the vehicle's own clock a nominal rate comes out up to some per cent off.
_AS_NOMINAL = 0.95
#: Between the least rate and this, lag and effectiveness can only be told apart on calm data.
_CAUTION_RATE_HZ = 90.0


def find_in_data(log: FlightLog, data: FlightData, identification: Identification) -> Iterator[Finding]:
    """Yield the findings about signals, rates and flight; none about a vehicle that the model is not for.

    Parameters
    ----------
    log : FlightLog
    data : FlightData
    identification : Identification
        Empty where nothing was fitted yet.

    Yields
    ------
    Finding
    """
    if not log.has_time or not log.may_be_multirotor:
        return
    advice = advice_for(log.autopilot).logging(log.format, log.parameters, log.version)
    rate = data.sources.get("body_rate")
    torque = data.sources.get("torque_n_m") or data.sources.get("torque_command")
    logged = sorted(data.sources)
    # Without a flight, a pilot must be told of that first.
    if not data.flights:
        reason = data.on_ground_reason
        title = f"No flight in this log: {reason or 'nothing shows one'}"
        yield finding("QL401", "error", {"reason": reason}, title=title)
    # A log that covers no time would hold them later: how it is logged is not to be blamed.
    covers_time = data.duration_s > 0.0
    if rate is None and covers_time:
        yield finding("QL301", "error", {"found": logged}, advice=advice)
    if torque is None and covers_time:
        yield _no_torque(data, advice)
    # A few rows have no rate: where nothing was flown either, they ask for no other way of logging.
    sources = [source for source in (rate, torque) if source is not None and (source.rate_hz or data.flights)]
    yield from _rates(sources, advice, only_yaw=identification.only_yaw)
    yield from _attitude(data)
    if data.flights:
        yield from _flight(data, identification)
    yield from _system_identification(log, data)
    if 0 < identification.n_samples < data.n_samples:
        minute = 60.0 / data.sample_period_s
        evidence = {
            "used_min": round(identification.n_samples / minute, 1),
            "flown_min": round(data.n_samples / minute, 1),
        }
        yield finding("QL311", "info", evidence)
    if data.input is not None and data.input.unit == "1":
        yield not_in_newton_metres(log, data.input)


def _no_torque(data: FlightData, advice: str) -> Finding:
    """Say that there is no torque, and that none follows from motor outputs where they were logged."""
    evidence: dict[str, object] = {"found": sorted(data.sources)}
    outputs = data.sources.get("motor_thrust") or data.sources.get("output_pwm")
    if outputs is None:
        return finding("QL302", "error", evidence, advice=advice)
    evidence |= {"motor_outputs": outputs.source, "motor_outputs_hz": round(outputs.rate_hz, 2)}
    title = (
        "No torque was logged, and none can be computed from the motor outputs logged at "
        f"{number(outputs.rate_hz, 3)} Hz"
    )
    return finding("QL302", "error", evidence, advice=advice, title=title)


def _rates(sources: Sequence[SourceChoice], advice: str, *, only_yaw: bool) -> Iterator[Finding]:
    """Judge how fast rates and torque were logged, in one finding for both."""
    slow = [source for source in sources if source.rate_hz < MIN_RATE_HZ]
    slowish = [source for source in sources if source.rate_hz < _CAUTION_RATE_HZ]
    if slow:
        yield finding(
            "QL303",
            "error",
            {**_sampling(slow), "needed_hz": MIN_RATE_HZ},
            axes=AXES[:2] if only_yaw else (),
            advice=advice,
            title=f"{_told(slow)}: too slowly to identify {'roll or pitch' if only_yaw else 'anything'}",
        )
    elif slowish:
        yield finding(
            "QL304",
            "warning",
            {**_sampling(slowish), "better_hz": _CAUTION_RATE_HZ},
            advice=advice,
            title=f"{_told(slowish)}: rather slowly",
        )
    sparse = [source for source in sources if source.mean_rate_hz < _RATE_SHORTFALL * source.rate_hz]
    if sparse:
        yield finding("QL305", "info", _sampling(sparse))


def _sampling(sources: Sequence[SourceChoice]) -> dict[str, object]:
    """Return the evidence of how each source was sampled."""
    return {
        source.signal: {
            "source": source.source,
            "rate_hz": round(source.rate_hz, 2),
            "mean_rate_hz": round(source.mean_rate_hz, 2),
            "longest_gap_s": round(source.longest_gap_s, 3),
            "gaps": source.n_gaps,
        }
        for source in sources
    }


def _told(sources: Sequence[SourceChoice]) -> str:
    """Say in words at which rates the sources were logged."""
    rates = {_rate_words(source) for source in sources}
    names = [_SPOKEN[source.signal] for source in sources]
    if len(rates) == 1:
        subject = " and ".join(names)
        verb = "were" if len(names) > 1 else "was"
        return f"{subject[:1].upper()}{subject[1:]} {verb} logged {rates.pop()}"
    first, second = (_rate_words(source) for source in sources)
    return f"{names[0][:1].upper()}{names[0][1:]} was logged {first} and {names[1]} {second}"


def _rate_words(source: SourceChoice) -> str:
    """Say at which rate a source was logged; a few rows, or pauses alone, have none."""
    if not source.rate_hz:
        return f"in {source.n_samples} rows, too few for a rate"
    return f"at {number(source.rate_hz, 3)} Hz"


_SPOKEN = {"body_rate": "the body rate", "torque_command": "the torque", "torque_n_m": "the torque"}


def _too_slow(data: FlightData) -> bool:
    """Return whether a rate is the reason that nothing was identified."""
    return any(
        source.rate_hz < MIN_RATE_HZ
        for name, source in data.sources.items()
        if name in ("body_rate", "torque_command", "torque_n_m")
    )


def _attitude(data: FlightData) -> Iterator[Finding]:
    attitude = data.sources.get("attitude")
    if attitude is None:
        yield finding("QL306", "info", {"attitude": "not logged"})
    elif attitude.rate_hz < _AS_NOMINAL * _MIN_ATTITUDE_HZ:
        yield finding("QL306", "info", {"source": attitude.source, "rate_hz": round(attitude.rate_hz, 2)})


def _flight(data: FlightData, identification: Identification) -> Iterator[Finding]:
    airborne_s = sum(end - start for start, end in data.flights)
    usable_s = data.n_samples * data.sample_period_s if data.segments else 0.0
    if airborne_s < LEAST_FLIGHT_S:
        yield finding("QL402", "error", {"airborne_s": round(airborne_s, 2), "needed_s": LEAST_FLIGHT_S})
    elif data.input is not None and "body_rate" in data.sources and usable_s < LEAST_FLIGHT_S:
        yield finding(
            "QL402",
            "error",
            {
                "airborne_s": round(airborne_s, 2),
                "gap_free_s": round(usable_s, 2),
                "needed_s": LEAST_FLIGHT_S,
            },
            title="The flight without gaps is too short",
        )
    elif (
        data.segments
        and identification.skipped
        # Where a rate is the reason, that is said by itself.
        and not _too_slow(data)
    ):
        yield finding("QL402", "error", {"reason": identification.skipped, "gap_free_s": round(usable_s, 2)})


def _system_identification(log: FlightLog, data: FlightData) -> Iterator[Finding]:
    """Say when an excitation was injected, and on which axis if the parameters tell."""
    chirp = data.overview.get("sysid_chirp")
    if chirp is None:
        return
    running = chirp.time_s[np.abs(chirp.values[:, 0]) > 0.0]
    if not running.size:
        return
    source = data.sources["sysid_chirp"].source
    evidence: dict[str, object] = {
        "from_s": round(float(running[0]), 2),
        "to_s": round(float(running[-1]), 2),
        "source": source,
    }
    for name in advice_for(log.autopilot).excitation_parameters:
        if name in log.parameters:
            evidence[name] = rounded(log.parameters[name])
    yield finding("QL406", "info", evidence)
