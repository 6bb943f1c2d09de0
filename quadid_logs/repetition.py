"""Repeatability of several flights: whether flights of one vehicle in one state agree."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Literal

import numpy as np

from quadid_logs.align.pool import copies
from quadid_logs.comparison import throttle_powers
from quadid_logs.control.next_flight import DAMPING_SPREAD, TIME_SPREAD_S
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Model, Parameter
from quadid_logs.data.result import Result
from quadid_logs.diagnose.advice import next_steps
from quadid_logs.errors import SettingsError
from quadid_logs.maths.multiple_tests import adjusted, two_sided
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.random_effect import RandomEffectMean, random_effect, random_effect_mean
from quadid_logs.sentences import continued
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, ON_AXIS, RATE_SYMBOLS, term_words

Agreement = Literal["agree", "differ", "not comparable"]
Kind = Literal["effectiveness", "damping", "lag", "delay"]

#: Probability of a false difference between equal flights, over all pairs and quantities.
_FALSE_ALARMS = 0.05
#: With two flights that differ, the outlier cannot be determined.
_FEWEST_OTHERS = 2
#: With this relative half width, the interval of the effectiveness reaches zero and its sign is unknown.
_WIDEST = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightEstimate:
    """The estimate of a quantity from one flight.

    ``flight`` is the index of the log. ``half_width`` is half of the estimate's 95 % interval; ``allowed`` is
    the same including the typical differences between flights of one vehicle (air, throttle). ``predicted``
    is the prediction from the other flights. ``predicted_half_width`` is half of its 95 % interval, including
    the error of this flight and the difference between flights. The two are NaN and infinite if fewer than
    two other flights give the quantity.
    """

    flight: int
    value: float
    half_width: float
    allowed: float
    predicted: float = math.nan
    predicted_half_width: float = math.inf

    @property
    def held(self) -> bool | None:
        """Whether the interval predicted from the other flights contains this value; None without one."""
        if not math.isfinite(self.predicted_half_width):
            return None
        return abs(self.value - self.predicted) <= self.predicted_half_width


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """Two flights: difference over its standard deviation, and p-value corrected over all pairs (Holm)."""

    flights: tuple[int, int]
    z: float
    p_value: float

    @property
    def differs(self) -> bool:
        """Whether the difference is significant."""
        return self.p_value < _FALSE_ALARMS


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlier:
    """A flight that differs from the others, which agree among themselves.

    ``difference`` is in the unit of the quantity. ``p_value`` is corrected over all flights and quantities
    (Holm).
    """

    flight: int
    difference: float
    p_value: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RepeatedQuantity:
    """One number of the model in all flights that identify it.

    Attributes
    ----------
    name, kind, axis, unit, words : str
        ``axis`` is "" for lag and delay, which all axes share.
    estimates : tuple of FlightEstimate
        Estimates by flight.
    mean : RandomEffectMean
        Mean over the flights, with the standard deviation between flights.
    p_value : float
        P-value of Cochran's test that all flights have one value.
    pairs : tuple of Pair
        Tests of pairs of flights.
    outliers : tuple of Outlier
        Flights that differ from the others.
    """

    name: str
    kind: Kind
    axis: str
    unit: str
    words: str
    estimates: tuple[FlightEstimate, ...]
    mean: RandomEffectMean
    p_value: float
    pairs: tuple[Pair, ...] = ()
    outliers: tuple[Outlier, ...] = ()

    @property
    def differs(self) -> bool:
        """Whether two flights, or one flight and the others, differ significantly."""
        return bool(self.outliers) or any(pair.differs for pair in self.pairs)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Repeatability:
    """The agreement of several flights.

    Attributes
    ----------
    flights : tuple of str
        Paths of the logs, in the given order.
    structure : str
        Structure of all models; "" if there is none.
    quantities : tuple of RepeatedQuantity
        Quantities that at least two flights identify.
    axes : mapping of str to Agreement
        Verdict by axis.
    reasons : tuple of mapping of str to str
        For each flight, by axis: why the axis is not identified.
    strangers : mapping of int to str
        Index of each flight whose log names another vehicle, and the evidence. Untrusted text.
    advice : tuple of str
        What to set or fly so that more flights can be compared.
    """

    flights: tuple[str, ...]
    structure: str
    quantities: tuple[RepeatedQuantity, ...]
    axes: Mapping[str, Agreement]
    reasons: tuple[Mapping[str, str], ...]
    strangers: Mapping[int, str]
    advice: tuple[str, ...]

    @property
    def verdict(self) -> Agreement:
        """Verdict: "differ" if anything differs, "agree" if every axis was compared and none differs."""
        if self.strangers or any(quantity.differs for quantity in self.quantities):
            return "differ"
        return "agree" if set(self.axes.values()) == {"agree"} else "not comparable"

    @property
    def left_out(self) -> tuple[int, int]:
        """Number of estimates inside the interval predicted from the others, and number of predictions."""
        held = [one.held for each in self.quantities for one in each.estimates if one.held is not None]
        return sum(held), len(held)

    def __repr__(self) -> str:
        lines = [f"<Repeatability of {len(self.flights)} flights: {self.verdict}"]
        lines += [f"  {axis:<5}  {found}" for axis, found in self.axes.items()]
        return "\n".join(lines) + ">"


def repeat(results: Sequence[Result]) -> Repeatability:
    """Test whether several flights of one vehicle in one state agree.

    Parameters
    ----------
    results : sequence of Result
        Two or more results. A flight that is given twice counts once.

    Raises
    ------
    SettingsError
        If there are fewer than two results, or their torques are not the same quantity.

    Notes
    -----
    The statistic of a pair is the difference of its values over the root sum square of their standard
    deviations. Holm's correction covers all pairs and quantities. A flight is an outlier if it differs
    significantly from the mean of the others, allowing for their spread, while no two of these differ. Each
    flight is predicted from the others: from their mean, the standard deviation between flights, and the
    flight's own error (`quadid_logs.maths.random_effect.random_effect_mean`). The intervals of damping, lag
    and delay include their typical differences between flights of one vehicle. The interval of the
    effectiveness includes the possible effect of the throttle, as in `quadid_logs.comparison.compare`.

    Examples
    --------
    >>> import quadid_logs
    >>> r = quadid_logs.analyze("sample_logs/sysid-quad-x.bin")
    >>> quadid_logs.repeat([r, r]).verdict
    'not comparable'
    """
    # Refuse flights that cannot be compared.
    if len(results) < 2:
        raise SettingsError(
            "One flight cannot be compared with itself.", hint="Name two logs or more of one vehicle."
        )
    kinds = {(result.data.input.unit, result.log.autopilot) for result in results if result.data.input}
    units = {unit for unit, _autopilot in kinds}
    if len(units) > 1:
        raise SettingsError(
            "One log holds torque in N m, the other a normalised command.",
            hint="Describe the vehicle with --vehicle, or compare logs that were logged in the same way.",
        )
    if units == {"1"} and len(kinds) > 1:
        raise SettingsError(
            "Commands of different autopilots have different units.",
            hint="Describe the vehicle with --vehicle.",
        )
    # The structure that is recommended most often; the first of several.
    recommended = [result.identification.recommended for result in results]
    names = Counter(model.structure for model in recommended if model is not None)
    structure = names.most_common(1)[0][0] if names else ""
    same = copies([result.data for result in results])
    # By axis, why a flight does not identify the effectiveness.
    reasons = tuple(
        dict.fromkeys(AXES, f"it repeats the flight of log {same[place] + 1}")
        if place in same
        else {axis: reason for axis in AXES if (reason := _why_unknown(result, structure, axis))}
        for place, result in enumerate(results)
    )
    found = [each for each in _quantities(results, structure, reasons) if len(each.estimates) > 1]
    quantities = tuple(_tested(found))
    # It takes two flights that tell its effectiveness to compare an axis.
    axes: dict[str, Agreement] = {}
    for axis in AXES:
        own = [each for each in quantities if each.axis == axis]
        if not any(each.kind == "effectiveness" for each in own):
            axes[axis] = "not comparable"
        else:
            axes[axis] = "differ" if any(each.differs for each in own) else "agree"
    return Repeatability(
        flights=tuple(result.log.path for result in results),
        structure=structure if quantities else "",
        quantities=quantities,
        axes=axes,
        reasons=reasons,
        strangers=strangers([result.log for result in results]),
        advice=next_steps(
            (result.log, finding)
            for result, why in zip(results, reasons, strict=True)
            for finding in result.diagnosis.findings
            if finding.level == "error" and why
        ),
    )


def _model(result: Result, structure: str) -> Model | None:
    return next((each for each in result.identification.models if each.structure == structure), None)


def _why_unknown(result: Result, structure: str, axis: str) -> str:
    """Return why a flight does not identify the effectiveness of an axis, "" if it does.

    A wide interval is accepted as long as it excludes zero: its weight is small.
    """
    verdict, model = result.diagnosis.axes.get(axis), _model(result, structure)
    if verdict is None or verdict.verdict == "refused" or model is None:
        return continued(verdict.sentence if verdict else "there is no verdict").removesuffix(".")
    gain = model.entries.get(ON_AXIS[axis])
    if gain is None:
        return "it was not fitted"
    return "" if _half_width(gain.ci95) < _WIDEST * abs(gain.value) else "its interval is too wide"


def _half_width(ci95: tuple[float, float]) -> float:
    return 0.5 * (ci95[1] - ci95[0])


def _quantities(
    results: Sequence[Result], structure: str, reasons: Sequence[Mapping[str, str]]
) -> Iterator[RepeatedQuantity]:
    """Yield effectiveness and damping by axis, lag and delay."""
    models = [_model(result, structure) for result in results]
    # The mean throttle of each flight over the median of the flights; 1 if not known.
    means = np.array([result.data.mean_throttle for result in results])
    told = means > 0.0
    ratio = np.where(told, means / np.median(means[told]), 1.0) if told.any() else np.ones(means.size)
    for axis, power in throttle_powers(results).items():
        trusted = [None if axis in why else model for why, model in zip(reasons, models, strict=True)]
        # The possible relative effect of the throttle on each effectiveness.
        by_throttle = np.maximum(ratio, 1.0 / ratio) ** power - 1.0
        on_axis = _told(trusted, ON_AXIS[axis])
        estimates = [
            _estimate(flight, each.value, each.ci95, alike=abs(each.value) * float(by_throttle[flight]))
            for flight, each in on_axis.items()
        ]
        yield _quantity("effectiveness", axis, *_words(on_axis), estimates)
        yield _damping(axis, trusted)
    # If no axis of a flight is usable, its actuator is not usable either.
    trusted = [None if len(why) == len(AXES) else model for why, model in zip(reasons, models, strict=True)]
    yield from _actuators(trusted)


def _damping(axis: str, models: Sequence[Model | None]) -> RepeatedQuantity:
    """Return the damping of an axis where it is identified."""
    target, _torque = ON_AXIS[axis]
    told = _told(models, (target, RATE_SYMBOLS[ACCELERATION_SYMBOLS.index(target)]))
    told = {flight: each for flight, each in told.items() if each.identifiable}
    size = float(np.median([abs(each.value) for each in told.values()])) if told else 0.0
    estimates = [
        _estimate(flight, each.value, each.ci95, spread=DAMPING_SPREAD * size)
        for flight, each in told.items()
    ]
    return _quantity("damping", axis, *_words(told), estimates)


def _told(models: Sequence[Model | None], entry: tuple[str, str]) -> dict[int, Parameter]:
    """Return an element of the models by flight, for flights that identify it."""
    found = {}
    for flight, model in enumerate(models):
        each = None if model is None else model.entries.get(entry)
        if each is not None and math.isfinite(_half_width(each.ci95)):
            found[flight] = each
    return found


def _words(told: Mapping[int, Parameter]) -> tuple[str, str, str]:
    """Return name, unit and words of an element; empty if no flight has it."""
    return next(
        ((each.name, each.unit, term_words(each.target, each.regressor)) for each in told.values()), ("",) * 3
    )


def _actuators(models: Sequence[Model | None]) -> Iterator[RepeatedQuantity]:
    """Yield lag and delay."""
    actuators = {
        flight: model.actuator
        for flight, model in enumerate(models)
        if model is not None and model.actuator is not None
    }
    kinds: tuple[Literal["lag", "delay"], ...] = ("lag", "delay")
    for kind in kinds:
        estimates = []
        for flight, each in actuators.items():
            value, ci95 = (
                (each.lag_s, each.lag_ci95_s) if kind == "lag" else (each.delay_s, each.delay_ci95_s)
            )
            if math.isfinite(value) and math.isfinite(_half_width(ci95)):
                in_ms = (1e3 * ci95[0], 1e3 * ci95[1])
                estimates.append(_estimate(flight, 1e3 * value, in_ms, spread=1e3 * TIME_SPREAD_S))
        yield _quantity(kind, "", kind, "ms", f"{kind} of the actuators", estimates)


def _estimate(
    flight: int, value: float, ci95: tuple[float, float], *, spread: float = 0.0, alike: float = 0.0
) -> FlightEstimate:
    """Return the estimate of a flight; ``spread`` is that of a difference of two, ``alike`` is a bias."""
    own = _half_width(ci95)
    return FlightEstimate(
        flight=flight, value=value, half_width=own, allowed=math.hypot(own, spread / math.sqrt(2.0)) + alike
    )


def _quantity(
    kind: Kind, axis: str, name: str, unit: str, words: str, estimates: Sequence[FlightEstimate]
) -> RepeatedQuantity:
    """Return a quantity with its mean and the prediction of each flight from the others."""
    value = np.array([each.value for each in estimates])
    allowed = np.array([each.allowed for each in estimates])
    predicted = []
    for place, each in enumerate(estimates):
        others = random_effect_mean(np.delete(value, place), np.delete(allowed, place))
        if len(estimates) > _FEWEST_OTHERS:
            half_width = math.hypot(others.next_half_width, each.allowed)
            each = replace(each, predicted=others.value, predicted_half_width=half_width)
        predicted.append(each)
    return RepeatedQuantity(
        name=name,
        kind=kind,
        axis=axis,
        unit=unit,
        words=words,
        estimates=tuple(predicted),
        mean=random_effect_mean(value, allowed),
        p_value=random_effect(value, allowed).p_value,
    )


def _tested(quantities: Sequence[RepeatedQuantity]) -> Iterator[RepeatedQuantity]:
    """Yield quantities with their pairs and outliers, corrected for all tests."""
    # The difference of each pair over its standard deviation.
    pairs = [
        {
            (one.flight, two.flight): NORMAL_95
            * (two.value - one.value)
            / math.hypot(one.allowed, two.allowed)
            for one, two in combinations(each.estimates, 2)
        }
        for each in quantities
    ]
    adjusted = _adjusted(pairs)
    told_pairs = [
        tuple(
            Pair(flights=flights, z=z, p_value=p)
            for (flights, z), p in zip(each.items(), p_values, strict=True)
        )
        for each, p_values in zip(pairs, adjusted, strict=True)
    ]
    # By flight its difference from the mean of the others over its standard deviation.
    outliers: list[dict[int, float]] = [{} for _ in quantities]
    for each, found in zip(quantities, outliers, strict=True):
        if len(each.estimates) > _FEWEST_OTHERS:
            for one in each.estimates:
                difference, half_width = _from_others(each.estimates, one.flight)
                found[one.flight] = NORMAL_95 * difference / half_width
    adjusted = _adjusted(outliers)
    for quantity, own_pairs, found, p_values in zip(quantities, told_pairs, outliers, adjusted, strict=True):
        told = tuple(
            Outlier(flight=flight, difference=_from_others(quantity.estimates, flight)[0], p_value=p)
            for (flight, _z), p in zip(found.items(), p_values, strict=True)
            if p < _FALSE_ALARMS and not any(pair.differs for pair in own_pairs if flight not in pair.flights)
        )
        # With two candidates that both leave the others in agreement, the outlier cannot be determined.
        yield replace(quantity, pairs=own_pairs, outliers=told if len(told) == 1 else ())


def _adjusted(families: Sequence[Mapping[Any, float]]) -> list[list[float]]:
    """Return the p-values of z-values, corrected over all families together."""
    z = np.array([value for each in families for value in each.values()])
    corrected = iter(adjusted(two_sided(z)).tolist())
    return [[next(corrected) for _ in each] for each in families]


def _from_others(estimates: Sequence[FlightEstimate], flight: int) -> tuple[float, float]:
    """Return the difference of a flight from the mean of the others, and half of its 95 % interval."""
    (own,) = (each for each in estimates if each.flight == flight)
    value = np.array([each.value for each in estimates if each is not own])
    variance = np.array([each.allowed**2 for each in estimates if each is not own])
    sd = random_effect(value, np.sqrt(variance)).sd
    weight = 1.0 / (variance + (NORMAL_95 * sd) ** 2)
    squared = own.allowed**2 + (NORMAL_95 * sd) ** 2 + 1.0 / float(weight.sum())
    return own.value - float(np.average(value, weights=weight)), math.sqrt(squared)


def strangers(logs: Sequence[FlightLog]) -> dict[int, str]:
    """Return the logs that name another vehicle than most logs, by index, with the evidence.

    Missing information does not make a log one of another vehicle. Names and frames come from the log:
    untrusted text.
    """
    found: dict[int, list[str]] = {}
    for words, tell in _IDENTITY:
        told = [tell(log).strip() for log in logs]
        known = Counter(each for each in told if each)
        if len(known) < 2:
            continue
        most = known.most_common(1)[0][0]
        for place, each in enumerate(told):
            if each and each != most:
                found.setdefault(place, []).append(f"{words} {each} instead of {most}")
    return {place: ", ".join(found[place]) for place in sorted(found)}


#: The properties that identify a vehicle. The firmware is not one of them: it is updated.
_IDENTITY: tuple[tuple[str, Callable[[FlightLog], str]], ...] = (
    ("autopilot", lambda log: log.autopilot),
    ("hardware id", lambda log: log.hardware_id),
    ("name", lambda log: "" if log.systems else log.vehicle_name),
    ("type", lambda log: "" if log.vehicle_type == "unknown" else log.vehicle_type),
    ("frame", lambda log: log.frame),
)
