"""Equations told by the spectra of what was commanded, in the place of those that air has spoiled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Model, Parameter, SpectralFit, TimingCheck
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.actuator_model import KnownActuator
from quadid_logs.identify.design import Design
from quadid_logs.identify.inference import intervals
from quadid_logs.identify.parameters import MAX_RELATIVE_CI
from quadid_logs.identify.rotors import rotors_known
from quadid_logs.identify.splice import with_axis_of, with_interval
from quadid_logs.identify.structural import LARGE_SHIFT, is_late, possible_losses, seen_effects
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.terms import TRIM, YAW_REACTION
from quadid_logs.identify.validate import validate
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, ON_AXIS, RATE_SYMBOLS, TORQUE_SYMBOLS

#: What air does comes back in the torque through the controller, and lowers a fit in time by up to the part
#: of the acceleration that it leaves unexplained: below the hundredth that gyros are off by, it is no matter.
_EXPLAINED_R2 = 0.99
_NOT_TOLD = "the response to commands gives effectiveness and damping only"
_YAW = 2


def actuator_told(fits: Sequence[SpectralFit]) -> KnownActuator | None:
    """Return lag and delay as commands tell them, and whether the torque is late.

    Parameters
    ----------
    fits : sequence of SpectralFit
        Of roll, pitch, yaw.

    Returns
    -------
    KnownActuator or None
        None where neither roll nor pitch is told.
    """
    told = next((fit for fit in fits[:_YAW] if fit.is_sound), None)
    if told is None:
        return None
    lag_s, delay_s = (float(value) for value in told.mean[2:4])
    half_s = NORMAL_95 * float(np.sqrt(told.covariance[3, 3]))
    # The effectiveness that commands tell knows of it.
    late = TimingCheck(delay_s=delay_s, half_width_s=half_s, shift=(0.0, 0.0, 0.0))
    return KnownActuator(lag_s, delay_s, late if delay_s + half_s < 0.0 else None)


def spoiled_axes(model: Model, period_s: float) -> tuple[int, ...]:
    """Return the axes of which air, an effect, or a torque from another time may have spoiled a fit in time.

    Parameters
    ----------
    model : Model
        Fitted in time, equation by equation.
    period_s : float
        Between samples.

    Returns
    -------
    tuple of int
        0 roll, 1 pitch, 2 yaw.
    """
    check = model.structural
    if check is None or is_late(check, period_s):
        return tuple(range(len(AXES)))
    return tuple(
        axis
        for axis in range(len(AXES))
        if not explains(model, axis)
        or any(abs(each.shift) > LARGE_SHIFT for each in possible_losses(check, axis))
        or seen_effects(check, axis)
    )


def explains(model: Model, axis: int) -> bool:
    """Say whether a fit in time explains so much that what air does through the controller is no matter.

    Parameters
    ----------
    model : Model
    axis : int
        0 roll, 1 pitch, 2 yaw.

    Returns
    -------
    bool
    """
    return model.validation.r2_acceleration.get(ACCELERATION_SYMBOLS[axis], -np.inf) >= _EXPLAINED_R2


def with_spectral_axes(
    model: Model,
    structure: Structure,
    fits: Sequence[SpectralFit],
    axes: Sequence[int],
    *,
    data: FlightData,
    design: Design,
    settings: IdentifySettings,
) -> Model:
    """Return a model whose equations of some axes are those that the spectra tell.

    Parameters
    ----------
    model : Model
        Behind an actuator.
    structure : Structure
        Of the model.
    fits : sequence of SpectralFit
        Of roll, pitch, yaw.
    axes : sequence of int
        0 roll, 1 pitch, 2 yaw.
    data : FlightData
    design : Design
        Its rows, not high-passed.
    settings : IdentifySettings

    Returns
    -------
    Model
    """
    for axis in axes:
        other = _of_axis(model, structure, fits[axis], axis, data, design, settings)
        model = with_axis_of(model, other, axis, data)
    tilting = [axis for axis in axes if axis != _YAW]
    # Lag and delay of a fit in time are those of the axes that it explains.
    in_time = any(explains(model, axis) for axis in {0, 1} - {*tilting})
    if tilting and model.actuator is not None and not in_time:
        fit = fits[tilting[0]]
        lag_s, delay_s = float(fit.mean[2]), float(fit.mean[3])
        half_lag, half_delay = (NORMAL_95 * float(np.sqrt(fit.covariance[k, k])) for k in (2, 3))
        # What is known of a lag is its logarithm: it may be longer by more than it may be shorter.
        times = float(np.exp(half_lag / lag_s)) if lag_s > 0.0 else 1.0
        # The spectra put the lag on the speed of rotors where these are known, and it is one lag.
        acts_on, side_s = ("rotor speed", lag_s) if rotors_known(data) else ("torque", float("nan"))
        model = replace(
            model,
            actuator=replace(
                model.actuator,
                acts_on=acts_on,
                lag_s=lag_s,
                lag_ci95_s=(max(0.0, lag_s - half_lag), lag_s * times),
                delay_s=delay_s,
                delay_ci95_s=(max(0.0, delay_s - half_delay), delay_s + half_delay),
                lag_up_s=side_s,
                lag_down_s=side_s,
            ),
        )
    return model


def with_effects_beside(model: Model, fits: Sequence[SpectralFit], axes: Sequence[int]) -> Model:
    """Widen what a fit in time tells of some axes by what effects make of it that it knows nothing of.

    Parameters
    ----------
    model : Model
    fits : sequence of SpectralFit
        Of roll, pitch, yaw. One that is not a vehicle's response to commands says nothing of effects.
    axes : sequence of int
        0 roll, 1 pitch, 2 yaw.

    Returns
    -------
    Model
    """
    for axis in axes:
        fit, old = fits[axis], model.entries[ON_AXIS[AXES[axis]]]
        if not (fit.follows_commands and np.isfinite([*old.ci95, fit.by_effects]).all()):
            continue
        more = fit.by_effects * abs(old.value)
        low, high = (
            old.value + sign * float(np.hypot(old.value - end, more))
            for sign, end in zip((-1.0, 1.0), old.ci95, strict=True)
        )
        model = with_interval(model, axis, (low, high))
    return model


def _of_axis(
    model: Model,
    structure: Structure,
    fit: SpectralFit,
    axis: int,
    data: FlightData,
    design: Design,
    settings: IdentifySettings,
) -> Model:
    """Return the model with one axis' equation, its intervals and its validation."""
    theta = np.column_stack([model.A, model.B])
    half, kept = np.zeros_like(theta), np.isfinite(theta)
    theta[axis], half[axis], kept[axis] = 0.0, np.inf, False
    # What the spectra tell: value, half width of the 95 % interval, symbol of the column.
    half_widths = NORMAL_95 * np.sqrt(np.diag(fit.covariance))
    told = [
        (float(fit.mean[0]), float(half_widths[0]), TORQUE_SYMBOLS[axis]),
        (float(fit.mean[1]), float(half_widths[1]), RATE_SYMBOLS[axis]),
    ]
    if axis == _YAW and YAW_REACTION in structure.terms:
        told.append((float(fit.mean[4]), float(half_widths[4]), YAW_REACTION.symbol))
    for value, width, symbol in told:
        if symbol in structure.columns:
            column = structure.columns.index(symbol)
            theta[axis, column], half[axis, column], kept[axis, column] = value, width, True
    estimate = intervals(structure, theta, half, kept, knows_gyro=False, band=None, given=data.input)
    if TORQUE_SYMBOLS[axis] in structure.columns:
        for end in (estimate.low, estimate.high):
            end[axis, structure.columns.index(TORQUE_SYMBOLS[axis])] += fit.skew * fit.gain
    parameters = tuple(
        _parameter(old, *(float(each[row, column]) for each in (theta, estimate.low, estimate.high)))
        if row == axis
        else old
        for old, (row, column) in zip(model.parameters, np.ndindex(theta.shape), strict=True)
    )
    torque = design.torque.behind(float(fit.mean[2]), float(fit.mean[3]), structure.inputs)
    with_trim = theta.copy()
    if TRIM.symbol in structure.columns:
        # The constant that makes the equation right on average.
        modelled = design.stack(structure.columns, torque, structure.inputs) @ theta[axis]
        left = design.columns[ACCELERATION_SYMBOLS[axis]] - modelled
        with_trim[axis, structure.columns.index(TRIM.symbol)] = left[design.train].mean()
    validation, series = validate(
        design,
        structure,
        with_trim,
        torque,
        disturbance=np.zeros((len(theta), len(design.disturbances(structure)))),
        high_pass_hz=settings.high_pass_hz,
    )
    target = ACCELERATION_SYMBOLS[axis]
    validation = replace(validation, r2_commanded={**validation.r2_commanded, target: fit.r2_commanded})
    A, B = np.split(theta, [len(structure.terms)], axis=1)
    posterior = model.posterior
    if posterior is not None:
        mean, covariance = posterior.mean.copy(), posterior.covariance.copy()
        mean[axis], covariance[axis] = fit.mean, fit.covariance
        posterior = replace(posterior, mean=mean, covariance=covariance, only_brakes=(False, False, False))
    return replace(
        model,
        A=A,
        B=B,
        parameters=parameters,
        validation=validation,
        fit=series,
        posterior=posterior,
    )


def _parameter(old: Parameter, value: float, low: float, high: float) -> Parameter:
    """Return an element of the equation with what the spectra tell of it."""
    half = 0.5 * (high - low)
    if not np.isfinite(half):
        return replace(
            old, value=value, ci95=(low, high), identifiable=False, reason=_NOT_TOLD, half_width=half
        )
    known = half <= MAX_RELATIVE_CI * abs(value)
    reason = "" if known else "its interval is wide"
    return replace(old, value=value, ci95=(low, high), identifiable=known, reason=reason, half_width=half)
