"""Comparison of two flights: whether the vehicle changed significantly."""

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
#: Exit codes of the verb, for scripts.
EXIT_CODES: Final[Mapping[AxisChange, int]] = MappingProxyType({"same": 0, "changed": 1, "not comparable": 3})

#: Probability of a false "changed" for an unchanged vehicle, over all quantities together.
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

    ``axis`` is "" for lag and delay, which all axes share. ``ci95_before`` and ``ci95_after`` are the 95 %
    intervals. ``spread`` is the typical difference between flights of one vehicle, ``margin`` the smallest
    difference that counts as a change; both are in `unit`. Differences are stated as a fraction of ``scale``,
    the value of the parameter ``scale_name``. ``is_on_axis`` marks the effectiveness of an axis for the
    torque about it. ``words`` and ``scale_words`` name the two in plain words. ``throttle_change`` is the
    relative change of the mean throttle, ``throttle_spread`` its possible effect on the value, in `unit`.
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
        """Whether the difference is significant."""
        return abs(self.difference) > self.margin


class ParameterDifference(NamedTuple):
    """A parameter of the autopilot with different values at the ends of the two logs.

    Untrusted: escape the name before showing.
    """

    name: str
    before: float
    after: float


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Comparison:
    """The changes of a vehicle between two flights.

    Attributes
    ----------
    structure : str
        Structure of both models; "" if nothing could be compared.
    quantities : tuple of Quantity
        The numbers that were compared.
    axes : mapping of str to AxisChange
        Verdict by axis.
    reasons : mapping of str to str
        Why an axis could not be compared, by axis.
    advice : tuple of str
        What to set or fly so that such an axis can be compared.
    parameters : tuple of ParameterDifference
        Autopilot parameters that differ, sorted by name, without calibrations and counters.
    """

    structure: str
    quantities: tuple[Quantity, ...]
    axes: Mapping[str, AxisChange]
    reasons: Mapping[str, str]
    advice: tuple[str, ...]
    parameters: tuple[ParameterDifference, ...] = ()

    @property
    def verdict(self) -> AxisChange:
        """Verdict: "changed" if anything changed, "same" if every axis was compared and none changed."""
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

    The test covers the control effectiveness B, the rate damping in A, lag and delay. A quantity has changed
    if the difference of its values exceeds a margin: the root sum square of both 95 % half widths and of the
    typical difference between flights of one vehicle. The half widths are widened by Bonferroni's correction
    for the number of quantities [1]_. Without it, with fourteen quantities, every other unchanged vehicle
    would count as changed. For yaw, the margin includes the possible effect of another mean throttle; for
    roll and pitch too, if the firmware does not compensate the thrust curve. The rest of A (couplings, tilt,
    trim) depends on wind and manoeuvre, and is not tested.

    Parameters
    ----------
    before, after : Result

    Returns
    -------
    Comparison
        Contains axes whose effectiveness both flights identify, and elements of A and B that both identify.

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
    """Yield the differences between the parameters of two logs of one autopilot."""
    if before.autopilot != after.autopilot:
        return
    left_out = advice_for(before.autopilot).not_set_by_hand
    for name in sorted(before.parameters.keys() & after.parameters.keys()):
        one, two = before.parameters[name], after.parameters[name]
        if np.array_equal(one, two, equal_nan=True) or any(fnmatchcase(name, each) for each in left_out):
            continue
        yield ParameterDifference(name, one, two)


def _obstacle(both: tuple[Result, Result], axis: str) -> str:
    """Return why an axis cannot be compared, "" if it can."""
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
    """Return why a flight does not identify the effectiveness of an axis.

    Parameters
    ----------
    result : Result
    axis : str

    Returns
    -------
    str
        The reason; "" if the effectiveness is identified.
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
    """Return both models of one structure: that recommended for the first flight, else for the second."""
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
    """Yield effectiveness and damping that both models identify, for axes without an obstacle."""
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
    """Return, by axis, the largest power of the throttle that the effectiveness may grow with.

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
    """Return the largest change of the yaw effectiveness by another mean throttle.

    Parameters
    ----------
    effectiveness : ndarray or float
        Effectiveness at one throttle.
    ratio : ndarray or float
        The other throttle, as a fraction of that one.

    Returns
    -------
    ndarray
        Change in the unit of `effectiveness`, not negative.
    """
    return by_throttle(effectiveness, ratio, _YAW_POWER)


def by_throttle(value: FloatArray | float, ratio: FloatArray | float, power: float) -> FloatArray:
    """Return the largest change, up or down, of a value that grows with a power of the throttle.

    Parameters
    ----------
    value : ndarray or float
        Value at one throttle.
    ratio : ndarray or float
        The other throttle, as a fraction of that one.
    power : float
        Exponent of the throttle.

    Returns
    -------
    ndarray
        Change in the unit of ``value``, not negative.
    """
    return np.asarray((np.maximum(ratio, np.divide(1.0, ratio)) ** power - 1.0) * np.abs(value))


def _known(parameter: Parameter) -> bool:
    """Return whether a parameter is identifiable, with a finite interval."""
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
    """Return the factor by which Bonferroni's correction widens a 95 % interval.

    >>> round(_widening(1), 3), round(_widening(20), 2)
    (1.0, 1.54)
    """
    from scipy.special import ndtri

    if not n_quantities:
        return 1.0
    return float(ndtri(1.0 - 0.5 * _FALSE_ALARMS / n_quantities) / ndtri(1.0 - 0.5 * _FALSE_ALARMS))
