"""Transfer functions of the loop: controller, gyro filters, and the identified vehicle.

The sampled parts (controller, filters) are exact at their own periods; the vehicle stands behind a zero-order
hold. Aliases of the sampler are left out: at half the loop's rate a vehicle has a thousandth of its gain at
the crossover.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController, in_series
from quadid_logs.maths.band import ComplexArray, delay_response

#: A pole this near to one in z is at zero frequency: rounding leaves 1e-16, the slowest filter 1e-5.
_AT_ZERO: Final = 1e-9


class Loop(NamedTuple):
    """The loop of one axis against frequency, each of shape (n_plants, n_frequencies).

    ``rate`` and ``full`` are open loops, cut at the mixer's input: the rate loop alone, and with the angle
    loop around it, None where no angle loop is known. ``target_to_torque`` and ``target_to_rate`` are the
    closed rate loop's answers to a set-point; the rate is that behind the gyro's filters, as it is logged.
    """

    frequency_hz: FloatArray
    rate: ComplexArray
    full: ComplexArray | None
    target_to_torque: ComplexArray
    target_to_rate: ComplexArray


def close(
    controller: AxisController, plant: Plant, frequency_hz: FloatArray, body: ComplexArray | None = None
) -> Loop:
    """Close the loop of a controller around vehicles.

    Parameters
    ----------
    controller : AxisController
    plant : Plant
    frequency_hz : ndarray, shape (n_frequencies,)
        Above zero.
    body : ndarray of complex, shape (n_plants, n_frequencies), optional
        The response of the plant behind a hold of the controller's period, where it is known.

    Returns
    -------
    Loop
    """
    if body is None:
        body = plant.response(frequency_hz, controller.period_s)
    rate, to_torque, to_rate = rate_answers(controller, body, frequency_hz)
    full = None
    if controller.angle_gain_per_s is not None:
        full = rate + body * on_angle(controller, frequency_hz)
    return Loop(frequency_hz, rate, full, to_torque, to_rate)


def rate_answers(
    controller: AxisController, body: ComplexArray, frequency_hz: FloatArray
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return the open rate loop, and the closed one's answers to a set-point: see `Loop`.

    Parameters
    ----------
    controller : AxisController
    body : ndarray of complex, shape (n_plants, n_frequencies)
        The response of vehicles behind a hold of the controller's period.
    frequency_hz : ndarray, shape (n_frequencies,)

    Returns
    -------
    rate, target_to_torque, target_to_rate : ndarray of complex, shape (n_plants, n_frequencies)
    """
    rate = body * on_rate(controller, frequency_hz)
    to_torque = forward_filters(controller, frequency_hz) / (1.0 + rate)
    return rate, to_torque, to_torque * body * gyro_filters(controller, frequency_hz)


def rate_loop(controller: AxisController, plant: Plant, frequency_hz: FloatArray) -> ComplexArray:
    """Return the open rate loop of vehicles.

    Parameters
    ----------
    controller, plant, frequency_hz
        As of `close`.

    Returns
    -------
    ndarray of complex, shape (n_plants, n_frequencies)
    """
    back = on_rate(controller, frequency_hz)
    return np.asarray(plant.response(frequency_hz, controller.period_s) * back)


def on_rate(controller: AxisController, frequency_hz: FloatArray) -> ComplexArray:
    """Return the response of the command to the rate, from the gyro's filters to the mixer's input.

    Parameters
    ----------
    controller : AxisController
    frequency_hz : ndarray, shape (n_frequencies,)

    Returns
    -------
    ndarray of complex, shape (n_frequencies,)
        With its sign turned: the loop is the product with the vehicle.
    """
    of_error = controller.error.response(frequency_hz)
    if controller.rate is not None:
        of_error = of_error + controller.rate.response(frequency_hz)
    back = gyro_filters(controller, frequency_hz) * _behind(controller, frequency_hz) * of_error
    return np.asarray(back, dtype=np.complex128)


def on_angle(controller: AxisController, frequency_hz: FloatArray) -> ComplexArray:
    """Return the response of the command to the rate by way of the angle loop.

    Parameters
    ----------
    controller : AxisController
        Its angle gain is known.
    frequency_hz : ndarray, shape (n_frequencies,)

    Returns
    -------
    ndarray of complex, shape (n_frequencies,)
        With its sign turned, as of `on_rate`.
    """
    s, late_s = _laplace(frequency_hz), controller.angle_delay_steps * controller.period_s
    gain_per_s = np.nan if controller.angle_gain_per_s is None else controller.angle_gain_per_s
    forward = forward_filters(controller, frequency_hz)
    return np.asarray(forward * gain_per_s / s * delay_response(s, late_s), dtype=np.complex128)


def forward_filters(controller: AxisController, frequency_hz: FloatArray) -> ComplexArray:
    """Return the response of the command to a rate set-point, the measured rate being zero.

    Parameters
    ----------
    controller : AxisController
    frequency_hz : ndarray, shape (n_frequencies,)

    Returns
    -------
    ndarray of complex, shape (n_frequencies,)
    """
    on_target = controller.error.response(frequency_hz)
    if controller.feed_forward is not None:
        on_target = on_target + controller.feed_forward.response(frequency_hz)
    return _behind(controller, frequency_hz) * on_target * controller.target.response(frequency_hz)


def _behind(controller: AxisController, frequency_hz: FloatArray) -> ComplexArray:
    """Return the response of what stands behind the sum of the terms."""
    if controller.command is None:
        return np.ones(frequency_hz.shape, dtype=np.complex128)
    return controller.command.response(frequency_hz)


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
    return in_series(controller.gyro, frequency_hz)


def integrators(controller: AxisController) -> int:
    """Count the poles at zero frequency of the rate loop; the angle loop adds one.

    Parameters
    ----------
    controller : AxisController

    Returns
    -------
    int
    """
    above, below = controller.error.numerator, controller.error.denominator
    # Without an integral gain, the integrator's pole is there and a zero upon it.
    pole, zero = (abs(each.sum()) < _AT_ZERO * np.abs(each).sum() for each in (below, above))
    return int(pole and not zero)


def _laplace(frequency_hz: FloatArray) -> ComplexArray:
    return np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
