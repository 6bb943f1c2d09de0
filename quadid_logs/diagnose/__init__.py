"""FlightLog + FlightData + Identification -> Diagnosis: findings, and a verdict per axis."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.diagnosis import AxisVerdict, Diagnosis, Finding
from quadid_logs.data.flight import FlightData
from quadid_logs.data.health import Rotors
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification
from quadid_logs.data.result import PooledLog
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.diagnose.advice import advice_for
from quadid_logs.diagnose.data_findings import find_in_data
from quadid_logs.diagnose.file_findings import find_in_file, find_in_pool
from quadid_logs.diagnose.gyro_findings import find_in_gyro
from quadid_logs.diagnose.model_findings import find_in_models
from quadid_logs.diagnose.structural_findings import find_in_rotors, find_in_structure
from quadid_logs.diagnose.torque_findings import find_in_given_inertia, find_in_torque, find_in_weight
from quadid_logs.vocabulary import AXES

__all__ = ["diagnose", "remedied", "with_findings"]

_SEVERITY = {"error": 0, "warning": 1, "info": 2}


def diagnose(
    log: FlightLog,
    data: FlightData,
    identification: Identification,
    pooled: Sequence[PooledLog] = (),
    vehicle: Vehicle | None = None,
    rotors: Rotors | None = None,
) -> Diagnosis:
    """Judge what was read, aligned and identified.

    Parameters
    ----------
    log : FlightLog
    data : FlightData
    identification : Identification
    pooled : sequence of PooledLog
        The logs behind the one model, where there are several.
    vehicle : Vehicle, optional
        What the user gave: its inertia is compared with the control effectiveness.
    rotors : Rotors, optional
        What the flight tells of each rotor; intervals hold what one that lost thrust changed.

    Returns
    -------
    Diagnosis
        An axis is *refused* if any error touches it, *caution* if any warning
        does, else *usable*.

    Examples
    --------
    >>> from quadid_logs.data.flight import FlightData
    >>> log = FlightLog(path="a.csv", format="table", autopilot="other", n_bytes=0, signals={})
    >>> nothing = FlightData(
    ...     sample_period_s=0.01, segments=(), flights=(), sources={}, input=None, start_s=0.0, duration_s=0.0
    ... )
    >>> diagnose(log, nothing, Identification()).axes["roll"].verdict
    'refused'
    """
    found = [
        *find_in_pool(pooled, identification),
        *find_in_file(log, data),
        *find_in_data(log, data, identification),
        *find_in_gyro(data),
        *find_in_torque(log, data, identification),
        *find_in_models(log, identification),
        *find_in_structure(data, identification),
        *find_in_rotors(identification, rotors),
        *find_in_given_inertia(data, identification, vehicle),
        *find_in_weight(data, vehicle),
    ]
    told = remedied(found, log.autopilot, log.version)
    findings = sorted(told, key=lambda finding: _SEVERITY[finding.level])
    return Diagnosis(
        findings=tuple(findings),
        axes={axis: _verdict(axis, findings) for axis in AXES},
    )


def with_findings(
    diagnosis: Diagnosis, found: Iterable[Finding], autopilot: str, version: tuple[int, ...] | None = None
) -> Diagnosis:
    """Add what a later stage found.

    Parameters
    ----------
    diagnosis : Diagnosis
    found : iterable of Finding
    autopilot : str
        As in `FlightLog.autopilot`.
    version : tuple of int or None
        Of the firmware.

    Returns
    -------
    Diagnosis
        With the verdicts anew.
    """
    every = [*diagnosis.findings, *remedied(found, autopilot, version)]
    findings = sorted(every, key=lambda finding: _SEVERITY[finding.level])
    return Diagnosis(findings=tuple(findings), axes={axis: _verdict(axis, findings) for axis in AXES})


def remedied(
    findings: Iterable[Finding], autopilot: str, version: tuple[int, ...] | None = None
) -> Iterator[Finding]:
    """Put what to do on this autopilot in the place of the catalogue's advice.

    Parameters
    ----------
    findings : iterable of Finding
    autopilot : str
        As in `FlightLog.autopilot`.
    version : tuple of int or None
        Of the firmware.

    Yields
    ------
    Finding
    """
    advice = advice_for(autopilot)
    for finding in findings:
        yield replace(finding, advice=advice.remedy(finding.code, version) or finding.advice)


def _verdict(axis: str, findings: list[Finding]) -> AxisVerdict:
    """Sum up what touches one axis; the sentence gives the reason and leaves the verdict to its own word."""
    touching = [
        finding
        for finding in findings
        if (not finding.axes or axis in finding.axes) and CATALOGUE[finding.code].scope == "model"
    ]
    errors = [finding for finding in touching if finding.level == "error"]
    warnings = [finding for finding in touching if finding.level == "warning"]
    if errors:
        return AxisVerdict(verdict="refused", reasons=_codes(errors), sentence=f"{errors[0].title}.")
    if warnings:
        # What is about this axis tells its pilot more than what is about the whole file.
        first = min(warnings, key=lambda one: not one.axes)
        return AxisVerdict(verdict="caution", reasons=_codes(warnings), sentence=f"{first.title}.")
    by_commands = next((each for each in touching if each.code == "QL535"), None)
    sentence = "The model predicts validation data." if by_commands is None else f"{by_commands.title}."
    return AxisVerdict(verdict="usable", reasons=(), sentence=sentence)


def _codes(findings: list[Finding]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(finding.code for finding in findings))
