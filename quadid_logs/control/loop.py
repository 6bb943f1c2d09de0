"""Transfer functions of the loop: controller, gyro filters, and the identified vehicle.

The sampled parts (controller, filters) are exact at their own periods; the vehicle stands behind a zero-order
hold. Aliases of the sampler are left out: at half the loop's rate a vehicle has a thousandth of its gain at
the crossover.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.controller import AxisController
from quadid_logs.maths.band import ComplexArray, delay_response, lag_response


class Plant(NamedTuple):
    """Vehicles with their actuators, one axis: each of shape (n_plants,).

    Torque to rate is B / (s - A) / (1 + s lag) exp(-s delay); ``damping`` A is negative where the air brakes.
    The delay does not contain the zero-order hold.
    """

    effectiveness: FloatArray
    damping: FloatArray
    lag_s: FloatArray
    delay_s: FloatArray

    def at(self, numbers: slice) -> Plant:
        """Return some of the plants."""
        return Plant(*(values[numbers] for values in self))

    def times(self, factor: float) -> Plant:
        """Return plants that are so many times as effective."""
        return self._replace(effectiveness=self.effectiveness * factor)

    def response(self, frequency_hz: FloatArray, hold_s: float) -> ComplexArray:
        """Return the response of the rate to the controller's command, before the gyro's filters.

        Parameters
        ----------
        frequency_hz : ndarray, shape (n_frequencies,)
        hold_s : float
            For which a command is held [s].

        Returns
        -------
        ndarray of complex, shape (n_plants, n_frequencies)
        """
        s = _laplace(frequency_hz)
        B, A, lag_s, delay_s = (values[:, np.newaxis] for values in self)
        held = np.sinc(frequency_hz * hold_s)
        response = B / (s - A) * lag_response(s, lag_s) * np.exp(-s * (delay_s + 0.5 * hold_s))
        return np.asarray(held * response, dtype=np.complex128)


class Loop(NamedTuple):
    """The loop of one axis against frequency, each of shape (n_plants, n_frequencies).

    ``rate`` and ``full`` are open loops, cut at the mixer's input: the rate loop alone, and with the angle loop
    around it, None where no angle loop is known. ``target_to_torque`` and ``target_to_rate`` are the closed rate
    loop's answers to a set-point; the rate is that behind the gyro's filters, as it is logged.
    """

    frequency_hz: FloatArray
    rate: ComplexArray
    full: ComplexArray | None
    target_to_torque: ComplexArray
    target_to_rate: ComplexArray


def close(controller: AxisController, plant: Plant, frequency_hz: FloatArray) -> Loop:
    """Close the loop of a controller around vehicles.

    Parameters
    ----------
    controller : AxisController
    plant : Plant
    frequency_hz : ndarray, shape (n_frequencies,)
        Above zero.

    Returns
    -------
    Loop
    """
    s = _laplace(frequency_hz)
    gyro = gyro_filters(controller, frequency_hz)
    body = plant.response(frequency_hz, controller.period_s)
    behind = np.ones_like(s) if controller.command is None else controller.command.response(frequency_hz)
    on_rate = controller.error.response(frequency_hz)
    on_target = on_rate.copy()
    if controller.rate is not None:
        on_rate = on_rate + controller.rate.response(frequency_hz)
    if controller.feed_forward is not None:
        on_target = on_target + controller.feed_forward.response(frequency_hz)
    forward = behind * on_target * controller.target.response(frequency_hz)
    rate = body * (gyro * behind * on_rate)
    full = None
    if controller.angle_gain_per_s is not None:
        steps_s = controller.angle_delay_steps * controller.period_s
        angle = controller.angle_gain_per_s / s * delay_response(s, steps_s)
        full = rate + body * (forward * angle)
    to_torque = forward / (1.0 + rate)
    return Loop(frequency_hz, rate, full, to_torque, to_torque * body * gyro)


def gyro_filters(controller: AxisController, frequency_hz: FloatArray) -> ComplexArray:
    """Return the response of what lies between gyro and controller.

    Parameters
    ----------
    controller : AxisController
    frequency_hz : ndarray, shape (n_frequencies,)

    Returns
    -------
    ndarray of complex, shape (n_frequencies,)
    """
    response = np.ones(frequency_hz.shape, dtype=np.complex128)
    for each in controller.gyro:
        response = response * each.response(frequency_hz)
    return response


def without_angle(controller: AxisController) -> AxisController:
    """Return the controller of the rate alone.

    Parameters
    ----------
    controller : AxisController

    Returns
    -------
    AxisController
    """
    return replace(controller, angle_gain_per_s=None)


def _laplace(frequency_hz: FloatArray) -> ComplexArray:
    return np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
