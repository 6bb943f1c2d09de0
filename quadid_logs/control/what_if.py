"""Margins and step with other gains and filters than flew: a grid, computed before anybody asks."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.scaled_loop import ScaledLoops, figures_alone, scaled_loops
from quadid_logs.control.separate_gains import Rebuild
from quadid_logs.control.step import Steps, step_of
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
    changed = [dict(zip(values, one, strict=True)) for one in itertools.product(*values.values())]
    others = [rebuild(one) for one in changed]
    told = iter(
        _loops([one for one in others if one is not None], scaled_loops(controller, estimate, np.inf), time_s)
    )
    return WhatIf(
        values=values, time_s=time_s, loops=tuple(None if one is None else next(told) for one in others)
    )


def _loops(
    controllers: list[AxisController], flown: ScaledLoops, time_s: FloatArray
) -> Iterator[WhatIfLoop | None]:
    """Yield the figures of each controller around the vehicle that flew, None where a loop is unstable."""
    if not controllers:
        return
    figures = figures_alone([flown.of(one) for one in controllers])
    outer = figures.outer
    stable = figures.rate.stable & outer.stable
    gain_db, phase_deg = 20.0 * np.log10(outer.gain_margin), np.degrees(outer.phase_margin_rad)
    steps = Steps(flown.plants)
    for number, controller in enumerate(controllers):
        step = steps.of(controller) if stable[number] else None
        yield (
            None
            if step is None
            else WhatIfLoop(
                gain_margin_db=_known(gain_db[number]),
                phase_margin_deg=_known(phase_deg[number]),
                rise_time_s=step.rise_time_s.value,
                overshoot_percent=step.overshoot_percent.value,
                response=np.interp(time_s, step.time_s, step.response),
            )
        )


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
