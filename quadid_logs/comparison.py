"""Two results -> Comparison: whether the vehicle changed by more than the two flights can leave open."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import Final, Literal, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.next_flight import DAMPING_SPREAD, TIME_SPREAD_S
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Model, Parameter
from quadid_logs.data.result import Result
from quadid_logs.data.torque import HeldScale
from quadid_logs.diagnose.advice import advice_for, next_steps
from quadid_logs.sentences import continued
from quadid_logs.vocabulary import (
    ACCELERATION_SYMBOLS,
    AXES,
    ON_AXIS,
    RATE_SYMBOLS,
    TORQUE_SYMBOLS,
    term_words,
)

AxisChange = Literal["same", "changed", "not comparable"]
#: Of the verb, for scripts.
EXIT_CODES: Final[Mapping[AxisChange, int]] = MappingProxyType({"same": 0, "changed": 1, "not comparable": 3})

#: Of two unchanged vehicles, this fraction is called changed by chance, over all quantities together.
_FALSE_ALARMS = 0.05
#: Spread between flights of one vehicle, measured as in `control.next_flight`: couplings change by up to
#: 0.3 % of the larger of the two on-axis effectivenesses (and half a degree in the mounting of a gyro makes
#: 0.9 %).
COUPLING_SPREAD = 0.01
_TIME_SPREAD_MS = 1e3 * TIME_SPREAD_S
#: Yaw comes from the drag of the rotors, which grows at most with the cube of the command (thrust times
#: command; a drag that goes with thrust alone is less), so that its slope grows at most with the square.
_YAW_POWER = 2.0
#: Where the firmware does not undo the thrust curve, thrust grows at most with the square of the command,
#: so that its slope grows at most with the command.
_THRUST_POWER = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """One number of the model in both flights.

    ``axis`` is "" for what belongs to all; ``ci95`` are the intervals of the
    two values, ``spread`` is what differs between flights of one vehicle, and
    ``margin`` the least difference that counts as a change. ``scale`` is what
    a difference is a fraction of, the value called ``scale_name``. ``is_on_axis``
    marks how an axis answers to the torque about it. ``words`` and ``scale_words``
    are what people call the two. ``throttle_change`` is by what fraction of itself the mean throttle
    differed, and ``throttle_spread`` what that alone may make of the value, in `unit`: 0 where nothing.
    """

    name: str
    axis: str
    unit: str
    before: float
    after: float
    ci95_before: tuple[float, float]
    ci95_after: tuple[float, float]
    spread: float = 0.0
    margin: float = math.nan
    scale: float = math.nan
    scale_name: str = ""
    is_on_axis: bool = False
    words: str = ""
    scale_words: str = ""
    throttle_change: float = 0.0
    throttle_spread: float = 0.0

    @property
    def difference(self) -> float:
        """After minus before, in `unit`."""
        return self.after - self.before

    @property
    def changed(self) -> bool:
        """Whether the difference is more than chance."""
        return abs(self.difference) > self.margin


class ParameterDifference(NamedTuple):
    """A parameter of the autopilot that both logs hold, with different values at their ends.

    Untrusted: escape the name before showing.
    """

    name: str
    before: float
    after: float


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Comparison:
    """What changed between two flights.

    Attributes
    ----------
    structure : str
        The structure that both values come from, "" where nothing could be compared.
    quantities : tuple of Quantity
    axes : mapping of str to AxisChange
    reasons : mapping of str to str
        By axis that could not be compared: why.
    advice : tuple of str
        What to set or fly so that it can.
    parameters : tuple of ParameterDifference
        The parameters of the autopilot that differ, by name, without its calibrations and counters.
    """

    structure: str
    quantities: tuple[Quantity, ...]
    axes: Mapping[str, AxisChange]
    reasons: Mapping[str, str]
    advice: tuple[str, ...]
    parameters: tuple[ParameterDifference, ...] = ()

    @property
    def verdict(self) -> AxisChange:
        """Say "changed" if anything did, "same" if every axis was compared and none did."""
        if any(quantity.changed for quantity in self.quantities):
            return "changed"
        return "same" if set(self.axes.values()) == {"same"} else "not comparable"

    def __repr__(self) -> str:
        lines = [f"<Comparison: {self.verdict}"]
        for axis, found in self.axes.items():
            changed = [
                f"{one.name} {one.before:.4g} -> {one.after:.4g} {one.unit}"
                for one in self.quantities
                if one.axis == axis and one.changed
            ]
            lines.append(f"  {axis:<5}  {'; '.join((found, *changed))}")
        return "\n".join(lines) + ">"


def compare(before: Result, after: Result) -> Comparison:
    """Compare the models of two flights.

    Compared are the gains B, the rate damping in A, lag and delay. A quantity
    has changed if its two values differ by more than the root sum square of
    their 95 % half-widths, widened by Bonferroni's correction for the number
    of quantities [1]_ (with fourteen of them, the plain intervals would call
    every other unchanged vehicle changed), and of what differs between flights
    of one vehicle. Yaw is also given what another mean throttle can make of it, roll and pitch
    where the firmware does not undo the thrust curve.
    The rest of A (couplings, tilt, trim) depends on wind and manoeuvre and says nothing about a change.

    Parameters
    ----------
    before, after : Result

    Returns
    -------
    Comparison
        Only axes whose gain both flights know are compared, and only entries
        of A and B that both identify.

    Examples
    --------
    >>> import quadid_logs
    >>> r = quadid_logs.analyze("sample_logs/sysid-quad-x.bin")
    >>> quadid_logs.compare(r, r).verdict
    'same'

    References
    ----------
    .. [1] O. J. Dunn, "Multiple comparisons among means," J. Amer. Statist.
       Assoc., vol. 56, pp. 52-64, 1961.
    """
    both = (before, after)
    reasons = {axis: reason for axis in AXES if (reason := _obstacle(both, axis))}
    first, second = _models(before, after)
    if first is None and not reasons:
        reasons = dict.fromkeys(AXES, "no structure was fitted to both flights")
    found: list[Quantity] = []
    if first is not None and second is not None and len(reasons) < len(AXES):
        parameters = _parameters(first, second, reasons)
        means = [result.data.mean_throttle for result in (before, after)]
        change = means[1] / means[0] - 1.0 if min(means) > 0.0 else 0.0
        powers = throttle_powers(both)
        for each in parameters:
            # What the throttle alone may make of a value: two flights cannot hold the two apart.
            power = powers[each.axis] if each.is_on_axis else 0.0
            if power:
                spread = float(by_throttle(each.before, 1.0 + change, power))
                found.append(dataclasses.replace(each, throttle_change=change, throttle_spread=spread))
            else:
                found.append(each)
        found += _actuators(first, second)
    widening, quantities = _widening(len(found)), []
    for quantity in found:
        # The least difference that counts.
        halves = [0.5 * (high - low) for low, high in (quantity.ci95_before, quantity.ci95_after)]
        chance = math.hypot(widening * math.hypot(*halves), quantity.spread)
        quantities.append(dataclasses.replace(quantity, margin=chance + quantity.throttle_spread))
    axes: dict[str, AxisChange] = {}
    for axis in AXES:
        changed = any(quantity.changed for quantity in quantities if quantity.axis == axis)
        axes[axis] = "not comparable" if axis in reasons else "changed" if changed else "same"
    return Comparison(
        structure=first.structure if first is not None and found else "",
        quantities=tuple(quantities),
        axes=axes,
        reasons=reasons,
        advice=next_steps(
            (result.log, finding)
            for result in both
            for finding in result.diagnosis.findings
            if finding.level == "error" and reasons
        ),
        parameters=tuple(_differing(before.log, after.log)),
    )


def _differing(before: FlightLog, after: FlightLog) -> Iterator[ParameterDifference]:
    """Yield what differs between the parameters of two logs of one autopilot."""
    if before.autopilot != after.autopilot:
        return
    left_out = advice_for(before.autopilot).not_set_by_hand
    for name in sorted(before.parameters.keys() & after.parameters.keys()):
        one, two = before.parameters[name], after.parameters[name]
        if np.array_equal(one, two, equal_nan=True) or any(fnmatchcase(name, each) for each in left_out):
            continue
        yield ParameterDifference(name, one, two)


def _obstacle(both: tuple[Result, Result], axis: str) -> str:
    """Say why an axis cannot be compared, "" if it can."""
    unknown = [why_unknown(result, axis) for result in both]
    if all(unknown) and unknown[0] == unknown[1]:
        return f"in both flights {unknown[0]}"
    if any(unknown):
        named = zip(("before", "after"), unknown, strict=True)
        return "; ".join(f"{which}: {reason}" for which, reason in named if reason)
    before, after = both
    units = [result.data.input.unit if result.data.input else "" for result in both]
    if units[0] != units[1]:
        return (
            f"torque is in {_spoken(units[0])} before and in {_spoken(units[1])} after: describe the "
            "vehicle with --vehicle, or compare logs that were logged in the same way"
        )
    if units[0] == "1" and before.log.autopilot != after.log.autopilot:
        return "commands of different autopilots have different units: describe the vehicle with --vehicle"
    return ""


def why_unknown(result: Result, axis: str) -> str:
    """Say why a flight does not tell the gain of an axis.

    Parameters
    ----------
    result : Result
    axis : str

    Returns
    -------
    str
        "" if it does.
    """
    verdict = result.diagnosis.axes.get(axis)
    model = result.identification.recommended
    if verdict is None or verdict.verdict == "refused" or model is None:
        sentence = verdict.sentence if verdict else "there is no verdict"
        return continued(sentence).removesuffix(".")
    gain = model.entries.get(ON_AXIS[axis])
    if gain is None or not gain.identifiable:
        return f"the flight does not identify the effectiveness ({gain.reason if gain else 'not fitted'})"
    return ""


def _spoken(unit: str) -> str:
    return "N m" if unit == "N m" else "normalised command"


def _models(before: Result, after: Result) -> tuple[Model | None, Model | None]:
    """Return the models of one structure: that recommended for the first flight, else for the second."""
    for result in (before, after):
        recommended = result.identification.recommended
        if recommended is None:
            continue
        first, second = (
            next(
                (model for model in one.identification.models if model.structure == recommended.structure),
                None,
            )
            for one in (before, after)
        )
        if first is not None and second is not None:
            return first, second
    return None, None


def _parameters(first: Model, second: Model, reasons: Mapping[str, str]) -> Iterator[Quantity]:
    """Yield gains and damping that both models know, of axes without an obstacle."""
    before, after = first.entries, second.entries
    for number, axis in enumerate(AXES):
        target, rate = ACCELERATION_SYMBOLS[number], RATE_SYMBOLS[number]
        gain = before.get(ON_AXIS[axis])
        if axis in reasons or gain is None:
            continue
        for regressor in (*TORQUE_SYMBOLS, rate):
            one, two = before.get((target, regressor)), after.get((target, regressor))
            if one is None or two is None or not (_known(one) and _known(two)):
                continue
            scale = one
            if regressor != rate:
                # What a coupling is a fraction of: the larger on-axis gain of the two axes that it couples
                other = first.entries.get(ON_AXIS[AXES[TORQUE_SYMBOLS.index(regressor)]])
                scale = gain if other is None or abs(gain.value) >= abs(other.value) else other
            spread = DAMPING_SPREAD if regressor == rate else 0.0 if one is gain else COUPLING_SPREAD
            yield Quantity(
                name=one.name,
                axis=axis,
                unit=one.unit,
                before=one.value,
                after=two.value,
                ci95_before=one.ci95,
                ci95_after=two.ci95,
                spread=spread * abs(scale.value),
                scale=abs(scale.value),
                scale_name=scale.name,
                is_on_axis=one is gain,
                words=term_words(target, regressor),
                scale_words=term_words(scale.target, scale.regressor),
            )


def throttle_powers(results: Sequence[Result]) -> Mapping[str, float]:
    """Return by axis with which power of the throttle the effectiveness may grow.

    Parameters
    ----------
    results : sequence of Result
        Flights of one vehicle.

    Returns
    -------
    mapping of str to float
    """
    expos = [result.data.input.expo for result in results if result.data.input is not None]
    is_curved = any(expo is not None and expo.held is HeldScale.COMMAND for expo in expos)
    thrust = _THRUST_POWER if is_curved else 0.0
    return {"roll": thrust, "pitch": thrust, "yaw": _YAW_POWER}


def yaw_by_throttle(effectiveness: FloatArray | float, ratio: FloatArray | float) -> FloatArray:
    """Return what another mean throttle alone may make of the yaw effectiveness.

    Parameters
    ----------
    effectiveness : ndarray or float
        At one throttle.
    ratio : ndarray or float
        The other throttle, as a fraction of that one.

    Returns
    -------
    ndarray
        In the unit of `effectiveness`, not negative.
    """
    return by_throttle(effectiveness, ratio, _YAW_POWER)


def by_throttle(value: FloatArray | float, ratio: FloatArray | float, power: float) -> FloatArray:
    """Return what a ratio of throttles may make of a value that grows with a power of it, up or down.

    Parameters
    ----------
    value : ndarray or float
        At one throttle.
    ratio : ndarray or float
        The other throttle, as a fraction of that one.
    power : float

    Returns
    -------
    ndarray
        In the unit of ``value``, not negative.
    """
    return np.asarray((np.maximum(ratio, np.divide(1.0, ratio)) ** power - 1.0) * np.abs(value))


def _known(parameter: Parameter) -> bool:
    """Return whether a value has an interval, and the flight tells it."""
    bounded = all(math.isfinite(value) for value in (parameter.value, *parameter.ci95))
    return bounded and parameter.identifiable


def _actuators(first: Model, second: Model) -> Iterator[Quantity]:
    """Yield lag and delay of the actuators, in milliseconds."""
    if first.actuator is None or second.actuator is None:
        return
    one, two = first.actuator, second.actuator
    for name, values, intervals in (
        ("lag", (one.lag_s, two.lag_s), (one.lag_ci95_s, two.lag_ci95_s)),
        ("delay", (one.delay_s, two.delay_s), (one.delay_ci95_s, two.delay_ci95_s)),
    ):
        if all(math.isfinite(value) for value in (*values, *intervals[0], *intervals[1])):
            before, after = ((1e3 * low, 1e3 * high) for low, high in intervals)
            yield Quantity(
                name=name,
                axis="",
                unit="ms",
                before=1e3 * values[0],
                after=1e3 * values[1],
                ci95_before=before,
                ci95_after=after,
                spread=_TIME_SPREAD_MS,
                words=f"{name} of the actuators",
            )


def _widening(n_quantities: int) -> float:
    """Return by how much Bonferroni's correction widens a 95 % interval.

    >>> round(_widening(1), 3), round(_widening(20), 2)
    (1.0, 1.54)
    """
    from scipy.special import ndtri

    if not n_quantities:
        return 1.0
    return float(ndtri(1.0 - 0.5 * _FALSE_ALARMS / n_quantities) / ndtri(1.0 - 0.5 * _FALSE_ALARMS))
