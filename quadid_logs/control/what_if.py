"""Margins and step with other gains and filters than flew: a grid, computed before anybody asks."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.scaled_loop import scaled_loops
from quadid_logs.control.separate_gains import Rebuild
from quadid_logs.control.step import step_of
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.tuning import four_digits
from quadid_logs.data.what_if import WhatIf, WhatIfLoop

#: Of the flown value: of gains what a flight may change, and of filters an octave.
GAIN_FACTORS: Final = (0.7, 1.0, 1.4)
FILTER_FACTORS: Final = (0.5, 1.0, 2.0)
#: The step is shown for so many settling times of the flown loop, and no longer than this [s].
_SHOWN: Final = 1.5
_LONGEST_S: Final = 1.0
_N_POINTS: Final = 41


def what_if(
    gains: Mapping[str, float],
    filters: Mapping[str, float],
    controller: AxisController,
    plants: Plant,
    rebuild: Rebuild,
    written: Callable[[float], float] = four_digits,
) -> WhatIf | None:
    """Compute the loops of all combinations.

    Parameters
    ----------
    gains, filters : mapping of str to float
        Flown values by parameter; what is not positive is not varied.
    controller : AxisController
        That flew.
    plants : Plant
        The first of them is looked at.
    rebuild : callable
    written : callable
        Returns a value as a file holds it.

    Returns
    -------
    WhatIf or None
        None where the flown loop is not stable.
    """
    values: dict[str, tuple[float, ...]] = {}
    for flown, factors in ((gains, GAIN_FACTORS), (filters, FILTER_FACTORS)):
        for name, value in flown.items():
            if 0.0 < value < np.inf:
                values[name] = tuple(written(factor * value) for factor in factors)
    estimate = plants.at(slice(0, 1))
    before = step_of(controller, estimate)
    if before is None or not values:
        return None
    settled_s = before.settling_time_s.value
    end_s = min(_SHOWN * settled_s, _LONGEST_S) if np.isfinite(settled_s) else _LONGEST_S
    time_s = np.linspace(0.0, end_s, _N_POINTS)
    loops = []
    for combination in itertools.product(*values.values()):
        other = rebuild(dict(zip(values, combination, strict=True)))
        loops.append(None if other is None else _loop(other, estimate, time_s))
    return WhatIf(values=values, time_s=time_s, loops=tuple(loops))


def _loop(controller: AxisController, estimate: Plant, time_s: FloatArray) -> WhatIfLoop | None:
    """Return the figures of one combination, None where a loop is unstable."""
    margins = scaled_loops(controller, estimate, np.inf).margins()
    outer = margins.full or margins.rate
    step = step_of(controller, estimate)
    if step is None or not (margins.rate.stable and outer.stable):
        return None
    gain, phase = outer.gain_margin_db, outer.phase_margin_deg
    return WhatIfLoop(
        gain_margin_db=None if gain is None else gain.value,
        phase_margin_deg=None if phase is None else phase.value,
        rise_time_s=step.rise_time_s.value,
        overshoot_percent=step.overshoot_percent.value,
        response=np.interp(time_s, step.time_s, step.response),
    )
