"""What each filter costs the rate loop in phase, and what it takes from lines of the gyro's spectrum."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.loop import on_rate
from quadid_logs.data.closed_loop import AxisLoop, Estimated
from quadid_logs.data.controller import AxisController, FilterPlace, MeanFilter, NamedFilter, in_series
from quadid_logs.data.health import Health, Line, LineSource
from quadid_logs.maths.band import ComplexArray

#: Frequencies across the interval of a crossover, among which the least and the largest cost are looked for.
_N_ACROSS: Final = 33
#: Nothing is told to be weaker than this [dB].
_WEAKEST_DB: Final = -120.0


class FilterCost(NamedTuple):
    """What one filter does to the rate loop.

    Attributes
    ----------
    name : str
        Of its parameters; "" for all of the gyro's path together.
    place : FilterPlace
    centre_hz : tuple of float
        As of `NamedFilter`.
    phase_deg : Estimated or None
        Phase that the loop loses at its crossover [deg]; its interval is that of the crossover. None where
        no crossover is known.
    at_lines_db : tuple of float
        Gain at each of the lines [dB]; of a filter on a part of the controller, the gain on that part.
    """

    name: str
    place: FilterPlace
    centre_hz: tuple[float, ...]
    phase_deg: Estimated | None
    at_lines_db: tuple[float, ...]


def rate_crossover(found: AxisLoop) -> Estimated | None:
    """Return where the rate loop of an axis crosses over, None where nothing may be said of it."""
    return None if found.margins is None or found.contradicted else found.margins.rate.crossover_hz


def lines_of(health: Health | None) -> Mapping[str, Sequence[Line]]:
    """Return the lines of the gyro's spectrum by axis, none where none was made."""
    return {} if health is None or health.noise is None else health.noise.lines


def filter_costs(
    controller: AxisController, crossover_hz: Estimated | None, lines: Sequence[Line] = ()
) -> tuple[FilterCost, ...]:
    """Return what each filter of an axis does.

    Parameters
    ----------
    controller : AxisController
    crossover_hz : Estimated or None
        Of the rate loop.
    lines : sequence of Line
        Of the gyro's spectrum about this axis.

    Returns
    -------
    tuple of FilterCost
        In the order of the signal; last all of the gyro's path together, where it has several filters.

    Notes
    -----
    The cost of a filter in the whole path is its own phase. One on P or D alone changes the controller C to
    C + (1 - F) X, with X that part without the filter: it costs the phase between the two.
    """
    at_hz = None
    if crossover_hz is not None:
        across = np.linspace(*crossover_hz.ci95, _N_ACROSS)
        at_hz = np.concatenate([[crossover_hz.value], across])
    found = [
        FilterCost(
            one.name,
            one.place,
            one.centre_hz,
            None if at_hz is None else _cost([_factor(controller, one, at_hz)]),
            tuple(_gain_db(one, line) for line in lines),
        )
        for one in controller.filters
    ]
    of_gyro = [one for one in controller.filters if one.place is FilterPlace.GYRO]
    if len(of_gyro) > 1:
        lost = [cost.at_lines_db for cost in found if cost.place is FilterPlace.GYRO]
        phase = None if at_hz is None else _cost([one.filter.response(at_hz) for one in of_gyro])
        together = tuple(max(sum(each), _WEAKEST_DB) for each in zip(*lost, strict=True))
        found.append(FilterCost("", FilterPlace.GYRO, (), phase, together))
    return tuple(found)


def _cost(factors: Sequence[ComplexArray]) -> Estimated:
    """Return the phase [deg] that factors of the loop take, at the crossover and across its interval."""
    # One by one: together they may turn it by more than half of a circle.
    lost = -np.degrees(np.sum([np.angle(each) for each in factors], axis=0))
    return Estimated(float(lost[0]), (float(lost.min()), float(lost.max())))


def _factor(controller: AxisController, one: NamedFilter, frequency_hz: FloatArray) -> ComplexArray:
    """Return the rate loop with a filter over that without it."""
    response = one.filter.response(frequency_hz)
    if one.part is None:
        return response
    # Gyro and command stand in both, and cancel.
    alone = AxisController(
        period_s=controller.period_s,
        error=controller.error,
        target=controller.target,
        rate=controller.rate,
    )
    whole = on_rate(alone, frequency_hz)
    without = whole + (1.0 - response) * one.part.response(frequency_hz)
    return np.asarray(whole / without, dtype=np.complex128)


def _gain_db(one: NamedFilter, line: Line) -> float:
    """Return the gain at a line, in the mean of its power over the flight.

    A line of the rotors moves as they do: it keeps its distance from a notch that follows them.
    """
    moves = one.filter.instants if isinstance(one.filter, MeanFilter) else ((one.filter,),)
    follows = bool(one.speed) and line.source in (LineSource.ROTOR, LineSource.FOLLOWS_THROTTLE)
    speeds = one.speed if follows else (1.0,) * len(moves)
    power = [
        float(np.abs(in_series(each, np.array([line.frequency_hz * speed]))[0]) ** 2)
        for each, speed in zip(moves, speeds, strict=True)
    ]
    mean = float(np.mean(power))
    return max(10.0 * math.log10(mean), _WEAKEST_DB) if mean > 0.0 else _WEAKEST_DB
