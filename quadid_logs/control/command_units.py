"""What was identified per newton metre, per unit of the controller's command: what a loop is closed with."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from quadid_logs.data.closed_loop import Estimated
from quadid_logs.data.controller import CommandUnit
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Model, Parameter, Posterior
from quadid_logs.data.torque import Calibration
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.vocabulary import AXES, ON_AXIS

#: Effectiveness and reaction are per torque; damping, lag and delay between them are not.
_OF_TORQUE: Final = np.array([True, False, False, False, True])


def per_command(data: FlightData, model: Model) -> tuple[FlightData, Model]:
    """Return flight and model with the torque in units of the normalised command.

    Parameters
    ----------
    data : FlightData
    model : Model

    Returns
    -------
    FlightData
        As it was where nothing was calibrated.
    Model
        On-axis effectiveness and what is known of it with the rest, per unit of command: the calibration
        cancels out of the loop, and with it its uncertainty.
    """
    if data.input is None or data.input.unit == "1":
        return data, model
    calibration = data.input.calibration
    n_m = np.array(calibration.n_m_per_command)
    segments = tuple(replace(each, torque=each.torque / n_m) for each in data.segments)
    given = replace(
        data.input,
        torque_per_thrust=None
        if data.input.torque_per_thrust is None
        else data.input.torque_per_thrust / n_m[:, np.newaxis],
    )
    own = {ON_AXIS[axis]: number for number, axis in enumerate(AXES)}
    parameters = tuple(
        _converted(one, calibration, own[one.target, one.regressor])
        if (one.target, one.regressor) in own
        else one
        for one in model.parameters
    )
    posterior = None if model.posterior is None else _posterior(model.posterior, calibration)
    return replace(data, segments=segments, input=given), replace(
        model, parameters=parameters, posterior=posterior
    )


def in_degrees(effectiveness: Estimated, unit: CommandUnit) -> Estimated:
    """Return an effectiveness as an autopilot counts it.

    Parameters
    ----------
    effectiveness : Estimated
        [rad/s^2] per command of 1.
    unit : CommandUnit

    Returns
    -------
    Estimated
        [deg/s^2] per one of its units.
    """
    factor = math.degrees(1.0) / unit.per_command
    low, high = effectiveness.ci95
    return Estimated(factor * effectiveness.value, (factor * low, factor * high))


def _converted(parameter: Parameter, calibration: Calibration, number: int) -> Parameter:
    n_m, value = calibration.n_m_per_command[number], parameter.value
    half_width = 0.5 * (parameter.ci95[1] - parameter.ci95[0])
    narrower = _narrowing(half_width / NORMAL_95, value, calibration.relative_sigma[number])
    low, high = (n_m * (value + narrower * (end - value)) for end in parameter.ci95)
    return replace(parameter, value=n_m * value, ci95=(low, high))


def _posterior(posterior: Posterior, calibration: Calibration) -> Posterior:
    mean, covariance = posterior.mean.copy(), posterior.covariance.copy()
    for number, n_m in enumerate(calibration.n_m_per_command):
        # The calibration's uncertainty is no part of what is known of the loop: see `data.model.Posterior`.
        per_command = np.where(_OF_TORQUE, n_m, 1.0)
        mean[number] *= per_command
        covariance[number] *= np.outer(per_command, per_command)
    return replace(posterior, mean=mean, covariance=covariance)


def _narrowing(sigma: float, value: float, relative_sigma: float) -> float:
    """Return what is left of a standard deviation without that of the calibration, relative.

    Both are independent: their squares add up to the whole.
    """
    of_calibration = abs(value) * relative_sigma if np.isfinite(relative_sigma) else 0.0
    if not sigma > 0.0:
        return 1.0
    return float(np.sqrt(max(1.0 - (of_calibration / sigma) ** 2, 0.0)))
