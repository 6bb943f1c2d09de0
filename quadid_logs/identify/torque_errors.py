"""What else the torque may have been, and so how far the estimate may be off for not knowing.

A log that holds every second or third step of the control loop misses part of
the torque after a step of the set-point, or counts it twice. If such errors
fall at random, the residuals tell of them; a manoeuvre in step with the
samples repeats the same error, and the fit takes it for the vehicle. What
would have come out of every second or every third sample of the log, begun
with the one or the other, shows how much that matters.

A thrust curve with another expo than the firmware believes gives another torque from the same commands.

A battery that runs down takes thrust with it. Mixed with a manoeuvre that
changes as time goes on, such as a chirp, that passes for damping.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import InputDescription, Segment
from quadid_logs.identify.design import Design
from quadid_logs.identify.torque import RowTorque
from quadid_logs.maths.normal import NORMAL_95

#: Every second and every third sample: three independent differences in all.
_EVERY = (2, 3)
#: What was cut is missing in full, beside all that adds in squares: sqrt((1.2 b)^2 + s^2) is b + s and more
#: up to s = b / 5.
_IN_FULL = 1.2
#: A lithium battery's voltage falls by some 14 % in a quarter of an hour of flight, and thrust with its
#: square: by 2 % a minute, 1 % to either side of the mean. Autopilots make up for it by halves.
_DRIFT_1_S = 0.01 / 60.0


def sampling_errors(design: Design) -> tuple[RowTorque, ...]:
    """Return possible errors of the torque from not knowing it between the samples, for intervals of 95 %.

    Parameters
    ----------
    design : Design
        With the torque as it is fitted.

    Returns
    -------
    tuple of RowTorque
        The squares of what they do to an estimate, added, are the square of
        the half width that not knowing the torque between the samples makes.

    Notes
    -----
    A pulse shorter than a sample is seen at T with the probability of its
    fraction of T, so the variance of what is seen grows with T: that of every
    n-th sample, over n, is that of all. Of longer pulses it is too much, which makes
    up for there being no more than three independent differences.
    """
    found = []
    for n in _EVERY:
        # The mean square over the n - 1 degrees of freedom, over n; and the mean of both ways.
        scale = NORMAL_95 / np.sqrt((n - 1) * n * len(_EVERY))
        chunks = []
        for torque in (chunk.torque for chunk in design.chunks):
            # How every n-th sample, held, differs from the mean over all starts.
            place = np.arange(len(torque))
            held = np.array([torque[np.maximum((place - start) // n * n + start, 0)] for start in range(n)])
            chunks.append((held - held.mean(axis=0)) * scale)
        found += [design.torque.replaced([chunk[start] for chunk in chunks]) for start in range(n)]
    return tuple(found)


def battery_errors(design: Design) -> tuple[RowTorque, ...]:
    """Return torques, one per axis, that are what a battery that runs down takes and gives.

    Parameters
    ----------
    design : Design
        With the torque as it is fitted.

    Returns
    -------
    tuple of RowTorque
        As of `sampling_errors`.
    """
    middle_s = {
        flight: np.mean([np.mean(chunk.time_s) for chunk in design.chunks if chunk.flight == flight])
        for flight in {chunk.flight for chunk in design.chunks}
    }
    drifts = [
        _DRIFT_1_S * (chunk.time_s - middle_s[chunk.flight])[:, np.newaxis] * chunk.torque
        for chunk in design.chunks
    ]
    return tuple(
        design.torque.replaced([drift * (np.arange(3) == axis) for drift in drifts]) for axis in range(3)
    )


def expo_errors(design: Design, described: InputDescription | None) -> tuple[RowTorque, ...]:
    """Return the torque that comes of the expo of the thrust curve being at the end of its interval.

    Parameters
    ----------
    design : Design
    described : InputDescription or None
        With how far the expo is known.

    Returns
    -------
    tuple of RowTorque
        As of `sampling_errors`; none where the torque was rebuilt from no assumed curve.
    """
    expo = None if described is None else described.expo
    if described is None or expo is None or not expo.half_width:
        return ()
    changes = torques_by_expo(design.chunks, described)
    return (design.torque.replaced([expo.half_width * change for change in changes]),)


def grid_errors(design: Design, grid: Sequence[float]) -> tuple[RowTorque, ...]:
    """Return the torque that whole steps hide where they were cut toward zero, one for each axis.

    Cut, a torque is half a step more than was logged on the mean, in its own direction; where zero was
    logged, it goes from the sign before to the sign after. Rounded, it is none of that: the log does not
    tell which.

    Parameters
    ----------
    design : Design
        With the torque as it is fitted.
    grid : sequence of float
        Step of the values of L, M and N, 0 where they take any.

    Returns
    -------
    tuple of RowTorque
        As of `sampling_errors`.
    """
    return tuple(
        design.torque.replaced(
            [
                _IN_FULL * half_steps(chunk.torque[:, [axis]], np.array([step])) * (np.arange(3) == axis)
                for chunk in design.chunks
            ]
        )
        for axis, step in enumerate(grid)
        if step
    )


def half_steps(torque: FloatArray, steps: FloatArray) -> FloatArray:
    """Return half a step in the direction of each torque; at zero, from the sign before to that after.

    Parameters
    ----------
    torque : ndarray, shape (n_samples, n_axes)
    steps : ndarray, shape (n_axes,)
        Of the values that were logged, 0 where they take any.

    Returns
    -------
    ndarray, shape (n_samples, n_axes)
    """
    half = np.copysign(0.5 * steps, torque)
    for column, values, step in zip(half.T, torque.T, steps.tolist(), strict=True):
        known = np.flatnonzero(np.abs(values) > 0.5 * step)
        if known.size:
            column[:] = np.interp(np.arange(values.size), known, column[known])
    return np.asarray(half)


def torques_by_expo(chunks: Sequence[Segment], described: InputDescription) -> list[FloatArray]:
    """Return the derivative of the torque by the expo of the thrust curve; one (n_samples, 3) per chunk.

    Parameters
    ----------
    chunks : sequence of Segment
        With their ``thrust_by_expo``, without which there is none.
    described : InputDescription
        With the ``torque_per_thrust`` of the rotors.

    Returns
    -------
    list of ndarray, shape (n_samples, 3)
    """
    per_thrust, expo = described.torque_per_thrust, described.expo
    # What the slope of an axis on the command changes by, beyond what the scale of the thrust does.
    own = 0.0 if expo is None else expo.own_slopes
    return [
        np.zeros_like(chunk.torque)
        if chunk.thrust_by_expo is None or per_thrust is None
        else np.asarray(chunk.thrust_by_expo @ per_thrust.T - own * chunk.torque, dtype=np.float64)
        for chunk in chunks
    ]
