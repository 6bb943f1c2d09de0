"""The frequency sweep that ArduCopter's System ID mode adds to the mixer, one axis after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.simulator.manoeuvres import Reference


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """SID_MAGNITUDE, SID_F_START_HZ, SID_F_STOP_HZ, SID_T_FADE_IN, SID_T_REC and SID_T_FADE_OUT."""

    magnitude: float
    start_hz: float = 0.5
    stop_hz: float = 8.0
    fade_in_s: float = 3.0
    record_s: float = 40.0
    fade_out_s: float = 1.0

    @property
    def constant_s(self) -> float:
        """Two full cycles at the first frequency, before it rises (mode_systemid.cpp) [s]."""
        return 2.0 / self.start_hz


def sweep_wave(sweep: Sweep, time_s: FloatArray) -> FloatArray:
    """Return what is added to the mixer's input.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Since the sweep began; zero before 0 and after ``record_s``.

    Returns
    -------
    ndarray, shape (n,)
        Normalised torque command [1].

    References
    ----------
    ArduPilot, ArduCopter/mode_systemid.cpp, ModeSystemId::waveform.

    Examples
    --------
    >>> wave = sweep_wave(Sweep(magnitude=0.1), np.linspace(-1.0, 42.0, 5000))
    >>> bool(0.099 < wave.max() <= 0.1), bool(wave[0] == wave[-1] == 0.0)
    (True, True)
    """
    low, high = 2.0 * np.pi * sweep.start_hz, 2.0 * np.pi * sweep.stop_hz
    rising_s = sweep.record_s - sweep.constant_s
    growth = np.log(high / low)
    since = np.clip(time_s - sweep.constant_s, 0.0, rising_s)
    rising = low * rising_s / growth * np.expm1(growth * since / rising_s)
    phase = np.where(time_s <= sweep.constant_s, low * (time_s - sweep.constant_s), rising)
    ends = np.minimum(time_s / sweep.fade_in_s, (sweep.record_s - time_s) / sweep.fade_out_s)
    window = 0.5 - 0.5 * np.cos(np.pi * np.clip(ends, 0.0, 1.0))
    return np.asarray(sweep.magnitude * window * np.sin(phase), dtype=np.float64)


def sweeps_in_turn(
    time_s: FloatArray,
    rng: np.random.Generator,  # noqa: ARG001 - a manoeuvre's signature
    *,
    sweeps: Sequence[tuple[int, Sweep]],
    pause_s: float,
) -> Reference:
    """Fly one sweep after the other, each given with its axis (0 roll, 1 pitch, 2 yaw).

    ``pause_s`` is what the pilot needs to choose the next axis.
    """
    n = time_s.shape[0]
    torque = np.zeros((n, 3))
    begin_s = 0.0
    for axis, sweep in sweeps:
        torque[:, axis] += sweep_wave(sweep, time_s - begin_s)
        begin_s += sweep.record_s + pause_s
    return Reference(
        tilt_rad=np.zeros((n, 2)), yaw_rate_rad_s=np.zeros(n), rate_rad_s=np.zeros((n, 3)), torque=torque
    )
