"""Vehicles that the flight allows, drawn evenly from what it tells of them together."""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.model import Posterior
from quadid_logs.maths.even_draws import Drawn, even_normal, even_uniform, symmetric_root

#: The 2.5 % quantile of a margin over so many draws is itself known to a twelfth of a standard deviation (of
#: so many random ones, to an eighth).
N_DRAWS: Final = 400
#: Every analysis of a log draws the same vehicles.
_SEED = 1


def draw(
    posterior: Posterior, axis: int, hold_s: float, n_draws: int = N_DRAWS, *, seed: int = _SEED
) -> Plant | None:
    """Return the estimate of one axis, then vehicles drawn around it.

    Parameters
    ----------
    posterior : Posterior
    axis : int
    hold_s : float
        Period of the control loop [s].
    n_draws : int
    seed : int

    Returns
    -------
    Plant or None
        Each of its numbers of shape (1 + n_draws,). None where the axis tells nothing, or turns the wrong
        way.

    Notes
    -----
    The identified delay contains the zero-order hold of the loop, half its period, which a `Plant` does not.
    Where it is shorter than that, the stamps of torque and rate are off by at least the difference: the
    delay is taken for none then, and is as uncertain as that.
    Standard deviations are drawn along the covariance's own root, which is symmetric: vehicles that flights
    tell almost alike are drawn almost alike.
    Rotors and air brake: a damping that is estimated as none is drawn on that side alone, and the other
    numbers as they go with it.
    """
    mean, covariance = posterior.mean[axis], posterior.covariance[axis]
    if not (np.isfinite(mean).all() and np.isfinite(covariance).all() and mean[0] > 0.0):
        return None
    root = symmetric_root(covariance)
    drawn = mean + (even_normal(Drawn.NUMBERS, n_draws, seed) @ root)
    if posterior.only_brakes[axis]:
        drives = np.maximum(drawn[:, 1], 0.0)
        drawn -= 2.0 * drives[:, np.newaxis] * covariance[1] / covariance[1, 1]
    effectiveness, damping, lag_s, delay_s, reaction = np.vstack([mean, drawn]).T
    effectiveness = np.maximum(effectiveness, 0.01 * mean[0])
    unheld_s = delay_s - 0.5 * hold_s
    part, stamps = (
        np.append(0.0, even_uniform(one, n_draws, seed)[:, 0]) for one in (Drawn.LAG_OR_DELAY, Drawn.STAMPS)
    )
    as_lag_s = part * np.clip(unheld_s, 0.0, posterior.lag_or_delay_s)
    short_s = max(0.0, -float(unheld_s[0])) * np.append(0.0, 2.0 * stamps[1:] - 1.0)
    return Plant(
        effectiveness=effectiveness,
        damping=damping,
        lag_s=np.maximum(lag_s + as_lag_s, 0.0),
        delay_s=np.maximum(unheld_s - as_lag_s, 0.0) + short_s,
        lead_s=reaction / effectiveness,
    )
