"""The autopilot: attitude and rate loops, altitude hold, mixer, thrust curve.

Plain floats throughout, as in `plant`. The structure and the mixer are
ArduPilot's (AC_AttitudeControl, AC_PID, AP_MotorsMatrix.cpp
`output_armed_stabilizing`); PX4 differs in its rate law (rate_control.cpp), in
its factors and in the thrust curve, and its sequential desaturation is replaced
by the same scaling.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from quadid_logs.maths.rotational_dynamics import Quadruple, Triple
from quadid_logs.maths.rotations import Component
from quadid_logs.vocabulary import GRAVITY_M_S2

ZERO: Final[Triple] = (0.0, 0.0, 0.0)


def vector(values: ArrayLike) -> Triple:
    """Return three values as plain floats, which cost a tenth of numpy's scalars."""
    p, q, r = np.asarray(values, dtype=np.float64).tolist()
    return p, q, r


def lower(one: float, other: float) -> float:
    """Return what `min` does, in a third of the time."""
    return other if other < one else one


def higher(one: float, other: float) -> float:
    """Return what `max` does, in a third of the time."""
    return other if other > one else one


class Biquad(NamedTuple):
    """Coefficients of a filter of second order in the gyro's path."""

    b0: float
    b1: float
    b2: float
    a1: float
    a2: float


def butterworth(cutoff_hz: float, sample_rate_hz: float) -> Biquad:
    """Return ArduPilot's DigitalBiquadFilter (LowPassFilter2p.cpp), the same as PX4's LowPassFilter2p.

    Both use a cut-off of at most 0.4 of the sample rate.
    """
    ohm = math.tan(math.pi * min(cutoff_hz / sample_rate_hz, 0.4))
    c = 1.0 + 2.0 * math.cos(math.pi / 4.0) * ohm + ohm * ohm
    b0 = ohm * ohm / c
    return Biquad(
        b0=b0,
        b1=2.0 * b0,
        b2=b0,
        a1=2.0 * (ohm * ohm - 1.0) / c,
        a2=(1.0 - 2.0 * math.cos(math.pi / 4.0) * ohm + ohm * ohm) / c,
    )


class TrackingNotch(NamedTuple):
    """ArduPilot's harmonic notch that follows the mean speed of the rotors (INS_HNTCH_MODE 3), or stands (0).

    ``lowest_hz`` is INS_HNTCH_FREQ, for which the width is told; ``n_harmonics`` of the speed have a notch.
    """

    lowest_hz: float
    width_hz: float
    depth_db: float = 40.0
    n_harmonics: int = 1
    stands: bool = False

    def biquad(self, harmonic: int, speed_hz: float, sample_rate_hz: float) -> Biquad:
        """Return the filter at one harmonic of a speed (NotchFilter.cpp)."""
        octaves = 2.0 * math.log2(self.lowest_hz / (self.lowest_hz - 0.5 * self.width_hz))
        quality = math.sqrt(2.0**octaves) / (2.0**octaves - 1.0)
        centre_hz = self.lowest_hz if self.stands else np.maximum(speed_hz, self.lowest_hz)
        omega = 2.0 * math.pi * harmonic * centre_hz / sample_rate_hz
        alpha, passed = 0.5 * np.sin(omega) / quality, 10.0 ** (-self.depth_db / 20.0)
        middle = -2.0 * np.cos(omega) / (1.0 + alpha)
        return Biquad(
            b0=(1.0 + alpha * passed) / (1.0 + alpha),
            b1=middle,
            b2=(1.0 - alpha * passed) / (1.0 + alpha),
            a1=middle,
            a2=(1.0 - alpha) / (1.0 + alpha),
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
    """Per axis: attitude P [1/s], rate P, I, D [per rad/s]; weights of a new value in the filters per step.

    ``slew_limit`` is ArduPilot's SMAX [1/s], 0 for none.
    """

    attitude: Triple
    proportional: Triple
    integral: Triple
    derivative: Triple
    derivative_weight: Triple
    step_s: float
    target_weight: float = 1.0
    error_weight: float = 1.0
    slew_limit: float = 0.0
    integral_limit: float = 0.5

    def scaled(self, factor: float) -> Gains:
        """Return the gains with P, I and D of the rate loops times a factor."""
        p, i, d = (
            (factor * x, factor * y, factor * z)
            for x, y, z in (self.proportional, self.integral, self.derivative)
        )
        return self._replace(proportional=p, integral=i, derivative=d)


class RateTerms(NamedTuple):
    """What one axis' rate controller made of its inputs in one step, and what it remembers.

    ``slope`` is what D acts on, ``scale`` the slew limiter's factor on P and D; ``target``, ``error`` and
    ``rate`` are the filtered ones, ``pd`` and ``peaks`` the slew limiter's.
    """

    proportional: float
    integral: float
    derivative: float
    slope: float
    scale: float
    target: float
    error: float
    rate: float
    learned: float
    pd: float = 0.0
    slew: float = 0.0
    peaks: tuple[float, float] = (0.0, 0.0)

    @property
    def output(self) -> float:
        """The torque command."""
        return self.proportional + self.integral + self.derivative


RateMemory = tuple[RateTerms, RateTerms, RateTerms]
RateLaw = Callable[[float, float, RateTerms, Gains, int, float], RateTerms]


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


def reset_rates(setpoint: Triple, rate: Triple) -> RateMemory:
    """Return the memory of controllers that begin: no derivative, no integral, filters settled."""
    first, second, third = (
        RateTerms(0.0, 0.0, 0.0, 0.0, 1.0, target, target - measured, measured, 0.0)
        for target, measured in zip(setpoint, rate, strict=True)
    )
    return first, second, third


def torque_command(
    law: RateLaw, setpoint: Triple, rate: Triple, memory: RateMemory, gains: Gains, *, limited: float
) -> tuple[Triple, RateMemory]:
    """Run the three rate controllers on the set-point of the loop before."""
    first = law(setpoint[0], rate[0], memory[0], gains, 0, limited)
    second = law(setpoint[1], rate[1], memory[1], gains, 1, limited)
    third = law(setpoint[2], rate[2], memory[2], gains, 2, limited)
    return (first.output, second.output, third.output), (first, second, third)


def ardupilot_rate_law(
    setpoint: float, rate: float, before: RateTerms, gains: Gains, axis: int, limited: float
) -> RateTerms:
    """Run AC_PID::update_all: D on the filtered error; the integrator only shrinks at the mixer's limits."""
    target = before.target + gains.target_weight * (setpoint - before.target)
    error = before.error + gains.error_weight * (target - rate - before.error)
    change = (error - before.error) / gains.step_s
    slope = before.slope + gains.derivative_weight[axis] * (change - before.slope)
    increment = gains.integral[axis] * error * gains.step_s
    grows = 1.0 * (before.integral * increment > 0.0)
    integral = before.integral + increment * (1.0 - limited * grows)
    bound = gains.integral_limit
    proportional, derivative = gains.proportional[axis] * error, gains.derivative[axis] * slope
    # By place: names take as long as all the sums.
    found = RateTerms(
        proportional,
        bound if integral > bound else -bound if integral < -bound else integral,
        derivative,
        slope,
        before.scale,
        target,
        error,
        rate,
        before.learned,
    )
    return _slew_limited(found, before, gains) if gains.slew_limit > 0.0 else found


#: SlewLimiter.cpp: low-pass on the slope [Hz], decay of its peaks [s], slope of the factor, highest peak.
_SLEW_HZ: Final = 25.0
_SLEW_DECAY_S: Final = 1.0
_SLEW_STEEPNESS: Final = 1.5
_SLEW_PEAK: Final = 10.0


def _slew_limited(found: RateTerms, before: RateTerms, gains: Gains) -> RateTerms:
    """Scale P and D down while their sum of the steps before slews faster than the limit.

    The limiter's window of events is left out: its peaks decay from the first moment.
    """
    limit, step_s = gains.slew_limit, gains.step_s
    weight = step_s / (step_s + 1.0 / (2.0 * math.pi * _SLEW_HZ))
    total = before.proportional + before.derivative
    slew = before.slew + weight * ((total - before.pd) / step_s - before.slew)
    left, highest = math.exp(-step_s / _SLEW_DECAY_S), _SLEW_PEAK * limit
    up = lower(higher(slew, left * before.peaks[0]), highest)
    down = lower(higher(-slew, left * before.peaks[1]), highest)
    excess = higher(0.5 * (up + down) - limit, 0.0)
    scale = limit / (limit + _SLEW_STEEPNESS * excess)
    return found._replace(
        proportional=scale * found.proportional,
        derivative=scale * found.derivative,
        scale=scale,
        pd=total,
        slew=slew,
        peaks=(up, down),
    )


#: rate_control.cpp: the integrator slows down with the error, to nothing at this one [rad/s].
_INTEGRATOR_END: Final = math.radians(400.0)


def px4_rate_law(
    setpoint: float, rate: float, before: RateTerms, gains: Gains, axis: int, limited: float
) -> RateTerms:
    """Run RateControl::update: D on the measured rate; the integral is that of the errors before.

    At the allocator's limits errors that would push further are not learned from.
    """
    error = setpoint - rate
    slope = before.slope + gains.derivative_weight[axis] * (
        (rate - before.rate) / gains.step_s - before.slope
    )
    proportional, derivative = gains.proportional[axis] * error, -gains.derivative[axis] * slope
    integral = before.learned
    pushes = 1.0 * (error * (proportional + integral + derivative) > 0.0)
    slower = higher(1.0 - (error / _INTEGRATOR_END) ** 2, 0.0)
    step = gains.integral[axis] * slower * error * gains.step_s * (1.0 - limited * pushes)
    bound = gains.integral_limit
    return RateTerms(
        proportional,
        integral,
        derivative,
        slope,
        before.scale,
        setpoint,
        error,
        rate,
        learned=higher(lower(integral + step, bound), -bound),
    )


def betaflight_rate_law(
    setpoint: float, rate: float, before: RateTerms, gains: Gains, axis: int, limited: float
) -> RateTerms:
    """Run pidController (pid.c): D on the filtered rate; the integral stands still at the mixer's limits.

    As with iterm relax, anti-gravity, throttle attenuation and feed-forward off.
    """
    error = setpoint - rate
    slope = before.slope + gains.derivative_weight[axis] * (
        (rate - before.rate) / gains.step_s - before.slope
    )
    step = gains.integral[axis] * error * gains.step_s * (1.0 - limited)
    integral, bound = before.integral + step, gains.integral_limit
    return RateTerms(
        gains.proportional[axis] * error,
        higher(lower(integral, bound), -bound),
        -gains.derivative[axis] * slope,
        slope,
        before.scale,
        setpoint,
        error,
        rate,
        before.learned,
    )


_LAWS: Final[dict[str, RateLaw]] = {"ardupilot": ardupilot_rate_law, "betaflight": betaflight_rate_law}


def rate_law(autopilot: str) -> RateLaw:
    """Return the rate controller of an autopilot; PX4's of one whose own is not simulated."""
    return _LAWS.get(autopilot, px4_rate_law)


def altitude_throttle(
    height_error: float, climb_error: float, integral: float, *, hover: float, attitude: Quadruple
) -> float:
    """Hold the height: hover throttle, more when tilted, plus a PID on the height (0 to 1)."""
    _, x, y, _ = attitude
    upright = higher(1.0 - 2.0 * (x * x + y * y), 0.5)
    wanted = 1.0 + (1.4 * height_error + 2.4 * climb_error + integral) / GRAVITY_M_S2
    return higher(lower(hover * wanted / upright, 1.0), 0.02)


class Mixer(NamedTuple):
    """Roll, pitch, yaw and throttle factor of every motor, and the mixer's settings."""

    roll: tuple[float, ...]
    pitch: tuple[float, ...]
    yaw: tuple[float, ...]
    throttle: tuple[float, ...]
    hover: float
    yaw_headroom: float = 0.2
    throttle_mix: float = 0.5


class Mixed(NamedTuple):
    """Thrust fraction per motor (0 to 1), torque that was achieved, 1 where anything was limited."""

    thrust: tuple[float, ...]
    torque: Triple
    limited: float


def mix(command: Triple, throttle: float, mixer: Mixer) -> Mixed:
    """Allocate torque and throttle to the motors: yaw is clipped first, then all is scaled."""
    roll, pitch, yaw = command
    average = higher(throttle, (1.0 - mixer.throttle_mix) * throttle + mixer.throttle_mix * mixer.hover)
    tilt = [r * roll + p * pitch for r, p in zip(mixer.roll, mixer.pitch, strict=True)]
    allowed = _yaw_room(tilt, yaw, lower(average, 0.5), mixer)
    turned = higher(lower(yaw, allowed), -allowed)
    wanted = [t + y * turned for t, y in zip(tilt, mixer.yaw, strict=True)]
    low, high = min(wanted), max(wanted)
    scale = lower(1.0 / higher(high - low, 1.0), average / higher(-low, 1e-9))
    # The lower bound on -low only avoids a division by zero: the ratio is then far above 1.
    scale = lower(scale, 1.0)
    base = -low * scale
    room = higher(1.0 - base - high * scale, 0.0)
    lift = lower(higher(throttle - base, 0.0), room) * (scale >= 1.0)
    collective = base + lift
    # Written out: a call for each bound and motor would take longer than the sums.
    thrust = [
        0.0 if (each := collective * t + scale * value) < 0.0 else 1.0 if each > 1.0 else each
        for t, value in zip(mixer.throttle, wanted, strict=True)
    ]
    limited = 1.0 * ((scale < 1.0) | (turned != yaw) | (collective < throttle - 1e-9))
    return Mixed(tuple(thrust), (scale * roll, scale * pitch, scale * turned), limited)


def _yaw_room(tilt: list[float], yaw: float, best_throttle: float, mixer: Mixer) -> float:
    """How much yaw the motors have room for beside roll and pitch, the headroom at least."""
    allowed = 1.0
    for value, factor in zip(tilt, mixer.yaw, strict=True):
        base = room = best_throttle + value
        if yaw * factor > 0.0:
            room = base + (1.0 - 2.0 * base)
        size = abs(factor)
        # A motor without yaw authority sets no limit.
        if size >= 1e-6 and room < allowed * size:
            allowed = 0.0 if room < 0.0 else room / size
    return higher(allowed, mixer.yaw_headroom)


def throttle_for_thrust(thrust: Component, expo: float) -> Component:
    """Invert thrust = (1-e) y + e y^2 (AP_Motors_Thrust_Linearization.cpp, FunctionMotors.hpp)."""
    return (expo - 1.0 + ((1.0 - expo) * (1.0 - expo) + 4.0 * expo * thrust) ** 0.5) / (2.0 * expo)


def thrust_of_throttle(throttle: Component, expo: float) -> Component:
    """Return the thrust fraction (1-e) y + e y^2 of the voltage-effective throttle y."""
    return throttle * (1.0 - expo + expo * throttle)
