"""What earlier flights of the same vehicle tell of it as well, with the gains that flew then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.control import flexible_mode
from quadid_logs.control.closed_loop import close_loop_of_earlier, disagrees, loop_around
from quadid_logs.control.next_flight import (
    DAMPING_SPREAD,
    EFFECTIVENESS_SPREAD,
    TIME_SPREAD_S,
    of_next_flight,
)
from quadid_logs.control.posterior import draw
from quadid_logs.data.closed_loop import AxisLoop, Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Model
from quadid_logs.maths.even_draws import Drawn
from quadid_logs.maths.multiple_tests import holm
from quadid_logs.maths.normal import NORMAL_95

#: A flight that differs more from earlier ones than one in twenty would by chance is one of another vehicle.
_SAME_VEHICLE: Final = 0.05
#: How much each of two flights weighs in what may be wrong in both alike.
_WEIGHTS: Final = tuple(np.linspace(0.02, 0.98, 25).tolist())
#: Of effectiveness, damping, lag, delay and lead: what a prior or the structure of the model may set, which
#: is the same in all flights. Gusts, which disturb the effectiveness most, are not.
_SHARED: Final = np.array([0.0, 1.0, 1.0, 1.0, 0.0])
#: Below this part of a variance is rounding.
_ROUNDING: Final = 1e-9


class _Drawn(NamedTuple):
    """Numbers of vehicles: the estimate (n,); mean (n,) and covariance (n, n) of those drawn around it."""

    estimate: FloatArray
    mean: FloatArray
    covariance: FloatArray


class Joined(NamedTuple):
    """A loop around the vehicles of several flights.

    ``used`` are the places of those that tell of it, ``differ`` of those that tell of another vehicle.
    """

    loop: AxisLoop
    used: tuple[int, ...] = ()
    differ: tuple[int, ...] = ()


def with_earlier(now: AxisLoop, controller: AxisController, earlier: Sequence[AxisLoop]) -> Joined:
    """Close the loop around the vehicles that a flight and earlier ones allow together.

    Parameters
    ----------
    now : AxisLoop
    controller : AxisController
        That of now.
    earlier : sequence of AxisLoop
        Of the same axis, per the same unit of command, with whatever gains.

    Returns
    -------
    Joined
        As it is where no earlier flight tells of the axis, or one tells of another vehicle.
    """
    if now.plants is None:
        return Joined(now)
    told = {
        place: (one, one.plants)
        for place, one in enumerate(earlier)
        if one.plants is not None and not one.contradicted
    }
    # One in twenty vehicles that did not change differs from any of its earlier flights.
    p_values = [_same_by_chance(now.plants, plants) for _, plants in told.values()]
    differ = tuple(
        place for place, differs in zip(told, holm(p_values, _SAME_VEHICLE), strict=True) if differs
    )
    if differ or not told:
        return Joined(now, differ=differ)
    plants, known_hz = now.plants, now.known_hz
    for one, others in told.values():
        plants, known_hz = _together(plants, others), max(known_hz, one.known_hz)
    frame = now.frame
    if frame is not None:
        frames = [one.frame for one, _ in told.values() if one.frame is not None]
        frame = flexible_mode.with_earlier(frame, frames, controller, plants.at(slice(0, 1)), known_hz)
        plants = plants._replace(modes=None if frame is None else frame.modes)
    margins, curve = loop_around(controller, plants, known_hz)
    loop = replace(now, plants=plants, known_hz=known_hz, frame=frame, margins=margins, curve=curve)
    return Joined(loop, tuple(told))


def by_earlier(
    now: AxisLoop,
    data: FlightData,
    model: Model,
    number: int,
    controller: AxisController,
    earlier: Sequence[AxisLoop],
) -> Joined:
    """Close the loop of an axis that a flight tells too little of around the vehicles of earlier flights.

    Parameters
    ----------
    now : AxisLoop
        Without vehicles.
    data : FlightData
        Its torques in units of the controller's command.
    model : Model
        Of this flight, per unit of the controller's command.
    number : int
        Of the axis.
    controller : AxisController
        That flew now.
    earlier : sequence of AxisLoop
        Of the same axis, per the same unit of command, the last flight last.

    Returns
    -------
    Joined
        As it is where no earlier flight tells of the axis, or another controller flew. All that do differ
        where they tell of several vehicles, or where something in this flight contradicts them: what it tells
        of the axis, little as it may be, or the response that it shows around the crossover.

    Notes
    -----
    The intervals are those of earlier flights together, wider by what differs between flights of one
    vehicle. Nothing of this flight narrows them.
    """
    places = tuple(
        place for place, one in enumerate(earlier) if one.plants is not None and not one.contradicted
    )
    if not places or disagrees(now.replay):
        return Joined(now)
    *before, last = (earlier[place] for place in places)
    found = with_earlier(last, controller, before)
    if found.differ or found.loop.plants is None:
        return Joined(now, differ=places)
    plants = of_next_flight(found.loop.plants._replace(modes=None), Drawn.BETWEEN_FLIGHTS)
    own = None if model.posterior is None else draw(model.posterior, number, controller.period_s)
    if own is not None and _same_by_chance(own, found.loop.plants) < _SAME_VEHICLE:
        return Joined(now, differ=places)
    closed = close_loop_of_earlier(data, model, number, controller, plants, found.loop.known_hz)
    if closed.plants is None:
        return Joined(now, differ=places)
    frame, known_hz = closed.frame, closed.known_hz
    if frame is not None:
        frames = [one.frame for one in (*before, last) if one.frame is not None]
        estimate = closed.plants.at(slice(0, 1))
        frame = flexible_mode.with_earlier(frame, frames, controller, estimate, known_hz)
    plants = closed.plants._replace(modes=None if frame is None else frame.modes)
    margins, curve = loop_around(controller, plants, known_hz)
    loop = replace(closed, replay=now.replay, plants=plants, frame=frame, margins=margins, curve=curve)
    return Joined(loop, places)


class _Both(NamedTuple):
    """What two flights tell of the numbers that both draw, in standard deviations of the first.

    ``told`` are the columns of `_numbers`, ``scale`` these deviations, ``spread`` the covariance between
    flights.
    """

    told: IntArray
    scale: FloatArray
    new: _Drawn
    old: _Drawn
    spread: FloatArray


def _both(now: Plant, earlier: Plant) -> _Both:
    drawn, others = _numbers(now), _numbers(earlier)
    told = np.flatnonzero((np.std(drawn[1:], axis=0) > 0.0) & (np.std(others[1:], axis=0) > 0.0))
    scale = np.std(drawn[1:, told], axis=0)
    # What differs between flights of one vehicle, of each of the five numbers.
    effectiveness, damping = abs(drawn[0, 0]), abs(drawn[0, 1])
    half_widths = [EFFECTIVENESS_SPREAD * effectiveness, DAMPING_SPREAD * damping, 0.0, TIME_SPREAD_S, 0.0]
    spread = np.diag(2.0 * ((np.array(half_widths) / NORMAL_95)[told] / scale) ** 2)
    return _Both(told, scale, _drawn(drawn[:, told] / scale), _drawn(others[:, told] / scale), spread)


def _same_by_chance(now: Plant, earlier: Plant) -> float:
    """Return with what probability two flights of one vehicle differ as much."""
    from scipy.stats import chi2

    both = _both(now, earlier)
    difference = both.old.mean - both.new.mean
    covariance = both.new.covariance + both.old.covariance + both.spread
    return float(chi2.sf(difference @ np.linalg.solve(covariance, difference), both.told.size))


def _together(now: Plant, earlier: Plant) -> Plant:
    """Return the vehicles that two flights of one vehicle allow.

    Notes
    -----
    Errors of one flight are independent of those of another but for what both share (`_SHARED`), whose
    correlation is unknown: split covariance intersection (Julier and Uhlmann, 2001) holds for any. Between
    the flights battery, air and load change, as between this one and the next (`next_flight`).
    """
    told, scale, new, old, spread = _both(now, earlier)
    drawn, difference, shared = _numbers(now), old.mean - new.mean, _SHARED[told]
    gain, covariance = min(
        (_fused(new.covariance, old.covariance + spread, shared, weight) for weight in _WEIGHTS),
        key=lambda both: float(np.linalg.slogdet(both[1])[1]),
    )
    if np.linalg.slogdet(covariance)[1] >= np.linalg.slogdet(new.covariance)[1]:
        return now
    # The same draws, moved and drawn together: what else is drawn with them stays with them.
    narrower = np.linalg.cholesky(covariance) @ np.linalg.inv(np.linalg.cholesky(new.covariance))
    found = drawn.copy()
    found[0, told] += scale * (gain @ (old.estimate - new.estimate))
    centred = drawn[1:, told] / scale - new.mean
    found[1:, told] = scale * (new.mean + gain @ difference + centred @ narrower.T)
    # With signs as they were drawn before.
    effectiveness, damping, lag_s, delay_s, lead_s = found.T
    least = 0.5 * float(np.min(now.effectiveness))
    if np.all(now.damping <= 0.0):
        damping = np.minimum(damping, 0.0)
    lowest_s = min(float(np.min(now.delay_s)), 0.0)
    return now._replace(
        effectiveness=np.maximum(effectiveness, least),
        damping=damping,
        lag_s=np.maximum(lag_s, 0.0),
        delay_s=np.maximum(delay_s, lowest_s),
        lead_s=lead_s,
    )


def _fused(
    new: FloatArray, old: FloatArray, shared: FloatArray, weight: float
) -> tuple[FloatArray, FloatArray]:
    """Return the weight of the other flight, and the covariance of both together, each (n, n)."""
    both_share = np.outer(shared, shared)
    wide_new = new + (1.0 / weight - 1.0) * both_share * new
    wide_old = old + (1.0 / (1.0 - weight) - 1.0) * both_share * old
    gain = wide_new @ np.linalg.inv(wide_new + wide_old)
    return gain, wide_new - gain @ wide_new


def _numbers(plants: Plant) -> FloatArray:
    """Return effectiveness, damping, lag, delay and lead, (n_plants, 5)."""
    lead_s = np.broadcast_to(plants.lead_s, plants.effectiveness.shape)
    return np.stack([plants.effectiveness, plants.damping, plants.lag_s, plants.delay_s, lead_s], axis=1)


def _drawn(numbers: FloatArray) -> _Drawn:
    drawn = numbers[1:]
    covariance = np.atleast_2d(np.cov(drawn.T)) + _ROUNDING * np.eye(drawn.shape[1])
    return _Drawn(numbers[0], drawn.mean(axis=0), np.asarray(covariance, dtype=np.float64))
