"""result.json: the machine-readable result, with the keys that docs/result.schema.json fixes."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.filters import lines_of
from quadid_logs.data.closed_loop import Estimated
from quadid_logs.data.flight import FlightData, GyroCheck, InputDescription
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import (
    Actuator,
    BandCheck,
    Identification,
    Model,
    Windows,
)
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.maths.sliding_windows import weakest_words
from quadid_logs.report.calibration_parts import calibration_half_width, flight_interval
from quadid_logs.report.health_json import health_dict
from quadid_logs.report.loop_json import closed_loop_dict
from quadid_logs.report.provenance import Provenance
from quadid_logs.report.strict_json import fields_of, plain, some_fields, strict_text
from quadid_logs.vocabulary import AXES

if TYPE_CHECKING:
    pass

#: The on-axis control effectiveness of roll, pitch and yaw.
_ON_AXIS_NAMES = ("B11", "B22", "B33")
#: Minor steps add keys, a major step changes or removes one.
SCHEMA_VERSION = "1.0"


def result_dict(result: Result, provenance: Provenance | None = None) -> dict[str, Any]:
    """Return the result as plain JSON values: no NaN, no infinity, no arrays.

    Parameters
    ----------
    result : Result
    provenance : Provenance, optional
        Adds ``tool``: version, command, hash of the log.

    Returns
    -------
    dict
        Keys, units and meanings as docs/result.schema.json says. What is
        unknown or not finite is None.

    Examples
    --------
    >>> from quadid_logs import analyze, result_dict
    >>> content = result_dict(analyze("sample_logs/sysid-quad-x.bin"))
    >>> content["axes"]["roll"]["verdict"], content["data"]["input"]["unit"]
    ('usable', '1')
    """
    values: dict[str, Any] = plain(_content(result, provenance))
    return values


def json_text(result: Result, provenance: Provenance | None = None, *, compact: bool = False) -> str:
    """Return result.json's text: `result_dict` as strict JSON in ASCII.

    Parameters
    ----------
    result : Result
    provenance : Provenance, optional
    compact : bool
        In one line.

    Returns
    -------
    str
    """
    return strict_text(_content(result, provenance), compact=compact)


def _content(result: Result, provenance: Provenance | None) -> dict[str, Any]:
    """Return all keys of the result, the values not yet `plain`."""
    curve = result.identification.thrust_curve
    content: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "log": log_dict(result.log, result.data),
        "pooled": result.pooled,
        "data": data_dict(result.data),
        "models": [_model(model, result.data.input) for model in result.identification.models],
        "axes": {
            name: {"verdict": one.verdict, "reasons": one.reasons, "sentence": one.sentence}
            for name, one in result.diagnosis.axes.items()
        },
        "findings": result.diagnosis.findings,
        "closed_loop": None
        if result.closed_loop is None
        else closed_loop_dict(result.closed_loop, lines_of(result.health)),
        "excitation": {
            item.axis: some_fields(item, "torque_rms", "rate_rms_rad_s", "signal_to_noise")
            for item in result.identification.excitation
        },
        "health": None if result.health is None else health_dict(result.health),
        "thrust_curve": None
        if curve is None
        else {
            "expo": Estimated(curve.expo, curve.ci95),
            **some_fields(curve, "assumed", "parameter", "identifiable", "reason", "corrected"),
            **some_fields(curve, "thrust_over_mean", "effectiveness", "effectiveness_ci95"),
        },
        "spectral": _spectral(result.identification),
        "skipped": result.identification.skipped,
        "timings_s": {
            "read": 0.0,
            "align": 0.0,
            "identify": 0.0,
            "report": 0.0,
            "total": 0.0,
            **result.timings_s,
        },
        "settings": settings_of(result.settings),
    }
    if provenance is not None:
        content["tool"] = {"name": "quadid-logs", **fields_of(provenance)}
    return content


def settings_of(settings: Settings) -> dict[str, Any]:
    """Return the settings of all stages by name."""
    every: dict[str, Any] = {}
    for name, value in fields_of(settings).items():
        every |= (
            fields_of(value)
            if dataclasses.is_dataclass(value) and not isinstance(value, type)
            else {name: value}
        )
    return every


def log_dict(log: FlightLog, data: FlightData) -> dict[str, Any]:
    """Return ``log``."""
    model = log.torque
    return {
        **some_fields(log, "path", "format", "dialect", "autopilot", "firmware"),
        **some_fields(log, "vehicle_type", "vehicle_name", "frame"),
        "airframe": None if model is None else fields_of(model) | {"n_rotors": model.n_rotors},
        "n_bytes": log.n_bytes,
        **some_fields(data, "start_s", "duration_s"),
        **some_fields(log, "corrupt_bytes", "lost", "n_dropped"),
        "clock_resets": data.clock_resets,
        "remarks": log.remarks,
    }


def data_dict(data: FlightData) -> dict[str, Any]:
    """Return ``data``."""
    described = data.input
    rates = {}
    for name, choice in data.sources.items():
        content = fields_of(choice)
        content.pop("signal")
        content["others"] = [{"source": source, "rate_hz": rate_hz} for source, rate_hz in choice.others]
        rates[name] = content
    return {
        "sample_period_s": data.sample_period_s,
        "segments": data.flight_segments,
        "gap_free": [[segment.start_s, segment.end_s] for segment in data.segments],
        "flights": data.flights,
        "n_samples": data.n_samples,
        "rates": rates,
        "input": None
        if described is None
        else some_fields(
            described, "kind", "unit", "source", "saturated_fraction", "achieved", "calibration"
        ),
        "gyro_check": None if data.gyro_check is None else _gyro(data.gyro_check),
        "on_ground_reason": data.on_ground_reason,
    }


def _gyro(check: GyroCheck) -> dict[str, Any]:
    """Return ``data.gyro_check``: the matrix from logged body rates to those that the attitude shows."""
    low, high = check.interval
    return {
        "n_intervals": check.start_s.shape[0],
        "interval_s": check.length_s,
        "attitude_over_rate": check.matrix,
        "low": low,
        "high": high,
        "explained": check.explained,
        "bias_rad_s": check.bias_rad_s,
        "lag_s": _within(check.lag_s, check.lag_half_width_s),
    }


def _spectral(identification: Identification) -> dict[str, Any]:
    """Return ``spectral``: by axis, empty where nothing tells what was commanded."""
    return {
        axis: {
            "effectiveness": _within(fit.gain, fit.half_width),
            "damping_1_s": fit.mean[1],
            "lag_s": fit.mean[2],
            "delay_s": fit.mean[3],
            **some_fields(fit, "departure", "r2_commanded"),
            "torque_commanded": fit.commanded,
            "segments": fit.n_blocks,
            "sound": fit.is_sound,
            **some_fields(fit, "used", "planned", "repeated", "effects"),
            "effectiveness_with_effects": 1.0 + fit.shift,
        }
        for axis, fit in zip(AXES, identification.spectral, strict=False)
    }


def _within(value: float, half_width: float) -> Estimated:
    return Estimated(value, (value - half_width, value + half_width))


def _model(model: Model, given: InputDescription | None) -> dict[str, Any]:
    """Return an entry of ``models``."""
    parameters = []
    for parameter in model.parameters:
        content = fields_of(parameter)
        if calibration_half_width(parameter, given):
            # Per newton metre: that the flight alone leaves.
            content["ci95_flight"] = flight_interval(parameter, given)
        parameters.append(content)
    return {
        **some_fields(model, "structure", "recommended", "states", "regressors", "targets", "inputs"),
        "A": model.A,
        "B": model.B,
        "parameters": parameters,
        "actuator": None if model.actuator is None else _actuator(model.actuator),
        "yaw_reaction": None
        if model.yaw_reaction is None
        else {"lead_s": Estimated(model.yaw_reaction.lead_s, model.yaw_reaction.ci95_s)},
        "inertia_kg_m2": model.inertia,
        "windows": None if model.windows is None else _windows(model, model.windows),
        "validation": model.validation,
        "discrete": model.discrete,
        "smoothing_hz": model.smoothing_hz,
        "condition_number": model.condition_number,
        "band_check": None if model.band is None else _band(model.band),
        "yaw_band_check": None if model.yaw_band is None else _band(model.yaw_band),
        "change_check": None
        if model.change is None
        else {
            name: {"time_s": time_s, "before": before, "after": after, "statistic": statistic}
            for name, time_s, before, after, statistic in zip(
                _ON_AXIS_NAMES,
                model.change.time_s,
                model.change.before,
                model.change.after,
                model.change.statistic,
                strict=True,
            )
        },
        "information_criterion": model.criterion,
        "note": model.note,
    }


def _actuator(actuator: Actuator) -> dict[str, Any]:
    """Return ``actuator``."""
    return {
        "lag_s": {
            "value": actuator.lag_s,
            "ci95": actuator.lag_ci95_s,
            "identifiable": actuator.lag_identifiable,
        },
        "delay_s": {
            "value": actuator.delay_s,
            "ci95": actuator.delay_ci95_s,
            "identifiable": actuator.delay_identifiable,
        },
        **some_fields(actuator, "acts_on", "lag_up_s", "lag_down_s"),
    }


def _windows(model: Model, windows: Windows) -> dict[str, Any]:
    """Return ``windows``: statistics over all of them, estimates over the used ones."""
    ranks, counts = np.unique(windows.rank, return_counts=True)
    columns = (*model.regressors, *model.inputs)
    # Infinite values count, and are reported as None.
    spread: dict[str, float | None] = dict.fromkeys(("median", "p05", "p95"))
    if windows.condition_number.size:
        # Quantiles of the order statistics themselves: interpolating beside an infinity gives NaN.
        low, middle, high = np.quantile(windows.condition_number, [0.05, 0.5, 0.95], method="nearest")
        spread = {"median": float(middle), "p05": float(low), "p95": float(high)}
    used = windows.coefficients[windows.used]
    return {
        "n": windows.time_s.shape[0],
        **some_fields(windows, "width", "stride", "period_s"),
        "used": int(np.count_nonzero(windows.used)),
        "weakest": weakest_words(windows.weakest, (*model.regressors, *model.inputs)),
        "condition_number": spread,
        "rank": {str(rank): int(count) for rank, count in zip(ranks, counts, strict=True)},
        "estimates": {
            parameter.name: _estimate(used[:, row, column])
            for parameter, row, column in [
                (parameter, model.targets.index(parameter.target), columns.index(parameter.regressor))
                for parameter in model.parameters
                if parameter.target in model.targets and parameter.regressor in columns
            ]
        },
    }


def _estimate(values: FloatArray) -> dict[str, Any]:
    """Return median and quartiles of one coefficient over the windows."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return {"median": None, "iqr": [None, None]}
    low, middle, high = np.quantile(finite, [0.25, 0.5, 0.75])
    return {"median": float(middle), "iqr": [float(low), float(high)]}


def _band(check: BandCheck) -> dict[str, Any]:
    """Return ``band_check``: each on-axis effectiveness by cut-off of the smoothing, the model's first."""
    return {
        "low_hz": check.low_hz,
        "cutoff_hz": check.cutoff_hz,
        "gain": dict(zip(_ON_AXIS_NAMES, check.on_axis_gain.T, strict=True)),
        "spread": dict(zip(_ON_AXIS_NAMES, check.spread, strict=True)),
    }
