"""Fly one drawn flight, analyze its log, and hold every parameter against the truth."""

from __future__ import annotations

import dataclasses
import math
import time
from typing import Any, Final

import numpy as np

from quadid_logs.align import cut
from quadid_logs.arrays import FloatArray
from quadid_logs.data.diagnosis import Diagnosis
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Model
from quadid_logs.data.settings import Settings
from quadid_logs.diagnose import diagnose
from quadid_logs.identify import identify
from quadid_logs.load import prepare
from quadid_logs.simulator import Record, fly, plan_flights
from quadid_logs.simulator.closed_loop import Setup
from quadid_logs.simulator.logger import log_flights
from quadid_logs.simulator.truth import flight_truth
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, RATE_SYMBOLS, TORQUE_SYMBOLS
from study.draw import Drawn

#: PX4's placeholder for the thrust of a rotor: with it, the torque stays on the
#: scale of the command, and no owner's claim about newtons is part of the study.
_PX4_PLACEHOLDER_CT: Final = 6.5


def measure(drawn: Drawn) -> dict[str, Any]:
    """Return everything that the study wants to know about one flight, ready for JSON."""
    log, truth = simulate_drawn(drawn)
    began = time.perf_counter()
    settings = Settings()
    prepared = prepare(log)
    log, data = prepared.log, cut(prepared, settings.align)
    identification = identify(data, settings.identify)
    diagnosis = diagnose(log, data, identification)
    seconds = time.perf_counter() - began
    model = identification.recommended
    parameters: list[dict[str, Any]] = []
    if model is not None:
        parameters = [
            *_parameters(model, truth),
            *_actuator(model, truth, diagnosis, data.gyro_filter.low_pass_hz),
        ]
    return {
        **drawn.settings,
        "seed": drawn.seed,
        "effects": truth["effects"],
        "structure": "" if model is None else model.structure,
        "skipped": identification.skipped,
        "unit": "" if data.input is None else data.input.unit,
        "analysis_s": seconds,
        "mixer_limited": truth["mean"]["mixer_limited_fraction"],
        "rms_rate_rad_s": truth["excitation"]["rms_rate_rad_s"],
        "verdicts": {axis: diagnosis.axes[axis].verdict for axis in AXES},
        "reasons": {axis: list(diagnosis.axes[axis].reasons) for axis in AXES},
        "r2": {} if model is None else dict(model.validation.r2_acceleration),
        "findings": [finding.code for finding in diagnosis.findings],
        "parameters": parameters,
    }


def setup_of(drawn: Drawn) -> Setup:
    """Return the flight as it was set up.

    Parameters
    ----------
    drawn : Drawn

    Returns
    -------
    Setup
    """
    scenario = drawn.scenario
    (setup,) = plan_flights(
        scenario,
        seed=1000 * drawn.seed + drawn.number,
        duration_s=scenario.duration_s,
        rate_hz=scenario.logging.rate_hz,
        autopilot=drawn.autopilot,
    )
    return setup


def simulate_drawn(drawn: Drawn) -> tuple[FlightLog, dict[str, Any]]:
    """Fly, log, and tell the truth; no file is written: it would read back the same."""
    scenario, setup = drawn.scenario, setup_of(drawn)
    record = fly(setup)
    if drawn.clipped_fraction:
        record = fly(_limited(setup, record, drawn.clipped_fraction))
    truth = flight_truth((record,), scenario=scenario.name, boot_s=scenario.logging.boot_s)
    return per_command(log_flights((record,), scenario.logging)), truth


def per_command(log: FlightLog) -> FlightLog:
    """Return the log without what would put its torque into newton metres.

    Parameters
    ----------
    log : FlightLog

    Returns
    -------
    FlightLog
    """
    parameters = {
        name: _PX4_PLACEHOLDER_CT if name.startswith("CA_ROTOR") and name.endswith("_CT") else value
        for name, value in log.parameters.items()
    }
    return dataclasses.replace(log, parameters=parameters)


def _limited(setup: Setup, record: Record, clipped_fraction: float) -> Setup:
    """Return the flight anew with a hidden limit of the torque beyond which this fraction of commands was."""
    schedule = setup.schedule
    rows = (record.time_s >= schedule.manoeuvre_s) & (record.time_s < schedule.land_s)
    sizes = np.abs(record.channels["achieved"][rows])
    roll, pitch, yaw = np.quantile(sizes, 1.0 - clipped_fraction, axis=0).tolist()
    return dataclasses.replace(
        setup, effects=dataclasses.replace(setup.effects, torque_limit=(roll, pitch, yaw))
    )


def kind_of(target: str, regressor: str) -> str:
    """Say what sort of parameter this is; "" for trim and kinematics, which are no property of a vehicle."""
    if target not in ACCELERATION_SYMBOLS:
        return ""
    axis = ACCELERATION_SYMBOLS.index(target)
    if regressor in TORQUE_SYMBOLS:
        return "on-axis effectiveness" if regressor == TORQUE_SYMBOLS[axis] else "off-axis effectiveness"
    if regressor in RATE_SYMBOLS:
        return "on-axis damping" if regressor == RATE_SYMBOLS[axis] else "off-axis damping"
    if regressor in ("qr", "pr", "pq", "pp", "qq", "rr"):
        return "gyroscopic" if regressor == ("qr", "pr", "pq")[axis] else "product of inertia"
    return ""


def _parameters(model: Model, truth: dict[str, Any]) -> list[dict[str, Any]]:
    """List the elements of A and B whose truth the simulator states."""
    stated = truth["models"].get(model.structure, truth["models"]["damped"])
    columns = [*stated["regressors"], *stated["inputs"]]
    values = np.hstack([np.array(stated["A"]), np.array(stated["B"])])
    gains = np.array(stated["B"])[:3]
    rows = []
    for parameter in model.parameters:
        kind = kind_of(parameter.target, parameter.regressor)
        if not kind or parameter.regressor not in columns:
            continue
        true = float(values[stated["targets"].index(parameter.target), columns.index(parameter.regressor)])
        rows.append(
            {
                "name": parameter.name,
                "target": parameter.target,
                "regressor": parameter.regressor,
                "kind": kind,
                "axis": parameter.target[0],
                "identifiable": parameter.identifiable,
                "value": parameter.value,
                "low": parameter.ci95[0],
                "high": parameter.ci95[1],
                "truth": true,
                "scale": _scale(kind, parameter.target, parameter.regressor, true, gains),
            }
        )
    return rows


def _scale(kind: str, target: str, regressor: str, true: float, gains: FloatArray) -> float:
    """Return against what an error of ten per cent is counted: the truth, where it cannot be zero.

    An off-axis effectiveness is held against the geometric mean of the two axes' on-axis effectiveness,
    which does not depend on the units of the torques; a gyroscopic term against
    1, the largest that a rigid body can have; an off-axis damping against 1 1/s.
    """
    if kind == "off-axis effectiveness":
        row, column = ACCELERATION_SYMBOLS.index(target), TORQUE_SYMBOLS.index(regressor)
        return float(np.sqrt(gains[row, row] * gains[column, column]))
    if kind in ("on-axis effectiveness", "on-axis damping"):
        return abs(true)
    return 1.0


def _actuator(
    model: Model, truth: dict[str, Any], diagnosis: Diagnosis, filter_hz: float
) -> list[dict[str, Any]]:
    """List lag and delay; none is claimed where all axes are refused.

    Where the analysis knows the gyro's filter, it models it as the analogue one that the fast loops of
    real autopilots come close to; what the simulator's, which runs at the rate of its control loop, does
    otherwise is part of the delay to be found.
    """
    actuator = model.actuator
    if actuator is None:
        return []
    believed = any(axis.verdict != "refused" for axis in diagnosis.axes.values())
    delay_s = truth["actuator"]["delay_s"]
    if math.isfinite(filter_hz):
        delay_s -= math.sqrt(2.0) / (2.0 * math.pi * filter_hz)
    found = (
        ("lag", actuator.lag_s, actuator.lag_ci95_s, actuator.lag_identifiable, truth["actuator"]["lag_s"]),
        ("delay", actuator.delay_s, actuator.delay_ci95_s, actuator.delay_identifiable, delay_s),
    )
    return [
        {
            "name": f"{kind}_s",
            "target": "",
            "regressor": "",
            "kind": kind,
            "axis": "",
            "identifiable": believed and identifiable,
            "value": value,
            "low": float(low),
            "high": float(high),
            "truth": true,
            "scale": true,
        }
        for kind, value, (low, high), identifiable, true in found
    ]
