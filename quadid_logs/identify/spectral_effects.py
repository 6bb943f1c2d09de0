"""Effectiveness by block spectra, averaged over what rotors and logs may do beside a linear response.

A dead zone, a limit, rotors that slow down later than they speed up, a moment of the tilt, an effectiveness
that comes and goes: each adds one column to the equations of `identify.spectral`, with a coefficient between
none and what physics allows. What is not linear has an instrument of its own: the same function of the torque
that was commanded, without what the torque itself holds of it.
How likely each is follows from its marginal likelihood (Bayesian model averaging: Hoeting, Madigan, Raftery
and Volinsky, Statistical Science 14, 1999): an effect that the flight shows is taken out, one that it rules
out costs nothing, and one that it leaves open moves the mean and widens the interval by what it might be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Effect, SpectralFit
from quadid_logs.identify.effect_columns import (
    EffectColumn,
    FlownSignals,
    as_cut,
    effect_columns,
    variation_columns,
)
from quadid_logs.identify.spectral import (
    AxisMoments,
    SpectralSolution,
    around,
    by_coordinates,
    few_blocks,
    figures_by_coordinates,
    fit_axes,
    known_figures,
    moment_noise,
    shared,
    slopes_of,
    solve_flight,
)
from quadid_logs.maths.band import ComplexArray
from quadid_logs.maths.normal import NORMAL_95

#: Drag, a load, the height of the centre of mass: every vehicle has a moment of its tilt, of some size. To be
#: named it needs the evidence of any other effect; its size counts without.
_ALWAYS: Final[tuple[Effect, ...]] = ("tilt",)
#: The effects that are averaged over.
AVERAGED: Final[frozenset[Effect]] = frozenset(
    {"threshold", "rotor threshold", "limit", "asymmetry", "tilt", "varying gain", "cut steps"}
)
#: Before a log is seen: none of the effects is as likely as one of them, and each kind as likely as another.
_NO_EFFECT = 0.5
#: Whole steps were cut or rounded: of two ways to write a number one is as likely as the other.
_CUT_OR_ROUNDED = 1.0
#: The form of an effect is assumed, and others beside it change what it takes: in simulated flights with two
#: of them by up to about half of it, in 95 of 100.
_FORM = 0.5
#: An effect that is at least so likely is taken out; what is less likely moves the mean, and widens the
#: interval.
_SHOWN = 0.95
#: More than three effects at once are not told from each other.
_MOST_TOGETHER = 3
#: Actuators `around` one.
_N_AROUND = 6
_AXES: Final = 3
_TINY = float(np.finfo(np.float64).tiny)


class _Posterior(NamedTuple):
    """What one more effect does: its likelihood against none, its coefficient, and what that moves."""

    column: EffectColumn
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
    signals = FlownSignals(solution, data)
    columns = [*effect_columns(signals, solution.actuator.lag_s)]
    equations = _Equations(solution)
    while True:
        # What is left of all axes and what is explained, over the noise.
        error, explained = np.zeros((2, *solution.told.shape), dtype=np.complex128)
        for axis, theta, left in zip(equations.axes, equations.theta, equations.error, strict=True):
            noise = shared(np.mean(np.abs(left) ** 2, axis=0)) / shared(np.ones(left.shape[1]))
            scale = 1.0 / np.sqrt(np.maximum(noise.real, _TINY))
            error[:, :, axis.number] = scale * left
            explained[:, :, axis.number] = scale * theta[0] * axis.response(equations.actuator)[0] * axis.told
        tried = [*columns, *variation_columns(signals, error, explained)]
        found = [equations.with_one_more(each) for each in tried if equations.allows(each)]
        likely = _probabilities(found)
        # The likeliest level of the likeliest effect that an axis shows, of its own or of all axes together.
        best, chance = None, _SHOWN
        kinds = dict.fromkeys((each.column.kind, number) for each in found for number in each.column.axes)
        for kind, shows in kinds:
            levels = [
                k for k, each in enumerate(found) if each.column.kind == kind and shows in each.column.axes
            ]
            if likely[levels].sum() > chance:
                chance = float(likely[levels].sum())
                best = found[max(levels, key=lambda number: likely[number])].column
        if best is None:
            break
        if best.kind == "cut steps":
            return _as_cut(solution, signals)
        equations = equations.beside(best)
    varies = [value * each.varies for value, each in zip(equations.taken, equations.shown, strict=True)]
    variation = float(np.sqrt(np.sum(np.square(varies))))
    fits, weighted = list(equations.fits), list(zip(likely.tolist(), found, strict=True))
    for place, axis in enumerate(equations.axes):
        shown = tuple(dict.fromkeys(each.kind for each in equations.shown if axis.number in each.axes))
        varied = variation / math.sqrt(_looks(axis)) if "varying gain" in shown else 0.0
        # A fit in time sees a moment of the tilt for itself: it is told of one as of any other effect.
        told, in_time = (
            replace(equations.fit_of(place, weighted, always), variation=variation, effects=shown)
            for always in (_ALWAYS, ())
        )
        without = solution.fits[axis.number]
        fits[axis.number] = replace(
            _beside(without, told, varied), by_effects=_beside(without, in_time, varied).by_effects
        )
    return tuple(fits)


def _looks(axis: AxisMoments) -> float:
    """Return how many independent looks at an effectiveness that varies the commands of a flight are.

    Each block counts by what was commanded in it; of blocks that overlap by half, two are one look.
    """
    power = np.sum(np.abs(axis.told) ** 2, axis=1)
    square = float(power @ power)
    return max(0.5 * float(power.sum()) ** 2 / square, 1.0) if square > 0.0 else 1.0


def _as_cut(solution: SpectralSolution, signals: FlownSignals) -> tuple[SpectralFit, ...]:
    """Return the estimates by the torque as it was before the log cut it to whole steps."""
    data = as_cut(signals)
    solved = solve_flight(data)
    if solved is None:
        return solution.fits
    fits = average_over_effects(solved, data)
    return tuple(
        _beside(without, replace(fit, effects=("cut steps", *fit.effects)))
        for without, fit in zip(solution.fits, fits, strict=True)
    )


def _beside(without: SpectralFit, fit: SpectralFit, varied: float = 0.0) -> SpectralFit:
    """Return an estimate with what the form of its effects leaves open, and by how much they move it.

    ``varied``: relative rms of an effectiveness that varies, over the root of the looks at it.
    """
    shift = fit.gain / without.gain - 1.0 if without.gain else 0.0
    form = _FORM * float(np.hypot(fit.gain - without.gain, varied * fit.gain))
    covariance = fit.covariance.copy()
    covariance[0, 0] += (form / NORMAL_95) ** 2
    half_width = float(np.hypot(fit.half_width, form))
    more = _relative(half_width, fit.gain) ** 2 - _relative(without.half_width, without.gain) ** 2
    moved = math.hypot(math.sqrt(max(more, 0.0)), shift, fit.by_effects)
    return replace(fit, covariance=covariance, half_width=half_width, shift=shift, by_effects=moved)


def _relative(half_width: float, gain: float) -> float:
    return half_width / abs(gain) if gain else float("inf")


def _probabilities(found: Sequence[_Posterior]) -> FloatArray:
    """Return how likely each effect is.

    Each axis has one of its own effects or none, by itself; what all axes share is an explanation instead of
    those of all axes together.
    """
    kinds = len({each.column.kind for each in found} - {"cut steps"})
    prior = (1.0 - _NO_EFFECT) / _NO_EFFECT / max(kinds, 1)
    priors = [_CUT_OR_ROUNDED if each.column.kind == "cut steps" else prior for each in found]
    odds = np.array(
        [np.log(one * each.column.weight) + each.log_ratio for one, each in zip(priors, found, strict=True)]
    )
    shared_by_axes = np.array([len(each.column.axes) > 1 for each in found], dtype=bool)
    axes = np.array([each.column.axes[0] for each in found], dtype=int)
    own = [odds[~shared_by_axes & (axes == axis)] for axis in range(_AXES)]
    each_by_itself = [np.logaddexp.reduce([0.0, *each]) for each in own]
    by_themselves = np.sum(each_by_itself)
    whole = np.logaddexp.reduce([by_themselves, *odds[shared_by_axes]])
    of_axes = np.array(each_by_itself)[axes] + whole - by_themselves
    return np.asarray(np.exp(odds - np.where(shared_by_axes, whole, of_axes)))


class _Moments(NamedTuple):
    """Normal equations of an axis, and where its unknowns are among those of all.

    ``main`` are those of the moments of the commanded torque alone, of which the estimate is.
    """

    where: IntArray
    normal: FloatArray
    right: FloatArray
    main: FloatArray


class _Normal(NamedTuple):
    """Normal equations of all axes; ``main`` as of `_Moments`."""

    normal: FloatArray
    right: FloatArray
    main: FloatArray

    @classmethod
    def none(cls, n: int) -> _Normal:
        """Return equations of nothing about n unknowns."""
        return cls(np.zeros((n, n)), np.zeros(n), np.zeros((n, n)))

    def add(self, of_axis: _Moments, sign: float = 1.0) -> None:
        """Add the equations of an axis, or take them away."""
        where = np.ix_(of_axis.where, of_axis.where)
        self.normal[where] += sign * of_axis.normal
        self.main[where] += sign * of_axis.main
        self.right[of_axis.where] += sign * of_axis.right


class _Own(NamedTuple):
    """Equations of an effect's own instrument, in standard deviations, without the columns of effects.

    ``weight`` (n_blocks, n_lines) and ``scale`` (n_bands,) make a moment of an acceleration, ``slopes`` are
    columns by the actuator, ``known`` those of torque and motion, ``left`` is what is left.
    """

    weight: ComplexArray
    scale: FloatArray
    slopes: FloatArray
    known: Sequence[FloatArray]
    left: FloatArray

    def white(self, moments: ComplexArray) -> FloatArray:
        """Return moments (..., n_bands) in standard deviations, (..., 2 n_bands)."""
        return np.concatenate([self.scale * moments.real, self.scale * moments.imag], axis=-1)


class _Shown(NamedTuple):
    """Accelerations of an axis' effects, all instruments, and the equations of the effects' own ones."""

    effects: Sequence[ComplexArray]
    instruments: Sequence[ComplexArray]
    own: Sequence[_Own]


class _Equations:
    """The moments of all axes around an estimate, to first order, with the columns of effects beside them.

    ``shown`` are the effects that the flight shows, ``taken`` their coefficients: the estimate knows of them.
    """

    def __init__(
        self, solution: SpectralSolution, shown: Sequence[EffectColumn] = (), taken: Sequence[float] = ()
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
        # The rows of each axis without effects: slopes by the actuator, then its linear columns.
        self.known = []
        for axis, theta in zip(self.axes, self.theta, strict=True):
            columns = axis.system(self.actuator)[0]
            slopes = theta[0] * by_coordinates(axis.white_commanded, self.actuator)
            # The priors of what is linear do not move with the actuator.
            slopes = np.vstack([slopes, np.zeros((len(columns) - len(slopes), _AXES))])
            self.known.append(np.column_stack([slopes, columns]))
        self._by_shown: dict[int, _Moments] = {}
        self._lines: dict[int, ComplexArray] = {}
        self._of_shown: dict[int, _Shown] = {}
        self.base = self._normal(shown)
        known = self.base.main[: self.n_known, : self.n_known]
        self._covariance = np.asarray(np.linalg.pinv(known, hermitian=True), dtype=np.float64)

    def allows(self, column: EffectColumn) -> bool:
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

    def with_one_more(self, column: EffectColumn) -> _Posterior:
        """Return what one more effect does beside those that are shown."""
        # The size of one more effect is free.
        columns, n = [*self.shown, column], self.n_known + len(self.shown)
        found = _Normal.none(n + 1)
        found.normal[:n, :n], found.right[:n], found.main[:n, :n] = self.base
        for place, axis in enumerate(self.axes):
            if axis.number in column.axes:
                # What is shown is taken away for every effect that is tried.
                if place not in self._by_shown:
                    self._by_shown[place] = self._moments(place, self.shown)
                found.add(self._by_shown[place], -1.0)
                found.add(self._moments(place, columns))
        normal, right, main = found
        covariance = np.linalg.pinv(normal[:-1, :-1], hermitian=True)
        moved = -covariance @ normal[:-1, -1]
        information = float(normal[-1, -1] + normal[-1, :-1] @ moved)
        prior = column.spread**2 * self._scale(column)
        if not information > _TINY / prior:
            return _Posterior(column, 0.0, 0.0, prior, self._estimate_moved(main, moved))
        value = float(right[-1] + right[:-1] @ moved) / information
        variance = few_blocks(self.axes[0].run.size) ** 2 / information
        mean, left = value * prior / (prior + variance), prior * variance / (prior + variance)
        log_ratio = 0.5 * (value * mean / variance + np.log(left / prior))
        if column.lost:
            # Rotors lose torque, and win none.
            mean, left, above = _positive(mean, left)
            log_ratio += np.log(2.0 * above)
        return _Posterior(column, float(log_ratio), mean, left, self._estimate_moved(main, moved))

    def _estimate_moved(self, main: FloatArray, moved: FloatArray) -> FloatArray:
        """Return what one unit of one more effect, and what that makes of others, moves the estimate by."""
        of_effects = np.append(moved[self.n_known :], 1.0)
        return np.asarray(-self._covariance @ main[: self.n_known, self.n_known :] @ of_effects)

    def beside(self, column: EffectColumn) -> _Equations:
        """Return the equations around the estimate that knows of one more effect: fitted without it."""
        shown = [*self.shown, column]
        normal, right, _ = self._normal(shown)
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

    @cached_property
    def _covariance_beside_shown(self) -> FloatArray:
        """Covariance of all that is known, with what the size of effects that are shown leaves open.

        The estimate is that of the moments of the commanded torque. What an effect has moments of its own for
        is its size: they are at the same frequencies, and depart with the others.
        """
        by_shown = self._covariance @ self.base.main[: self.n_known, self.n_known :]
        whole = np.asarray(np.linalg.pinv(self.base.normal, hermitian=True), dtype=np.float64)
        of_shown = whole[self.n_known :, self.n_known :]
        return np.asarray(self._covariance + by_shown @ of_shown @ by_shown.T)

    def fit_of(
        self, place: int, weighted: Sequence[tuple[float, _Posterior]], always: Sequence[Effect]
    ) -> SpectralFit:
        """Return the estimate of an axis with what effects that are shown, and one more, may still be.

        ``weighted``: how likely each effect is, and what it does; what is ``always`` there is certain.
        """
        axis, own = self.axes[place], self.own(place)[: _AXES + 2]
        covariance = self._covariance_beside_shown[np.ix_(own, own)]
        moved, certain = np.zeros(own.size), np.zeros(own.size)
        for chance, each in weighted:
            if axis.number not in each.column.axes:
                continue
            by_effect = np.outer(each.moved[own], each.moved[own])
            if each.column.kind in always:
                covariance = covariance + each.variance * by_effect
                certain = certain + each.mean * each.moved[own]
            else:
                covariance = covariance + chance * (each.mean**2 + each.variance) * by_effect
                moved = moved + chance * each.mean * each.moved[own]
        # The law of total variance: around the mean over all effects, and not around none.
        covariance = covariance - np.outer(moved, moved)
        fit, gain = self.fits[axis.number], float(self.theta[place][0])
        mean = fit.mean + figures_by_coordinates(axis.number, gain, self.actuator) @ (moved + certain)
        known = known_figures(axis, float(mean[0]), self.actuator, covariance)
        return replace(fit, mean=mean, **known._asdict())

    def _scale(self, column: EffectColumn) -> float:
        """Return the square of what one unit of a coefficient is: of lost torque, the mean effectiveness."""
        gains = [
            float(theta[0])
            for axis, theta in zip(self.axes, self.theta, strict=True)
            if axis.number in column.axes
        ]
        return float(np.mean(np.square(gains))) if column.of_torque and len(column.axes) == 1 else 1.0

    def _normal(self, columns: Sequence[EffectColumn]) -> _Normal:
        """Return the normal equations with effects and the priors of their size."""
        found = _Normal.none(self.n_known + len(columns))
        for each in (found.normal, found.main):
            each[:_AXES, :_AXES] = np.eye(_AXES)
        found.right[:_AXES] = -self.actuator.coordinates
        for place in range(len(self.axes)):
            found.add(self._moments(place, columns))
        taken = [*self.taken, *[0.0] * (len(columns) - len(self.taken))]
        for number, column in enumerate(columns, self.n_known):
            information = 1.0 / (column.spread**2 * self._scale(column))
            found.normal[number, number] += information
            found.right[number] -= information * taken[number - self.n_known]
        return found

    def _moments(self, place: int, columns: Sequence[EffectColumn]) -> _Moments:
        """Return the normal equations of an axis with those of these effects that are about it."""
        axis, known = self.axes[place], self.known[place]
        own = [number for number, column in enumerate(columns) if axis.number in column.axes]
        where = np.concatenate([self.own(place), [self.n_known + number for number in own]]).astype(int)
        n_shown = sum(axis.number in column.axes for column in self.shown)
        about = [columns[number] for number in own]
        # What is shown is the same beside every effect that is tried.
        if place not in self._of_shown:
            none = _Shown((), (axis.instrument,), ())
            self._of_shown[place] = self._with_own(place, about[:n_shown], none)
        found = self._with_own(place, about[n_shown:], self._of_shown[place])
        # In the moments of the commanded torque the columns of effects are new; their own instruments add
        # moments of everything.
        of_effects = np.zeros((len(known), len(about)))
        for number, effect in enumerate(found.effects):
            white = axis.white(axis.summed((axis.instrument.conj() * effect).sum(axis=0)))
            of_effects[: white.size, number] = white
        parts, rest = [np.column_stack([known, of_effects])], [self.left[place]]
        for one in found.own:
            moments = [axis.summed((one.weight * effect).sum(axis=0)) for effect in found.effects]
            parts.append(np.column_stack([one.slopes, *one.known, *(one.white(each) for each in moments)]))
            rest.append(one.left)
        rows, left = np.vstack(parts), np.concatenate(rest)
        main = rows[: len(known)]
        return _Moments(where, rows.T @ rows, rows.T @ left, main.T @ main)

    def _with_own(self, place: int, columns: Sequence[EffectColumn], before: _Shown) -> _Shown:
        """Return the accelerations of more effects, and equations of their own instruments."""
        axis, instruments, own = self.axes[place], [*before.instruments], [*before.own]
        for column in columns:
            if column.told is not None:
                told = column.told[:, :, axis.number] * axis.response(self.actuator._replace(lead_s=0.0))[0]
                instruments.append(_without(axis, told, instruments))
                # The equations of the effect's own instrument without those of effects.
                instrument, theta = instruments[-1], self.theta[place]
                weight = instrument.conj()
                if place not in self._lines:
                    torques = [axis.acting(each) for each in (*around(self.actuator), self.actuator)]
                    self._lines[place] = np.stack([*torques, *axis.regressors, self.error[place]])
                moments = axis.summed((weight * self._lines[place]).sum(axis=1))
                size = theta[0] * np.abs(moments[_N_AROUND])
                variance = 0.5 * moment_noise(axis, instrument, self.error[place])
                variance += axis.variance_of_departure() * size**2
                scale = 1.0 / np.sqrt(
                    np.maximum(variance, 1e-12 * max(float(variance.max(initial=0.0)), _TINY))
                )
                equations = _Own(weight, scale, np.zeros((0, _AXES)), (), np.zeros(0))
                white = equations.white(moments)
                slopes = theta[0] * slopes_of([*white[:_N_AROUND]])
                own.append(equations._replace(slopes=slopes, known=[*white[_N_AROUND:-1]], left=white[-1]))
        effects = [*before.effects, *(self._acting(place, column) for column in columns)]
        return _Shown(effects, instruments, own)

    def _acting(self, place: int, column: EffectColumn) -> ComplexArray:
        """Return the acceleration that one unit of an effect makes of an axis, shape (n_blocks, n_lines).

        A unit of lost torque is of effectiveness, of what rotors of all axes lose a fraction of it.
        """
        axis = self.axes[place]
        values, by_slope = (each[:, :, axis.number] for each in (column.values, column.by_slope))
        if not column.of_torque:
            return np.asarray(axis.gyro * values)
        unit = float(self.theta[place][0]) if len(column.axes) > 1 else 1.0
        return np.asarray(-unit * axis.behind(self.actuator, values, by_slope))


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
