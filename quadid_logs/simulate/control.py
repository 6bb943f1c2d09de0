"""The autopilot: attitude and rate loops, altitude hold, mixer, thrust curve.

Components throughout, as in `plant`. The structure and the mixer are
ArduPilot's (AC_AttitudeControl, AC_PID, AP_MotorsMatrix.cpp
`output_armed_stabilizing`); PX4 differs in its factors and in the thrust
curve, and its sequential desaturation is replaced by the same scaling.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from quadid_logs.maths.rotational_dynamics import Quadruple, Triple
from quadid_logs.maths.rotations import Component
from quadid_logs.simulate.airframes import GRAVITY_M_S2


class Arithmetic(NamedTuple):
    """Minimum and maximum for floats or for arrays: all that Python writes differently."""

    lower: Callable[[Any, Any], Any]
    higher: Callable[[Any, Any], Any]


def arithmetic(n_flights: int) -> Arithmetic:
    """Return the arithmetic for one flight (floats) or for many (arrays)."""
    return Arithmetic(min, max) if n_flights == 1 else Arithmetic(np.minimum, np.maximum)


class Biquad(NamedTuple):
    """Coefficients of the second-order Butterworth low-pass of both autopilots' gyros."""

    b0: float
    b1: float
    b2: float
    a1: float
    a2: float


def butterworth(cutoff_hz: float, sample_rate_hz: float) -> Biquad:
    """Return ArduPilot's DigitalBiquadFilter (LowPassFilter2p.cpp), the same as PX4's LowPassFilter2p."""
    ohm = math.tan(math.pi * cutoff_hz / sample_rate_hz)
    c = 1.0 + 2.0 * math.cos(math.pi / 4.0) * ohm + ohm * ohm
    b0 = ohm * ohm / c
    return Biquad(
        b0=b0,
        b1=2.0 * b0,
        b2=b0,
        a1=2.0 * (ohm * ohm - 1.0) / c,
        a2=(1.0 - 2.0 * math.cos(math.pi / 4.0) * ohm + ohm * ohm) / c,
    )


def filter_rates(
    sample: Triple, memory: tuple[Triple, Triple], biquad: Biquad
) -> tuple[Triple, tuple[Triple, Triple]]:
    """Pass one gyro sample through the filter of each axis."""
    b0, b1, b2, a1, a2 = biquad
    (p1, q1, r1), (p2, q2, r2) = memory
    p0 = sample[0] - a1 * p1 - a2 * p2
    q0 = sample[1] - a1 * q1 - a2 * q2
    r0 = sample[2] - a1 * r1 - a2 * r2
    filtered = (
        b0 * p0 + b1 * p1 + b2 * p2,
        b0 * q0 + b1 * q1 + b2 * q2,
        b0 * r0 + b1 * r1 + b2 * r2,
    )
    return filtered, ((p0, q0, r0), memory[0])


class Gains(NamedTuple):
    """Per axis: attitude P [1/s], rate P, I, D [per rad/s], and the weight of a new slope in D per step."""

    attitude: Triple
    proportional: Triple
    integral: Triple
    derivative: Triple
    derivative_weight: float
    step_s: float
    integral_limit: float = 0.5


class RateMemory(NamedTuple):
    """What the rate loops remember: integrators, last rates, filtered derivatives."""

    integral: Triple
    rate: Triple
    derivative: Triple


def rate_setpoint(attitude: Quadruple, wanted: Quadruple, feedforward: Triple, gains: Gains) -> Triple:
    """Turn an attitude error into body rates, plus the pilot's own rate command [rad/s]."""
    w, x, y, z = attitude
    a, b, c, d = wanted
    # conj(attitude) * wanted: the rotation still to be made, in body axes.
    scalar = w * a + x * b + y * c + z * d
    sign = 2.0 - 4.0 * (scalar < 0.0)
    return (
        feedforward[0] + gains.attitude[0] * sign * (w * b - x * a - y * d + z * c),
        feedforward[1] + gains.attitude[1] * sign * (w * c + x * d - y * a - z * b),
        feedforward[2] + gains.attitude[2] * sign * (w * d - x * c + y * b - z * a),
    )


def torque_command(
    setpoint: Triple, rate: Triple, memory: RateMemory, gains: Gains, *, limited: Component, ops: Arithmetic
) -> tuple[Triple, RateMemory]:
    """Run the three rate PIDs; the integrators wait while the mixer is at its limits."""
    commands, integrals, derivatives = [], [], []
    learn = gains.step_s * (1.0 - limited)
    bound = gains.integral_limit
    for axis in range(3):
        error = setpoint[axis] - rate[axis]
        integral = memory.integral[axis] + gains.integral[axis] * error * learn
        integral = ops.higher(ops.lower(integral, bound), -bound)
        slope = (memory.rate[axis] - rate[axis]) / gains.step_s
        derivative = memory.derivative[axis] + gains.derivative_weight * (slope - memory.derivative[axis])
        commands.append(gains.proportional[axis] * error + integral + gains.derivative[axis] * derivative)
        integrals.append(integral)
        derivatives.append(derivative)
    return _triple(commands), RateMemory(_triple(integrals), rate, _triple(derivatives))


def _triple(values: list[Component]) -> Triple:
    """Make a vector of three components."""
    first, second, third = values
    return first, second, third


def altitude_throttle(
    height_error: Component,
    climb_error: Component,
    integral: Component,
    *,
    hover: Component,
    attitude: Quadruple,
    ops: Arithmetic,
) -> Component:
    """Hold the height: hover throttle, more when tilted, plus a PID on the height (0 to 1)."""
    _, x, y, _ = attitude
    upright = ops.higher(1.0 - 2.0 * (x * x + y * y), 0.5)
    wanted = 1.0 + (1.4 * height_error + 2.4 * climb_error + integral) / GRAVITY_M_S2
    return ops.higher(ops.lower(hover * wanted / upright, 1.0), 0.02)


class Mixer(NamedTuple):
    """Roll, pitch, yaw and throttle factor of every motor, and the mixer's settings."""

    roll: tuple[Component, ...]
    pitch: tuple[Component, ...]
    yaw: tuple[Component, ...]
    throttle: tuple[Component, ...]
    hover: Component
    yaw_headroom: float = 0.2
    throttle_mix: float = 0.5


class Mixed(NamedTuple):
    """Thrust fraction per motor (0 to 1), torque that was achieved, 1 where anything was limited."""

    thrust: tuple[Component, ...]
    torque: Triple
    limited: Component


def mix(command: Triple, throttle: Component, mixer: Mixer, ops: Arithmetic) -> Mixed:
    """Allocate torque and throttle to the motors: yaw is clipped first, then all is scaled."""
    roll, pitch, yaw = command
    average = ops.higher(throttle, (1.0 - mixer.throttle_mix) * throttle + mixer.throttle_mix * mixer.hover)
    tilt = [r * roll + p * pitch for r, p in zip(mixer.roll, mixer.pitch, strict=True)]
    allowed = _yaw_room(tilt, yaw, ops.lower(average, 0.5), mixer, ops)
    turned = ops.higher(ops.lower(yaw, allowed), -allowed)
    wanted = [t + y * turned for t, y in zip(tilt, mixer.yaw, strict=True)]
    low = high = wanted[0]
    for value in wanted[1:]:
        low, high = ops.lower(low, value), ops.higher(high, value)
    scale = ops.lower(1.0 / ops.higher(high - low, 1.0), average / ops.higher(-low, 1e-9))
    # The lower bound on -low only avoids a division by zero: the ratio is then far above 1.
    scale = ops.lower(scale, 1.0)
    base = -low * scale
    room = ops.higher(1.0 - base - high * scale, 0.0)
    lift = ops.lower(ops.higher(throttle - base, 0.0), room) * (scale >= 1.0)
    collective = base + lift
    thrust = tuple(
        ops.higher(ops.lower(collective * t + scale * value, 1.0), 0.0)
        for t, value in zip(mixer.throttle, wanted, strict=True)
    )
    limited = 1.0 * ((scale < 1.0) | (turned != yaw) | (collective < throttle - 1e-9))
    return Mixed(thrust, (scale * roll, scale * pitch, scale * turned), limited)


def _yaw_room(
    tilt: list[Component], yaw: Component, best_throttle: Component, mixer: Mixer, ops: Arithmetic
) -> Component:
    """How much yaw the motors have room for beside roll and pitch, the headroom at least."""
    allowed: Component = 1.0
    for value, factor in zip(tilt, mixer.yaw, strict=True):
        size = abs(factor)
        base = best_throttle + value
        room = base + (1.0 - 2.0 * base) * (yaw * factor > 0.0)
        # A motor without yaw authority sets no limit.
        allowed = ops.lower(allowed, ops.higher(room, 0.0) / ops.higher(size, 1e-6) + 1e6 * (size < 1e-6))
    return ops.higher(allowed, mixer.yaw_headroom)


def throttle_for_thrust(thrust: Component, expo: Component) -> Component:
    """Invert thrust = (1-e) y + e y^2 (AP_Motors_Thrust_Linearization.cpp, FunctionMotors.hpp)."""
    return (expo - 1.0 + ((1.0 - expo) * (1.0 - expo) + 4.0 * expo * thrust) ** 0.5) / (2.0 * expo)


def thrust_of_throttle(throttle: Component, expo: Component) -> Component:
    """Return the thrust fraction (1-e) y + e y^2 of the voltage-effective throttle y."""
    return throttle * (1.0 - expo + expo * throttle)
