"""What is flown between take-off and landing.

Each function returns a `Reference` over the manoeuvre's own time, which
starts at zero and is uniform. Excitation enters as a body-rate or as a torque
command on top of the attitude loop's command, as the autopilots' own
system-identification modes do it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.multisine import low_peak_phases


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reference:
    """What the pilot or the test mode commands, one row per control period.

    ``tilt_rad`` (n, 2) roll and pitch angles, ``yaw_rate_rad_s`` (n,),
    ``rate_rad_s`` (n, 3) added to the rate set-point, ``torque`` (n, 3)
    added to the normalised torque command.
    """

    tilt_rad: FloatArray
    yaw_rate_rad_s: FloatArray
    rate_rad_s: FloatArray
    torque: FloatArray

    @property
    def asks_for_angles(self) -> bool:
        """Whether nothing but angles of roll and pitch, and the rate of yaw, is commanded."""
        return not np.any(self.rate_rad_s) and not np.any(self.torque)


def _reference(
    time_s: FloatArray,
    *,
    tilt_rad: FloatArray | None = None,
    yaw_rate_rad_s: FloatArray | None = None,
    rate_rad_s: FloatArray | None = None,
    torque: FloatArray | None = None,
) -> Reference:
    """Fill what is not given with zeros."""
    n = time_s.shape[0]
    return Reference(
        tilt_rad=np.zeros((n, 2)) if tilt_rad is None else tilt_rad,
        yaw_rate_rad_s=np.zeros(n) if yaw_rate_rad_s is None else yaw_rate_rad_s,
        rate_rad_s=np.zeros((n, 3)) if rate_rad_s is None else rate_rad_s,
        torque=np.zeros((n, 3)) if torque is None else torque,
    )


def hover(time_s: FloatArray, rng: np.random.Generator) -> Reference:
    """Hold the attitude: only disturbances excite the vehicle."""
    return _reference(time_s)


def gentle_sticks(time_s: FloatArray, rng: np.random.Generator) -> Reference:
    """Move the sticks like a careful pilot: angles below 3 degrees, almost no yaw."""
    return sticks(time_s, rng, tilt_rad=0.03, yaw_rate_rad_s=0.05)


def sticks(
    time_s: FloatArray, rng: np.random.Generator, *, tilt_rad: float = 0.25, yaw_rate_rad_s: float = 0.7
) -> Reference:
    """Move the sticks like a pilot: random targets, held for 0.3 to 1.5 s, in random order.

    ``tilt_rad`` and ``yaw_rate_rad_s`` are the largest deflections.
    """
    holds = []
    for _ in range(3):
        # Piecewise constant values in -1 to 1; every other one is the centre.
        n_holds = int(time_s[-1] / 0.3) + 2
        ends = np.cumsum(rng.uniform(0.3, 1.5, n_holds))
        values = rng.uniform(-1.0, 1.0, n_holds + 1) * (np.arange(n_holds + 1) % 2)
        holds.append(values[np.searchsorted(ends, time_s)])
    return _reference(
        time_s,
        tilt_rad=tilt_rad * np.column_stack(holds[:2]),
        yaw_rate_rad_s=yaw_rate_rad_s * holds[2],
    )


def sinusoid(
    time_s: FloatArray, rng: np.random.Generator, *, axis: int = 0, amplitude: float = 0.01
) -> Reference:
    """Put the paper's input, 1 rad/s, on one axis as torque command."""
    torque = np.zeros((time_s.shape[0], 3))
    torque[:, axis] = amplitude * np.sin(time_s)
    return _reference(time_s, torque=torque)


def doublets(
    time_s: FloatArray, rng: np.random.Generator, *, amplitude_rad_s: float = 1.2, pulse_s: float = 0.25
) -> Reference:
    """Doublets on roll, pitch and yaw in turn, a rest of three pulses between them."""
    return _in_turn(time_s, ((1.0, 1), (-1.0, 1), (0.0, 3)), amplitude_rad_s, pulse_s)


def steps_3211(
    time_s: FloatArray, rng: np.random.Generator, *, amplitude_rad_s: float = 0.8, pulse_s: float = 0.15
) -> Reference:
    """3-2-1-1 steps on roll, pitch and yaw in turn: a broader band than a doublet."""
    return _in_turn(time_s, ((1.0, 3), (-1.0, 2), (1.0, 1), (-1.0, 1), (0.0, 6)), amplitude_rad_s, pulse_s)


def _in_turn(
    time_s: FloatArray, steps: tuple[tuple[float, int], ...], amplitude: float, pulse_s: float
) -> Reference:
    """Play (level, pulses) on one axis after the other; yaw gets half the amplitude, twice the time."""
    pattern = np.concatenate([np.full(length, level) for level, length in steps])
    turn_s = pattern.size * pulse_s
    cycle = time_s % (4.0 * turn_s)
    rate = np.zeros((time_s.shape[0], 3))
    for axis, (begin, width, gain) in enumerate(((0.0, 1.0, 1.0), (1.0, 1.0, 1.0), (2.0, 2.0, 0.5))):
        index = np.floor((cycle - begin * turn_s) / (width * pulse_s)).astype(np.int64)
        inside = (index >= 0) & (index < pattern.size)
        rate[inside, axis] = gain * amplitude * pattern[index[inside]]
    return _reference(time_s, rate_rad_s=rate)


def chirp(
    time_s: FloatArray,
    rng: np.random.Generator,
    *,
    axis: int = 0,
    amplitude: float = 0.06,
    band_hz: tuple[float, float] = (0.4, 10.0),
) -> Reference:
    """Sweep one axis exponentially through a band, as torque command (ArduPilot's SID_AXIS 10 to 12)."""
    length = float(time_s[-1])
    growth = np.log(band_hz[1] / band_hz[0]) / length
    phase = 2.0 * np.pi * band_hz[0] * np.expm1(growth * time_s) / growth
    torque = np.zeros((time_s.shape[0], 3))
    torque[:, axis] = amplitude * _fade(time_s) * np.sin(phase)
    return _reference(time_s, torque=torque)


def _fade(time_s: FloatArray, fade_s: float = 1.0) -> FloatArray:
    """Rise from zero and fall back to it, so that nothing jumps."""
    edge = np.minimum(time_s, time_s[-1] - time_s) / min(fade_s, 0.25 * float(time_s[-1]))
    return np.asarray(np.sin(0.5 * np.pi * np.clip(edge, 0.0, 1.0)) ** 2, dtype=np.float64)


def tones(
    time_s: FloatArray,
    rng: np.random.Generator,
    *,
    rms_rad_s: tuple[float, float, float] = (0.9, 0.9, 0.35),
    frequency_hz: tuple[float, float, float] = (3.7, 4.3, 1.9),
) -> Reference:
    """Excite each axis at one frequency only, which cannot tell a gain from a lag or a damping."""
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    wave = np.sqrt(2.0) * np.sin(2.0 * np.pi * np.outer(time_s, frequency_hz) + phase)
    return _reference(time_s, rate_rad_s=_fade(time_s)[:, np.newaxis] * wave * np.array(rms_rad_s))


def multisine(
    time_s: FloatArray,
    rng: np.random.Generator,
    *,
    rms_rad_s: tuple[float, float, float] = (0.9, 0.9, 0.35),
    band_hz: tuple[tuple[float, float], ...] = ((0.25, 6.0), (0.25, 6.0), (0.15, 2.0)),
) -> Reference:
    """Excite all axes at once with orthogonal multisines of low peak factor.

    Each axis has its own harmonics of one common base frequency, so that any
    two axes are uncorrelated over a period [1]_; the phases are found by
    clipping the wave again and again [2]_.

    References
    ----------
    .. [1] E. A. Morelli, "Multiple input design for real-time parameter
       estimation in the frequency domain," IFAC SYSID, 2003.
    .. [2] E. Van der Ouderaa, J. Schoukens, J. Renneboog, "Peak factor
       minimization using a time-frequency domain swapping algorithm," IEEE
       Trans. Instrum. Meas., vol. 37, no. 1, 1988.
    """
    period_s = min(float(time_s[-1]), 20.0)
    rate = np.zeros((time_s.shape[0], 3))
    for axis in range(3):
        low, high = band_hz[axis]
        harmonics = np.arange(max(int(np.ceil(low * period_s)), 1), max(int(high * period_s), 4) + 1)
        harmonics = harmonics[harmonics % 3 == axis]
        phases = low_peak_phases(harmonics, rng)
        angle = 2.0 * np.pi * np.outer(time_s / period_s, harmonics) + phases
        wave = np.sin(angle).sum(axis=1) * np.sqrt(2.0 / harmonics.size)
        rate[:, axis] = rms_rad_s[axis] * _fade(time_s) * wave
    return _reference(time_s, rate_rad_s=rate)
