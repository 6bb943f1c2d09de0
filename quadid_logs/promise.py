"""The promise of one flight for the next, and the check of the next flight against it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import PurePath
from typing import Final

from quadid_logs.autopilots import named
from quadid_logs.comparison import COUPLING_SPREAD, by_throttle, throttle_powers, why_unknown
from quadid_logs.control.command_units import per_command
from quadid_logs.control.next_flight import EFFECTIVENESS_SPREAD, TIME_SPREAD_S
from quadid_logs.control.room import Room, leads_back, room_of, whole
from quadid_logs.data.closed_loop import Estimated, LoopMargins, Margins
from quadid_logs.data.flight import flown_parameters
from quadid_logs.data.model import Model
from quadid_logs.data.off_nominal import OFF_NOMINAL
from quadid_logs.data.promise import (
    AxisCheck,
    AxisPromise,
    Check,
    Decision,
    FigureCheck,
    Flown,
    Gain,
    Held,
    Obstacle,
    Outcome,
    Promise,
    QuantityKind,
    VehicleCheck,
    VehicleQuantity,
    WeakRotor,
)
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD, Tuning
from quadid_logs.health.rotors import weakened
from quadid_logs.maths.multiple_tests import holm
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.tuning import (
    margins_with,
    recommend,
    same_gain,
    same_law,
    shaping_gains,
    tuning_of,
)
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, ON_AXIS, TORQUE_SYMBOLS

#: Probability of a false "broken" for a vehicle that keeps every promise.
_FALSE_ALARMS: Final = 0.05
#: Largest length of a text of the log; real texts are shorter.
_LONGEST: Final = 200
#: The margins that are compared with the promise; +1 if a larger value is better. A lower crossover frequency
#: rejects gusts less.
FIGURES: Final[Mapping[str, int]] = {
    "gain_margin_db": 1,
    "phase_margin_deg": 1,
    "disk_margin": 1,
    "peak_sensitivity": -1,
    "crossover_hz": 1,
}


def promise_of(result: Result, tuning: Tuning, log_sha256: str = "") -> Promise | None:
    """Return the promise of a flight for the next one with the recommended gains.

    Parameters
    ----------
    result : Result
        Result of the flight.
    tuning : Tuning
        Recommendation from it.
    log_sha256 : str
        SHA-256 of the log, "" if unknown.

    Returns
    -------
    Promise or None
        None if there is no promise for any axis.
    """
    axes = {}
    for axis, found in tuning.axes.items():
        gains = {
            name: Gain(value, found.gains[name].next if name in found.gains else value)
            for name, value in shaping_gains(result, axis).items()
        }
        # A filter that was off, without settings in the log, can only be switched off again.
        gains |= {
            name: Gain(one.now if math.isfinite(one.now) else one.next, one.next)
            for name, one in found.filters.items()
        }
        margins = None if found.verdict == "refused" else found.next
        axes[axis] = AxisPromise(verdict=found.verdict, gains=gains, margins=margins)
    if all(one.margins is None for one in axes.values()):
        return None
    log, model = result.log, result.identification.recommended
    rotors = None if result.health is None else result.health.rotors
    return Promise(
        log=printable(PurePath(log.path).name, _LONGEST),
        log_sha256=log_sha256,
        autopilot=log.autopilot,
        frame=printable(log.frame, _LONGEST),
        hardware_id=printable(log.hardware_id, _LONGEST),
        n_cells=_n_cells(result),
        throttle=result.data.mean_throttle,
        throttle_powers=throttle_powers((result,)),
        structure="" if model is None else model.structure,
        quantities=() if model is None else tuple(_quantities(result, model)),
        axes=axes,
        limits=tuning.limits,
        ranges=tuning.ranges,
        balance=None if rotors is None else rotors.balance,
    )


def _n_cells(result: Result) -> int:
    battery = None if result.health is None else result.health.battery
    return 0 if battery is None else battery.n_cells


def _quantities(result: Result, model: Model) -> Iterator[VehicleQuantity]:
    """Yield the identified effectiveness, couplings, lag and delay, per unit of command."""
    given = result.data.input
    calibrated = given is not None and given.unit != "1"
    n_m = given.calibration.n_m_per_command if given is not None and calibrated else (1.0, 1.0, 1.0)
    _, model = per_command(result.data, model)
    for axis, target in zip(AXES, ACCELERATION_SYMBOLS, strict=True):
        if why_unknown(result, axis):
            continue
        for command, regressor, scale in zip(AXES, TORQUE_SYMBOLS, n_m, strict=True):
            one = model.entries.get((target, regressor))
            if one is None or not (
                one.identifiable and all(math.isfinite(value) for value in (one.value, *one.ci95))
            ):
                continue
            if (target, regressor) == ON_AXIS[axis]:
                yield VehicleQuantity(QuantityKind.EFFECTIVENESS, axis, command, one.value, one.ci95)
            else:
                ci95 = (scale * one.ci95[0], scale * one.ci95[1])
                yield VehicleQuantity(QuantityKind.COUPLING, axis, command, scale * one.value, ci95)
    actuator = model.actuator
    if actuator is None:
        return
    for kind, value, ci95 in (
        (QuantityKind.LAG, actuator.lag_s, actuator.lag_ci95_s),
        (QuantityKind.DELAY, actuator.delay_s, actuator.delay_ci95_s),
    ):
        if all(math.isfinite(each) for each in (value, *ci95)):
            yield VehicleQuantity(kind, "", "", value, ci95)


def check(promise: Promise, after: Result, log_sha256: str = "") -> Check:
    """Check the next flight against a promise.

    A margin differs if the difference is significant, given both 95 % intervals: at a level of 5 % over all
    tests of the vehicle together (Holm). The tests of the vehicle's properties allow for the typical
    differences between flights of one vehicle.

    Parameters
    ----------
    promise : Promise
    after : Result
        Result of the next flight.
    log_sha256 : str
        SHA-256 of its log, "" if unknown.
    """
    obstacle = _obstacle(promise, after, log_sha256)
    n_cells = (promise.n_cells, _n_cells(after))
    axes = {axis: _axis_check(one, after, axis, obstacle) for axis, one in promise.axes.items()}
    vehicle = () if obstacle is not None else tuple(_vehicle_checks(promise, after))
    # What differs by more than chance, over all tests of the vehicle.
    p_values = [one.p_value for axis in axes.values() for one in axis.figures]
    differ = iter(holm([*p_values, *(one.p_value for one in vehicle)], _FALSE_ALARMS))
    judged: dict[str, AxisCheck] = {}
    for axis, one in axes.items():
        figures = tuple(replace(each, differs=next(differ)) for each in one.figures)
        differing = {figure.gain for figure in figures if figure.differs}
        if one.obstacle is not None:
            held = Held.NOT_COMPARABLE
        elif -1 in differing or not one.stable:
            held = Held.WORSE
        else:
            held = Held.BETTER if differing else Held.INSIDE
        judged[axis] = replace(one, figures=figures, held=held)
    axes, vehicle = judged, tuple(replace(one, differs=next(differ)) for one in vehicle)
    # The rotor that gives less than in the flight of the promise.
    rotor, rotors = None, None if after.health is None else after.health.rotors
    if obstacle is None and rotors is not None and rotors.balance is not None and promise.balance is not None:
        found = weakened(promise.balance, rotors.balance)
        rotor = None if found is None else WeakRotor(found[0], rotors.names[found[0]], found[1])
    outcome = Outcome.NOT_COMPARABLE
    if obstacle is None:
        promised = [one for one in axes.values() if one.obstacle is not Obstacle.NO_PROMISE]
        broken = any(one.held is Held.WORSE or one.obstacle is Obstacle.OTHER_GAINS for one in promised)
        if broken or rotor is not None or any(one.differs for one in vehicle):
            outcome = Outcome.BROKEN
        elif promised and all(one.obstacle is None for one in promised):
            outcome = Outcome.KEPT
        by_default = (promise.limits, promise.ranges) == (GOOD, OFF_NOMINAL)
        advised = tuning_of(after) if by_default else recommend(after, promise.limits, ranges=promise.ranges)
        axes = {
            axis: replace(one, decision=_axis_decision(promise, after, axis, one, advised))
            for axis, one in axes.items()
        }
    return Check(
        outcome=outcome,
        decision=_decision(promise, axes),
        obstacle=obstacle,
        axes=axes,
        vehicle=vehicle,
        n_cells=n_cells,
        rotor=rotor,
    )


def checked(before: Result, after: Result) -> Mapping[str, AxisCheck]:
    """Check a flight against the promise of its predecessor.

    The result holds the axes that flew with recommended gains which differ from the previous gains.
    """
    flown = [flown_parameters(one.log, one.data) for one in (before, after)]
    tunable = named(before.log.autopilot).tunable(flown[0])
    if tunable is None or all(
        flown[0].get(name) == flown[1].get(name) for one in tunable.axes.values() for name in one.every
    ):
        return {}
    promise = promise_of(before, tuning_of(before))
    if promise is None:
        return {}
    changed = {
        axis
        for axis, one in promise.axes.items()
        if any(gain.back != gain.next for gain in one.gains.values())
    }
    found = check(promise, after).axes
    return {axis: one for axis, one in found.items() if axis in changed and one.obstacle is None}


def _obstacle(promise: Promise, after: Result, log_sha256: str) -> Obstacle | None:
    """Return why the flight cannot be compared with the promise; None if it can."""
    log = after.log
    if log_sha256 and log_sha256 == promise.log_sha256:
        return Obstacle.SAME_LOG
    if log.autopilot != promise.autopilot:
        return Obstacle.OTHER_AUTOPILOT
    for own, other, obstacle in (
        (promise.frame, log.frame, Obstacle.OTHER_FRAME),
        (promise.hardware_id, log.hardware_id, Obstacle.OTHER_HARDWARE),
    ):
        if own and other and own != printable(other, _LONGEST):
            return obstacle
    return None


def _axis_check(promised: AxisPromise, after: Result, axis: str, obstacle: Obstacle | None) -> AxisCheck:
    """Compare one axis with its promise; significance is decided later, for all axes together."""
    parameters = flown_parameters(after.log, after.data)
    values = {name: parameters.get(name, math.nan) for name in promised.gains}
    # Whose law flew; gains may be written in more than one way, as a product of two.
    if same_law(after, axis, {name: gain.next for name, gain in promised.gains.items()}):
        flown = Flown.NEXT
    else:
        is_back = same_law(after, axis, {name: gain.back for name, gain in promised.gains.items()})
        flown = Flown.BACK if is_back else Flown.OTHER
    other = {
        name: (gain.next, values[name])
        for name, gain in promised.gains.items()
        if flown is not Flown.NEXT and not same_gain(values[name], gain.next)
    }
    seen = _margins(after, axis)
    if obstacle is None:
        if promised.margins is None:
            obstacle = Obstacle.NO_PROMISE
        elif flown is not Flown.NEXT:
            obstacle = Obstacle.OTHER_GAINS
        elif seen is None:
            obstacle = Obstacle.NO_MARGINS
    if obstacle is not None or promised.margins is None or seen is None:
        return AxisCheck(held=Held.NOT_COMPARABLE, obstacle=obstacle, flown=flown, other_gains=other)
    # The margins with the angle loop; those of the rate loop if one flight has no others.
    if promised.margins.full is None or seen.full is None:
        same_loop = (promised.margins.rate, seen.rate)
    else:
        same_loop = (promised.margins.full, seen.full)
    figures = tuple(_figures(*same_loop))
    return AxisCheck(
        held=Held.INSIDE,
        obstacle=None,
        flown=flown,
        other_gains=other,
        figures=figures,
        stable=seen.rate.stable and (seen.full is None or seen.full.stable),
    )


def _margins(result: Result, axis: str) -> LoopMargins | None:
    loop = result.loop_of(axis)
    return None if loop is None else loop.margins


def _figures(promised: Margins, seen: Margins) -> Iterator[FigureCheck]:
    for name, better in FIGURES.items():
        said, found = getattr(promised, name), getattr(seen, name)
        if isinstance(said, Estimated) and isinstance(found, Estimated):
            gain = better if found.value >= said.value else -better
            yield FigureCheck(
                name=name,
                promised=said,
                measured=found,
                p_value=_p_value(said, found),
                differs=False,
                gain=gain,
            )


def _p_value(said: Estimated, found: Estimated, spread: float = 0.0, bias: float = 0.0) -> float:
    """Return the p-value of the difference of two values of one quantity.

    Parameters
    ----------
    said, found : Estimated
        Independent estimates. Of each interval, the half that faces the other value counts.
    spread : float
        Half of the 95 % interval of the difference between flights.
    bias : float
        Possible shift by a known cause, to either side.

    Returns
    -------
    float
        Two-sided p-value.
    """
    difference = found.value - said.value
    down = difference < 0.0
    halves = (
        said.value - said.ci95[0] if down else said.ci95[1] - said.value,
        found.ci95[1] - found.value if down else found.value - found.ci95[0],
    )
    beyond = max(abs(difference) - bias, 0.0)
    if beyond == 0.0:
        return 1.0
    sigma = math.hypot(*(max(half, 0.0) for half in halves), spread) / NORMAL_95
    return math.erfc(beyond / sigma / math.sqrt(2.0)) if sigma > 0.0 else 0.0


def _vehicle_checks(promise: Promise, after: Result) -> Iterator[VehicleCheck]:
    """Compare the vehicle's properties with those of the flight of the promise, if both are identified."""
    models = after.identification.models
    model = next((one for one in models if one.structure == promise.structure), None)
    if model is None:
        return
    seen = {(one.kind, one.axis, one.command): one for one in _quantities(after, model)}
    own = {one.axis: abs(one.value) for one in promise.quantities if one.kind is QuantityKind.EFFECTIVENESS}
    throttle = after.data.mean_throttle
    ratio = throttle / promise.throttle if throttle > 0.0 < promise.throttle else 1.0
    powers = throttle_powers((after,))
    for one in promise.quantities:
        other = seen.get((one.kind, one.axis, one.command))
        if other is None:
            continue
        bias = 0.0
        match one.kind:
            case QuantityKind.EFFECTIVENESS:
                spread = EFFECTIVENESS_SPREAD * abs(one.value)
                power = max(promise.throttle_powers.get(one.axis, 0.0), powers.get(one.axis, 0.0))
                bias = float(by_throttle(one.value, ratio, power))
            case QuantityKind.COUPLING:
                spread = COUPLING_SPREAD * max(own.get(one.axis, 0.0), own.get(one.command, 0.0))
            case QuantityKind.LAG | QuantityKind.DELAY:
                spread = TIME_SPREAD_S
        said, found = Estimated(one.value, one.ci95), Estimated(other.value, other.ci95)
        yield VehicleCheck(
            kind=one.kind,
            axis=one.axis,
            command=one.command,
            promised=said,
            measured=found,
            p_value=_p_value(said, found, spread, bias),
            differs=False,
        )


def _axis_decision(promise: Promise, after: Result, axis: str, one: AxisCheck, advised: Tuning) -> Decision:
    """Return the decision for the gains of an axis: follow the new recommendation, or go back.

    Go back only if the margins of the flown gains are below the limits, and the previous gains have larger
    margins on the present vehicle.
    """
    found = advised.axes.get(axis)
    if found is None:
        return Decision.NO_ADVICE
    seen = _margins(after, axis)
    if one.held is Held.WORSE and seen is not None and found.direction not in ("raise", "keep"):
        gains = promise.axes[axis].gains
        before = margins_with(after, axis, {name: each.back for name, each in gains.items()})
        changed = any(each.back != each.next for each in gains.values())
        below = room_of(whole(seen), promise.limits) <= Room.LITTLE
        if changed and below and before is not None and leads_back(before, seen, promise.limits):
            return Decision.BACK
    match found.verdict:
        case "keep":
            return Decision.KEEP
        case "change":
            return Decision.GO_ON
        case "refused":
            return Decision.NO_ADVICE


def _decision(promise: Promise, axes: Mapping[str, AxisCheck]) -> Decision:
    """Return the most urgent decision of the axes with a promise."""
    own = [one.decision for axis, one in axes.items() if promise.axes[axis].margins is not None]
    for urgent in (Decision.BACK, Decision.GO_ON, Decision.NO_ADVICE):
        if urgent in own:
            return urgent
    return Decision.KEEP if own else Decision.NO_ADVICE
