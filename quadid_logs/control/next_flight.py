"""The vehicles that the next flight allows: those of this one, and what differs from flight to flight."""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.data.closed_loop import Plant
from quadid_logs.maths.even_draws import Drawn, even_normal
from quadid_logs.maths.normal import NORMAL_95

#: Spread between flights of one vehicle, which the intervals do not hold (95 %). Measured on one simulated
#: vehicle with multisines, doublets, 3-2-1-1 steps and wind of 8 m/s: damping changes by up to 12 % (drag is
#: no constant), lag and delay by 1 ms.
DAMPING_SPREAD: Final = 0.15
TIME_SPREAD_S: Final = 0.001
#: Of the effectiveness: battery, throttle and air. Flown: crossovers of 17 flights of three vehicles with the
#: same gains spread by 2.7 % (one standard deviation) beyond their intervals (`study/flown_loops.py`).
EFFECTIVENESS_SPREAD: Final = 0.053
#: Every recommendation from a log looks at the same vehicles.
_SEED = 2


def of_next_flight(plants: Plant, what: Drawn = Drawn.NEXT_FLIGHT, *, seed: int = _SEED) -> Plant:
    """Return the vehicles with what may be different in another flight.

    Parameters
    ----------
    plants : Plant
        The estimate, then vehicles drawn around it.
    what : Drawn
        `BETWEEN_FLIGHTS` for what differs from an earlier flight to this one: that is independent.
    seed : int

    Returns
    -------
    Plant
        The estimate as it is; each of the others a little more or less effective, damped, and late.
    """
    n = plants.effectiveness.size
    random = np.zeros((3, n))
    random[:, 1:] = even_normal(what, n - 1, seed).T / NORMAL_95
    return plants._replace(
        effectiveness=plants.effectiveness * (1.0 + EFFECTIVENESS_SPREAD * random[0]),
        damping=plants.damping * (1.0 + DAMPING_SPREAD * random[1]),
        delay_s=plants.delay_s + TIME_SPREAD_S * random[2],
    )
