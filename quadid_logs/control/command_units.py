"""What was identified per newton metre, per unit of the controller's command: what a loop is closed with."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from quadid_logs.data.closed_loop import Estimated
from quadid_logs.data.controller import CommandUnit
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Model
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.vocabulary import AXES, ON_AXIS

#: Effectiveness and reaction are per torque; damping, lag and delay between them are not.
_OF_TORQUE: Final = np.array([True, False, False, False, True])


def per_command(data: FlightData, model: Model) -> tuple[FlightData, Model]:
    """Return flight and model with the torque in units of the normalised command.

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
    parameters = []
    for one in model.parameters:
        number = own.get((one.target, one.regressor))
        if number is None:
            parameters.append(one)
            continue
        # Calibration and fit are independent: their variances add up to the whole; the fit's is left.
        value, relative_sigma = one.value, calibration.relative_sigma[number]
        sigma = 0.5 * (one.ci95[1] - one.ci95[0]) / NORMAL_95
        of_calibration = abs(value) * relative_sigma if np.isfinite(relative_sigma) else 0.0
        narrower = 1.0 if not sigma > 0.0 else float(np.sqrt(max(1.0 - (of_calibration / sigma) ** 2, 0.0)))
        per_unit = calibration.n_m_per_command[number]
        low, high = (per_unit * (value + narrower * (end - value)) for end in one.ci95)
        parameters.append(replace(one, value=per_unit * value, ci95=(low, high)))
    posterior = model.posterior
    if posterior is not None:
        mean, covariance = posterior.mean.copy(), posterior.covariance.copy()
        for number, per_unit in enumerate(calibration.n_m_per_command):
            # The calibration's uncertainty is no part of what is known of the loop: see
            # `data.model.Posterior`.
            scale = np.where(_OF_TORQUE, per_unit, 1.0)
            mean[number] *= scale
            covariance[number] *= np.outer(scale, scale)
        posterior = replace(posterior, mean=mean, covariance=covariance)
    return replace(data, segments=segments, input=given), replace(
        model, parameters=tuple(parameters), posterior=posterior
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
