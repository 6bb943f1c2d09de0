"""Doubts about the recommended model, axis by axis."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification, Model
from quadid_logs.data.settings import Settings
from quadid_logs.diagnose.advice import excitation_advice
from quadid_logs.diagnose.findings import finding
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, RATE_SYMBOLS

#: A gain that moves by more than this from band to band is not one number.
_BAND_ERROR = 0.25
_BAND_WARNING = 0.1
#: A battery that empties lowers the gain by some per cent; more is another vehicle.
_HALVES_WARNING = 0.1
_HALVES_ERROR = 0.25
#: Windows of the paper of which fewer than this share rise above the noise.
_FEW_WINDOWS = 0.5


def find_in_models(log: FlightLog, identification: Identification, settings: Settings) -> Iterator[Finding]:
    """Yield the findings about the models."""
    model = identification.recommended
    if model is None:
        return
    for number, axis in enumerate(AXES):
        yield from _axis(log, identification, model, settings, number, axis)
    yield from _actuator(model, settings)
    yield from _windows(identification)


def _axis(
    log: FlightLog, identification: Identification, model: Model, settings: Settings, number: int, axis: str
) -> Iterator[Finding]:
    """Judge one axis; the first error is enough, because the others follow from it."""
    target = ACCELERATION_SYMBOLS[number]
    r2 = model.validation.r2_acceleration.get(target, float("nan"))
    excitation = identification.excitation[number]
    evidence: dict[str, object] = {
        "held_out_r2": _rounded(r2),
        "signal_to_noise": _rounded(excitation.signal_to_noise),
        "rate_rms_deg_s": _rounded(np.degrees(excitation.rate_rms_rad_s)),
        "torque_rms": _rounded(excitation.torque_rms),
    }
    own = next(p for p in model.parameters if p.target == target and p.regressor == model.inputs[number])
    gain = {"gain": _rounded(own.value), "ci95": [_rounded(own.ci95[0]), _rounded(own.ci95[1])]}
    advice = excitation_advice(log.autopilot, axis)
    moved_deg_s = float(np.degrees(excitation.rate_rms_rad_s))
    if moved_deg_s < settings.min_rate_rms_deg_s:
        yield finding(
            "QL403",
            "error",
            {**evidence, "needed_deg_s": settings.min_rate_rms_deg_s},
            axes=(axis,),
            advice=advice,
            title=f"{axis.capitalize()} was hardly moved ({moved_deg_s:.2g} deg/s rms)",
        )
        return
    if not excitation.signal_to_noise >= settings.min_signal_to_noise:
        yield finding(
            "QL504",
            "error",
            evidence,
            axes=(axis,),
            advice=advice,
            title=f"The torque explains only {100.0 * max(0.0, np.nan_to_num(r2)):.0f} % of the "
            f"{axis} acceleration on flight that the model was not fitted to",
        )
        return
    if not own.value > 0.0:
        yield finding("QL506", "error", {**evidence, **gain}, axes=(axis,))
        return
    half_width = 0.5 * (own.ci95[1] - own.ci95[0])
    if not half_width <= settings.max_relative_ci * own.value:
        yield finding(
            "QL505",
            "error",
            {**evidence, **gain},
            axes=(axis,),
            advice=advice,
        )
        return
    yield from _simulation(model, settings, number, axis, advice)
    yield from _band(model, number, axis, advice)
    yield from _halves(model, number, axis)
    if excitation.signal_to_noise < settings.caution_signal_to_noise:
        yield finding(
            "QL404",
            "warning",
            evidence,
            axes=(axis,),
            advice=advice,
            title=f"{axis.capitalize()} was moved only a little",
        )


def _simulation(model: Model, settings: Settings, number: int, axis: str, advice: str) -> Iterator[Finding]:
    """Doubt an axis whose motion does not follow from its torque over some seconds."""
    r2 = model.validation.r2_simulated_rate.get(RATE_SYMBOLS[number], float("nan"))
    if r2 >= settings.caution_simulated_r2:
        return
    yield finding(
        "QL511",
        "warning" if r2 >= settings.min_simulated_r2 else "error",
        {
            "simulated_rate_r2": _rounded(r2),
            "block_s": settings.held_out_block_s,
            "needed_r2": settings.min_simulated_r2,
        },
        axes=(axis,),
        advice=advice,
    )


def _band(model: Model, number: int, axis: str, advice: str) -> Iterator[Finding]:
    if model.band is None:
        return
    spread = float(model.band.spread[number])
    if spread > _BAND_WARNING:
        yield finding(
            "QL503",
            "error" if spread > _BAND_ERROR else "warning",
            {
                "cutoff_hz": [_rounded(value) for value in model.band.cutoff_hz],
                "gain": [_rounded(value) for value in model.band.own_gain[:, number]],
            },
            axes=(axis,),
            advice=advice,
        )


def _halves(model: Model, number: int, axis: str) -> Iterator[Finding]:
    if model.halves is None:
        return
    change = float(model.halves.changed[number])
    if change > _HALVES_WARNING:
        yield finding(
            "QL509",
            "error" if change > _HALVES_ERROR else "warning",
            {
                "first_half": _rounded(float(model.halves.own_gain[0, number])),
                "second_half": _rounded(float(model.halves.own_gain[1, number])),
                "half_widths_95": [_rounded(float(value)) for value in model.halves.half_width[:, number]],
            },
            axes=(axis,),
        )


def _actuator(model: Model, settings: Settings) -> Iterator[Finding]:
    actuator = model.actuator
    if actuator is None:
        return
    if actuator.lag_s >= 0.99 * settings.max_lag_s or actuator.delay_s >= 0.99 * settings.max_delay_s:
        yield finding(
            "QL507", "warning", {"lag_s": _rounded(actuator.lag_s), "delay_s": _rounded(actuator.delay_s)}
        )


def _windows(identification: Identification) -> Iterator[Finding]:
    """Say how the published windows fare, once for all structures that have them."""
    weak = {}
    for model in identification.models:
        windows = model.windows
        if windows is None or model.recommended:
            continue
        share = float(np.mean(windows.used)) if windows.used.size else 0.0
        if share < _FEW_WINDOWS:
            weak[model.structure] = {
                "windows": int(windows.used.size),
                "above_noise": int(np.count_nonzero(windows.used)),
                "median_condition_number": _rounded(float(np.median(windows.condition_number))),
                "rank_deficient": int(np.count_nonzero(windows.rank < windows.singular_values.shape[1])),
            }
    if weak:
        yield finding("QL501", "info", weak)


def _rounded(value: float) -> float:
    """Return four significant digits: evidence is read by people."""
    return float(f"{value:.4g}")
