"""A promise held against the next flight, in words for a pilot and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePath
from typing import Any, Final

from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.promise import (
    AxisCheck,
    Check,
    Decision,
    FigureCheck,
    Flown,
    Held,
    Obstacle,
    Outcome,
    Promise,
    QuantityKind,
    VehicleCheck,
)
from quadid_logs.data.result import Result
from quadid_logs.report.commands import on_log
from quadid_logs.report.gain_files import exact, file_names
from quadid_logs.report.json import log_dict
from quadid_logs.report.numbers import estimate, number
from quadid_logs.report.strict_json import some_fields, strict_text
from quadid_logs.sentences import listed
from quadid_logs.untrusted import printable

#: Minor steps add keys, a major step changes or removes one.
SCHEMA_VERSION: Final = "1.1"
_HEADLINES: Final = {
    Outcome.KEPT: "the promise was kept",
    Outcome.BROKEN: "the promise was broken",
    Outcome.NOT_COMPARABLE: "the promise cannot be checked with this log",
}
_HELD: Final = {
    Held.INSIDE: "as promised",
    Held.BETTER: "better than promised",
    Held.WORSE: "worse than promised",
}
#: Figures of `Margins` in words, with their units.
_FIGURES: Final = {
    "gain_margin_db": ("gain margin", "dB"),
    "phase_margin_deg": ("phase margin", "degrees"),
    "disk_margin": ("disk margin", ""),
    "peak_sensitivity": ("peak sensitivity", ""),
    "crossover_hz": ("crossover", "Hz"),
}
#: Always told; the others only where they differ.
_ALWAYS: Final = ("gain_margin_db", "phase_margin_deg")
#: So many parameters are named, and the others counted.
_MOST_NAMED: Final = 6
#: What to do about a rotor that gives less stands with the finding about one.
_WEAK_ROTOR: Final = "QL430"


def check_lines(promise: Promise, after: Result, found: Check) -> tuple[str, ...]:
    """Return a check as lines for people.

    Lines without control characters, whatever log and file hold.
    """
    name = printable(PurePath(after.log.path).name, 80)
    # Where other gains flew and nothing is worse, nothing tested the promise.
    tested = any(one.held is Held.WORSE for one in found.axes.values()) or bool(found.vehicle_changes)
    headline = (
        "other gains flew than the promised ones"
        if found.outcome is Outcome.BROKEN and not tested
        else _HEADLINES[found.outcome]
    )
    lines = [f"{name} against the promise of {printable(promise.log, 80)}: {headline}"]
    if found.obstacle is not None:
        lines.append(f"  {_obstacle_words(promise, after, found.obstacle)}")
    else:
        for axis, one in found.axes.items():
            lines.append(f"  {axis}: {_axis_words(one)}")
            lines += [f"    {text}" for text in _details(one)]
        lines += [f"  {text}" for text in _vehicle_lines(found)]
    return (*lines, *(f"  {text}" for text in _decision_lines(promise, after, found)))


def _obstacle_words(promise: Promise, after: Result, obstacle: Obstacle) -> str:
    """Say why nothing of a promise can be compared."""
    log = after.log
    match obstacle:
        case Obstacle.SAME_LOG:
            return "The promise was made from this same flight. Check the log of the next flight."
        case Obstacle.OTHER_AUTOPILOT:
            names = [printable(one, 40) for one in (log.autopilot, promise.autopilot)]
            return f"Another autopilot flew: {names[0]}, not {names[1]}."
        case Obstacle.OTHER_FRAME:
            return f"Another frame flew: {printable(log.frame, 60)}, not {printable(promise.frame, 60)}."
        case Obstacle.OTHER_HARDWARE:
            return (
                f"Another flight controller flew: {printable(log.hardware_id, 60)}, not "
                f"{printable(promise.hardware_id, 60)}. If you replaced it, tune again from this flight."
            )
        case Obstacle.NO_PROMISE | Obstacle.OTHER_GAINS | Obstacle.NO_MARGINS:
            return ""


def _axis_words(one: AxisCheck) -> str:
    match one.obstacle:
        case Obstacle.NO_PROMISE:
            return "not comparable: nothing was promised for it"
        case Obstacle.NO_MARGINS:
            return "not comparable: this log does not show its margins"
        case Obstacle.OTHER_GAINS if one.flown is Flown.BACK:
            return "not comparable: the earlier gains flew, because the next ones were not loaded"
        case Obstacle.OTHER_GAINS:
            return "not comparable: other gains flew than promised"
    return _HELD[one.held] if one.stable else "worse than promised: the loop is unstable"


def _details(one: AxisCheck) -> Iterator[str]:
    """Yield the figures of an axis, or the parameters that flew with other values."""
    for figure in one.figures:
        if figure.differs or figure.name in _ALWAYS:
            words, unit = _FIGURES[figure.name]
            measured, promised_text = (
                f"{estimate(each.value, *each.ci95)} {unit}".rstrip()
                for each in (figure.measured, figure.promised)
            )
            judged = ""
            if figure.differs:
                judged = ": better" if figure.gain > 0 else ": worse"
            yield f"{words} {measured}, promised {promised_text}{judged}"
    if one.obstacle is not Obstacle.OTHER_GAINS:
        return
    for name, (promised, flown) in list(one.other_gains.items())[:_MOST_NAMED]:
        value = "is not in the log" if flown != flown else f"flew with {exact(flown)}"
        yield f"{printable(name, 60)} {value}, promised {exact(promised)}"
    if len(one.other_gains) > _MOST_NAMED:
        yield f"and {len(one.other_gains) - _MOST_NAMED} more"


def _vehicle_lines(found: Check) -> Iterator[str]:
    """Yield what of the vehicle is not as it was, and what to look at."""
    changes = found.vehicle_changes
    if found.rotor is not None:
        loss = found.rotor.loss
        ends = (loss.value, loss.value) if loss.ci95 is None else loss.ci95
        percent = estimate(*(100.0 * one for one in (loss.value, *ends)))
        yield (
            f"{found.rotor.name.capitalize()} gives {percent} % less thrust for the same command than in "
            f"the earlier flight [{_WEAK_ROTOR}]. {CATALOGUE[_WEAK_ROTOR].advice}"
        )
    for one in changes:
        if one.kind in (QuantityKind.LAG, QuantityKind.DELAY):
            values = [
                f"{estimate(*(1e3 * end for end in (each.value, *each.ci95)))} ms"
                for each in (one.measured, one.promised)
            ]
            yield f"The {one.kind.value} of the motors is {values[0]}, promised {values[1]}."
        else:
            values = [estimate(each.value, *each.ci95) for each in (one.measured, one.promised)]
            told = f"{values[0]} rad/s² per unit of command, promised {values[1]}"
            if one.kind is QuantityKind.COUPLING:
                yield f"A {one.command} command turns {one.axis} by {told}."
            else:
                before = one.promised.value
                change = 100.0 * (one.measured.value / before - 1.0) if before else 0.0
                more = "stronger" if change > 0.0 else "weaker"
                yield f"{one.axis.capitalize()} is {number(abs(change), 2)} % {more}: {told}."
    kinds = {one.kind for one in changes}
    if kinds:
        looked = {"propellers", "motors"}
        if QuantityKind.EFFECTIVENESS in kinds:
            looked |= {"battery", "load"}
        if QuantityKind.COUPLING in kinds:
            looked |= {"mounting of the flight controller"}
        if kinds & {QuantityKind.LAG, QuantityKind.DELAY}:
            looked |= {"ESC settings"}
        yield f"The vehicle differs from the one of the promise: check {listed(sorted(looked))}."
    cells = found.n_cells
    if 0 not in cells and cells[0] != cells[1]:
        yield f"The battery has {cells[1]} cells. The promise was made with {cells[0]}."


def _decision_lines(promise: Promise, after: Result, found: Check) -> Iterator[str]:
    """Yield what to do now."""
    again = f"`{on_log(after, 'tune')}`"
    match found.decision:
        case Decision.KEEP if found.outcome is Outcome.BROKEN:
            yield "keep: these gains suit the vehicle as it flew. Find out what changed before you fly again."
        case Decision.KEEP:
            yield "keep: fly on with these gains."
        case Decision.GO_ON if found.is_other_vehicle:
            yield "stop: find out what changed before you fly again."
            yield f"If you changed it on purpose, tune from this flight: {again}"
        case Decision.GO_ON:
            yield f"go on: tune from this flight and fly its next gains: {again}"
        case Decision.BACK:
            axes = [axis for axis, one in found.axes.items() if one.decision is Decision.BACK]
            file = file_names(after.log.autopilot)[1]
            yield f"back: set the earlier gains of {listed(axes)} before you fly again (as in {file}):"
            for axis in axes:
                for name, gain in promise.axes[axis].gains.items():
                    if gain.back != gain.next:
                        yield f"  {printable(name, 60)} {exact(gain.next)} -> {exact(gain.back)}"
        case Decision.NO_ADVICE if found.obstacle is None:
            yield f"no advice from this flight. For the reasons and what to do, run {again}"


def check_text(promise: Promise, after: Result, found: Check) -> str:
    """Return a check as strict JSON in ASCII."""
    content: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "log": log_dict(after.log, after.data),
        "promise": {"log": promise.log, "sha256": promise.log_sha256},
        "verdict": found.outcome.value,
        "decision": found.decision.value,
        "reason": None if found.obstacle is None else found.obstacle.value,
        "axes": {
            axis: {
                "verdict": one.held.value,
                "reason": None if one.obstacle is None else one.obstacle.value,
                "decision": one.decision.value,
                "stable": one.stable,
                "flown": one.flown.value,
                "other_gains": {
                    name: {"promised": promised, "flown": flown}
                    for name, (promised, flown) in one.other_gains.items()
                },
                "figures": {
                    figure.name: _test(figure) | {"better": figure.gain > 0} for figure in one.figures
                },
            }
            for axis, one in found.axes.items()
        },
        "vehicle": {
            "changed": found.is_other_vehicle,
            "rotor": None
            if found.rotor is None
            else {
                "number": found.rotor.rotor + 1,
                "name": found.rotor.name,
                "loss": found.rotor.loss.value,
                "ci95": found.rotor.loss.ci95,
            },
            "n_cells": {"promised": found.n_cells[0], "measured": found.n_cells[1]},
            "quantities": [
                {"kind": one.kind.value, "axis": one.axis, "command": one.command, **_test(one)}
                for one in found.vehicle
            ],
        },
    }
    return strict_text(content)


def _test(one: FigureCheck | VehicleCheck) -> dict[str, Any]:
    return some_fields(one, "promised", "measured", "p_value", "differs")
