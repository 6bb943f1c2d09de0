"""Where the autopilot's own tuning procedure would end on the vehicles that the flight allows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.doubling import double
from quadid_logs.control.pole_placement import place_poles
from quadid_logs.control.scaled_loop import figures_alone, scaled_loops
from quadid_logs.control.separate_gains import Rebuild
from quadid_logs.control.twitch import twitch
from quadid_logs.data.autotune import (
    AutotuneForecast,
    Doubling,
    PolePlacement,
    Procedure,
    ProcedureKind,
    Twitching,
)
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.tuning import GainNames
from quadid_logs.maths.normal import ENDS_95

#: The estimate and so many vehicles around it: an interval is not a tail's last per cent.
_N_VEHICLES: Final = 61


def forecast(
    procedure: Procedure, controller: AxisController, plants: Plant, names: GainNames, rebuild: Rebuild
) -> AutotuneForecast | None:
    """Run a procedure on vehicles and tell with which gains and margins it ends.

    Parameters
    ----------
    procedure : PolePlacement, Twitching or Doubling
    controller : AxisController
        That flew.
    plants : Plant
        The estimate, then vehicles drawn around it.
    names : GainNames
    rebuild : callable

    Returns
    -------
    AutotuneForecast or None
        None where it ends on none of the vehicles.
    """
    few = plants.at(slice(0, _N_VEHICLES))
    gains = _gains(procedure, controller, few, names, rebuild)
    if gains is None:
        return None
    ended = np.all([np.isfinite(values) & (values >= 0.0) for values in gains.values()], axis=0)
    places = np.flatnonzero(ended & (gains[names.proportional] > 0.0))
    if not places.size:
        return None
    common = {procedure.common: 1.0} if isinstance(procedure, PolePlacement) and procedure.common else {}
    flown, loops = scaled_loops(controller, few, np.inf), []
    for place in places:
        other = rebuild({name: float(each[place]) for name, each in gains.items()} | common)
        if other is None:
            return None
        loops.append(flown.at(slice(place, place + 1)).of(other))
    figures = figures_alone(loops)
    # The rate loop alone may be unstable where the whole one is not, and the other way round.
    stable = figures.rate.stable & figures.outer.stable
    return AutotuneForecast(
        kind=ProcedureKind.QUIKTUNE if isinstance(procedure, Doubling) else ProcedureKind.AUTOTUNE,
        title=procedure.title,
        gains={name: _interval(values[places]) for name, values in gains.items()},
        gain_margin_db=_margin(np.where(stable, 20.0 * np.log10(figures.outer.gain_margin), 0.0)),
        phase_margin_deg=_margin(np.where(stable, np.degrees(figures.outer.phase_margin_rad), 0.0)),
        unstable_fraction=float(np.mean(~stable)),
        ended_fraction=places.size / ended.size,
    )


def _gains(
    procedure: Procedure, controller: AxisController, plants: Plant, names: GainNames, rebuild: Rebuild
) -> Mapping[str, FloatArray] | None:
    """Return by parameter the gains at the end, of each vehicle."""
    if isinstance(procedure, Twitching):
        found = twitch(procedure, controller, plants, names, rebuild)
        if found is None:
            return None
        p, d, angle = found
        return {
            names.proportional: p,
            names.integral: procedure.integral_ratio * p,
            names.derivative: d,
            names.angle: angle,
        }
    if isinstance(procedure, Doubling):
        doubled = double(procedure, controller, plants, names, rebuild)
        if doubled is None:
            return None
        ends = dict(zip((names.proportional, names.integral, names.derivative), doubled, strict=True))
        n = plants.effectiveness.size
        return ends | {name: np.full(n, value) for name, value in procedure.filters.items()}
    p, i_per_s, d_s, angle = place_poles(procedure, controller, plants)
    return {names.proportional: p, names.integral: p * i_per_s, names.derivative: p * d_s, names.angle: angle}


def _interval(values: FloatArray) -> tuple[float, float]:
    low, high = np.quantile(values, ENDS_95, method="nearest")
    return float(low), float(high)


def _margin(values: FloatArray) -> tuple[float, float] | None:
    known = values[np.isfinite(values)]
    return _interval(known) if known.size else None
