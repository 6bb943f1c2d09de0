"""What was commanded from outside: rate set-points without the answer of the angle controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import Segment
from quadid_logs.data.log import ModeChange
from quadid_logs.maths.recurrence import lag
from quadid_logs.maths.rotations import TILT_MEMORY_S

#: By flight mode, gains from angles of roll, pitch and yaw to rate set-points [1/s].
AngleGains = Mapping[str, tuple[float, float, float]]
#: Firmwares allow angle gains of up to 12 1/s; a parameter far beyond is damaged.
_MOST_GAIN_1_S = 100.0


def command_of(segment: Segment, modes: Sequence[ModeChange], gains: AngleGains) -> FloatArray | None:
    """Return what moved the vehicle from outside.

    An angle controller asks for the rate k (s - x) + f of an angle x that is to be s. With k x put back,
    k s + f is left, which no gust moves.

    Parameters
    ----------
    segment : Segment
    modes : sequence of ModeChange
        On the segment's clock.
    gains : mapping of str to (roll, pitch, yaw)
        Of the modes whose set-points follow from sticks [1/s].

    Returns
    -------
    ndarray, shape of `Segment.reference`, or None
        As of `Segment.command`.
    """
    if segment.reference is None or not modes:
        return None
    rate = segment.body_rate_rad_s
    # By trapezoids: half a sample of delay would leave a part of the angle in what is commanded.
    means = 0.5 * (rate + np.vstack([rate[:1], rate[:-1]]))
    angles = TILT_MEMORY_S * lag(
        np.vstack([np.zeros((1, 3)), means]),
        float(segment.time_s[1] - segment.time_s[0]) if segment.n_samples > 1 else 1.0,
        TILT_MEMORY_S,
    )
    command = segment.reference.copy()
    command[:, :3] += _gain_at(segment.time_s, modes, gains) * angles[1:]
    return command


def _gain_at(time_s: FloatArray, modes: Sequence[ModeChange], gains: AngleGains) -> FloatArray:
    """Return the gains at some times, shape (n, 3); NaN in modes that have none."""
    order = sorted(modes, key=lambda one: one.time_s)
    unknown = (np.nan, np.nan, np.nan)
    of_modes = np.array([gains.get(one.name, unknown) for one in order])
    of_modes[~(np.abs(of_modes) <= _MOST_GAIN_1_S)] = np.nan
    current = np.searchsorted([one.time_s for one in order], time_s, side="right") - 1
    return np.asarray(of_modes[np.maximum(current, 0)], dtype=np.float64)
