"""Gains by generalized minimum variance control, as a procedure in flight finds them on given vehicles."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.loop import forward_filters, gyro_filters, rate_loop
from quadid_logs.data.autotune import PolePlacement
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController

#: A high-pass of this cut-off takes off what does not move [Hz].
_SLOWEST_HZ: Final = 0.5
_N_FREQUENCIES: Final = 400
#: The integral gain of the law is divided by this in firmware.
_INTEGRAL_SHARE: Final = 5.0
#: D over P that is not less than this counts as none [s].
_NO_DERIVATIVE_S: Final = -0.001


class PlacedGains(NamedTuple):
    """Gains, each (n_plants,): P (NaN where they are not accepted), I and D over P, and that of the angle."""

    proportional: FloatArray
    integral_per_s: FloatArray
    derivative_s: FloatArray
    angle_per_s: FloatArray


def place_poles(procedure: PolePlacement, controller: AxisController, plants: Plant) -> PlacedGains:
    """Return the gains with which the procedure ends on each vehicle.

    Parameters
    ----------
    procedure : PolePlacement
    controller : AxisController
        That flies while the vehicle is excited.
    plants : Plant

    Notes
    -----
    The discrete model is that of least squares without noise, weighted by the spectrum of the excited
    command. T. Yamamoto, K. Fujii, M. Kaneda, "Design and implementation of a self-tuning PID controller,"
    1998.
    """
    a1, a2, *b = _discrete_models(procedure, controller, plants)
    step_s = procedure.model_period_s
    rho = step_s / procedure.rise_time_s
    # Critical damping: both poles in one place.
    p1, p2 = -2.0 * np.exp(-2.0 * rho), np.exp(-4.0 * rho)
    e1 = p1 + 1.0 - a1
    f0, f1, f2 = p2 + e1 + a1 - a2 - a1 * e1, a2 + a1 * e1 - a2 * e1, a2 * e1
    sloped = f1 + 2.0 * f2
    proportional = -sloped / (procedure.detuning + (1.0 + e1) * (b[0] + b[1] + b[2]))
    integral = -(f0 + f1 + f2) / (step_s * sloped) / _INTEGRAL_SHARE
    derivative = -step_s * f2 / sloped
    derivative = np.where((derivative < 0.0) & (derivative > _NO_DERIVATIVE_S), 0.0, derivative)
    good = (proportional > 0.0) & (integral > 0.0) & (derivative >= 0.0)
    for found, limit in zip((proportional, integral, derivative), procedure.highest, strict=True):
        good &= found < limit
    lowest, highest = procedure.angle_gains
    return PlacedGains(
        proportional=np.where(good, proportional, np.nan),
        integral_per_s=integral,
        derivative_s=derivative,
        angle_per_s=np.clip(1.0 / (procedure.angle_error_rad * proportional), lowest, highest),
    )


def _discrete_models(procedure: PolePlacement, controller: AxisController, plants: Plant) -> FloatArray:
    """Return a1, a2, b0, b1, b2 of y = -a1 y1 - a2 y2 + b0 u1 + b1 u2 + b2 u3, shape (5, n_plants)."""
    highest_hz = 0.5 / procedure.model_period_s
    frequency_hz = np.linspace(highest_hz / _N_FREQUENCIES, highest_hz, _N_FREQUENCIES)
    gyro = gyro_filters(controller, frequency_hz)
    s = 2j * np.pi * frequency_hz
    weight = s / (s + 2.0 * np.pi * _SLOWEST_HZ) / (s + procedure.excitation_per_s) * gyro
    command = weight * forward_filters(controller, frequency_hz)
    command = command / (1.0 + rate_loop(controller, plants, frequency_hz))
    rate = command * plants.response(frequency_hz, controller.period_s) * gyro
    late = np.exp(-s * procedure.model_period_s)
    models = []
    for u, y in zip(command, rate, strict=True):
        regressors = np.stack([-late * y, -(late**2) * y, *(late**k * u for k in (1, 2, 3))], axis=1)
        both = np.vstack([regressors.real, regressors.imag])
        scale = np.linalg.norm(both, axis=0)
        models.append(np.linalg.lstsq(both / scale, np.concatenate([y.real, y.imag]), rcond=None)[0] / scale)
    return np.transpose(models)
