"""Transfer functions of the loop: controller, gyro filters, and the identified vehicle.

The sampled parts (controller, filters) are exact at their own periods; the vehicle stands behind a zero-order
hold. Aliases of the sampler are left out: at half the loop's rate a vehicle has a thousandth of its gain at
the crossover.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController, Filter, MeanFilter
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
    """
    if body is None:
        body = plant.response(frequency_hz, controller.period_s)
    paths = Paths(controller, frequency_hz)
    rate, to_torque, to_rate = _closed(paths, body)
    full = None if controller.angle_gain_per_s is None else rate + body * paths.on_angle
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
    return _closed(Paths(controller, frequency_hz), body)


def _closed(paths: Paths, body: ComplexArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return what `rate_answers` does, of a controller whose paths are known."""
    rate = body * paths.on_rate
    to_torque = paths.forward / (1.0 + rate)
    return rate, to_torque, to_torque * body * paths.gyro


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


class Paths:
    """What a controller makes of a rate and of its set-point, each (n_frequencies,): what paths share, once.

    Parameters
    ----------
    controller : AxisController
    frequency_hz : ndarray, shape (n_frequencies,)
        Above zero.
    """

    def __init__(self, controller: AxisController, frequency_hz: FloatArray) -> None:
        self._controller, self._frequency_hz = controller, frequency_hz
        self._steps: dict[float, ComplexArray] = {}

    @cached_property
    def on_rate(self) -> ComplexArray:
        """The response of the command to the rate, from the gyro's filters to the mixer's input.

        With its sign turned: the loop is the product with the vehicle.
        """
        of_error = self._error
        if self._controller.rate is not None:
            of_error = of_error + self._response(self._controller.rate)
        return np.asarray(self.gyro * self._behind * of_error, dtype=np.complex128)

    @cached_property
    def on_angle(self) -> ComplexArray:
        """The response of the command to the rate by way of the angle loop, whose gain is known.

        With its sign turned, as of `on_rate`.
        """
        return self._by_angle(self.forward)

    @cached_property
    def on_angle_by_error(self) -> ComplexArray:
        """The part of `on_angle` that goes through the rate error, and not through the feed-forward."""
        return self._by_angle(self._on_target(self._error))

    @cached_property
    def forward(self) -> ComplexArray:
        """The response of the command to a rate set-point, the measured rate being zero."""
        on_target = self._error
        if self._controller.feed_forward is not None:
            on_target = on_target + self._response(self._controller.feed_forward)
        return self._on_target(on_target)

    @cached_property
    def gyro(self) -> ComplexArray:
        """The response of what lies between gyro and controller."""
        response = np.ones(self._frequency_hz.shape, dtype=np.complex128)
        for each in self._controller.gyro:
            response = response * self._response(each)
        return response

    @cached_property
    def _error(self) -> ComplexArray:
        return self._response(self._controller.error)

    @cached_property
    def _behind(self) -> ComplexArray | float:
        """The response of what stands behind the sum of the terms."""
        return 1.0 if self._controller.command is None else self._response(self._controller.command)

    def _on_target(self, terms: ComplexArray) -> ComplexArray:
        return np.asarray(self._behind * terms * self._response(self._controller.target))

    def _by_angle(self, forward: ComplexArray) -> ComplexArray:
        controller = self._controller
        s = np.asarray(2j * np.pi * self._frequency_hz, dtype=np.complex128)
        late_s = controller.angle_delay_steps * controller.period_s
        gain_per_s = np.nan if controller.angle_gain_per_s is None else controller.angle_gain_per_s
        return np.asarray(forward * gain_per_s / s * delay_response(s, late_s), dtype=np.complex128)

    def _response(self, one: Filter) -> ComplexArray:
        """Return the response of a filter; those of one period share what a step delays."""
        if isinstance(one, MeanFilter):
            return one.response(self._frequency_hz)
        if one.period_s not in self._steps:
            self._steps[one.period_s] = one.step(self._frequency_hz)
        return one.at(self._steps[one.period_s])


def on_rate(controller: AxisController, frequency_hz: FloatArray) -> ComplexArray:
    """Return `Paths.on_rate` alone, shape (n_frequencies,)."""
    return Paths(controller, frequency_hz).on_rate


def on_angle(controller: AxisController, frequency_hz: FloatArray) -> ComplexArray:
    """Return `Paths.on_angle` alone, shape (n_frequencies,)."""
    return Paths(controller, frequency_hz).on_angle


def forward_filters(controller: AxisController, frequency_hz: FloatArray) -> ComplexArray:
    """Return `Paths.forward` alone, shape (n_frequencies,)."""
    return Paths(controller, frequency_hz).forward


def gyro_filters(controller: AxisController, frequency_hz: FloatArray) -> ComplexArray:
    """Return `Paths.gyro` alone, shape (n_frequencies,)."""
    return Paths(controller, frequency_hz).gyro


def integrators(controller: AxisController) -> int:
    """Count the poles at zero frequency of the rate loop; the angle loop adds one."""
    above, below = controller.error.numerator, controller.error.denominator
    # Without an integral gain, the integrator's pole is there and a zero upon it.
    pole, zero = (abs(each.sum()) < _AT_ZERO * np.abs(each).sum() for each in (below, above))
    return int(pole and not zero)
