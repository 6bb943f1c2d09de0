"""A planned flight as parameter files, and as a card to take to the field."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from quadid_logs.data.model import Parameter
from quadid_logs.diagnose.advice import STICKS
from quadid_logs.plan import Plan, Prediction, Setting
from quadid_logs.report.json import strict_text
from quadid_logs.report.numbers import estimate, number
from quadid_logs.report.words import pretty_unit
from quadid_logs.simulate.sweep import Sweep
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import ON_AXIS

CARD_FILE = "plan.md"


def parameter_files(plan: Plan) -> dict[str, str]:
    """Return the text of each parameter file by its name.

    ArduPilot's files hold ``NAME,VALUE`` lines, as every ground station
    loads them; PX4's are QGroundControl's tab-separated ones (vehicle,
    component, name, value, type 6 for an integer).
    """
    if plan.autopilot == "px4":
        lines = [f"1\t1\t{name}\t{value:g}\t6" for name, value in plan.logging]
        return {"logging.params": "\n".join(("# Vehicle-Id Component-Id Name Value Type", *lines)) + "\n"}
    files = {"logging.param": _ardupilot("Log rates and torque at the loop rate", plan.logging)}
    for axis in plan.sweeps:
        text = f"Sweep the {axis} axis. Load twice: SID_AXIS shows the others. Check SID_MAGNITUDE"
        files[f"sweep-{axis}.param"] = _ardupilot(text, plan.settings_of(axis))
    return files


def _ardupilot(comment: str, settings: tuple[Setting, ...]) -> str:
    """Return a parameter file with a comment."""
    return "\n".join((f"# {comment}", *(f"{name},{value:g}" for name, value in settings))) + "\n"


def card_lines(plan: Plan, prediction: Prediction) -> tuple[str, ...]:
    """Return the manoeuvre card as Markdown that reads well as plain text.

    Parameters
    ----------
    plan : Plan
    prediction : Prediction

    Returns
    -------
    tuple of str
    """
    return (
        f"# Flight plan: {', '.join(plan.axes)} ({plan.autopilot})",
        "",
        "## Set",
        "",
        *_settings_lines(plan),
        "",
        "## Fly",
        "",
        *(f"{place}. {step}" for place, step in enumerate(_steps(plan), start=1)),
        "",
        "## Expect",
        "",
        *_expected(plan, prediction),
    )


def plan_text(plan: Plan, prediction: Prediction) -> str:
    """Return the plan and what its simulated flight gave as strict JSON in ASCII."""
    model = prediction.identification.recommended
    actuator = None if model is None else model.actuator
    content: dict[str, Any] = {
        "schema_version": "1.0",
        "autopilot": plan.autopilot,
        "axes": plan.axes,
        "duration_s": plan.duration_s,
        "logging": dict(plan.logging),
        "sweeps": {axis: dict(plan.settings_of(axis)) for axis in plan.sweeps},
        "steps": _steps(plan),
        "expected": {
            "vehicle": prediction.vehicle,
            "axes": {axis: _expected_axis(prediction, axis) for axis in plan.axes},
            "lag_s": None if actuator is None else {"value": actuator.lag_s, "ci95": actuator.lag_ci95_s},
        },
    }
    return strict_text(content)


def _expected_axis(prediction: Prediction, axis: str) -> dict[str, Any]:
    """Return verdict and gain of an axis of the simulated flight."""
    own = _own_gain(prediction, axis)
    gain = None if own is None else {"name": own.name, "value": own.value, "ci95": own.ci95, "unit": own.unit}
    return {"verdict": prediction.diagnosis.axes[axis].verdict, "gain": gain}


def _own_gain(prediction: Prediction, axis: str) -> Parameter | None:
    """Return how the torque about an axis turns the simulated vehicle about it."""
    model = prediction.identification.recommended
    return None if model is None else model.entries.get(ON_AXIS[axis])


def _settings_lines(plan: Plan) -> Iterator[str]:
    """Yield what to set and why."""
    for name, value in plan.logging:
        yield f"- {name} = {value:g} (rates and torque at the loop rate; {_REMARK[plan.autopilot]})"
    for axis, sweep in plan.sweeps.items():
        yield f"- for {axis}: {', '.join(f'{name} = {value:g}' for name, value in plan.settings_of(axis))}"
        yield f"  ({_sweep_words(sweep)})"
    yield _FILTERS[plan.autopilot]


_REMARK = {
    "ardupilot": "if yours is not the default, keep it and add bit 0",
    "px4": "restart the vehicle afterwards",
}
_FILTERS = {
    "ardupilot": "- leave INS_GYRO_FILTER as you fly it: its delay is known from the log and allowed for",
    "px4": "- leave IMU_GYRO_CUTOFF as you fly it: its delay is known from the log and allowed for",
}


def _sweep_words(sweep: Sweep) -> str:
    """Say what a sweep does."""
    return (
        f"{100.0 * sweep.magnitude:g} % of the mixer's range, {sweep.start_hz:g} to {sweep.stop_hz:g} Hz "
        f"in {sweep.record_s:g} s"
    )


def _steps(plan: Plan) -> tuple[str, ...]:
    """Return what to do, in order."""
    before = "Choose calm air, a full battery, 10 m of room to all sides, and a height of 10 m or more."
    after = "Land, take the log from the card, and run: quadid-log analyze LOG"
    if not plan.sweeps:
        manoeuvres = (
            f"{axis.capitalize()}: quick {STICKS[axis]} doublets, half a second each way, a third of full "
            "stick, a second of rest between them, for 30 s."
            for axis in plan.axes
        )
        return (before, "Take off in Stabilized or Altitude mode and hover.", *manoeuvres, after)
    sweeps = tuple(
        f"{axis.capitalize()}: load sweep-{axis}.param, READ BACK that SID_MAGNITUDE is "
        f"{plan.sweeps[axis].magnitude:g}, switch to System ID, hold the place with small stick moves for "
        f"{plan.sweeps[axis].record_s:g} s, switch back when it says finished."
        for axis in plan.axes
    )
    return (
        "Put System ID (mode 25) on a switch beside AltHold or Stabilize.",
        "SID_MAGNITUDE is a share of full motor authority here, and its default of 15 would flip the "
        "vehicle: never switch to System ID before you have read it back.",
        before,
        "Take off in Stabilize and hover. System ID flies like Stabilize; leaving it stops the sweep.",
        *sweeps,
        "If the vehicle hardly shakes at the first sweep, double SID_MAGNITUDE; if it leans more than 20 "
        "degrees, halve it.",
        "Set SID_AXIS back to 0.",
        after,
    )


def _expected(plan: Plan, prediction: Prediction) -> Iterator[str]:
    """Yield what the simulated flight of this plan gave."""
    yield (
        f"A simulated flight of this plan ({printable(prediction.vehicle, 60)}, calm air, "
        f"{plan.duration_s:.0f} s) gives:"
    )
    yield ""
    model = prediction.identification.recommended
    for axis in plan.axes:
        own = _own_gain(prediction, axis)
        yield f"- {axis}: {prediction.diagnosis.axes[axis].verdict}{'' if own is None else _gain(own)}"
    if model is not None and model.actuator is not None:
        low, high = (1e3 * value for value in model.actuator.lag_ci95_s)
        yield f"- motor lag {estimate(1e3 * model.actuator.lag_s, low, high)} ms"
    yield ""
    yield (
        "In brackets: 95 % intervals. Values and intervals are the simulated vehicle's; yours differ with "
        "its size, its vibration and the wind. With --vehicle FILE.toml the simulated one is more like it."
    )


def _gain(parameter: Parameter) -> str:
    """Return a gain, its interval, and half its width as a share."""
    low, high = parameter.ci95
    calibrated = "N m" in parameter.unit
    unit = f"{pretty_unit(parameter.unit)}{'' if calibrated else ' per unit command'}"
    text = f", {parameter.name} = {estimate(parameter.value, low, high)} {unit}"
    if parameter.value and math.isfinite(high - low):
        share = 100.0 * (high - low) / (2.0 * abs(parameter.value))
        text += f", known to ±{number(share, 2)} %{' with the calibration to N m' if calibrated else ''}"
    return text
