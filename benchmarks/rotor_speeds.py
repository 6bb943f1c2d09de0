"""Flown effectiveness by the measured speeds of the rotors, beside that of `analyze`.

Nobody knows a flown vehicle's truth. But where every rotor's speed is logged fast (bidirectional DShot),
thrust goes with its square, and one factor takes that to the acceleration: no lag of motors, no dead zone and
no limit stand between them. `analyze` takes thrust curve and lag from these speeds, and the torque from the
outputs. Two slopes make the effectiveness here:

- acceleration over the torque by squared speeds, by set-points (1 to 12 Hz), with the delay taken off;
- the torque by squared speeds over the one by the squares of commanded speeds, behind the lags (upwards and
  downwards) and the delay that explain it best. A lag of the torque would not do: of large changes, speeds
  that lag make less of a torque than the same lag of the torque would.

Use: python -m benchmarks.rotor_speeds LOG... prints a row of a table for each axis. The logs of
docs/accuracy.md are public; none is in this repository.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy import optimize, signal

from quadid_logs.align import cut
from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.data.settings import Settings
from quadid_logs.diagnose import diagnose
from quadid_logs.identify import identify
from quadid_logs.identify.rotors import Rotors, lagged_speeds
from quadid_logs.load import load
from quadid_logs.vocabulary import AXES, ON_AXIS

BAND_HZ = (1.0, 12.0)
WINDOW_S = 2.0
#: Where the search for lag upwards [s], that downwards over it, and delay [s] begins.
START = np.array([np.log(0.03), np.log(1.2), 0.003])
AGES_S = np.arange(-0.006, 0.012, 0.0005)


def by_speeds(segment: Segment, mixing: FloatArray, speed: FloatArray, axis: int, period_s: float) -> float:
    """Return acceleration per unit of command [rad/s^2], by squared speeds (n_samples, n_rotors)."""
    assert segment.reference is not None
    torque, rate, target = (
        speed**2 @ mixing[axis],
        segment.body_rate_rad_s[:, axis],
        segment.reference[:, axis],
    )
    return _per_torque(target, torque, rate, period_s) * _per_command(segment, mixing[axis], torque, period_s)


def _per_command(segment: Segment, mixing: FloatArray, torque: FloatArray, period_s: float) -> float:
    """Return a torque by speeds over the commanded one, behind the lags and delay that explain it best."""
    assert segment.rotor_thrust is not None
    b, a = signal.butter(2, BAND_HZ, "band", fs=1.0 / period_s)
    flown = signal.filtfilt(b, a, torque)
    time_s = period_s * np.arange(len(torque))
    wanted = np.sqrt(np.maximum(segment.rotor_thrust, 0.0))

    def given(at: FloatArray) -> FloatArray:
        up_s, ratio = np.exp(np.clip(at[:2], np.log([0.003, 0.2]), np.log([0.3, 5.0])))
        late = np.column_stack([np.interp(time_s - at[2], time_s, each) for each in wanted.T])
        speeds = lagged_speeds(late, period_s, Rotors(up_s, ratio * up_s))
        return np.asarray(signal.filtfilt(b, a, speeds**2 @ mixing))

    def slope(torque: FloatArray) -> float:
        return float(torque @ flown / (torque @ torque))

    def left(at: FloatArray) -> float:
        torque = given(at)
        return float(np.sum((flown - slope(torque) * torque) ** 2))

    steps = START + np.vstack([np.zeros(3), np.diag([0.3, 0.3, 0.002])])
    found = optimize.minimize(left, START, method="Nelder-Mead", options={"initial_simplex": steps})
    return slope(given(found.x))


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
