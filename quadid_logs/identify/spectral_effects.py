"""Effectiveness by block spectra, averaged over what rotors and logs may do beside a linear response.

A dead zone, a limit, rotors that slow down later than they speed up, a moment of the tilt, an effectiveness
that comes and goes: each adds one column to the equations of `identify.spectral`, with a coefficient between
none and what physics allows. What is not linear has an instrument of its own: the same function of the torque
that was commanded, without what the torque itself holds of it.
How likely each is follows from its marginal likelihood (Bayesian model averaging: Hoeting, Madigan, Raftery
and Volinsky, Statistical Science 14, 1999): an effect that the flight shows is taken out, one that it rules
out costs nothing, and one that it leaves open widens the interval by what it might be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.flight import FlightData, InputDescription
from quadid_logs.data.model import Effect, SpectralFit
from quadid_logs.identify.spectral import (
    AxisMoments,
    CommandRecord,
    SharedActuator,
    SpectralSolution,
    by_coordinates,
    command_records,
    few_blocks,
    fit_axes,
    moment_noise,
    shared,
    solve_flight,
    spectra_of,
    spread_and_half_width,
)
from quadid_logs.identify.varying_gain import VARIES, likeliest_variation
from quadid_logs.maths.band import ComplexArray
from quadid_logs.maths.block_spectra import BlockSpectra
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.recurrence import lag
from quadid_logs.maths.rotations import tilt_from_rates

#: The effects that are averaged over.
AVERAGED: Final[frozenset[Effect]] = frozenset(
    {"threshold", "rotor threshold", "limit", "asymmetry", "tilt", "varying gain"}
)
#: Before a log is seen: none of the effects is as likely as one of them, and each kind as likely as another.
_NO_EFFECT = 0.5
#: Where dead zones and limits are looked for, as quantiles of the torque's size.
_DEAD_ZONES: Final = (0.1, 0.2, 0.35, 0.5, 0.65)
_LIMITS: Final = (0.8, 0.9, 0.96)
#: Standard deviations of the coefficients. From nothing to all of the torque is lost below a dead zone or
#: beyond a limit; rotors that slow down twice as slowly as they speed up lack a third as much again.
_LOST = 0.5
#: Drag beside the centre of mass, and loads, swing a tilted vehicle at some 0.4 Hz [1/s^2].
_TILT_1_S2 = (2.0 * np.pi * 0.4) ** 2
#: Thrust goes with the throttle to a power of one to two: its slope, where nothing straightens the curve, to
#: a power of none to one.
_BY_THROTTLE = 0.5
#: The form of an effect is assumed, and others beside it change what it takes: in simulated flights with two
#: of them by up to about half of it, in 95 of 100.
_FORM = 0.5
#: An effect that is at least so likely is taken out; what is less likely widens the interval.
_SHOWN = 0.95
#: More than three effects at once are not told from each other.
_MOST_TOGETHER = 3
_AXES: Final = 3
_TINY = float(np.finfo(np.float64).tiny)


class _Column(NamedTuple):
    """What one effect adds to the equations of some axes, at one level.

    ``values``, ``by_slope`` of shape (n_blocks, n_lines, 3), as of `BlockSpectra`; ``told``: the same
    function of the commanded torque, None where it is linear. ``of_torque``: it is taken from the torque, and
    acts through the rotors; else it is an acceleration by itself. ``lost``: it takes torque, and gives none.
    ``spread``: standard deviation of its coefficient before the flight is seen; ``weight``: of this level
    among those of its kind; ``varies``: standard deviation over the flight of what a unit makes of the gain.
    """

    kind: Effect
    axes: tuple[int, ...]
    values: ComplexArray
    by_slope: ComplexArray
    told: ComplexArray | None
    of_torque: bool
    lost: bool
    spread: float
    weight: float
    varies: float = 0.0


class _Posterior(NamedTuple):
    """What one more effect does: its likelihood against none, its coefficient, and what that moves."""

    column: _Column
    log_ratio: float
    mean: float
    variance: float
    moved: FloatArray


def fit_by_spectra(data: FlightData) -> tuple[SpectralFit, ...]:
    """Estimate the equations of all axes from what was commanded of them.

    Parameters
    ----------
    data : FlightData

    Returns
    -------
    tuple of SpectralFit
        Roll, pitch, yaw, as of `average_over_effects`; empty where nothing tells what was commanded, or
        it lasts for less than four blocks.
    """
    solution = solve_flight(data)
    return () if solution is None else average_over_effects(solution, data)


def average_over_effects(solution: SpectralSolution, data: FlightData) -> tuple[SpectralFit, ...]:
    """Return the estimates of a flight with the effects that it shows, averaged over one more of each.

    Parameters
    ----------
    solution : SpectralSolution
        Of the flight; its axes are left as the effects make them.
    data : FlightData

    Returns
    -------
    tuple of SpectralFit
        Roll, pitch, yaw. Planned trajectories are too gentle to show any effect: as they are.
    """
    if solution.planned:
        return solution.fits
    records = command_records(data)
    told = _told_in_time(
        solution.told, solution.spectra, [each.segment.n_samples for each in records], data.sample_period_s
    )
    columns = [*_columns(solution, told, records, data)]
    equations = _Equations(solution)
    while True:
        tried = [*columns, *_variations(equations, told, records, data)]
        found = [equations.with_one_more(each) for each in tried if equations.allows(each)]
        likely = _probabilities(found)
        best = _likeliest(found, likely)
        if best is None:
            break
        equations = equations.beside(best)
    varies = [value * each.varies for value, each in zip(equations.taken, equations.shown, strict=True)]
    variation = float(np.sqrt(np.sum(np.square(varies))))
    fits = list(equations.fits)
    for place, axis in enumerate(equations.axes):
        fit = equations.fit_of(place, found, likely)
        shown = dict.fromkeys(each.kind for each in equations.shown if axis.number in each.axes)
        fits[axis.number] = _beside(
            solution.fits[axis.number], replace(fit, variation=variation, effects=tuple(shown))
        )
    return tuple(fits)


def _beside(without: SpectralFit, fit: SpectralFit) -> SpectralFit:
    """Return an estimate with what the form of its effects leaves open, and by how much they move it."""
    shift = fit.gain / without.gain - 1.0 if fit.effects and without.gain else 0.0
    form = _FORM * (fit.gain - without.gain) if fit.effects else 0.0
    covariance = fit.covariance.copy()
    covariance[0, 0] += (form / NORMAL_95) ** 2
    half_width = float(np.hypot(fit.half_width, form))
    more = _relative(half_width, fit.gain) ** 2 - _relative(without.half_width, without.gain) ** 2
    moved = math.sqrt(max(more, 0.0) + shift**2)
    return replace(fit, covariance=covariance, half_width=half_width, shift=shift, by_effects=moved)


def _relative(half_width: float, gain: float) -> float:
    return half_width / abs(gain) if gain else float("inf")


def _probabilities(found: Sequence[_Posterior]) -> FloatArray:
    """Return how likely each effect is.

    Each axis has one of its own effects or none, by itself; what all axes share is an explanation instead of
    those of all axes together.
    """
    kinds = len({each.column.kind for each in found})
    prior = (1.0 - _NO_EFFECT) / _NO_EFFECT / max(kinds, 1)
    odds = np.array([np.log(prior * each.column.weight) + each.log_ratio for each in found])
    shared_by_axes = np.array([len(each.column.axes) > 1 for each in found], dtype=bool)
    axes = np.array([each.column.axes[0] for each in found], dtype=int)
    own = [odds[~shared_by_axes & (axes == axis)] for axis in range(_AXES)]
    each_by_itself = [np.logaddexp.reduce([0.0, *each]) for each in own]
    by_themselves = np.sum(each_by_itself)
    whole = np.logaddexp.reduce([by_themselves, *odds[shared_by_axes]])
    of_axes = np.array(each_by_itself)[axes] + whole - by_themselves
    return np.asarray(np.exp(odds - np.where(shared_by_axes, whole, of_axes)))


def _likeliest(found: Sequence[_Posterior], likely: FloatArray) -> _Column | None:
    """Return the likeliest level of the likeliest effect that the flight shows, if it shows one."""
    best, chance = None, _SHOWN
    for kind, axes in {(each.column.kind, each.column.axes) for each in found}:
        levels = [
            number
            for number, each in enumerate(found)
            if (each.column.kind, each.column.axes) == (kind, axes)
        ]
        if likely[levels].sum() > chance:
            chance = float(likely[levels].sum())
            best = found[max(levels, key=lambda number: likely[number])].column
    return best


class _Equations:
    """The moments of all axes around an estimate, to first order, with the columns of effects beside them.

    ``shown`` are the effects that the flight shows, ``taken`` their coefficients: the estimate knows of them.
    """

    def __init__(
        self, solution: SpectralSolution, shown: Sequence[_Column] = (), taken: Sequence[float] = ()
    ) -> None:
        self.solution, self.shown, self.taken = solution, shown, taken
        self.axes, self.actuator, self.fits = solution.axes, solution.actuator, solution.fits
        solved = [axis.solved(solution.actuator) for axis in self.axes]
        self.theta = [theta for theta, _ in solved]
        self.left = [left for _, left in solved]
        self.error = [
            axis.error(theta, self.actuator) for axis, theta in zip(self.axes, self.theta, strict=True)
        ]
        self.n_known = _AXES + sum(theta.size for theta in self.theta)
        self.known = [self._known(place) for place in range(len(self.axes))]
        self.base = self._normal(shown)

    def _known(self, place: int) -> FloatArray:
        """Return the rows of an axis without effects: slopes by the actuator, then its linear columns."""
        columns = self.axes[place].system(self.actuator)[0]
        slopes = self.theta[place][0] * by_coordinates(self.axes[place].white_commanded, self.actuator)
        # The priors of what is linear do not move with the actuator.
        slopes = np.vstack([slopes, np.zeros((len(columns) - len(slopes), _AXES))])
        return np.column_stack([slopes, columns])

    def allows(self, column: _Column) -> bool:
        """Say whether an effect may be tried beside those that are shown."""
        if any(each is column for each in self.shown):
            return False
        shown = [[each.kind for each in self.shown if axis in each.axes] for axis in column.axes]
        if column.kind == "varying gain" and any(column.kind in kinds for kinds in shown):
            # Several frequencies of one variation are one effect.
            return max(kinds.count(column.kind) for kinds in shown) < _MOST_TOGETHER
        together = (len(kinds) - max(kinds.count("varying gain") - 1, 0) for kinds in shown)
        return max(together) < _MOST_TOGETHER

    def own(self, place: int) -> IntArray:
        """Return where the unknowns of an axis are: the actuator's, then its own."""
        n_linear = self.theta[place].size
        first = _AXES + n_linear * place
        return np.concatenate([np.arange(_AXES), np.arange(first, first + n_linear)])

    def with_one_more(self, column: _Column) -> _Posterior:
        """Return what one more effect does beside those that are shown."""
        normal, right = self._with(column)
        covariance = np.linalg.pinv(normal[:-1, :-1], hermitian=True)
        moved = -covariance @ normal[:-1, -1]
        information = float(normal[-1, -1] + normal[-1, :-1] @ moved)
        prior = column.spread**2 * self._scale(column)
        if not information > _TINY / prior:
            return _Posterior(column, 0.0, 0.0, prior, moved[: self.n_known])
        value = float(right[-1] + right[:-1] @ moved) / information
        variance = few_blocks(self.axes[0].run.size) ** 2 / information
        mean, left = value * prior / (prior + variance), prior * variance / (prior + variance)
        log_ratio = 0.5 * (value * mean / variance + np.log(left / prior))
        if column.lost:
            # Rotors lose torque, and win none.
            mean, left, above = _positive(mean, left)
            log_ratio += np.log(2.0 * above)
        return _Posterior(column, float(log_ratio), mean, left, moved[: self.n_known])

    def beside(self, column: _Column) -> _Equations:
        """Return the equations around the estimate that knows of one more effect: fitted without it."""
        shown = [*self.shown, column]
        normal, right = self._normal(shown)
        found = (np.linalg.pinv(normal, hermitian=True) @ right)[self.n_known :]
        taken = np.add(found, [*self.taken, 0.0]).tolist()
        for place, axis in enumerate(self.axes):
            effects = [
                value * self._acting(place, each)
                for value, each in zip(taken, shown, strict=True)
                if axis.number in each.axes
            ]
            if effects:
                axis.take_out(np.sum(effects, axis=0))
        fits, actuator = fit_axes(self.axes)
        return _Equations(self.solution._replace(fits=fits, actuator=actuator), shown, taken)

    def fit_of(self, place: int, found: Sequence[_Posterior], likely: FloatArray) -> SpectralFit:
        """Return the estimate of an axis with what effects that are shown, and one more, may still be."""
        axis, own = self.axes[place], self.own(place)[: _AXES + 2]
        whole = np.asarray(np.linalg.pinv(self.base[0], hermitian=True), dtype=np.float64)
        covariance = whole[np.ix_(own, own)]
        for chance, each in zip(likely.tolist(), found, strict=True):
            if axis.number in each.column.axes:
                by_effect = np.outer(each.moved[own], each.moved[own])
                covariance = covariance + chance * (each.mean**2 + each.variance) * by_effect
        fit, gain = self.fits[axis.number], float(self.theta[place][0])
        spread, half_width = spread_and_half_width(axis, gain, self.actuator, covariance)
        return replace(fit, covariance=spread, half_width=half_width)

    def _scale(self, column: _Column) -> float:
        """Return the square of what one unit of a coefficient is: of lost torque, the mean effectiveness."""
        gains = [
            float(theta[0])
            for axis, theta in zip(self.axes, self.theta, strict=True)
            if axis.number in column.axes
        ]
        return float(np.mean(np.square(gains))) if column.of_torque and len(column.axes) == 1 else 1.0

    def _normal(self, columns: Sequence[_Column]) -> tuple[FloatArray, FloatArray]:
        """Return the normal equations with effects and the priors of their size."""
        n = self.n_known + len(columns)
        normal, right = np.zeros((n, n)), np.zeros(n)
        normal[:_AXES, :_AXES], right[:_AXES] = np.eye(_AXES), -self.actuator.coordinates
        for place in range(len(self.axes)):
            self._add(normal, right, place, columns, 1.0)
        taken = [*self.taken, *[0.0] * (len(columns) - len(self.taken))]
        for number, column in enumerate(columns):
            information = 1.0 / (column.spread**2 * self._scale(column))
            normal[self.n_known + number, self.n_known + number] += information
            right[self.n_known + number] -= information * taken[number]
        return normal, right

    def _with(self, column: _Column) -> tuple[FloatArray, FloatArray]:
        """Return the normal equations with one more effect, whose size is free."""
        columns, n = [*self.shown, column], self.n_known + len(self.shown)
        normal, right = np.zeros((n + 1, n + 1)), np.zeros(n + 1)
        normal[:n, :n], right[:n] = self.base
        for place, axis in enumerate(self.axes):
            if axis.number in column.axes:
                self._add(normal, right, place, self.shown, -1.0)
                self._add(normal, right, place, columns, 1.0)
        return normal, right

    def _add(
        self, normal: FloatArray, right: FloatArray, place: int, columns: Sequence[_Column], sign: float
    ) -> None:
        """Add the equations of an axis with effects, or take them away."""
        axis = self.axes[place].number
        own = [number for number, column in enumerate(columns) if axis in column.axes]
        where = np.concatenate([self.own(place), [self.n_known + number for number in own]]).astype(int)
        rows, left = self._rows(place, [columns[number] for number in own])
        normal[np.ix_(where, where)] += sign * rows.T @ rows
        right[where] += sign * rows.T @ left

    def _rows(self, place: int, columns: Sequence[_Column]) -> tuple[FloatArray, FloatArray]:
        """Return the equations of an axis with effects, and what is left of them.

        In the moments of the commanded torque the columns of effects are new; their own instruments add
        moments of everything.
        """
        axis, known = self.axes[place], self.known[place]
        effects = [self._acting(place, column) for column in columns]
        of_effects = np.zeros((len(known), len(effects)))
        for number, effect in enumerate(effects):
            white = axis.white(axis.summed((axis.instrument.conj() * effect).sum(axis=0)))
            of_effects[: white.size, number] = white
        rows, left = [np.column_stack([known, of_effects])], [self.left[place]]
        instruments = [axis.instrument]
        for column in columns:
            if column.told is not None:
                told = column.told[:, :, axis.number] * axis.response(self.actuator._replace(lead_s=0.0))[0]
                instruments.append(_without(axis, told, instruments))
                more, rest = self._own_moments(place, instruments[-1], effects)
                rows.append(more)
                left.append(rest)
        return np.vstack(rows), np.concatenate(left)

    def _acting(self, place: int, column: _Column) -> ComplexArray:
        """Return the acceleration that one unit of an effect makes of an axis, shape (n_blocks, n_lines).

        A unit of lost torque is of effectiveness, of what rotors of all axes lose a fraction of it.
        """
        axis = self.axes[place]
        values, by_slope = (each[:, :, axis.number] for each in (column.values, column.by_slope))
        if not column.of_torque:
            return np.asarray(axis.gyro * values)
        response, slope = axis.response(self.actuator)
        unit = float(self.theta[place][0]) if len(column.axes) > 1 else 1.0
        return np.asarray(-unit * (response * values + slope * by_slope))

    def _own_moments(
        self, place: int, instrument: ComplexArray, effects: Sequence[ComplexArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the moments of an effect's own instrument, in standard deviations."""
        axis, theta, weight = self.axes[place], self.theta[place], instrument.conj()

        def moments(lines: ComplexArray) -> ComplexArray:
            return axis.summed((weight * lines).sum(axis=0))

        def of_torque(actuator: SharedActuator) -> ComplexArray:
            response, slope = axis.response(actuator)
            return moments(response * axis.torque + slope * axis.by_slope)

        size = theta[0] * np.abs(of_torque(self.actuator))
        variance = 0.5 * moment_noise(axis, instrument, self.error[place]) + axis.variance * size**2
        scale = 1.0 / np.sqrt(np.maximum(variance, 1e-12 * max(float(variance.max(initial=0.0)), _TINY)))

        def white(lines: ComplexArray) -> FloatArray:
            return np.concatenate([scale * lines.real, scale * lines.imag])

        slopes = theta[0] * by_coordinates(lambda actuator: white(of_torque(actuator)), self.actuator)
        linear = [white(moments(each)) for each in axis.regressors]
        of_effects = [white(moments(each)) for each in effects]
        rows = np.column_stack([slopes, white(of_torque(self.actuator)), *linear, *of_effects])
        return rows, white(moments(self.error[place]))


def _positive(mean: float, variance: float) -> tuple[float, float, float]:
    """Return mean and variance of a normal distribution cut off below zero, and how much of it is above."""
    deviation = float(np.sqrt(variance))
    at = mean / deviation
    above = max(0.5 * math.erfc(-at / math.sqrt(2.0)), _TINY)
    density = math.exp(-0.5 * at**2) / math.sqrt(2.0 * math.pi) / above
    return mean + deviation * density, variance * max(1.0 - density * (density + at), 1e-6), above


def _without(axis: AxisMoments, told: ComplexArray, others: Sequence[ComplexArray]) -> ComplexArray:
    """Return an instrument without what other instruments hold of it, band by band."""
    widths = np.diff(axis.edges)
    for other in others:
        power = np.maximum(axis.power(other).sum(axis=0), _TINY)
        held = axis.summed((other.conj() * told).sum(axis=0)) / power
        told = told - np.repeat(held, widths) * other
    return told


def _columns(
    solution: SpectralSolution, told: Sequence[FloatArray], records: Sequence[CommandRecord], data: FlightData
) -> Iterator[_Column]:
    """Yield the columns of all effects that do not depend on what is left, at each level."""
    torques = [record.segment.torque for record in records]
    period_s = data.sample_period_s
    moved = tuple(axis.number for axis in solution.axes)
    losses = [
        *_losses_of_axes(torques, period_s, solution.actuator.lag_s),
        *_losses_of_rotors(torques, data.input),
    ]
    for kind, lost, weight in losses:
        affected = [moved] if kind == "rotor threshold" else [(axis,) for axis in moved]
        actual, commanded = (
            spectra_of([lost(each) for each in signals], records, data) for signals in (torques, told)
        )
        if actual is not None and commanded is not None:
            for axes in affected:
                both = actual.values, actual.by_slope
                yield _Column(kind, axes, *both, commanded.values, True, True, _LOST, weight)
    yield from _tilts(records, data, moved)
    yield from _by_throttle(solution, told, records, data)


class _Loss(NamedTuple):
    """What an effect takes from a torque (n_samples, 3) at one level, and its weight among all levels."""

    effect: Effect
    lost: Callable[[FloatArray], FloatArray]
    weight: float


def _below(torque: FloatArray, level: FloatArray) -> FloatArray:
    return np.clip(torque, -level, level)


def _beyond(torque: FloatArray, level: FloatArray) -> FloatArray:
    return torque - np.clip(torque, -level, level)


def _losses_of_axes(torques: Sequence[FloatArray], period_s: float, lag_s: float) -> Iterator[_Loss]:
    """Yield what the torque about each axis may lose by itself."""
    sizes = np.abs(np.concatenate(torques))
    for level in np.quantile(sizes, _DEAD_ZONES, axis=0):
        yield _Loss("threshold", partial(_below, level=level), 1.0 / len(_DEAD_ZONES))
    for level in np.quantile(sizes, _LIMITS, axis=0):
        yield _Loss("limit", partial(_beyond, level=level), 1.0 / len(_LIMITS))
    yield _Loss("asymmetry", partial(_not_braked, period_s=period_s, lag_s=lag_s), 1.0)


def _losses_of_rotors(torques: Sequence[FloatArray], described: InputDescription | None) -> Iterator[_Loss]:
    """Yield what dead zones of the rotors take, where it is known how they make the torque."""
    per_thrust = None if described is None else described.torque_per_thrust
    if per_thrust is None or not np.isfinite(per_thrust).all() or not per_thrust.any():
        return
    by_torque = np.asarray(np.linalg.pinv(per_thrust), dtype=np.float64)
    for level in np.quantile(np.abs(np.concatenate(torques) @ by_torque.T), _DEAD_ZONES):
        lost = partial(_below_of_rotors, level=level, by_torque=by_torque, per_thrust=per_thrust)
        yield _Loss("rotor threshold", lost, 1.0 / len(_DEAD_ZONES))


def _below_of_rotors(
    torque: FloatArray, level: float, by_torque: FloatArray, per_thrust: FloatArray
) -> FloatArray:
    """Return the torque of what each rotor gets of its command below a level."""
    return np.asarray(np.clip(torque @ by_torque.T, -level, level) @ per_thrust.T)


def _tilts(records: Sequence[CommandRecord], data: FlightData, moved: Sequence[int]) -> Iterator[_Column]:
    """Yield roll and pitch, of which a moment may be left."""
    angles = [
        tilt_from_rates(record.segment.body_rate_rad_s, data.sample_period_s)
        if record.segment.attitude_rad is None
        else record.segment.attitude_rad[:, :2]
        for record in records
    ]
    if not all(np.isfinite(each).all() for each in angles):
        return
    spectra = spectra_of([np.column_stack([each, 0.0 * each[:, :1]]) for each in angles], records, data)
    if spectra is not None:
        for axis in moved:
            if axis < 2:
                yield _Column(
                    "tilt", (axis,), spectra.values, spectra.by_slope, None, False, False, _TILT_1_S2, 1.0
                )


def _by_throttle(
    solution: SpectralSolution, told: Sequence[FloatArray], records: Sequence[CommandRecord], data: FlightData
) -> Iterator[_Column]:
    """Yield an effectiveness that goes with the throttle: the torque was rebuilt by another thrust curve."""
    throttle = [record.segment.throttle for record in records]
    known = [each for each in throttle if each is not None]
    if len(known) < len(records) or not 0.0 < (mean := float(np.mean(np.concatenate(known)))) < np.inf:
        return
    yield from _varying(
        [each / mean - 1.0 for each in known], _BY_THROTTLE, 0.5, solution, told, records, data
    )


def _variations(
    equations: _Equations, told: Sequence[FloatArray], records: Sequence[CommandRecord], data: FlightData
) -> Iterator[_Column]:
    """Yield the likeliest variation of all effectiveness, at its phase and across it."""
    solution, period_s = equations.solution, data.sample_period_s
    time_s = [record.segment.time_s - records[0].segment.time_s[0] for record in records]
    error, explained = (
        np.concatenate(_told_in_time(each, solution.spectra, [len(one) for one in time_s], period_s))
        for each in _over_noise(equations)
    )
    found = likeliest_variation(np.concatenate(time_s), error, explained, period_s)
    if found is None:
        return
    for across in (found.phase_rad, found.phase_rad + 0.5 * np.pi):
        varies = [np.cos(2.0 * np.pi * found.frequency_hz * each - across) for each in time_s]
        yield from _varying(varies, VARIES, 0.25 * found.weight, solution, told, records, data)


def _varying(
    varies: Sequence[FloatArray],
    spread: float,
    weight: float,
    solution: SpectralSolution,
    told: Sequence[FloatArray],
    records: Sequence[CommandRecord],
    data: FlightData,
) -> Iterator[_Column]:
    """Yield an effectiveness of all axes that is larger by ``varies`` of each record, (n_samples,)."""
    actual, commanded = (
        spectra_of(
            [-each * one[:, np.newaxis] for each, one in zip(signals, varies, strict=True)], records, data
        )
        for signals in ([record.segment.torque for record in records], told)
    )
    if actual is not None and commanded is not None:
        yield _Column(
            "varying gain",
            tuple(axis.number for axis in solution.axes),
            actual.values,
            actual.by_slope,
            commanded.values,
            of_torque=True,
            lost=False,
            spread=spread,
            weight=weight,
            varies=float(np.std(np.concatenate(varies))),
        )


def _over_noise(equations: _Equations) -> tuple[ComplexArray, ComplexArray]:
    """Return what is left of all axes and what is explained, over the noise.

    Shapes are (n_blocks, n_lines, 3).
    """
    solution = equations.solution
    error, explained = np.zeros((2, *solution.told.shape), dtype=np.complex128)
    for axis, theta, left in zip(equations.axes, equations.theta, equations.error, strict=True):
        noise = shared(np.mean(np.abs(left) ** 2, axis=0)) / shared(np.ones(left.shape[1]))
        scale = 1.0 / np.sqrt(np.maximum(noise.real, _TINY))
        error[:, :, axis.number] = scale * left
        explained[:, :, axis.number] = scale * theta[0] * axis.response(equations.actuator)[0] * axis.told
    return error, explained


def _not_braked(torque: FloatArray, period_s: float, lag_s: float) -> FloatArray:
    """Return what rotors that slow down later than they speed up take from the torque; shape (n, 3).

    While the torque rises, half of the rotors slow down: what all of them lack is off by the torque's lack,
    rectified and lagged, in the direction of its change.
    """
    lacking = torque - lag(torque, period_s, lag_s)
    return np.asarray(np.sign(lacking) * lag(np.abs(lacking), period_s, lag_s))


def _told_in_time(
    told: ComplexArray, spectra: BlockSpectra, lengths: Sequence[int], period_s: float
) -> list[FloatArray]:
    """Return the commanded torques of each record, shape (n_samples, 3): windows that overlap add to one."""
    step_hz = float(spectra.frequency_hz[1] - spectra.frequency_hz[0])
    n = 2 * round(0.5 / (step_hz * period_s))
    lines = np.rint(spectra.frequency_hz / step_hz).astype(int)
    signals = [np.zeros((length, told.shape[2])) for length in lengths]
    place = np.zeros(len(signals), dtype=int)
    for block, record in zip(told, spectra.run.tolist(), strict=True):
        full = np.zeros((n // 2 + 1, told.shape[2]), dtype=np.complex128)
        full[lines] = block / period_s
        first = place[record]
        # A window has a mean square of one; Hann's as it is adds up to one, its mean square is 3/8.
        signals[record][first : first + n] += np.sqrt(0.375) * np.fft.irfft(full, n, axis=0)
        place[record] += n // 2
    return signals
