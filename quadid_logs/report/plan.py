"""A planned flight as parameter files, and as a card to take to the field."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, Final, NamedTuple

from quadid_logs.autopilots.generic.advice import digits
from quadid_logs.commands import LOG, NEXT_LOG, command
from quadid_logs.data.model import Parameter
from quadid_logs.diagnose.advice import advice_for
from quadid_logs.planning import Plan, Prediction
from quadid_logs.report.numbers import estimate, number
from quadid_logs.report.strict_json import strict_text
from quadid_logs.report.words import pretty_unit
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES, ON_AXIS

CARD_FILE, CARD_PAGE = "plan.md", "plan.html"
#: A bound that is wider than what was wanted by less than this is as good.
_MISSED: Final = 1.1
#: How files are called that hold what flew.
BACK: Final = "back"


class FileNames(NamedTuple):
    """The names of the parameter files of an autopilot; ``sweeps`` by axis."""

    logging: str
    logging_back: str
    sweeps: Mapping[str, str]
    sweep_off: str


def plan_file_names(autopilot: str) -> FileNames:
    """Return the names of all parameter files that a plan may have.

    Parameters
    ----------
    autopilot : str
        As in `FlightLog.autopilot`.
    """
    suffix = advice_for(autopilot).parameter_suffix
    return FileNames(
        logging=f"logging{suffix}",
        logging_back=f"logging-{BACK}{suffix}",
        sweeps={axis: f"sweep-{axis}{suffix}" for axis in AXES},
        sweep_off=f"sweep-off{suffix}",
    )


def parameter_files(plan: Plan) -> dict[str, str]:
    """Return the text of each parameter file by its name, as the autopilot's ground station loads it.

    What makes the autopilot log, sweep, and fly a script, where that has to be set, and the ways back.
    """
    advice, names = plan.advice, plan_file_names(plan.autopilot)
    text = partial(advice.parameter_text, parameters=plan.parameters)
    files = {}
    if plan.logging:
        why = "Log rates and torque at the loop rate"
        known = f"to restore: {names.logging_back}" if plan.logging_back else advice.unknown_mask_note
        files[names.logging] = text(f"{why}; {known}", plan.logging)
    if plan.logging_back:
        files[names.logging_back] = text("Log as before", plan.logging_back)
    for axis in plan.sweeps:
        files[names.sweeps[axis]] = text(advice.sweep_comment(axis), plan.settings_of(axis))
    if plan.sweeps:
        files[names.sweep_off] = text("Remove the sweep from the vehicle", advice.sweep_off())
    return files | advice.whole_files(plan.axes) | plan.script_files()


def live_files(plan: Plan) -> dict[str, str]:
    """Return the text of each file by name: they make the vehicle stream its log for `quadid-log live`."""
    return plan.advice.live_files(plan.parameters)


def card_lines(plan: Plan, prediction: Prediction) -> tuple[str, ...]:
    """Return the manoeuvre card as Markdown that reads well as plain text."""
    by_hand = [f"{place}. [ ] {step}" for place, step in enumerate(plan.steps_by_hand(), start=1)]
    if by_hand:
        by_hand = ["## Without the script", "", *by_hand, ""]
    return (
        f"# Flight plan: {', '.join(plan.axes)} ({plan.autopilot})",
        "",
        "## Set",
        "",
        *settings_lines(plan),
        "",
        *excitation_lines(plan),
        "## Fly",
        "",
        *(f"{place}. [ ] {step}" for place, step in enumerate(_steps(plan), start=1)),
        "",
        *by_hand,
        "## Expect",
        "",
        *_expected(plan, prediction),
    )


def excitation_lines(plan: Plan) -> Iterator[str]:
    """Yield what moves each axis, as one table, and the best interval to expect; none where nothing can."""
    if not plan.excitations:
        return
    unit = "of full torque" if plan.advice.excitation_entry == "mixer" else "deg/s"
    yield f"## Excitation{f' by {plan.advice.excitation_by}' if plan.advice.excitation_by else ''}"
    yield ""
    columns = (
        "axis",
        "band [Hz]",
        f"amplitude [{unit}]",
        "length [s]",
        "crossover [Hz]",
        "phase crossover [Hz]",
    )
    yield f"| {' | '.join(columns)} | expected |"
    yield "|---|---|---|---|---|---|---|"
    for axis, one in plan.excitations.items():
        size = one.magnitude if plan.advice.excitation_entry == "mixer" else math.degrees(one.magnitude)
        beyond = number(one.phase_crossover_hz, 2) if math.isfinite(one.phase_crossover_hz) else "none"
        yield (
            f"| {axis} | {one.start_hz:g} to {one.stop_hz:g} | {number(size, 2)} | {one.record_s:g} | "
            f"{number(one.crossover_hz, 2)} | {beyond} | ±{number(100.0 * one.half_width, 2)} % |"
        )
    yield ""
    yield (
        f"Computed for the model of {printable(plan.model, 120)}, in this air: {plan.air}. The last column "
        "is half of the 95 % interval of the control effectiveness after such a flight. The interval is "
        "wider if the flight cannot rule out a dead zone or another effect."
    )
    short = [axis for axis, one in plan.excitations.items() if one.half_width > _MISSED * plan.wanted]
    if short:
        yield (
            f"{', '.join(short).capitalize()}: in this air, no sweep within the vehicle's limits can give "
            f"±{number(100.0 * plan.wanted, 2)} %. Fly in calmer air, or fly twice and pool the logs."
        )
    yield ""


def plan_text(plan: Plan, prediction: Prediction) -> str:
    """Return the plan and what its simulated flight gave as strict JSON in ASCII."""
    model = prediction.identification.recommended
    actuator = None if model is None else model.actuator
    axes = {}
    for axis in plan.axes:
        found = _on_axis(prediction, axis)
        gain = None
        if found is not None:
            gain = {"name": found.name, "value": found.value, "ci95": found.ci95, "unit": found.unit}
        axes[axis] = {"verdict": prediction.diagnosis.axes[axis].verdict, "gain": gain}
    content: dict[str, Any] = {
        "schema_version": "1.0",
        "autopilot": plan.autopilot,
        "firmware": plan.version,
        "axes": plan.axes,
        "duration_s": plan.duration_s,
        "logging": dict(plan.logging),
        "sweeps": {axis: dict(plan.settings_of(axis)) for axis in plan.sweeps},
        "excitation": {
            "model": plan.model,
            "air": plan.air,
            "wanted_half_width": plan.wanted,
            "axes": {axis: dataclasses.asdict(one) for axis, one in plan.excitations.items()},
        },
        "steps": _steps(plan),
        "expected": {
            "vehicle": prediction.vehicle,
            "axes": axes,
            "lag_s": None if actuator is None else {"value": actuator.lag_s, "ci95": actuator.lag_ci95_s},
        },
    }
    return strict_text(content)


def _on_axis(prediction: Prediction, axis: str) -> Parameter | None:
    """Return how the torque about an axis turns the simulated vehicle about it."""
    model = prediction.identification.recommended
    return None if model is None else model.entries.get(ON_AXIS[axis])


def settings_lines(plan: Plan) -> Iterator[str]:
    """Yield what to set and why."""
    for note in plan.advice.version_notes(plan.version):
        yield f"- {note}"
    if plan.advice.before_setting:
        yield f"- {plan.advice.before_setting}"
    yield from logging_lines(plan)
    if plan.advice.live_note:
        yield f"- to watch the intervals in flight with `quadid-log live ADDRESS`: {plan.advice.live_note}"
    kept = plan.advice.gyro_filter_parameter
    yield f"- leave {kept} as you fly it: its delay is known from the log"


def logging_lines(plan: Plan) -> Iterator[str]:
    """Yield what to set so that the autopilot logs enough, with the way back."""
    names = plan_file_names(plan.autopilot)
    flown = dict(plan.logging_back)
    for name, value in plan.logging:
        why = "; ".join(filter(None, ("rates and torque at the loop rate", plan.advice.logging_note)))
        if name in flown:
            yield f"- load {names.logging}: {name} {digits(flown[name])} -> {digits(value)} ({why})"
            yield f"  (after tuning, {names.logging_back} restores {digits(flown[name])})"
        else:
            yield f"- {name} = {digits(value)} ({why}; {plan.advice.unknown_mask_note})"
    if not plan.logging:
        yield f"- {plan.advice.logging('', plan.parameters, plan.version)}"


def _steps(plan: Plan) -> tuple[str, ...]:
    """Return what to do, in order."""
    return (
        plan.advice.room,
        *plan.steps(),
        f"Take the log from the card, and run `{command('analyze', LOG)}`. If there are several logs, for "
        f"example after a restart, run `{command('analyze', LOG, NEXT_LOG, '--pool')}`.",
    )


def _expected(plan: Plan, prediction: Prediction) -> Iterator[str]:
    """Yield what the simulated flight of this plan gave."""
    yield (
        f"A simulated flight of this plan in calm air ({printable(prediction.vehicle, 60)}, "
        f"{plan.duration_s:.0f} s) gives:"
    )
    yield ""
    model = prediction.identification.recommended
    for axis in plan.axes:
        found = _on_axis(prediction, axis)
        yield f"- {axis}: {prediction.diagnosis.axes[axis].verdict}{'' if found is None else _gain(found)}"
    if model is not None and model.actuator is not None:
        low, high = (1e3 * value for value in model.actuator.lag_ci95_s)
        yield f"- motor lag {estimate(1e3 * model.actuator.lag_s, low, high)} ms"
    yield ""
    yield (
        "In brackets: 95 % intervals. These values are those of the simulated vehicle. Yours will differ "
        "with size, vibration and wind. To simulate a vehicle more like yours, give --vehicle FILE.toml."
    )


def _gain(parameter: Parameter) -> str:
    """Return the on-axis effectiveness, its interval, and half its width as a fraction."""
    low, high = parameter.ci95
    calibrated = "N m" in parameter.unit
    unit = f"{pretty_unit(parameter.unit)}{'' if calibrated else ' per unit command'}"
    text = f", effectiveness {estimate(parameter.value, low, high)} {unit}"
    if parameter.value and math.isfinite(high - low):
        percent = 100.0 * (high - low) / (2.0 * abs(parameter.value))
        text += f", known to ±{number(percent, 2)} %{', with the calibration to N m' if calibrated else ''}"
    return text
