"""The shape of the thrust curve, found in flight: the expo that the torque should have been rebuilt with.

Torque is rebuilt from motor commands by the thrust curve that the firmware believes. If the propellers
have another expo, thrust is F + k F', with F' the derivative by the expo less what only changes the scale:
the torque is linear in k, which is fitted together with lag and delay (Gauss-Newton). What
tells k is how the effectiveness changes with thrust: throttle that varies, and rotors that two axes
command at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData, InputDescription, Segment
from quadid_logs.data.model import ThrustCurve
from quadid_logs.data.torque import AssumedExpo, HeldScale
from quadid_logs.identify.actuator import ActuatorFit, fit_actuator
from quadid_logs.identify.design import Design
from quadid_logs.identify.equation_by_equation import INFORMATIVE_R2
from quadid_logs.identify.excitation import excited_axes
from quadid_logs.identify.fit import explained_fraction
from quadid_logs.identify.inference import TorqueUnknowns, clusters_of, covariance_95, torque_effects
from quadid_logs.identify.instruments import Projection
from quadid_logs.identify.rotors import (
    MOST_ASYMMETRIC,
    Rotors,
    per_rotor,
    rotor_slopes,
    rotors_known,
    with_lag_on_rotors,
)
from quadid_logs.identify.structures import DAMPED
from quadid_logs.identify.terms import TRIM
from quadid_logs.identify.torque import RowTorque
from quadid_logs.identify.torque_errors import battery_errors, sampling_errors, torques_by_expo
from quadid_logs.identify.torque_products import MAX_DELAY_S, MAX_LAG_S
from quadid_logs.maths.least_squares import Equation
from quadid_logs.maths.thrust_curve import mean_while_moved, slope_at, slopes_at
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, TORQUE_SYMBOLS

#: Thrust stands show curves that leave the parabola by one or two hundredths of full thrust: the best
#: parabola over another range of throttle has an expo that differs by this.
EXPO_SYSTEMATIC: Final = 0.02
#: Between the least and the most thrust of a flight, other effects (air, battery under load, rotors that are
#: quicker at speed) are taken to change the effectiveness by up to this, at 95 %. That is judged from two
#: flights alone: their thrust varied by 7 %, and the expo was 0.17 and 0.24 off, as a change by about 1 %
#: would make it. Only a range of thrust tells the two apart.
_OTHER_CHANGE: Final = 0.02
#: What to fly, as a factor of the thrust: then the above leaves less than 0.1 of an expo.
_THRUST_TO_FLY: Final = 1.5
#: Half width beyond which an expo is no answer: a quarter of the range in which propellers lie.
_MOST_HALF_WIDTH: Final = 0.15
#: Propellers measured on stands lie here, most of them (0.2 to 0.8, see docs/method.md).
_PROPELLERS: Final = (0.2, 0.8)
#: Nothing that turns in air has less or more; what is found beyond is another effect of throttle.
_POSSIBLE: Final = (-0.25, 1.25)
#: Yaw is the rotors' drag, which goes with throttle in a way of its own, and their reaction.
_TILTING: Final = (0, 1)
#: Below [s], the lag of a rotor moves no torque by as much as can be seen.
_LEAST_LAG_S: Final = 0.002
#: Gauss-Newton needs three steps from a lag on the torque; a step of this size is a tenth of any interval.
_MOST_STEPS, _SMALL = 8, 2e-3
#: Relative squared error by which a lag on the rotors must be the worse to act on the torque instead.
_WORSE: Final = 1e-3
#: Quantiles of the thrust that was flown, and points between them for the effectiveness against thrust.
_FLOWN_QUANTILES, _N_POINTS = (0.02, 0.98), 7


class _Point(NamedTuple):
    """What is searched for: k, lag and delay [s], logarithm of the rotors' asymmetry; None on the torque."""

    shift: float
    lag_s: float
    delay_s: float
    log_asymmetry: float | None

    def moved(self, by: Mapping[str, float]) -> _Point:
        """Return the point after a step, inside the physical range."""
        limit, asymmetry = float(np.log(MOST_ASYMMETRIC)), self.log_asymmetry
        return _Point(
            self.shift + by["expo"],
            float(np.clip(self.lag_s + by.get("lag", 0.0), 0.0, MAX_LAG_S)),
            float(np.clip(self.delay_s + by["delay"], 0.0, MAX_DELAY_S)),
            None
            if asymmetry is None
            else float(np.clip(asymmetry + by.get("asymmetry", 0.0), -limit, limit)),
        )


class _Linear:
    """The equations of the informative axes about a point: residuals, and columns that all have in common.

    Attributes
    ----------
    fixed : ndarray, shape (n_train, n_columns)
        The regressors of each axis.
    residual : ndarray, shape (n_train, 3)
    explained : ndarray, shape (n_instruments, 3)
        What of the residual follows from the instruments.
    B : ndarray, shape (3, 3)
    chunks : list of Segment
        With the torque of that k.
    """

    def __init__(self, search: _Search, point: _Point) -> None:
        self._search, self._point = search, point
        design, described, train = search.design, search.described, search.design.train
        lag_s, delay_s = point.lag_s, point.delay_s
        self.chunks = [shifted(chunk, described, point.shift) for chunk in design.chunks]
        self._base = replace(design, chunks=tuple(self.chunks))
        shaped = (
            self._base.with_torque([chunk.torque for chunk in self.chunks])
            if point.log_asymmetry is None
            else with_lag_on_rotors(self._base, described, self._rotors(point.log_asymmetry))
        )
        self._shaped, self._by_expo = shaped, search.by_expo.behind(lag_s, delay_s)
        # Squares of thrust follow from no set-point linearly: they are instruments themselves.
        self._project = Projection(design, DAMPED, train, also=self._by_expo)
        names = [name for name in (*DAMPED.columns, *design.disturbances(DAMPED)) if name != TRIM.symbol]
        columns = shaped.stack(names, shaped.torque.behind(lag_s, delay_s))[train]
        targets = np.column_stack([design.columns[name] for name in ACCELERATION_SYMBOLS])[train]
        self.fixed = self._project(columns)
        scale = np.linalg.norm(self.fixed, axis=0)
        theta = np.linalg.lstsq(self.fixed / scale, targets, rcond=None)[0] / scale[:, np.newaxis]
        self.B = theta[[names.index(name) for name in TORQUE_SYMBOLS]].T
        self.residual = targets - columns @ theta
        self.explained = self._project.coordinates(self.residual)

    def _rotors(self, log_asymmetry: float) -> Rotors:
        return Rotors.of(max(self._point.lag_s, _LEAST_LAG_S), log_asymmetry)

    @cached_property
    def shared(self) -> Mapping[str, FloatArray]:
        """The derivatives by k, lag, delay and asymmetry, by name, each (n_train, 3).

        They cost more than all else, and a step that leads uphill needs none.
        """
        search, point = self._search, self._point
        slopes = None
        if point.log_asymmetry is not None:
            slopes = rotor_slopes(self._base, search.described, self._rotors(point.log_asymmetry))
        actuator = search.start._replace(lag_s=point.lag_s, delay_s=point.delay_s)
        effects = torque_effects(self._shaped, actuator, self.B, TorqueUnknowns(slopes), self._project)
        by_expo = self._project(self._by_expo[search.design.train] @ self.B.T)
        return {"expo": by_expo, **effects.shared}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Search:
    """Rows of the fit, the axes that count, and the best actuator as if the expo were right.

    ``by_expo`` is the derivative of the torque by k.
    """

    design: Design
    described: InputDescription
    axes: Sequence[int]
    start: ActuatorFit
    by_expo: RowTorque

    def least(self, *, on_rotors: bool) -> tuple[_Point, _Linear]:
        """Return the point of least error, and the equations about it."""
        point = _Point(0.0, self.start.lag_s, self.start.delay_s, 0.0 if on_rotors else None)
        linear = _Linear(self, point)
        step = self._step(linear)
        for _ in range(_MOST_STEPS):
            ahead = point.moved(step)
            tried = _Linear(self, ahead)
            if abs(step["expo"]) < _SMALL:
                return ahead, tried
            if self._misfit(tried, linear) < self._misfit(linear, linear):
                point, linear = ahead, tried
                step = self._step(linear)
            else:
                # As far as the equations are straight: half of a step that leads uphill, and so on.
                step = {name: 0.5 * each for name, each in step.items()}
        return point, linear

    def _misfit(self, linear: _Linear, weighted_by: _Linear) -> float:
        """Return the weighted squares that a step makes less, as far as they follow from the instruments."""
        weight = self._weight(weighted_by)
        return float(np.sum((weight * linear.explained[:, list(self.axes)]) ** 2))

    def _step(self, linear: _Linear) -> dict[str, float]:
        """Return the step to the least squares of the linear equations."""
        basis, _ = np.linalg.qr(linear.fixed)
        parts = []
        for axis, weight in zip(self.axes, self._weight(linear), strict=True):
            both = np.column_stack(
                [*(each[:, axis] for each in linear.shared.values()), linear.residual[:, axis]]
            )
            parts.append(weight * (both - basis @ (basis.T @ both)))
        rows = np.concatenate(parts)
        scale = np.linalg.norm(rows[:, :-1], axis=0)
        scale[scale == 0.0] = 1.0
        step = np.linalg.lstsq(rows[:, :-1] / scale, rows[:, -1], rcond=1e-6)[0] / scale
        return dict(zip(linear.shared, step.tolist(), strict=True))

    def _weight(self, linear: _Linear) -> FloatArray:
        """Return one over the residual's size, of the axes that count."""
        size = np.sqrt(np.mean(linear.residual[:, list(self.axes)] ** 2, axis=0))
        return np.asarray(1.0 / np.maximum(size, 1e-12))

    def loss(self, linear: _Linear) -> float:
        """Return the logarithm of the squared error, mean over the axes that count."""
        return float(-2.0 * np.mean(np.log(self._weight(linear))))

    def half_width(self, point: _Point, linear: _Linear) -> float:
        """Return the half width of the 95 % interval of k."""
        axes, design, n = list(self.axes), self.design, linear.fixed.shape[1]
        weight, n_shared = self._weight(linear), len(linear.shared)
        equations = [
            Equation(
                np.column_stack([*(each[:, axis] for each in linear.shared.values()), linear.fixed]) * one,
                linear.residual[:, axis] * one,
                np.concatenate([np.arange(n_shared), n_shared + number * n + np.arange(n)]),
            )
            for number, (axis, one) in enumerate(zip(axes, weight, strict=True))
        ]
        base = design.with_chunks(linear.chunks)
        errors = battery_errors(base)
        if not self.described.every_step:
            errors += sampling_errors(base)
        made = [each.behind(point.lag_s, point.delay_s)[design.train] @ linear.B.T for each in errors]
        of_errors = np.stack(made, axis=2)[:, axes] * weight[:, np.newaxis]
        nothing = np.zeros(n_shared + n * len(axes))
        covariance = covariance_95(equations, clusters_of(design), of_errors, nothing)
        return float(np.sqrt(max(covariance[0, 0], 0.0)))


def fit_thrust_curve(
    data: FlightData, whole: Design, high_pass_hz: float, *, hidden_by: str = ""
) -> tuple[FlightData, Design, ThrustCurve | None]:
    """Find the expo of the thrust curve, and rebuild the torque where the assumed one is not it.

    Parameters
    ----------
    data : FlightData
    whole : Design
        Its rows, not high-passed.
    high_pass_hz : float
    hidden_by : str
        What else this flight shows that looks like another expo: none is looked for then.

    Returns
    -------
    data : FlightData
    whole : Design
        Both with torque and thrust of the expo that was found, or those they had; the data's input
        says how far the expo is known.
    curve : ThrustCurve or None
        None where the torque was rebuilt from no assumed curve.
    """
    described = data.input
    if described is None or described.expo is None or not rotors_known(data):
        return data, whole, None
    if any(segment.thrust_by_expo is None for segment in data.segments):
        return data, whole, None
    expo, scale = described.expo, _scale_change(data, described.expo)
    data = replace(data, segments=tuple(_normalised(each, scale) for each in data.segments))
    whole = whole.with_chunks([_normalised(each, scale) for each in whole.chunks])
    found = (
        _Found(0.0, np.inf, hidden_by)
        if hidden_by
        else _with_other_changes(_search(whole.high_passed(high_pass_hz), described), data)
    )
    curve, shift, half_width = _judged(expo, found, scale)
    corrected = replace(expo, value=curve.expo, half_width=half_width)
    curve = _with_effectiveness(curve, data, shift, half_width)
    segments = tuple(shifted(each, described, shift) for each in data.segments)
    data = replace(data, segments=segments, input=replace(described, expo=corrected))
    whole = whole.with_chunks([shifted(each, described, shift) for each in whole.chunks])
    return data, whole, curve


def shifted(segment: Segment, described: InputDescription, shift: float) -> Segment:
    """Return a segment with torque and thrust of another expo.

    Parameters
    ----------
    segment : Segment
        Its ``thrust_by_expo`` without what only changes the scale.
    described : InputDescription
    shift : float
        k, of which torque is a linear function [1].

    Returns
    -------
    Segment
    """
    if not shift or segment.rotor_thrust is None or segment.thrust_by_expo is None:
        return segment
    thrust = np.clip(segment.rotor_thrust + shift * segment.thrust_by_expo, 0.0, None)
    (change,) = torques_by_expo([segment], described)
    return replace(segment, rotor_thrust=thrust, torque=segment.torque + shift * change)


def with_expo(data: FlightData, expo: float) -> FlightData:
    """Return a flight with the torque of another expo of its thrust curve.

    Parameters
    ----------
    data : FlightData
    expo : float

    Returns
    -------
    FlightData
        The same where no expo was assumed, or it was this one.
    """
    described = data.input
    if described is None or described.expo is None or described.expo.value == expo:
        return data
    if any(each.thrust_by_expo is None for each in data.segments):
        return data
    scale, change = _scale_change(data, described.expo), expo - described.expo.value
    shift = change / (1.0 + scale * change)  # the inverse of `_expo_change`
    segments = (shifted(_normalised(each, scale), described, shift) for each in data.segments)
    corrected = replace(described, expo=replace(described.expo, value=expo))
    return replace(data, segments=tuple(segments), input=corrected)


class _Found(NamedTuple):
    """k and the half width of its 95 % interval; infinite with the reason where it cannot be told."""

    shift: float
    half_width: float
    reason: str = ""
    thrust_ratio: float = float("nan")


def _with_other_changes(found: _Found, data: FlightData) -> _Found:
    """Widen the interval by what else may change the effectiveness from low to high thrust.

    Effectiveness goes with 1 + k dF'/dF: the difference of that slope over the flown thrust is the lever.
    """
    low, high = np.quantile(_collective(data), _FLOWN_QUANTILES)
    slopes = slopes_at(*per_rotor(data.segments), np.array([low, high]))
    lever = float(abs(slopes[1] - slopes[0]))
    by_others = _OTHER_CHANGE / lever if lever > 0.0 else np.inf
    half_width = float(np.hypot(found.half_width, by_others))
    return found._replace(half_width=half_width, thrust_ratio=float(high / low) if low > 0.0 else np.inf)


def _search(design: Design, described: InputDescription) -> _Found:
    """Search on the axes whose motion the model explains, with the lag where it explains them better."""
    axes = [axis for axis in excited_axes(design) if axis in _TILTING]
    by_expo = design.torque.replaced(torques_by_expo(design.chunks, described))
    while axes:
        start = fit_actuator(design, DAMPED, axes)
        search = _Search(design=design, described=described, axes=axes, start=start, by_expo=by_expo)
        point, linear = search.least(on_rotors=False)
        if search.start.lag_s >= _LEAST_LAG_S:
            other = search.least(on_rotors=True)
            if search.loss(other[1]) <= search.loss(linear) + _WORSE:
                point, linear = other
        targets = np.column_stack([design.columns[name] for name in ACCELERATION_SYMBOLS])[design.train]
        r2 = explained_fraction(targets, linear.residual)
        informative = [axis for axis in axes if r2[axis] >= INFORMATIVE_R2]
        if informative == axes:
            if point.lag_s >= MAX_LAG_S or point.delay_s >= MAX_DELAY_S:
                return _Found(0.0, np.inf, "no lag of a rotor explains the flight")
            return _Found(point.shift, search.half_width(point, linear))
        axes = informative
    return _Found(
        0.0, np.inf, "roll and pitch move too little, or the model explains too little of how they do"
    )


def _judged(expo: AssumedExpo, found: _Found, scale: float) -> tuple[ThrustCurve, float, float]:
    """Decide what is known of the expo; return also the k to apply, and how far it may be off (95 %)."""
    value, one, other = (
        expo.value + _expo_change(found.shift + sign * found.half_width, scale) for sign in (0.0, -1.0, 1.0)
    )
    half = max(abs(one - value), abs(other - value)) + EXPO_SYSTEMATIC
    reason = found.reason
    if not reason and not half <= _MOST_HALF_WIDTH:
        varied = f"thrust varied by a factor of {found.thrust_ratio:.3g}"
        enough = found.thrust_ratio >= _THRUST_TO_FLY
        reason = (
            f"{varied}, but other effects on roll and pitch hide the curve: in calm air, move the sticks "
            "while you climb and descend"
            if enough
            else (
                f"{varied}, which is too little: climb and descend so that it varies by a factor of "
                f"{_THRUST_TO_FLY:g}"
            )
        )
    if not reason and not _POSSIBLE[0] <= value <= _POSSIBLE[1]:
        reason = "the effectiveness changes more with thrust than any propeller's curve allows"
    if reason:
        middle, reach = 0.5 * sum(_PROPELLERS), 0.5 * (_PROPELLERS[1] - _PROPELLERS[0])
        half = expo.half_width or float(np.hypot(reach, expo.value - middle))
        value, shift, off = expo.value, 0.0, half
    elif abs(value - expo.value) > half:
        shift, off = found.shift, half
    else:
        shift, off = 0.0, abs(value - expo.value) + half
    curve = ThrustCurve(
        expo=value,
        ci95=(value - half, value + half),
        assumed=expo.value,
        parameter=expo.parameter,
        identifiable=not reason,
        reason=reason,
        corrected=shift != 0.0,
        measured=expo.lag_is_measured,
    )
    return curve, shift, off


def _expo_change(shift: float, scale: float) -> float:
    """Return the change of the expo that belongs to a k, at a scale that changes with it."""
    return shift / (1.0 - scale * shift) if scale * shift < 1.0 else float(np.inf)


def _scale_change(data: FlightData, expo: AssumedExpo) -> float:
    """Return the relative change of the scale of thrust by the expo, by what holds it."""
    held = expo.held
    if held is HeldScale.FULL:
        return 0.0
    if held is HeldScale.COMMAND:
        return expo.mean_slope
    thrust, by_expo = per_rotor(data.segments)
    if held is HeldScale.WEIGHT:
        return float(by_expo.sum() / thrust.sum())
    slope = slope_at(thrust, by_expo, _mean_thrust(data))
    return slope if np.isfinite(slope) else 0.0


def _mean_thrust(data: FlightData) -> float:
    """Return the mean thrust of a rotor while the vehicle was moved: there its effectiveness is found."""
    torque = np.concatenate([each.torque for each in data.segments])
    return mean_while_moved(_collective(data), torque, data.sample_period_s)


def _collective(data: FlightData) -> FloatArray:
    """Return the mean thrust of the rotors, of all samples in a row."""
    thrust = [each.rotor_thrust for each in data.segments if each.rotor_thrust is not None]
    return np.concatenate([each.mean(axis=1) for each in thrust])


def _normalised(segment: Segment, scale: float) -> Segment:
    """Take from the derivative by the expo what only changes the scale."""
    if segment.rotor_thrust is None or segment.thrust_by_expo is None:
        return segment
    return replace(segment, thrust_by_expo=segment.thrust_by_expo - scale * segment.rotor_thrust)


def _with_effectiveness(curve: ThrustCurve, data: FlightData, shift: float, half_width: float) -> ThrustCurve:
    """Add how the effectiveness per command changes over the thrust that was flown.

    With F the thrust that the firmware believes, that of the propellers is F + k F', and
    effectiveness goes with its slope, 1 + k dF'/dF.
    """
    thrust, by_expo = per_rotor(data.segments)
    middle = _mean_thrust(data)
    low, high = np.quantile(_collective(data), _FLOWN_QUANTILES)
    levels = np.linspace(float(low), float(high), _N_POINTS)
    *slopes, at_mean = slopes_at(thrust, by_expo, np.append(levels, middle))

    def relative(k: float) -> FloatArray:
        return np.asarray((1.0 + k * np.array(slopes)) / (1.0 + k * at_mean))

    ends = np.stack([relative(shift - half_width), relative(shift + half_width)])
    return replace(
        curve,
        thrust_over_mean=levels / middle,
        effectiveness=relative(shift),
        effectiveness_ci95=np.stack([ends.min(axis=0), ends.max(axis=0)], axis=1),
    )
