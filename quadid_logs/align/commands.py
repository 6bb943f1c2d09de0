"""What was commanded from outside: rate set-points without the answer of the angle controller, or sticks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import Segment
from quadid_logs.data.log import ModeChange
from quadid_logs.maths.recurrence import lag
from quadid_logs.maths.rotations import TILT_MEMORY_S

#: By flight mode, gains from angles of roll, pitch and yaw to rate set-points [1/s].
AngleGains = Mapping[str, tuple[float, float, float]]
#: By flight mode, the rate set-points of roll and pitch that full sticks make of a level vehicle [rad/s].
StickGains = Mapping[str, tuple[float, float]]
#: Firmwares allow angle gains of up to 12 1/s; a parameter far beyond is damaged.
_MOST_GAIN_1_S = 100.0


def with_commands(
    segments: Sequence[Segment],
    modes: Sequence[ModeChange],
    gains: AngleGains,
    *,
    stick_gains: StickGains | None = None,
    sticks: Sequence[FloatArray] = (),
) -> tuple[Segment, ...]:
    """Return segments with what moved the vehicle from outside.

    An angle controller asks for the rate k (s - x) + f of an angle x that is to be s. With k x put back,
    k s + f is left, which no gust moves. Where the log holds the sticks that make s, they are it.

    Parameters
    ----------
    segments : sequence of Segment
    modes : sequence of ModeChange
        On the segments' clock.
    gains : mapping of str to (roll, pitch, yaw)
        Of the modes whose set-points follow from sticks [1/s].
    stick_gains : mapping of str to (roll, pitch), optional
        Of the modes in which ``sticks`` ask for angles [rad/s]. Yaw's set-point stands as it is: it asks for
        a rate.
    sticks : sequence of ndarray, each of shape (n_samples, 2)
        Of roll and pitch, -1 to 1, on the grid of each segment; empty where they are not logged.

    Returns
    -------
    tuple of Segment
        With `Segment.command`, and `Segment.law` where modes of several kinds flew.
    """
    if not modes:
        return tuple(segments)
    order = sorted(modes, key=lambda one: one.time_s)
    put_back = _of_modes(order, gains, 3)
    asked = _of_modes(order, stick_gains or {}, 2) if sticks else np.full((len(order), 2), np.nan)
    # A number for each kind of mode, alike for modes of the same gains; -1 for those without any.
    both = [tuple(row) for row in np.nan_to_num(np.column_stack([put_back, asked]), nan=-1.0).tolist()]
    kinds = [*dict.fromkeys(both)]
    known = np.isfinite(put_back).all(axis=1) | np.isfinite(asked).all(axis=1)
    laws = np.where(known, [kinds.index(each) for each in both], -1).astype(np.int64)
    begin_s = [one.time_s for one in order]
    flown = [np.maximum(np.searchsorted(begin_s, each.time_s, side="right") - 1, 0) for each in segments]
    found = [
        segment
        if segment.reference is None
        else replace(
            segment,
            command=_command(
                segment, segment.reference, put_back[mode], asked[mode], sticks[number] if sticks else None
            ),
            law=laws[mode],
        )
        for number, (segment, mode) in enumerate(zip(segments, flown, strict=True))
    ]
    n_flown = len({*np.concatenate([laws[mode] for mode in flown]).tolist()} - {-1}) if flown else 0
    return tuple(found if n_flown > 1 else (replace(each, law=None) for each in found))


def _command(
    segment: Segment,
    reference: FloatArray,
    put_back: FloatArray,
    asked: FloatArray,
    sticks: FloatArray | None,
) -> FloatArray:
    """Return `Segment.command`; gains (n_samples, 3) and (n_samples, 2) are those of each sample's mode."""
    command = reference.copy()
    # The angles that the rates tell, up to what is slow, by trapezoids: half a sample of delay would leave a
    # part of the angle in what is commanded.
    rate = segment.body_rate_rad_s
    means = 0.5 * (rate + np.vstack([rate[:1], rate[:-1]]))
    period_s = float(segment.time_s[1] - segment.time_s[0]) if segment.n_samples > 1 else 1.0
    angles = TILT_MEMORY_S * lag(np.vstack([np.zeros((1, 3)), means]), period_s, TILT_MEMORY_S)[1:]
    command[:, :3] += put_back * angles
    if sticks is not None:
        by_stick = np.isfinite(asked).all(axis=1)
        command[by_stick, :2] = (asked * sticks)[by_stick]
        command[by_stick, 2] = reference[by_stick, 2]
    return command


def _of_modes(order: Sequence[ModeChange], gains: Mapping[str, tuple[float, ...]], width: int) -> FloatArray:
    """Return the gains of each mode, shape (n_modes, width); NaN in modes that have none."""
    found = np.array([gains.get(one.name, (np.nan,) * width) for one in order])
    found[~(np.abs(found) <= _MOST_GAIN_1_S)] = np.nan
    return found
