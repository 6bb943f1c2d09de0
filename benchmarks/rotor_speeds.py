"""Flown effectiveness by the measured speeds of the rotors, beside that of `analyze`.

Nobody knows a flown vehicle's truth. But where every rotor's speed is logged fast (bidirectional DShot),
thrust goes with its square, and one factor takes that to the acceleration: no lag of motors, no dead zone and
no limit stand between them. `analyze` takes thrust curve and lag from these speeds, and the torque from the
outputs. Two slopes make the effectiveness here:

- acceleration over the torque by squared speeds, by set-points (1 to 12 Hz), with the delay taken off;
- the torque by squared speeds over the commanded one, behind the lag and delay that explain it best.

Use: python -m benchmarks.rotor_speeds LOG... prints a row of a table for each axis. The logs of
docs/accuracy.md are public; none is in this repository.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy import signal

from quadid_logs.align import cut
from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.data.settings import Settings
from quadid_logs.diagnose import diagnose
from quadid_logs.identify import identify
from quadid_logs.load import load
from quadid_logs.maths.recurrence import lag
from quadid_logs.vocabulary import AXES, ON_AXIS

BAND_HZ = (1.0, 12.0)
WINDOW_S = 2.0
LAGS_S = np.arange(0.004, 0.08, 0.002)
DELAYS_S = np.arange(0.0, 0.008, 0.001)
AGES_S = np.arange(-0.006, 0.012, 0.0005)


def by_speeds(segment: Segment, mixing: FloatArray, speed: FloatArray, axis: int, period_s: float) -> float:
    """Return acceleration per unit of command [rad/s^2], by squared speeds (n_samples, n_rotors)."""
    assert segment.reference is not None
    torque, rate, target = (
        speed**2 @ mixing[axis],
        segment.body_rate_rad_s[:, axis],
        segment.reference[:, axis],
    )
    return _per_torque(target, torque, rate, period_s) * _per_command(
        torque, segment.torque[:, axis], period_s
    )


def _per_torque(target: FloatArray, torque: FloatArray, rate: FloatArray, period_s: float) -> float:
    """Return acceleration over the torque by speeds: the real part behind the delay that makes it largest."""
    rate_hz, n = 1.0 / period_s, round(WINDOW_S / period_s)
    beside = 3 * n // 4
    hz, with_torque = signal.csd(target, torque, rate_hz, nperseg=n, noverlap=beside)
    with_rate = signal.csd(target, rate, rate_hz, nperseg=n, noverlap=beside)[1]
    coherence = signal.coherence(target, rate, rate_hz, nperseg=n, noverlap=beside)[1]
    used = (hz >= BAND_HZ[0]) & (hz <= BAND_HZ[1])
    hz, response = hz[used], (2j * np.pi * hz * with_rate / with_torque)[used]
    weight = (coherence / (1.001 - coherence))[used]
    ahead = np.exp(2j * np.pi * np.outer(AGES_S, hz))
    return float(np.max((ahead * response).real @ weight) / weight.sum())


def _per_command(torque: FloatArray, command: FloatArray, period_s: float) -> float:
    """Return the torque by speeds over the commanded one, behind the lag and delay that explain it best."""
    b, a = signal.butter(2, BAND_HZ, "band", fs=1.0 / period_s)
    flown = signal.filtfilt(b, a, torque)
    time_s = period_s * np.arange(len(command))
    best = (np.inf, np.nan)
    for delay_s in DELAYS_S:
        late = np.interp(time_s - delay_s, time_s, command)
        for lag_s in LAGS_S:
            given = signal.filtfilt(b, a, lag(late, period_s, lag_s))
            slope = float(given @ flown / (given @ given))
            best = min(best, (float(np.sum((flown - slope * given) ** 2)), slope))
    return best[1]


def rows(path: Path) -> list[str]:
    """Return a row of the table for roll and pitch of a log."""
    prepared = load(path)
    data: FlightData = cut(prepared, Settings().align)
    mixing = None if data.input is None else data.input.torque_per_thrust
    measured = prepared.series.get("rotor_speed")
    if mixing is None or not mixing.size or measured is None or not data.segments:
        return [f"| {path.name} | - | no measured speeds of known rotors | | |"]
    longest = max(data.segments, key=lambda one: one.n_samples)
    speed = np.column_stack([measured.at(longest.time_s, rotor) for rotor in range(mixing.shape[1])])
    identified = identify(data, Settings().identify)
    judged = diagnose(prepared.log, data, identified)
    model, made = identified.recommended, []
    for axis in range(2):
        told = by_speeds(longest, mixing, speed, axis, data.sample_period_s)
        entry = None if model is None else model.entries[ON_AXIS[AXES[axis]]]
        shown = "-" if entry is None else f"{entry.value:.0f} ({entry.ci95[0]:.0f} to {entry.ci95[1]:.0f})"
        inside = "-" if entry is None else "yes" if entry.ci95[0] <= told <= entry.ci95[1] else "no"
        verdict = judged.axes[AXES[axis]].verdict
        made.append(f"| {path.name} | {AXES[axis]} | {told:.0f} | {shown}, {verdict} | {inside} |")
    return made


def main() -> None:
    """Print the table."""
    print("| log | axis | by rotor speeds | `analyze` | inside |", "|---|---|---|---|---|", sep="\n")
    for name in sys.argv[1:]:
        print(*rows(Path(name)), sep="\n", flush=True)


if __name__ == "__main__":
    main()
