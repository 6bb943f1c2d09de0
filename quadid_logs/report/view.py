"""What the report says, computed before any template sees it: sentences, tables and lists of strings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.flight import FlightData, SourceChoice
from quadid_logs.data.model import Inertia, Model, Parameter, Windows
from quadid_logs.data.result import Result
from quadid_logs.report.airframe import airframe_facts
from quadid_logs.report.numbers import estimate, interval, number, percent, seconds, size
from quadid_logs.report.provenance import Provenance
from quadid_logs.report.published import comparison_rows
from quadid_logs.report.words import evidence_name, evidence_text, signal_name
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, RATE_SYMBOLS, SIGNALS

_TARGETS = {"p_dot": "dp/dt", "q_dot": "dq/dt", "r_dot": "dr/dt"}
_MOST_STEPS = 5
#: What a model rests on; the other signals say when the vehicle flew and what the mixer did.
_MAIN_SIGNALS = frozenset({"torque_n_m", "torque_command", "body_rate", "attitude", "throttle"})
_MOST_ROWS = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One entry of a table: ``text`` in large, ``detail`` below it; ``weak`` is greyed."""

    text: str
    detail: str = ""
    weak: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table with a caption; the first cell of every row is its heading."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisView:
    """The verdict of one axis in one sentence; ``reasons`` are codes with the number of their finding."""

    axis: str
    verdict: str
    sentence: str
    effect: str
    reasons: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FindingView:
    """A finding: what it means, what to do, and its evidence as name and value."""

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
    model_sentence: str
    model_tables: tuple[Table, ...]
    steps: tuple[str, ...]
    facts: tuple[tuple[str, str], ...]
    signals: Table
    more_signals: Table
    stretches: tuple[str, ...]
    remarks: tuple[str, ...]
    messages: tuple[str, ...]
    structures: Table | None
    windows: Table | None
    excitation: Table | None
    validation_sentence: str
    findings: tuple[FindingView, ...]
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
    overall = _overall(result)
    return View(
        name=printable(PurePath(result.log.path).name, 120),
        subtitle=_subtitle(result),
        overall=overall,
        headline=headline(result),
        axes=tuple(_axis(result, axis) for axis in AXES if axis in result.diagnosis.axes),
        model_sentence=_model_sentence(result, model),
        model_tables=() if model is None else _model_tables(result, model),
        steps=next_steps(result),
        facts=_facts(result),
        signals=_signals(result),
        more_signals=_signal_table("Other signals", result, main=False),
        stretches=_stretches(result),
        remarks=tuple(printable(remark) for remark in result.log.remarks[:_MOST_ROWS]),
        messages=tuple(
            f"{text.time_s:.1f} s: {printable(text.text)}" for text in result.data.texts[:_MOST_ROWS]
        ),
        structures=_structures(result),
        windows=_windows(result),
        excitation=_excitation(result),
        validation_sentence=_validation_sentence(model),
        findings=tuple(_finding(finding) for finding in result.diagnosis.findings),
        reproduction=_reproduction(result, provenance),
    )


_HEADLINES = {
    "usable": "The model can be used on all three axes.",
    "caution": "The model can be used, with the doubts named below.",
    "refused": "This log gives no model that can be trusted.",
}


def headline(result: Result) -> str:
    """Return the verdict over all axes in one sentence."""
    refused = [axis for axis, no in zip(AXES, refused_axes(result), strict=True) if no]
    others = [axis for axis in AXES if axis not in refused]
    if refused and others:
        first, second = " and ".join(others), " and ".join(refused)
        return f"{first.capitalize()} can be used; {second} must not be trusted."
    return _HEADLINES[_overall(result)]


def _overall(result: Result) -> str:
    """Return the worst verdict of the axes."""
    verdicts = {axis.verdict for axis in result.diagnosis.axes.values()}
    return next((level for level in ("refused", "caution") if level in verdicts), "usable")


def _subtitle(result: Result) -> str:
    """Say in one line which vehicle flew for how long."""
    log = result.log
    parts = [
        printable(log.vehicle_name, 60),
        printable(log.frame, 60),
        printable(log.vehicle_type, 40) if log.vehicle_type != "unknown" else "",
        printable(log.firmware, 80) or printable(log.autopilot, 40),
        flown_sentence(result),
    ]
    return " · ".join(part for part in parts if part)


def flown_sentence(result: Result) -> str:
    """Say how much of the log was analysed, or flown where nothing could be identified."""
    if not result.log.has_time:
        return "nothing identified: the log has no time stamps"
    length = seconds(result.data.duration_s)
    if result.identification.recommended is not None:
        return f"{seconds(_used_s(result))} of {length} analysed"
    if not result.data.flights:
        return f"no flight in {length} of log"
    flown_s = sum(end - start for start, end in result.data.flights)
    return f"{seconds(flown_s)} of flight in {length} of log, nothing identified"


def _used_s(result: Result) -> float:
    """Return the length of all segments [s]."""
    return float(sum(segment.end_s - segment.start_s for segment in result.data.segments))


def refused_axes(result: Result) -> tuple[bool, ...]:
    """Return whether each of roll, pitch and yaw is refused."""
    found = result.diagnosis.axes
    return tuple(axis in found and found[axis].verdict == "refused" for axis in AXES)


def _input_unit(result: Result) -> str:
    """Return "N m" or "1"."""
    return result.data.input.unit if result.data.input else "1"


def _axis(result: Result, axis: str) -> AxisView:
    """Return verdict, sentence and main number of an axis."""
    verdict = result.diagnosis.axes[axis]
    codes = [finding.code for finding in result.diagnosis.findings]
    return AxisView(
        axis=axis,
        verdict=verdict.verdict,
        sentence=printable(verdict.sentence, 400),
        effect=effect_sentence(result, axis) if verdict.verdict != "refused" else "",
        reasons=tuple(
            (printable(code, 20), codes.index(code) + 1 if code in codes else 0) for code in verdict.reasons
        ),
    )


def effect_sentence(result: Result, axis: str) -> str:
    """Return the axis' torque effectiveness with its interval, "" where there is none."""
    model = result.identification.recommended
    number_of = AXES.index(axis)
    target, torque = ACCELERATION_SYMBOLS[number_of], ("L", "M", "N")[number_of]
    found = () if model is None else model.parameters
    for parameter in found:
        if parameter.target == target and parameter.regressor == torque and math.isfinite(parameter.value):
            per = " per unit command" if _input_unit(result) == "1" else ""
            shown_value = estimate(parameter.value, *parameter.ci95)
            return f"{parameter.name} = {shown_value} {pretty_unit(parameter.unit)}{per}"
    return ""


def pretty_unit(unit: str) -> str:
    """Return a unit with raised exponents.

    Examples
    --------
    >>> pretty_unit("rad/s^2")
    'rad/s²'
    """
    return printable(unit, 60).replace("^2", "²").replace("^-1", "⁻¹")


def _model_sentence(result: Result, model: Model | None) -> str:
    """Say what the recommended model is, or why there is none."""
    if model is None:
        return (
            f"No model was fitted: {printable(result.identification.skipped) or 'this log holds too little'}."
        )
    parts = [
        f"Structure {model.structure}, fitted to {seconds(_used_s(result))} of flight: "
        "[dp/dt, dq/dt, dr/dt] = A · regressors + B · [L, M, N]."
    ]
    actuator = model.actuator
    if actuator is not None and not all(refused_axes(result)):
        lag, delay = actuator.lag_s * 1e3, actuator.delay_s * 1e3
        lag_ci, delay_ci = (
            (low * 1e3, high * 1e3) for low, high in (actuator.lag_ci95_s, actuator.delay_ci95_s)
        )
        parts.append(
            f"The {printable(actuator.acts_on, 30) or 'torque'} follows its command with a lag of "
            f"{estimate(lag, *lag_ci)} ms after a delay of {estimate(delay, *delay_ci)} ms."
        )
    if _input_unit(result) == "1":
        parts.append("L, M and N are the autopilot's normalised commands, not N m.")
    if model.note:
        parts.append(printable(model.note))
    return " ".join(parts)


def _model_tables(result: Result, model: Model) -> tuple[Table, ...]:
    """Return B, A and, where it is known, the inertia tensor."""
    unit = "N m" if _input_unit(result) == "N m" else "unit of normalised command"
    distrusted = frozenset(
        target for target, no in zip(ACCELERATION_SYMBOLS, refused_axes(result), strict=True) if no
    )
    tables = [
        _matrix(model, model.B, model.inputs, f"{_B_CAPTION} [rad/s² per {unit}]", distrusted),
    ]
    if model.regressors:
        tables.append(_matrix(model, model.A, model.regressors, _A_CAPTION, distrusted))
    if model.inertia is not None:
        tables.append(_inertia(model.inertia, refused_axes(result)))
        tables.append(_published(model.inertia, result))
    return tuple(tables)


_B_CAPTION = "B: angular acceleration per torque"
_A_CAPTION = "A: angular acceleration per regressor [rad/s² per unit of the regressor]"
_DISTRUSTED = "not to be trusted"
_REGRESSORS = {
    "qr": "qr, pr, pq: products of two rates, by which a turn about two axes pushes the third",
    "p": "p, q, r: the rates themselves, as in damping",
    "phi": "phi, theta, psi: roll, pitch and yaw angle",
    "1": "1: a steady push, as of a bent arm.",
}


def _matrix(
    model: Model, values: FloatArray, columns: tuple[str, ...], caption: str, distrusted: frozenset[str]
) -> Table:
    """Return one matrix with its intervals; rows of refused axes are grey and say so."""
    known = {(parameter.target, parameter.regressor): parameter for parameter in model.parameters}
    rows = tuple(
        (
            Cell(text=_TARGETS.get(target, target), detail=_DISTRUSTED if target in distrusted else ""),
            *(
                _entry(known.get((target, regressor)), float(values[row, column]), target in distrusted)
                for column, regressor in enumerate(columns)
            ),
        )
        for row, target in enumerate(model.targets)
    )
    trusted = [(target, name) for target in model.targets if target not in distrusted for name in columns]
    note = _weak_note(known[place] for place in trusted if place in known)
    if distrusted:
        note = f"Rows marked {_DISTRUSTED!r} belong to refused axes: they are no results. {note}".strip()
    words = "; ".join(_REGRESSORS[name] for name in columns if name in _REGRESSORS)
    return Table(caption=caption, head=("", *columns), rows=rows, note=" ".join(filter(None, (words, note))))


def _entry(parameter: Parameter | None, value: float, distrusted: bool) -> Cell:
    """Return value and interval of one element, grey where it is no result."""
    if parameter is None:
        return Cell(text=number(value), weak=True, detail="no interval")
    if parameter.value == 0.0 and not all(map(math.isfinite, parameter.ci95)):
        return Cell(text="–", detail="left out", weak=True)
    detail = interval(*parameter.ci95)
    weak = distrusted or not parameter.identifiable
    return Cell(text=number(parameter.value), detail=detail, weak=weak)


def _weak_note(parameters: Iterable[Parameter]) -> str:
    """Say which elements are grey and why, those with the same reason together."""
    reasons: dict[str, list[str]] = {}
    for parameter in parameters:
        if not parameter.identifiable:
            reasons.setdefault(printable(parameter.reason, 160), []).append(printable(parameter.name, 20))
    if not reasons:
        return ""
    why = "; ".join(f"{', '.join(names)}: {reason or 'not known'}" for reason, names in reasons.items())
    return f"Grey: this flight cannot tell the value; do not read it as a property of the vehicle. {why}."


def _inertia(inertia: Inertia, distrusted: tuple[bool, ...]) -> Table:
    """Return the inertia tensor with its intervals; what rests on a refused axis is grey."""
    names = ("x", "y", "z")
    rows = tuple(
        (
            Cell(text=name, detail=_DISTRUSTED if distrusted[i] else ""),
            *(
                Cell(
                    text=number(float(inertia.matrix[i, j])),
                    detail=interval(float(inertia.ci95_low[i, j]), float(inertia.ci95_high[i, j])),
                    weak=distrusted[i] or distrusted[j],
                )
                for j in range(3)
            ),
        )
        for i, name in enumerate(names)
    )
    return Table(caption="Inertia tensor about the centre of mass [kg m²]", head=("", *names), rows=rows)


def _published(inertia: Inertia, result: Result) -> Table:
    """Hold the moments of inertia against the user's own and against published ones."""
    rows = comparison_rows(inertia, result.vehicle)
    return Table(
        caption="Beside other vehicles [kg m²]",
        head=("vehicle", "mass [kg]", "Ixx", "Iyy", "Izz"),
        rows=tuple(
            (
                Cell(text=name, detail=source),
                Cell(text=mass),
                *(
                    Cell(text=moment, weak=place == 0 and distrusted)
                    for moment, distrusted in zip(moments, refused_axes(result), strict=True)
                ),
            )
            for place, (name, mass, source, moments) in enumerate(rows)
        ),
        note="The nearest comes first. Moments grow with mass times the square of the size.",
    )


def next_steps(result: Result) -> tuple[str, ...]:
    """Return what to do next: the advice of the gravest findings, each once."""
    graded = [
        printable(finding.advice, 400)
        for level in ("error", "warning")
        for finding in result.diagnosis.findings
        if finding.level == level and finding.advice
    ]
    return tuple(dict.fromkeys(graded))[:_MOST_STEPS]


def _facts(result: Result) -> tuple[tuple[str, str], ...]:
    """Return what the log is."""
    log, data = result.log, result.data
    described = data.input
    torque = "none found"
    if described is not None:
        torque = (
            f"{printable(described.source, 120)}, "
            + ("in N m" if described.unit == "N m" else "normalised command, not N m")
            + f"; {percent(described.saturated_fraction)} of the samples saturated"
        )
    period_s = data.sample_period_s
    facts = [
        ("File", f"{printable(log.path)} ({size(log.n_bytes)})"),
        (
            "Format",
            " ".join(filter(None, (_FORMATS.get(log.format, log.format), printable(log.dialect, 40)))),
        ),
        ("Autopilot", _AUTOPILOTS.get(log.autopilot, printable(log.autopilot, 40))),
        ("Firmware", printable(log.firmware, 120) or "not stated"),
        (
            "Vehicle",
            ", ".join(filter(None, (printable(log.vehicle_type, 40), printable(log.vehicle_name, 60)))),
        ),
        ("Frame", printable(log.frame, 80) or "not stated"),
        ("Clock", _clock(data)),
        ("Torque", torque),
        ("Flights", _spans(data.flights) or printable(data.on_ground_reason) or "none"),
        (
            "Analysed" if result.identification.recommended else "Without gaps",
            _spans((item.start_s, item.end_s) for item in data.segments) or "nothing",
        ),
        ("Resampled to", f"{1.0 / period_s:.4g} Hz" if math.isfinite(period_s) and period_s > 0 else "–"),
        (
            "Unreadable",
            f"{size(log.corrupt_bytes)} in {_counted(len(log.lost), 'stretch', 'stretches')}; "
            f"{_counted(log.n_dropped, 'message', 'messages')} dropped by the autopilot",
        ),
    ]
    facts += airframe_facts(log)
    if log.systems:
        spoken = ", ".join(
            f"{system.system_id}/{system.component_id} {printable(system.vehicle_type, 30)}"
            + (" (chosen)" if system.chosen else "")
            for system in log.systems[:12]
        )
        facts.append(("MAVLink systems", spoken))
    return tuple(facts)


_FORMATS = {
    "dataflash": "ArduPilot DataFlash",
    "dataflash-text": "ArduPilot DataFlash as text",
    "ulog": "PX4 ULog",
    "tlog": "MAVLink telemetry log",
    "table": "table",
}
_AUTOPILOTS = {"ardupilot": "ArduPilot", "px4": "PX4", "other": "not stated"}


def _clock(data: FlightData) -> str:
    """Say what the log's clock covers."""
    if not data.duration_s > 0.0:
        return "covers no time"
    resets = _counted(data.clock_resets, "reset", "resets") if data.clock_resets else "no resets"
    return f"from {data.start_s:.1f} s, {seconds(data.duration_s)}; {resets}"


def _counted(count: int, one: str, many: str) -> str:
    """Return a number with its noun.

    Examples
    --------
    >>> _counted(1, "stretch", "stretches"), _counted(0, "stretch", "stretches")
    ('1 stretch', '0 stretches')
    """
    return f"{count} {one if count == 1 else many}"


def _spans(spans: Iterable[tuple[float, float]]) -> str:
    """Return stretches of time, the first few in full."""
    listed = list(spans)
    shown = ", ".join(f"{start:.1f} to {end:.1f} s" for start, end in listed[:6])
    return shown + (f" and {len(listed) - 6} more" if len(listed) > 6 else "")


def _signals(result: Result) -> Table:
    """Return each signal with its source, true rate, gaps and losses."""
    return _signal_table("Signals, where they come from, and how they were really sampled", result, main=True)


def _signal_table(caption: str, result: Result, *, main: bool) -> Table:
    """Return a table of the signals that the model rests on, or of the others."""
    found = [choice for choice in result.data.sources.values() if (choice.signal in _MAIN_SIGNALS) == main]
    return Table(
        caption=caption,
        head=("signal", "source and why", "true rate [Hz]", "longest gap [s]", "gaps", "rows put aside"),
        rows=tuple(_signal(choice) for choice in found[:_MOST_ROWS]),
    )


def _signal(choice: SourceChoice) -> tuple[Cell, ...]:
    """Return one row of the table of signals."""
    name = signal_name(choice.signal)
    why = printable(choice.reason, 160)
    if choice.others:
        others = ", ".join(
            f"{printable(source, 60)} ({number(rate, 3)} Hz)" for source, rate in choice.others[:4]
        )
        why += f". Not taken: {others}"
    aside = {
        "repeated": choice.n_duplicate,
        "reordered": choice.n_out_of_order,
        "impossible time": choice.n_wild,
        "not finite": choice.n_not_finite,
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
    unit = SIGNALS[signal].unit if signal in SIGNALS else ""
    return "normalised" if unit == "1" else pretty_unit(unit).replace("us", "µs")


def _stretches(result: Result) -> tuple[str, ...]:
    """Return what could not be read, each stretch in a line."""
    lost = result.log.lost
    lines = [
        f"{stretch.n_bytes} bytes at offset {stretch.offset}: {printable(stretch.reason, 160)}"
        for stretch in lost[:_MOST_ROWS]
    ]
    if len(lost) > _MOST_ROWS:
        lines.append(f"and {len(lost) - _MOST_ROWS} more")
    return tuple(lines)


def _structures(result: Result) -> Table | None:
    """Compare all structures by what they predict of held-out data."""
    models, distrusted = result.identification.models, refused_axes(result)
    if not models:
        return None
    return Table(
        caption="All structures, judged on held-out data (roll / pitch / yaw)",
        head=(
            "structure",
            "diagonal of B",
            "R² acceleration",
            "R² simulated rate",
            "fit [%]",
            "condition number",
        ),
        rows=tuple(_structure(model, distrusted) for model in models),
        note="R² is 1 and fit 100 % at best; noise in the acceleration is in R², and no model explains it."
        + (" In brackets: refused axes, not to be trusted." if any(distrusted) else ""),
    )


def _structure(model: Model, distrusted: tuple[bool, ...]) -> tuple[Cell, ...]:
    """Return one row of the table of structures."""
    found = {(parameter.target, parameter.regressor): parameter.value for parameter in model.parameters}
    diagonal = [
        found.get((target, torque), math.nan)
        for target, torque in zip(ACCELERATION_SYMBOLS, ("L", "M", "N"), strict=True)
    ]
    checked = model.validation
    return (
        Cell(text=model.structure, detail="recommended" if model.recommended else printable(model.note, 160)),
        Cell(text=_three(diagonal, distrusted)),
        Cell(text=_three(_of(checked.r2_acceleration, ACCELERATION_SYMBOLS), distrusted)),
        Cell(text=_three(_of(checked.r2_simulated_rate, RATE_SYMBOLS), distrusted)),
        Cell(text=_three(_of(checked.fit_percent, RATE_SYMBOLS), distrusted)),
        Cell(text=number(model.condition_number, 3)),
    )


def _of(values: Mapping[str, float], symbols: tuple[str, ...]) -> list[float]:
    """Return the value of each symbol, NaN where there is none."""
    return [values.get(symbol, math.nan) for symbol in symbols]


def _three(values: Iterable[float], bracketed: tuple[bool, ...]) -> str:
    """Return three values in one cell, some in brackets."""
    texts = [number(value, 3) for value in values]
    return " / ".join(f"({text})" if no else text for text, no in zip(texts, bracketed, strict=True))


def _windows(result: Result) -> Table | None:
    """Return how well the windows of each structure could be solved."""
    rows = tuple(
        _window_row(model.structure, model.windows)
        for model in result.identification.models
        if model.windows is not None and model.windows.time_s.size
    )
    if not rows:
        return None
    return Table(
        caption="Windows: each one solves H_k by itself",
        head=("structure", "windows", "used", "width × stride", "condition number", "full rank"),
        rows=rows,
        note="Condition number of the column-scaled H_k: median, then 5 to 95 %. Noise grows by as much.",
    )


def _window_row(structure: str, windows: Windows) -> tuple[Cell, ...]:
    """Return one row of the table of windows."""
    low, middle, high = np.quantile(windows.condition_number, [0.05, 0.5, 0.95], method="nearest")
    full = float(np.mean(windows.rank == windows.coefficients.shape[2]))
    return (
        Cell(text=structure),
        Cell(text=str(windows.time_s.size)),
        Cell(text=percent(float(np.mean(windows.used)))),
        Cell(
            text=f"{windows.width} × {windows.stride}", detail=f"{number(windows.period_s * 1e3, 3)} ms apart"
        ),
        Cell(text=number(float(middle), 3), detail=f"{number(float(low), 3)} to {number(float(high), 3)}"),
        Cell(text=percent(full)),
    )


def _excitation(result: Result) -> Table | None:
    """Return how much each axis was moved."""
    items = result.identification.excitation
    if not items:
        return None
    unit = "N m" if _input_unit(result) == "N m" else "normalised"
    rows = tuple(
        (
            Cell(text=item.axis),
            Cell(text=number(item.torque_rms, 3)),
            Cell(text=number(math.degrees(item.rate_rms_rad_s), 3)),
            Cell(text=number(item.signal_to_noise, 3)),
            Cell(text=_coherent(item.frequency_hz, item.coherence)),
        )
        for item in items
    )
    return Table(
        caption="How much each axis was moved",
        head=("axis", f"torque RMS [{unit}]", "rate RMS [deg/s]", "signal to noise", "coherent (above 0.5)"),
        rows=rows,
        note="Signal to noise: acceleration that the torque explains over what it does not, as power.",
    )


def _coherent(frequency_hz: FloatArray, coherence: FloatArray) -> str:
    """Return the widest span of frequencies, in octaves, all over which torque and rate belong together."""
    known = frequency_hz > 0.0
    frequency_hz, good = frequency_hz[known], coherence[known] > 0.5
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(np.int8)))
    first, last = frequency_hz[edges[::2]], frequency_hz[edges[1::2] - 1]
    if not first.size:
        return "nowhere"
    widest = int(np.argmax(last / first))
    return f"{number(float(first[widest]), 2)} to {number(float(last[widest]), 2)} Hz"


def _validation_sentence(model: Model | None) -> str:
    """Say how the model does on held-out data."""
    if model is None:
        return ""
    if not model.validation.held_out_s > 0.0:
        return "No data could be held out, so the model is not validated."
    r2 = _of(model.validation.r2_simulated_rate, RATE_SYMBOLS)
    # Below zero it is worse than no model at all, and by how much tells nobody anything.
    told = [
        f"{percent(value)} of {axis}" if value > 0.0 else f"nothing of {axis}"
        for axis, value in zip(AXES, r2, strict=True)
    ]
    return (
        f"{seconds(model.validation.held_out_s)} of the flight were kept from the fit. There, the rates "
        f"simulated from the torque explain {told[0]}, {told[1]} and {told[2]}."
    )


def _finding(finding: Finding) -> FindingView:
    """Return a finding as text."""
    return FindingView(
        code=printable(finding.code, 20),
        level=finding.level,
        title=printable(finding.title, 200),
        meaning=CATALOGUE[finding.code].meaning.replace("^2", "²") if finding.code in CATALOGUE else "",
        advice=printable(finding.advice, 600),
        axes=", ".join(axis for axis in finding.axes if axis not in finding.title.lower()),
        evidence=tuple(
            (evidence_name(name), evidence_text(name, value)) for name, value in finding.evidence.items()
        ),
    )


def _listed(settings: Mapping[str, object]) -> str:
    """Return names and values in one line."""
    return ", ".join(f"{name} = {value if value != '' else '(chosen)'}" for name, value in settings.items())


def _reproduction(result: Result, provenance: Provenance) -> tuple[tuple[str, str], ...]:
    """Return all that is needed to make the result again."""
    settings = result.settings
    every = {name: getattr(settings, name) for name in type(settings).__dataclass_fields__}
    usual = type(settings)()
    chosen = {name: value for name, value in every.items() if value != getattr(usual, name)}
    timings = ", ".join(f"{name} {value:.2f} s" for name, value in result.timings_s.items())
    vehicle = result.vehicle
    return (
        ("quadid-logs", provenance.version),
        ("Command", printable(provenance.command, 500) or "(called from Python)"),
        ("Log", printable(result.log.path)),
        ("SHA-256 of the log", provenance.log_sha256 or "the file cannot be read any more"),
        (
            "Vehicle file",
            "none" if vehicle is None else printable(vehicle.name, 80) or "given, without a name",
        ),
        ("Settings chosen", _listed(chosen) or "none, all as this version has them"),
        ("All settings", _listed(every)),
        ("Time taken", timings or "–"),
    )
