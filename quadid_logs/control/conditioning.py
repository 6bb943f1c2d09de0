"""Vehicles that agree with what was measured above the band that they were fitted in.

A lag and a delay that were found below 5 Hz are carried to crossovers at 20 Hz, where a third of a
millisecond is two degrees. Where instruments show the vehicle's response there, it takes part: every drawn
vehicle is moved towards the measured response by as much as the draws and the measurement leave to choose.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.frequency_response import TOLERANCE, Response
from quadid_logs.data.closed_loop import Plant
from quadid_logs.maths.band import ComplexArray
from quadid_logs.maths.even_draws import Drawn, even_normal, symmetric_root

#: Half a third octave: a band whose middle is this far above the fitted ones shares no line with them.
_HALF_BAND: Final = 2.0 ** (1.0 / 6.0)
#: What a lag and a delay leave of a vehicle is alike over about an octave [octaves].
_ALIKE_OCTAVES: Final = 1.0
#: `TOLERANCE` weighs as much as this many bands, an octave, that were seen to scatter by it.
_BANDS_ASSUMED: Final = 3
#: Every analysis of a log moves its draws alike.
_SEED = 2


class _Measured(NamedTuple):
    """Logarithms of gain and phase, measured over the estimate's (2 n_bands,), with frequency and error."""

    frequency_hz: FloatArray
    error: FloatArray
    value: FloatArray


def conditioned(
    plants: Plant, ratio: Response, hold_s: float, fitted_hz: float, *, crosses_above: bool
) -> Plant:
    """Move vehicles towards the response that was measured above the fitted band.

    Parameters
    ----------
    plants : Plant
        The estimate, then vehicles drawn around it.
    ratio : Response
        Of the vehicle, measured over the estimate's; the known bands only.
    hold_s : float
        Period of the control loop [s].
    fitted_hz : float
        Up to where the model was fitted: lower bands have taken part already.
    crosses_above : bool
        The crossover lies above the fitted band. What a lag and a delay leave of the phase at the band's end
        may then be a delay in truth, and is allowed to be.

    Returns
    -------
    Plant
        As before where nothing was measured above the fitted band.

    Notes
    -----
    The update of an ensemble Kalman filter with perturbed observations (G. Burgers, P. J. van Leeuwen,
    G. Evensen, Monthly Weather Review 126, 1998). What a lag and a delay leave is estimated from the
    scatter of the bands about the moved estimate, and is alike in neighbouring bands.
    """
    above = ratio.frequency_hz > _HALF_BAND * fitted_hz
    if not above.any():
        return plants
    measured = _Measured(
        ratio.frequency_hz[above], ratio.error[above], _parts(ratio.gain[np.newaxis, above])[0]
    )
    slack_s = TOLERANCE / (2.0 * np.pi * fitted_hz) if crosses_above else 0.0
    first = _moved(plants, measured, hold_s, TOLERANCE, slack_s)
    # What lag and delay leave of gain and phase, by the scatter of the bands and by experience.
    modelled = _relative(first.at(slice(0, 1)), plants, measured, hold_s)[0]
    n_bands = measured.frequency_hz.size
    scatter = float(np.sum((measured.value - modelled) ** 2) - np.sum(measured.error**2))
    seen = max(0.5 * scatter, 0.0)
    tolerance = float(np.sqrt((_BANDS_ASSUMED * TOLERANCE**2 + seen) / (_BANDS_ASSUMED + n_bands)))
    return _moved(plants, measured, hold_s, tolerance, slack_s * tolerance / TOLERANCE)


def _moved(plants: Plant, measured: _Measured, hold_s: float, tolerance: float, slack_s: float) -> Plant:
    """Return the plants after one update, with a delay that is free by so much more."""
    # A delay that is free, and the errors of effectiveness, damping, lag, delay and reaction.
    random = np.pad(even_normal(Drawn.MEASURED, plants.delay_s.size - 1, _SEED), ((1, 0), (0, 0)))
    free = plants._replace(delay_s=plants.delay_s + slack_s * random[:, 0])
    numbers = np.column_stack(
        [np.log(free.effectiveness), free.damping, free.lag_s, free.delay_s, free.reaction]
    )
    seen = _relative(free, plants, measured, hold_s)
    # The covariance of what was measured: random errors, and what lag and delay leave.
    octave = np.log2(measured.frequency_hz)
    alike = np.exp(-np.abs(octave[:, np.newaxis] - octave) / _ALIKE_OCTAVES)
    one = tolerance**2 * alike + np.diag(0.5 * measured.error**2)
    noise = np.kron(np.eye(2), one)
    spread, seen_spread = (each[1:] - each[1:].mean(axis=0) for each in (numbers, seen))
    together = seen_spread.T @ seen_spread / (len(spread) - 1) + noise
    gain = np.linalg.solve(together, seen_spread.T @ spread / (len(spread) - 1))
    # What random errors of the measurement make of the numbers: of that covariance, whatever the bands are.
    drawn = random[:, 1:] @ symmetric_root(gain.T @ noise @ gain)
    # Plants of logarithms of effectiveness, dampings, lags, delays, reactions; no time below none.
    logarithm, damping, lag_s, delay_s, reaction = (numbers + (measured.value - seen) @ gain + drawn).T
    effectiveness = np.exp(logarithm)
    # Below the crossover the two act as one: what one is short of, the other gives.
    total_s = np.maximum(lag_s + delay_s, 0.0)
    lag_s = np.clip(lag_s, 0.0, total_s)
    return Plant(effectiveness, damping, lag_s, total_s - lag_s, reaction / effectiveness)


def _relative(plants: Plant, reference: Plant, measured: _Measured, hold_s: float) -> FloatArray:
    """Return the plants' responses over that of the first reference, as `_parts`."""
    first = reference.at(slice(0, 1)).response(measured.frequency_hz, hold_s)
    return _parts(plants.response(measured.frequency_hz, hold_s) / first)


def _parts(ratio: ComplexArray) -> FloatArray:
    """Return the logarithm of the gain, and the phase beside it."""
    return np.hstack([np.log(np.abs(ratio)), np.angle(ratio)])
