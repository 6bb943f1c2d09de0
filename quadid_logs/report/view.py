"""What the report says, computed before any template sees it: sentences, tables and lists of strings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

from quadid_logs.autopilots import named
from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.model import Model, SpectralFit
from quadid_logs.data.result import Result
from quadid_logs.report.cells import Table
from quadid_logs.report.commands import filled, on_log
from quadid_logs.report.fit_tables import excitation_table, structures_table, values_of, windows_table
from quadid_logs.report.health_view import HealthView, health_view
from quadid_logs.report.json import settings_of
from quadid_logs.report.log_tables import MOST_ROWS, log_facts, lost_blocks, main_signals, other_signals
from quadid_logs.report.loop_view import LoopView, loop_view
from quadid_logs.report.meaning import beside_published, meaning_sentence
from quadid_logs.report.model_tables import model_tables, more_tables
from quadid_logs.report.next_flight import next_steps
from quadid_logs.report.numbers import estimate, number, percent, seconds
from quadid_logs.report.provenance import LONGEST_COMMAND, Provenance
from quadid_logs.report.tune_view import TuneView, tune_view
from quadid_logs.report.verdict import (
    effect_sentence,
    flown_sentence,
    headline,
    input_unit,
    overall,
    refused_axes,
)
from quadid_logs.report.words import evidence_name, evidence_text
from quadid_logs.sentences import continued, listed
from quadid_logs.tuning import tuning_of
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES, RATE_SYMBOLS

_LEVELS = ("error", "warning", "info")
_VERDICTS = ("refused", "caution", "usable")
#: The hundreds of the codes: model, loop, flight, rates, vehicle, file.
_STAGES = "564321"


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisView:
    """The verdict of one axis in one sentence; ``reasons`` are codes with the number of their finding."""

    axis: str
    verdict: str
    sentence: str
    effect: str
    meaning: str
    reasons: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FindingView:
    """A finding: its place among all, what it means, what to do, and its evidence as name and value."""

    place: int
    code: str
    level: str
    title: str
    meaning: str
    advice: str
    axes: str
    evidence: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Everything that the page shows, in its order."""

    name: str
    subtitle: str
    overall: str
    headline: str
    axes: tuple[AxisView, ...]
    published: str
    model_sentence: str
    model_tables: tuple[Table, ...]
    more_tables: tuple[Table, ...]
    steps: tuple[str, ...]
    facts: tuple[tuple[str, str], ...]
    signals: Table
    more_signals: Table
    lost_blocks: tuple[str, ...]
    remarks: tuple[str, ...]
    messages: tuple[str, ...]
    structures: Table | None
    windows: Table | None
    excitation: Table | None
    validation_sentence: str
    health: HealthView
    loop: LoopView
    gains: TuneView
    tune_command: str
    png_command: str
    findings: tuple[FindingView, ...]
    notes: tuple[FindingView, ...]
    reproduction: tuple[tuple[str, str], ...]


def view_of(result: Result, provenance: Provenance) -> View:
    """Turn a result into texts.

    Parameters
    ----------
    result : Result
    provenance : Provenance

    Returns
    -------
    View
        Plain, visible text; not yet escaped for HTML.
    """
    model = result.identification.recommended
    ranked = [
        FindingView(
            place=place,
            code=printable(finding.code, 20),
            level=finding.level,
            title=printable(finding.title, 200),
            meaning=CATALOGUE[finding.code].meaning.replace("^2", "²") if finding.code in CATALOGUE else "",
            advice=filled(printable(finding.advice, 600), result),
            axes=", ".join(axis for axis in finding.axes if axis not in finding.title.lower()),
            evidence=tuple(
                (evidence_name(name), evidence_text(name, value)) for name, value in finding.evidence.items()
            ),
        )
        for place, finding in enumerate(by_consequence(result), start=1)
    ]
    log = result.log
    parts = [
        printable(log.vehicle_name, 60),
        printable(log.frame, 60),
        printable(log.vehicle_type, 40) if log.vehicle_type != "unknown" else "",
        printable(log.firmware, 80) or named(log.autopilot).title,
        flown_sentence(result),
    ]
    asked = printable(provenance.command, LONGEST_COMMAND) or on_log(result, "analyze")
    return View(
        name=printable(result.name, 120),
        subtitle=" · ".join(part for part in parts if part),
        overall=overall(result),
        headline=headline(result),
        axes=tuple(_axis(result, axis) for axis in AXES if axis in result.diagnosis.axes),
        published=beside_published(result),
        model_sentence=_model_sentence(result, model),
        model_tables=() if model is None else model_tables(result, model),
        more_tables=() if model is None else more_tables(result, model),
        steps=next_steps(result),
        facts=log_facts(log, result.data, analyzed=model is not None),
        signals=main_signals(result),
        more_signals=other_signals(result),
        lost_blocks=lost_blocks(result),
        remarks=tuple(printable(remark) for remark in result.log.remarks[:MOST_ROWS]),
        messages=tuple(
            f"{text.time_s:.1f} s: {printable(text.text)}" for text in result.data.texts[:MOST_ROWS]
        ),
        structures=structures_table(result),
        windows=windows_table(result),
        excitation=excitation_table(result),
        validation_sentence=_validation_sentence(model, result.identification.spectral),
        health=health_view(result),
        loop=loop_view(result),
        gains=tune_view(result, tuning_of(result)),
        tune_command=on_log(result, "tune"),
        png_command=f"{asked} --png all{'' if '--force' in asked.split() else ' --force'}",
        findings=tuple(each for each in ranked if each.level != "info"),
        notes=tuple(each for each in ranked if each.level == "info"),
        reproduction=_reproduction(result, provenance),
    )


def _axis(result: Result, axis: str) -> AxisView:
    """Return verdict, sentence and main number of an axis."""
    verdict = result.diagnosis.axes[axis]
    codes = [finding.code for finding in by_consequence(result)]
    return AxisView(
        axis=axis,
        verdict=verdict.verdict,
        sentence=printable(verdict.sentence, 400),
        effect=effect_sentence(result, axis),
        meaning=meaning_sentence(result, axis),
        reasons=tuple(
            (printable(code, 20), codes.index(code) + 1 if code in codes else 0) for code in verdict.reasons
        ),
    )


def _model_sentence(result: Result, model: Model | None) -> str:
    """Say what the recommended model is, or why there is none."""
    if model is None:
        first = next((each.title for each in result.diagnosis.findings if each.level == "error"), "")
        reason = continued(first) or result.identification.skipped or "this log holds too little"
        return f"No model was fitted: {printable(reason)}."
    parts = [
        f"Structure {model.structure}, fitted to {seconds(result.data.used_s)} of flight: "
        "[dp/dt, dq/dt, dr/dt] = A · regressors + B · [L, M, N]."
    ]
    actuator = model.actuator
    if actuator is not None and not all(refused_axes(result)):
        lag, delay = (
            _milliseconds(value_s, *ci95_s, known=known)
            for value_s, ci95_s, known in (
                (actuator.lag_s, actuator.lag_ci95_s, actuator.lag_identifiable),
                (actuator.delay_s, actuator.delay_ci95_s, actuator.delay_identifiable),
            )
        )
        parts.append(
            f"The {printable(actuator.acts_on, 30) or 'torque'} follows its command with a lag of {lag} "
            f"after a delay of {delay}."
        )
        if isfinite(actuator.lag_up_s) and actuator.lag_up_s != actuator.lag_down_s:
            up, down = number(actuator.lag_up_s * 1e3, 3), number(actuator.lag_down_s * 1e3, 3)
            parts.append(f"The rotors speed up in {up} ms and slow down in {down} ms.")
        if model.yaw_reaction is not None and not refused_axes(result)[AXES.index("yaw")]:
            lead = _milliseconds(model.yaw_reaction.lead_s, *model.yaw_reaction.ci95_s, known=True)
            parts.append(f"Rotors that speed up also turn the vehicle, so yaw leads its torque by {lead}.")
    if input_unit(result) == "1":
        parts.append("L, M and N are the autopilot's normalised commands, not N m.")
    if model.note:
        parts.append(printable(model.note))
    return " ".join(parts)


def _milliseconds(value_s: float, low_s: float, high_s: float, *, known: bool) -> str:
    """Return a time with its interval, of which no more may be known than how long it is at most."""
    value, low, high = 1e3 * value_s, 1e3 * low_s, 1e3 * high_s
    if low <= 0.0 and not known:
        return f"at most {number(high, 2)} ms"
    return f"{'' if known else 'about '}{estimate(value, low, high)} ms"


def _validation_sentence(model: Model | None, spectral: Sequence[SpectralFit] = ()) -> str:
    """Say how the model does on held-out data, and on commands where these alone tell an axis."""
    if model is None:
        return ""
    if not model.validation.held_out_s > 0.0:
        return "No data could be kept for validation, so the model is not validated."
    # What the verdict asks too: each axis by itself, so that none pays for another that is refused.
    r2 = values_of(model.validation.r2_high_passed_rate, RATE_SYMBOLS)
    by_commands = {axis: fit.r2_commanded for axis, fit in zip(AXES, spectral, strict=False) if fit.is_told}
    # Below zero it is worse than no model at all, and by how much tells nobody anything.
    told = [
        f"{percent(value)} of {axis}" if value > 0.0 else f"nothing of {axis}"
        for axis, value in zip(AXES, r2, strict=True)
        if axis not in by_commands
    ]
    simulated = (
        f"{seconds(model.validation.held_out_s)} of the flight are validation data, which the fit did not "
        f"use. In the fitted band, the rates simulated from the torque reproduce {listed(told)}."
        if told
        else ""
    )
    # What wind did cannot be simulated: there, only what was commanded tells how good a model is.
    commanded = [f"{percent(value)} of {axis}" for axis, value in by_commands.items()]
    of_commands = (
        "Wind or another effect also moved the vehicle, so its response to commands is judged. Of the "
        f"commanded acceleration, the model explains {listed(commanded)}."
        if commanded
        else ""
    )
    return f"{simulated} {of_commands}".strip()


def by_consequence(result: Result) -> tuple[Finding, ...]:
    """Return the findings, those first that decided a verdict, and what concerns the file alone last.

    Parameters
    ----------
    result : Result

    Returns
    -------
    tuple of Finding
        Errors, warnings, notes; among each, those that refused an axis before those that called for
        caution, and then the later stage before the earlier one: a lost byte matters by what it did to the
        model.
    """
    verdicts = result.diagnosis.axes.values()
    worst = {
        code: min(_VERDICTS.index(each.verdict) for each in verdicts if code in each.reasons)
        for verdict in verdicts
        for code in verdict.reasons
    }

    def rank(finding: Finding) -> tuple[int, int, int]:
        decided = worst.get(finding.code, len(_VERDICTS))
        return _LEVELS.index(finding.level), decided, _STAGES.find(finding.code[2:3])

    return tuple(sorted(result.diagnosis.findings, key=rank))


def _listed(settings: Mapping[str, object]) -> str:
    """Return names and values in one line."""
    return ", ".join(f"{name} = {value if value != '' else '(chosen)'}" for name, value in settings.items())


def _reproduction(result: Result, provenance: Provenance) -> tuple[tuple[str, str], ...]:
    """Return all that is needed to make the result again."""
    settings = result.settings
    every, default = settings_of(settings), settings_of(type(settings)())
    chosen = {name: value for name, value in every.items() if value != default[name]}
    timings = ", ".join(f"{name} {value:.2f} s" for name, value in result.timings_s.items())
    vehicle = result.vehicle
    return (
        ("quadid-logs", provenance.version),
        ("Command", printable(provenance.command, LONGEST_COMMAND) or "(called from Python)"),
        ("Log", printable(result.log.path)),
        ("SHA-256 of the log", provenance.log_sha256 or "the file can no longer be read"),
        (
            "Vehicle file",
            "none" if vehicle is None else printable(vehicle.name, 80) or "given, without a name",
        ),
        ("Settings chosen", _listed(chosen) or "none: all at the defaults of this version"),
        ("All settings", _listed(every)),
        ("Time taken", timings or "–"),
    )
