"""The next gains to fly, from the result of an analysis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import PurePath
from typing import Final

import numpy as np

from quadid_logs.autopilots import named
from quadid_logs.control.autotune import forecast
from quadid_logs.control.closed_loop import open_loop
from quadid_logs.control.command_units import per_command
from quadid_logs.control.documented import within_documented
from quadid_logs.control.first_step import first_step, quieter_step
from quadid_logs.control.guard import Case
from quadid_logs.control.loop import Paths, on_rate
from quadid_logs.control.margins import grid_hz
from quadid_logs.control.next_flight import of_next_flight
from quadid_logs.control.off_nominal import FlownPoint, OffNominal, conditions
from quadid_logs.control.recommend import Axis, FilterWishes, tune_axes
from quadid_logs.control.scaled_loop import scaled_loops
from quadid_logs.control.what_if import what_if
from quadid_logs.data.autotune import AutotuneForecast
from quadid_logs.data.closed_loop import AxisLoop, LoopCurve, LoopMargins
from quadid_logs.data.controller import AxisController
from quadid_logs.data.flight import flown_parameters
from quadid_logs.data.health import Line, LineSource
from quadid_logs.data.model import Model
from quadid_logs.data.off_nominal import OFF_NOMINAL, Ranges
from quadid_logs.data.once import once
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD, AxisTuning, Limits, Tunable, Tuning
from quadid_logs.data.what_if import WhatIf
from quadid_logs.diagnose.findings import finding
from quadid_logs.maths.spectra import WINDOW_S
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES, MULTIROTOR, vehicle_words

#: Largest relative difference of two equal gains, as typed and stored in single precision.
_SAME_GAIN: Final = 1e-3
#: Two lines are one within what a window of 4 s resolves [Hz].
_SAME_LINE_HZ: Final = 2.0 / WINDOW_S


def recommend(
    result: Result,
    limits: Limits = GOOD,
    axes: Sequence[str] = AXES,
    *,
    apart: bool = True,
    filters: bool = False,
    ranges: Ranges = OFF_NOMINAL,
) -> Tuning:
    """Recommend the gains and filters of the next flight by axis, or give the reasons for refusing.

    Parameters
    ----------
    result : Result
        Result of `analyze`.
    limits : Limits
        Smallest margins. Each promised margin meets its limit with 97.5 % confidence.
    axes : sequence of str
        Axes to tune: roll, pitch and yaw.
    apart : bool
        True changes P, I, D and the angle gain separately where that rejects gusts better. False changes P, I
        and D by one common factor.
    filters : bool
        Change filters with the gains if that reduces gust response or noise. Has no effect without ``apart``.
    ranges : Ranges
        Ranges of load, air and propeller in which the limits are met too, as far as the flown gains meet them
        or any gains can; `AS_FLOWN` for none.

    Examples
    --------
    >>> from quadid_logs import analyze
    >>> recommend(analyze("sample_logs/default-logging.bin")).refused
    ('roll', 'pitch', 'yaw')
    """
    log = result.log
    parameters = flown_parameters(log, result.data)
    tunable = named(log.autopilot).tunable(parameters, log.version)
    # Name what no gains are given for.
    if tunable is None:
        obstacle = named(log.autopilot).title
        because = f"the rate controller of this autopilot ({obstacle}) is not modelled"
    else:
        kind = "" if log.vehicle_type == MULTIROTOR else vehicle_words(log.vehicle_type)
        obstacle = tunable.obstacle or kind
        because = f"this is {obstacle}"
    if tunable is None or obstacle:
        reason = finding(
            "QL610",
            "warning",
            {"autopilot": log.autopilot, "vehicle": obstacle},
            title=f"No gains are recommended: {because}",
        )
        refused = AxisTuning(verdict="refused", reasons=(reason,))
        return Tuning(axes=dict.fromkeys(axes, refused), limits=limits, ranges=ranges)
    known = {}
    point = _flown_point(result, parameters)
    for axis in axes:
        case, model = _case(result, axis, tunable, parameters)
        otherwise = OffNominal(point, tuple(conditions(point, ranges)), by_drag=axis == "yaw")
        known[axis] = Axis(case, model, partial(_rebuilt, result, parameters, axis), otherwise)
    # A notch that nobody knows delays the vehicle: behind other filters it would by another time.
    hidden = any(one.case.hides_a_notch for one in known.values())
    wishes = None
    if filters:
        wishes = FilterWishes() if hidden else _filter_wishes(result, parameters)
    tuned = tune_axes(known, limits, apart=apart, filters=wishes)
    tuned = {axis: _not_bare(result, axis, one, known[axis].case) for axis, one in tuned.items()}
    if wishes is not None:
        tuned = _quieter(result, known, tuned, wishes)
    return Tuning(
        axes={axis: within_documented(axis, one, tunable.axes[axis]) for axis, one in tuned.items()},
        limits=limits,
        ranges=ranges,
    )


def _flown_point(result: Result, parameters: Mapping[str, float]) -> FlownPoint:
    """Return the flown condition: hover, battery and propellers."""
    curve, battery = (
        result.identification.thrust_curve,
        None if result.health is None else result.health.battery,
    )
    point = FlownPoint(
        law=named(result.log.autopilot).thrust_law(result.log, parameters), command=result.data.mean_throttle
    )
    # What is assumed of the curve is the firmware's, which the propellers need not have.
    if curve is not None and (curve.identifiable or curve.measured):
        low, high = curve.ci95
        point = replace(point, expo=curve.expo, expo_half_width=0.5 * (high - low))
    if battery is None:
        return point
    return replace(
        point,
        voltage_v=float(np.mean(battery.voltage)),
        highest_v=float(np.max(battery.voltage)),
        lowest_v=battery.lowest_v.value,
        n_cells=battery.n_cells,
    )


def _not_bare(result: Result, axis: str, tuned: AxisTuning, case: Case) -> AxisTuning:
    """Return a first step by rule where a refused axis oscillates."""
    seen = None if result.health is None else result.health.oscillation
    if tuned.verdict != "refused" or seen is None or seen.may_be_folded:
        return tuned
    mine = next((one for one in seen.axes if one.axis == axis and one.drives_outputs), None)
    return tuned if mine is None else first_step(tuned, mine, case.names, case.parameters)


def _quieter(
    result: Result, known: Mapping[str, Axis], tuned: dict[str, AxisTuning], wishes: FilterWishes
) -> dict[str, AxisTuning]:
    """Return a first step by rule where every axis is refused and the command is full of noise."""
    seen = None if result.health is None else result.health.command_noise
    every_refused = set(tuned) == set(AXES) and all(one.verdict == "refused" for one in tuned.values())
    if seen is None or seen.level != "severe" or not every_refused:
        return tuned
    fast_hz = seen.frequency_hz[seen.frequency_hz > seen.above_hz]

    def noise(axis: str, filters: Mapping[str, float]) -> float:
        """Return what filters leave of the noise: there, no loop is closed any more."""
        flown, other = known[axis].case.controller, known[axis].rebuild(filters)
        if axis not in seen.axes or flown is None or other is None:
            return 0.0
        passed = np.abs(on_rate(other, fast_hz) / on_rate(flown, fast_hz)) ** 2
        left = seen.axes[axis].density[-fast_hz.size :] * passed
        return float(np.sqrt(np.sum(left) * seen.frequency_hz[0]))

    return quieter_step(tuned, wishes.choices, known[AXES[0]].case.parameters, noise)


@once
def tuning_of(result: Result) -> Tuning:
    """Return what is recommended with the default limits: every page and sentence takes it from here.

    Returns
    -------
    Tuning
        Computed once for each result, when a page or a sentence first needs it.
    """
    return recommend(result)


def autotune_forecasts(result: Result, tuning: Tuning) -> Mapping[str, tuple[AutotuneForecast, ...]]:
    """Tell where the autopilot's own tuning procedures would end.

    Parameters
    ----------
    result : Result
    tuning : Tuning
        Of `recommend`; what it refuses is not told of either.

    Returns
    -------
    mapping of str to tuple of AutotuneForecast
        By axis, as far as procedures are known.
    """
    log = result.log
    parameters = flown_parameters(log, result.data)
    tunable = named(log.autopilot).tunable(parameters, log.version)
    told: dict[str, tuple[AutotuneForecast, ...]] = {}
    for axis, procedures in ({} if tunable is None else tunable.procedures).items():
        if tunable is None or axis not in tuning.axes or axis in tuning.refused:
            continue
        case, _ = _case(result, axis, tunable, parameters)
        if case.controller is None or case.plants is None:
            continue
        rebuild = partial(_rebuilt, result, parameters, axis)
        plants = of_next_flight(case.plants)
        ends = (forecast(one, case.controller, plants, case.names, rebuild) for one in procedures)
        if found := tuple(one for one in ends if one is not None):
            told[axis] = found
    return told


def what_if_grids(result: Result, tuning: Tuning) -> Mapping[str, WhatIf]:
    """Compute the loops with other gains and filters than flew.

    Parameters
    ----------
    result : Result
    tuning : Tuning
        Of `recommend`; what it refuses is left out.

    Returns
    -------
    mapping of str to WhatIf
        By axis.
    """
    parameters = flown_parameters(result.log, result.data)
    tunable = named(result.log.autopilot).tunable(parameters, result.log.version)
    grids: dict[str, WhatIf] = {}
    for axis in () if tunable is None else tuning.axes:
        if tunable is None or axis in tuning.refused:
            continue
        case, _ = _case(result, axis, tunable, parameters)
        names = case.names
        if case.controller is None or case.plants is None:
            continue
        gains, filters = (
            {name: parameters.get(name, 0.0) for name in some}
            for some in ((names.proportional, names.integral, names.derivative), names.filters)
        )
        rebuild = partial(_rebuilt, result, parameters, axis)
        grid = what_if(gains, filters, case.controller, case.plants, rebuild, names.written)
        if grid is not None:
            grids[axis] = grid
    return grids


def next_loops(result: Result, tuning: Tuning) -> Mapping[str, LoopCurve]:
    """Compute the open loops with the recommended gains and filters.

    Parameters
    ----------
    result : Result
    tuning : Tuning
        Of `recommend`.

    Returns
    -------
    mapping of str to LoopCurve
        By axis, of those that change by what a model says; around the vehicles of the next flight, as the
        promised margins are.
    """
    parameters = flown_parameters(result.log, result.data)
    loops = {} if result.closed_loop is None else result.closed_loop.axes
    curves = {}
    for axis, found in tuning.axes.items():
        loop = loops.get(axis)
        if not found.changes or loop is None or loop.plants is None:
            continue
        following = {name: one.next for name, one in found.changes.items()}
        controller = _rebuilt(result, parameters, axis, following)
        if controller is not None:
            curves[axis] = open_loop(controller, of_next_flight(loop.plants), loop.known_hz)
    return curves


def _filter_wishes(result: Result, parameters: Mapping[str, float]) -> FilterWishes:
    """Return what of the filters may be set, for the lines that the flight shows."""
    noise = None if result.health is None else result.health.noise
    # A line that may stand elsewhere in truth is no place for a notch.
    lines = {} if noise is None or noise.may_be_folded else noise.lines
    # Nor is one that a loop may make.
    vibration = tuple(
        line for axis, some in lines.items() for line in some if not _may_be_loop(result, axis, line)
    )
    still = (
        one.frequency_hz
        for one in chain.from_iterable(lines.values())
        if one.source in (LineSource.FIXED, LineSource.UNKNOWN)
    )
    choices = named(result.log.autopilot).filter_choices(result.log, parameters, vibration)
    return FilterWishes(choices, tuple(still))


def _may_be_loop(result: Result, axis: str, line: Line) -> bool:
    """Tell whether a line is one of the oscillations of its axis, which a loop may make."""
    seen = None if result.health is None else result.health.oscillation
    return seen is not None and any(
        one.axis == axis and abs(one.line.frequency_hz - line.frequency_hz) <= _SAME_LINE_HZ
        for one in seen.axes
    )


def shaping_gains(result: Result, axis: str) -> dict[str, float]:
    """Return the parameters that shape the loop of an axis, as they flew.

    Returns
    -------
    dict of str to float
        Gains and filters by parameter; empty where the controller is not known.
    """
    parameters = flown_parameters(result.log, result.data)
    tunable = named(result.log.autopilot).tunable(parameters, result.log.version)
    controllers = None if result.closed_loop is None else result.closed_loop.controllers
    controller = None if controllers is None else controllers.axes.get(axis)
    if tunable is None or controller is None or axis not in tunable.axes:
        return {}
    names = dict.fromkeys((*controller.gains, *tunable.axes[axis].scaled))
    return {name: parameters[name] for name in names if math.isfinite(parameters.get(name, math.nan))}


def margins_with(
    result: Result, axis: str, changes: Mapping[str, float], *, next_flight: bool = False
) -> LoopMargins | None:
    """Return the margins that the vehicle of a flight has with other parameters.

    Parameters
    ----------
    result : Result
    axis : str
    changes : mapping of str to float
        By parameter.
    next_flight : bool
        In another flight: with what differs between flights of one vehicle, as the promise of `recommend`.

    Returns
    -------
    LoopMargins or None
        None where the loop of the axis is not known.
    """
    loop = result.loop_of(axis)
    parameters = flown_parameters(result.log, result.data)
    controller = _rebuilt(result, parameters, axis, changes)
    if loop is None or loop.plants is None or controller is None:
        return None
    plants = of_next_flight(loop.plants) if next_flight else loop.plants
    return scaled_loops(controller, plants, loop.known_hz).margins()


def same_gain(one: float, other: float) -> bool:
    """Return whether two values of a parameter are one, as they are typed in and held in single precision."""
    return math.isclose(one, other, rel_tol=_SAME_GAIN)


def same_law(result: Result, axis: str, others: Mapping[str, float]) -> bool:
    """Return whether the controller that flew is the one that some parameters make.

    Parameters
    ----------
    result : Result
    axis : str
    others : mapping of str to float
        By parameter.

    Returns
    -------
    bool
        Where no controller can be made of them: whether the parameters are the same.
    """
    parameters = flown_parameters(result.log, result.data)
    if all(same_gain(parameters.get(name, math.nan), value) for name, value in others.items()):
        return True
    both = [_rebuilt(result, parameters, axis, changes) for changes in ({}, others)]
    # What closes the loops of each controller, over frequency.
    paths = []
    for one in both:
        if one is not None:
            every = Paths(one, grid_hz(one.period_s))
            angle = () if one.angle_gain_per_s is None else (every.on_angle,)
            paths.append(np.stack([every.on_rate, *angle]))
    return (
        len(paths) == len(both)
        and paths[0].shape == paths[1].shape
        and bool(np.all(np.abs(paths[0] - paths[1]) <= _SAME_GAIN * np.abs(paths[0])))
    )


def _case(
    result: Result, axis: str, tunable: Tunable, parameters: Mapping[str, float]
) -> tuple[Case, Model | None]:
    """Put together what is known of an axis, per unit of command."""
    loop, model = result.closed_loop, result.identification.recommended
    found = None if loop is None else loop.axes.get(axis, AxisLoop())
    # Without a model no loop was closed; what the parameters tell of the controller stands all the same.
    controllers = (
        named(result.log.autopilot).controllers(result.log, parameters) if loop is None else loop.controllers
    )
    data = result.data
    if model is not None:
        data, model = per_command(result.data, model)
    case = Case(
        axis=axis,
        log=result.log,
        data=data,
        diagnosis=result.diagnosis,
        controllers=controllers,
        found=found,
        plants=None if found is None else found.plants,
        names=tunable.axes[axis],
        parameters=parameters,
        n_pooled=len(result.pooled),
        differ=tuple(printable(PurePath(one.path).name) for one in result.earlier if axis in one.differ),
    )
    return case, model


def _rebuilt(
    result: Result, parameters: Mapping[str, float], axis: str, changes: Mapping[str, float]
) -> AxisController | None:
    """Return the controller of an axis with some parameters changed, as the autopilot would make it."""
    log = result.log
    flown = None if result.closed_loop is None else result.closed_loop.controllers.axes.get(axis)
    period_s = None if flown is None else flown.period_s
    controllers = named(log.autopilot).controllers(
        log, {**parameters, **changes}, period_s=period_s, axes=(axis,)
    )
    return None if controllers is None else controllers.axes.get(axis)
