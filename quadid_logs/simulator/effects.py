"""Structural effects: what real vehicles and logs do, and the fitted model does not know.

`Effects` declares them; the other classes act in the control loop.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.rotational_dynamics import Quadruple, Triple
from quadid_logs.simulator.control import ZERO, Biquad, filter_rates, higher, lower
from quadid_logs.vocabulary import GRAVITY_M_S2

#: Of two research vehicles that hover indoors, the acceleration that no torque explains falls with about this
#: power of the frequency between 0.1 and 10 Hz: slow air most, propeller and frame at all frequencies.
_DISTURBANCE_EXPONENT: Final = -0.4
#: Where the disturbances begin, and about where they fall off, as the second power: air has no edge in its
#: spectrum, which would pass for a line [Hz]. Between the last limits their size is stated.
_DISTURBANCE_HZ: Final = (0.05, 30.0)
DISTURBANCE_BAND_HZ: Final = (0.3, 5.0)
#: A load on a string swings for some periods: drag of load and string.
_SLING_DAMPING: Final = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Effects:
    """What a flight has beside rigid body, rotors, wind and noise; nothing by default.

    Attributes
    ----------
    disturbance_rad_s2 : tuple of float
        Root mean square between 0.3 and 5 Hz of the angular acceleration that no torque explains.
    tilt_stiffness_1_s2 : float
        Angular acceleration per radian of tilt: positive drives away from level, negative back as a
        pendulum.
    sling_load_fraction, sling_length_m, sling_hook_m : float
        Mass of a load on a string as a fraction of the vehicle's, the string's length, and how far below
        the centre of mass it is hooked.
    dead_zone : float
        Torque command below which the rotors do nothing, taken off any larger one [1].
    rotor_dead_zone : float
        Of each rotor: by how much its command may differ from the mean of all before it follows, taken off
        any larger difference [1].
    torque_limit : tuple of float
        Largest torque command about each axis that the rotors follow, which nothing in the log tells [1].
    gain_swing, gain_period_s : float
        The torque is larger by this fraction for half a period and smaller for the other half.
    spin_down_ratio : float
        The rotors' time constant down over that of the airframe.
    firmware_expo : float or None
        The thrust curve's expo that the firmware is set to, where it is not the propellers'.
    thrust_linear, sag_compensation : float
        Settings of firmware whose outputs have no thrust curve (Betaflight), as fractions: outputs are raised
        where they are low, and held back while the battery is full.
    flexible_mode_hz, flexible_mode_damping, flexible_mode_gain : float
        A mode between body and gyro: natural frequency, damping ratio, and how much of the mode's
        deflection the gyro sees (1: a gyro on a soft mount).
    torque_late_s : float
        The log's torque and motor outputs are those of so much earlier.
    outlier_fraction : float
        Fraction of samples of rates, torque, motors and rotor speeds that are absurd.
    setpoints_logged : bool
        Whether the log holds the rate set-points.
    motor_fault : int
        Number of a motor, from 1, that gives less thrust than it is sent; 0 for none.
    motor_effectiveness, motor_fault_at, motor_ramp_s : float
        The fraction that it still gives, when that begins as a fraction of the manoeuvre (0: before the
        take-off), and how long it takes to come to it.
    bent_propeller : int
        Number of a rotor, from 1, whose propeller is out of balance; 0 for none.
    propeller_gyro_rad_s, propeller_acceleration_m_s2 : float
        Amplitude of what gyro and accelerometer see of it at the speed of a hover.
    mass_offset : tuple of float
        How far forward and to the right the centre of mass is off, as a fraction of the longest arm.
    desync_rotor : int
        Number of a motor, from 1, that loses step; 0 for none.
    desync_s, desync_at : float
        How long it is not driven, and when, as a fraction of the manoeuvre.
    """

    disturbance_rad_s2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt_stiffness_1_s2: float = 0.0
    sling_load_fraction: float = 0.0
    sling_length_m: float = 1.0
    sling_hook_m: float = 0.05
    dead_zone: float = 0.0
    rotor_dead_zone: float = 0.0
    torque_limit: tuple[float, float, float] = (1.0, 1.0, 1.0)
    gain_swing: float = 0.0
    gain_period_s: float = 5.0
    spin_down_ratio: float = 1.0
    firmware_expo: float | None = None
    thrust_linear: float = 0.0
    sag_compensation: float = 0.0
    flexible_mode_hz: float = 0.0
    flexible_mode_damping: float = 0.1
    flexible_mode_gain: float = 0.2
    torque_late_s: float = 0.0
    outlier_fraction: float = 0.0
    setpoints_logged: bool = True
    motor_fault: int = 0
    motor_effectiveness: float = 0.8
    motor_fault_at: float = 0.5
    motor_ramp_s: float = 0.0
    bent_propeller: int = 0
    propeller_gyro_rad_s: float = 0.3
    propeller_acceleration_m_s2: float = 6.0
    mass_offset: tuple[float, float] = (0.0, 0.0)
    desync_rotor: int = 0
    desync_s: float = 0.08
    desync_at: float = 0.5

    def named(self) -> dict[str, dict[str, Any]]:
        """Return the values of every effect that is present, by the effect's name."""
        nothing = Effects()
        return {
            name: {field: getattr(self, field) for field in fields}
            for name, fields in FIELDS.items()
            if getattr(self, fields[0]) != getattr(nothing, fields[0])
        }


#: The fields of each effect; the first says whether it is present.
FIELDS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "rough air": ("disturbance_rad_s2",),
        "tilt stiffness": ("tilt_stiffness_1_s2",),
        "sling load": ("sling_load_fraction", "sling_length_m", "sling_hook_m"),
        "dead zone": ("dead_zone",),
        "rotor dead zone": ("rotor_dead_zone",),
        "unlogged saturation": ("torque_limit",),
        "alternating gain": ("gain_swing", "gain_period_s"),
        "spin-down asymmetry": ("spin_down_ratio",),
        "expo mismatch": ("firmware_expo",),
        "thrust linearisation": ("thrust_linear",),
        "sag compensation": ("sag_compensation",),
        "flexible mode": ("flexible_mode_hz", "flexible_mode_damping", "flexible_mode_gain"),
        "late torque": ("torque_late_s",),
        "outliers": ("outlier_fraction",),
        "missing set-points": ("setpoints_logged",),
        "motor fault": ("motor_fault", "motor_effectiveness", "motor_fault_at", "motor_ramp_s"),
        "bent propeller": ("bent_propeller", "propeller_gyro_rad_s", "propeller_acceleration_m_s2"),
        "centre of mass off": ("mass_offset",),
        "desync": ("desync_rotor", "desync_s", "desync_at"),
    }
)


def disturbance(
    effects: Effects, inertia_kg_m2: FloatArray, n_samples: int, step_s: float, rng: np.random.Generator
) -> FloatArray:
    """Return the torque of the disturbances [N m], shape (n_samples, 3).

    Noise whose spectrum falls with the frequency as flown logs show it, scaled to the
    angular acceleration that `Effects` states.
    """
    if not any(effects.disturbance_rad_s2):
        return np.zeros((n_samples, 3))
    frequency_hz = np.asarray(np.fft.rfftfreq(n_samples, step_s), dtype=np.float64)
    shape = _disturbance_shape(frequency_hz)
    stated = (frequency_hz >= DISTURBANCE_BAND_HZ[0]) & (frequency_hz <= DISTURBANCE_BAND_HZ[1])
    # White noise of variance 1 has the variance 2 / n at each frequency of the one-sided spectrum.
    shape /= math.sqrt(2.0 / n_samples * float(np.sum(shape[stated] ** 2)))
    spectrum = np.fft.rfft(rng.standard_normal((n_samples, 3)), axis=0) * shape[:, np.newaxis]
    acceleration = np.fft.irfft(spectrum, n_samples, axis=0) * np.array(effects.disturbance_rad_s2)
    return np.asarray(acceleration @ inertia_kg_m2.T, dtype=np.float64)


def _disturbance_shape(frequency_hz: FloatArray) -> FloatArray:
    """Return the amplitude of the disturbances over frequency, in no unit."""
    low, high = _DISTURBANCE_HZ
    shape = np.maximum(frequency_hz, low) ** _DISTURBANCE_EXPONENT / (1.0 + (frequency_hz / high) ** 2)
    return np.where(frequency_hz < low, 0.0, shape)


def disturbance_density(frequency_hz: FloatArray) -> FloatArray:
    """Return the one-sided density [1/Hz] of disturbances of 1 rad/s^2, as `Effects` states their size.

    Times the square of `Effects.disturbance_rad_s2`: [(rad/s^2)^2 / Hz].
    """
    stated_hz = np.linspace(*DISTURBANCE_BAND_HZ, 2001)
    power = float(np.trapezoid(_disturbance_shape(stated_hz) ** 2, stated_hz))
    return np.asarray(_disturbance_shape(frequency_hz) ** 2 / power, dtype=np.float64)


class External(NamedTuple):
    """What acts from outside: torque in body axes [N m], force in NED [N]."""

    torque: Triple
    force: Triple


NOTHING: Final = External(ZERO, ZERO)


class Surroundings:
    """Disturbances, what drives a tilt away or back, and a load that swings on a string below."""

    def __init__(self, effects: Effects, inertia: Triple, mass: float, step_s: float) -> None:
        stiffness = effects.tilt_stiffness_1_s2
        self._tilt = stiffness * inertia[0], stiffness * inertia[1]
        self._load = mass * effects.sling_load_fraction
        self._length = effects.sling_length_m
        self._hook = effects.sling_hook_m
        self._step_s = step_s
        # Of the load from below the vehicle's centre of mass, north and east: place [m] and velocity [m/s].
        self._place, self._velocity = (0.0, 0.0), (0.0, 0.0)

    def act(self, attitude: Quadruple, acceleration: Triple, disturbance: Triple) -> External:
        """Return what acts over one control period, and let the load swing for it."""
        if not (self._load or any(self._tilt)):
            return External(disturbance, ZERO)
        w, x, y, z = attitude
        # The third row of the rotation from body to NED: where down is, in body axes.
        down_x, down_y = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
        L, M, N = disturbance
        L, M = L + self._tilt[0] * down_y, M - self._tilt[1] * down_x
        if not self._load:
            return External((L, M, N), ZERO)
        below = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
        north, east, down = self._swing(below, acceleration)
        across_x = (1.0 - 2.0 * (y * y + z * z)) * north + 2.0 * (x * y + w * z) * east + down_x * down
        across_y = 2.0 * (x * y - w * z) * north + (1.0 - 2.0 * (x * x + z * z)) * east + down_y * down
        return External((L - self._hook * across_y, M + self._hook * across_x, N), (north, east, down))

    def _swing(self, below: tuple[float, float], acceleration: Triple) -> Triple:
        """Move the load by a period; return the string's force on the vehicle in NED [N].

        `below` is where the body's z axis points, north and east; angles of the string are small.
        """
        lift = GRAVITY_M_S2 - acceleration[2]
        lift = lift * (lift > 0.0)
        force, place, velocity = [], [], []
        damping = 2.0 * _SLING_DAMPING * (GRAVITY_M_S2 / self._length) ** 0.5
        for axis in range(2):
            slope = (self._place[axis] - self._hook * below[axis]) / self._length
            gained = -lift * slope - acceleration[axis] - damping * self._velocity[axis]
            velocity.append(self._velocity[axis] + self._step_s * gained)
            place.append(self._place[axis] + self._step_s * velocity[axis])
            force.append(self._load * lift * slope)
        self._place, self._velocity = (place[0], place[1]), (velocity[0], velocity[1])
        return force[0], force[1], self._load * lift


class Actuation:
    """What the rotors make of a torque command that the log takes for achieved."""

    def __init__(self, effects: Effects) -> None:
        self._dead, self._rotor_dead = effects.dead_zone, effects.rotor_dead_zone
        self._limit = effects.torque_limit
        self._swing, self._period_s = effects.gain_swing, effects.gain_period_s
        #: Whether there is anything to do.
        self.present = bool(self._dead or self._rotor_dead or self._swing or min(self._limit) < 1.0)

    def error(self, torque: Triple, time_s: float) -> Triple:
        """Return what the rotors give beyond the torque command [1]."""
        gain = 1.0 + self._swing * (1.0 - 2.0 * (time_s / self._period_s % 1.0 >= 0.5))
        return (
            gain * self._passed(torque[0], self._limit[0]) - torque[0],
            gain * self._passed(torque[1], self._limit[1]) - torque[1],
            gain * self._passed(torque[2], self._limit[2]) - torque[2],
        )

    def followed(self, thrusts: tuple[float, ...]) -> tuple[float, ...]:
        """Return what each rotor follows: of differences from the mean, those beyond its dead zone."""
        mean = sum(thrusts[1:], thrusts[0]) / len(thrusts)
        return tuple(mean + _beyond(each - mean, self._rotor_dead) for each in thrusts)

    def _passed(self, command: float, limit: float) -> float:
        """Take off the dead zone, and clip."""
        moved = _beyond(command, self._dead)
        return higher(lower(moved, limit), -limit)


def _beyond(command: float, dead: float) -> float:
    return command - higher(lower(command, dead), -dead)


class FlexibleMode:
    """The gyro on a mode of the frame: it sees the body's rate and a part of the mode's own.

    The mode's deflection d obeys d'' + 2 z w d' + w^2 d = -(rate)', so that its rate is a second-order
    high-pass of the body's.
    """

    def __init__(self, effects: Effects, loop_hz: float) -> None:
        self._present = bool(effects.flexible_mode_hz)
        self._gain = effects.flexible_mode_gain
        self._biquad = Biquad(
            *high_pass(effects.flexible_mode_hz or 1.0, effects.flexible_mode_damping, loop_hz)
        )
        self._memory = (ZERO, ZERO)

    def seen(self, rate: Triple) -> Triple:
        """Return the rate where the gyro is [rad/s]."""
        if not self._present:
            return rate
        own, self._memory = filter_rates(rate, self._memory, self._biquad)
        gain = self._gain
        return rate[0] - gain * own[0], rate[1] - gain * own[1], rate[2] - gain * own[2]


def high_pass(natural_hz: float, damping: float, loop_hz: float) -> tuple[float, float, float, float, float]:
    """Return a second-order high-pass, s^2 / (s^2 + 2 z w s + w^2) by the bilinear transform.

    Parameters
    ----------
    natural_hz, damping : float
        It is right at this frequency.
    loop_hz : float
        Of its samples.

    Returns
    -------
    tuple of float
        b0, b1, b2, a1, a2.
    """
    ohm = math.tan(math.pi * natural_hz / loop_hz)
    c = 1.0 + 2.0 * damping * ohm + ohm * ohm
    return (
        1.0 / c,
        -2.0 / c,
        1.0 / c,
        2.0 * (ohm * ohm - 1.0) / c,
        (1.0 - 2.0 * damping * ohm + ohm * ohm) / c,
    )


def with_outliers(values: FloatArray, fraction: float, rng: np.random.Generator) -> FloatArray:
    """Return samples of which some are absurd, by 3 to 1000 times the series' own spread.

    Parameters
    ----------
    values : ndarray, shape (n_samples, n_columns)
    fraction : float
        Of the samples; in each, one column is absurd.

    Returns
    -------
    ndarray, shape (n_samples, n_columns)
    """
    struck = np.flatnonzero(rng.random(values.shape[0]) < fraction)
    column = rng.integers(0, values.shape[1], struck.size)
    size = np.exp(rng.uniform(math.log(3.0), math.log(1000.0), struck.size))
    size *= rng.choice([-1.0, 1.0], struck.size)
    changed = values.copy()
    changed[struck, column] += size * np.maximum(np.nanstd(values, axis=0)[column], 1e-9)
    return changed


#: Of a part that rings, 1 % of the critical damping.
_RINGING: Final = 0.01


def ringing(
    frequency_hz: float, rms_rad_s: float, n_samples: int, loop_hz: float, rng: np.random.Generator
) -> FloatArray:
    """Return white noise through the resonance of a lightly damped part, shape (n_samples, 3) [rad/s]."""
    from scipy.signal import lfilter

    radius = math.exp(-2.0 * math.pi * frequency_hz * _RINGING / loop_hz)
    poles = [1.0, -2.0 * radius * math.cos(2.0 * math.pi * frequency_hz / loop_hz), radius * radius]
    found = np.asarray(lfilter([1.0], poles, rng.standard_normal((n_samples, 3)), axis=0), dtype=np.float64)
    return np.asarray(rms_rad_s * found / np.std(found, axis=0), dtype=np.float64)
