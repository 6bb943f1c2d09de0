"""Effectiveness by block spectra, averaged over effects that rotors and logs may have beside a linear response.

A dead zone, a limit, rotors that slow down later than they speed up, a moment of the tilt: each adds one
column to the equations of `identify.spectral`, with a coefficient between none and what physics allows. What
is not linear has an instrument of its own: the same function of the torque that was commanded, without what
the torque itself holds of it. How likely the flight makes each follows from its marginal likelihood, and the
estimate is the mean over all (Bayesian model averaging: Hoeting, Madigan, Raftery and Volinsky, Statistical
Science 14, 1999): an effect that the flight shows is taken out, one that it shows the absence of costs nothing,
and one that it cannot tell widens the interval by what it might be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final, Literal, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import SpectralFit
from quadid_logs.identify.spectral import (
    AxisMoments,
    CommandRecord,
    SharedActuator,
    SpectralSolution,
    by_coordinates,
    command_records,
    few_blocks,
    figures_by_coordinates,
    is_planned,
    moment_noise,
    solve_spectra,
    spectra_of,
)
from quadid_logs.identify.systematic import GYRO_SYSTEMATIC
from quadid_logs.maths.band import ComplexArray
from quadid_logs.maths.block_spectra import BlockSpectra
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.recurrence import lag
from quadid_logs.maths.rotations import tilt_from_rates

_Kind = Literal["dead zone", "dead zone of rotors", "limit", "slow spin-down", "tilt"]
#: Before a log is seen: none of the effects is as likely as one of them, and each kind as likely as another.
_NO_EFFECT = 0.5
#: Where dead zones and limits are looked for, as quantiles of the torque's size.
_DEAD_ZONES: Final = (0.1, 0.2, 0.35, 0.5, 0.65)
_LIMITS: Final = (0.8, 0.9, 0.96)
#: Standard deviations of the coefficients. From nothing to all of the torque is lost below a dead zone or beyond
#: a limit; as much of what rotors lack is lacking where they slow down twice as slowly as they speed up.
_LOST = 0.5
#: A moment of the tilt swings a vehicle at up to 0.4 Hz: drag above or below the centre of mass, loads [1/s^2].
_TILT_1_S2 = (2.0 * np.pi * 0.4) ** 2
#: More than three effects at once are not told from each other.
_MOST_TOGETHER = 3
_AXES: Final = 3
_TINY = float(np.finfo(np.float64).tiny)


class _Column(NamedTuple):
    """What one effect adds to the equations of some axes, at one level.

    ``values``, ``by_slope`` of shape (n_blocks, n_lines, 3), as of `BlockSpectra`; ``told``: the same function
    of the commanded torque, None where it is linear. ``of_torque``: it is taken from the torque, and acts
    through the rotors; else it is an acceleration by itself. ``spread``: standard deviation of its coefficient.
    """

    kind: _Kind
    axes: tuple[int, ...]
    values: ComplexArray
    by_slope: ComplexArray
    told: ComplexArray | None
    of_torque: bool
    spread: float
    weight: float


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
        Roll, pitch, yaw, as of `identify.spectral.fit_spectra`, averaged over effects unless a planned
        trajectory is what was commanded: those are too gentle to show any.
    """
    records = command_records(data)
    spectra = spectra_of([record.columns for record in records], records, data)
    if spectra is None:
        return ()
    planned = is_planned(data)
    solution = solve_spectra(spectra, data.gyro_filter, planned=planned)
    if solution is None or planned:
        return () if solution is None else solution.fits
    return _averaged(solution, [*_columns(solution, spectra, records, data)])


def _averaged(solution: SpectralSolution, columns: Sequence[_Column]) -> tuple[SpectralFit, ...]:
    """Return the estimates with the effects that the flight shows, averaged over one more of each."""
    equations = _Equations(solution)
    shown: list[_Column] = []
    found = [equations.with_one_more(shown, column) for column in columns]
    while len(shown) < _MOST_TOGETHER:
        best = _likeliest(found)
        if best is None:
            break
        shown.append(best)
        found = [equations.with_one_more(shown, column) for column in columns if not _is_shown(column, shown)]
    fits = list(solution.fits)
    shift = equations.shift(shown)
    for place, axis in enumerate(solution.axes):
        own = [each for each in found if axis.number in each.column.axes]
        fits[axis.number] = equations.fit_of(place, solution.fits[axis.number], shift, own)
    return tuple(fits)


def _is_shown(column: _Column, shown: Sequence[_Column]) -> bool:
    return any(each.kind == column.kind and set(each.axes) & set(column.axes) for each in shown)


def _probabilities(found: Sequence[_Posterior]) -> FloatArray:
    """Return how likely each effect is; what is left is that there is none of them."""
    of_kind = (1.0 - _NO_EFFECT) / max(len({each.column.kind for each in found}), 1)
    log = [np.log(of_kind * each.column.weight) + each.log_ratio for each in found]
    likely = np.array([*log, np.log(_NO_EFFECT)])
    weight = np.exp(likely - likely.max())
    return np.asarray(weight[:-1] / weight.sum())


def _likeliest(found: Sequence[_Posterior]) -> _Column | None:
    """Return the likeliest level of the effect that is more likely than not, if there is one."""
    best, chance = None, 0.5
    for axis in range(_AXES):
        own = [each for each in found if axis in each.column.axes]
        likely = _probabilities(own)
        for kind in {each.column.kind for each in own}:
            levels = [number for number, each in enumerate(own) if each.column.kind == kind]
            if likely[levels].sum() > chance:
                chance = float(likely[levels].sum())
                best = own[max(levels, key=lambda number: likely[number])].column
    return best


class _Equations:
    """The moments of all axes around an estimate, to first order, with the columns of effects beside them."""

    def __init__(self, solution: SpectralSolution) -> None:
        self.axes, self.actuator = solution.axes, solution.actuator
        solved = [axis.solved(solution.actuator) for axis in self.axes]
        self.theta = [theta for theta, _ in solved]
        self.left = [left for _, left in solved]
        self.error = [
            axis.error(theta, self.actuator) for axis, theta in zip(self.axes, self.theta, strict=True)
        ]
        self.n_known = _AXES + sum(theta.size for theta in self.theta)
        self.known = [self._known(place) for place in range(len(self.axes))]

    def _known(self, place: int) -> FloatArray:
        """Return the rows of an axis without effects: slopes by the actuator, then its linear columns."""
        columns = self.axes[place].system(self.actuator)[0]
        slopes = self.theta[place][0] * by_coordinates(self.axes[place].white_commanded, self.actuator)
        # The priors of what is linear do not move with the actuator.
        slopes = np.vstack([slopes, np.zeros((len(columns) - len(slopes), _AXES))])
        return np.column_stack([slopes, columns])

    def own(self, place: int) -> IntArray:
        """Return where the unknowns of an axis are: the actuator's, then its own."""
        n_linear = self.theta[place].size
        first = _AXES + n_linear * place
        return np.r_[0:_AXES, first : first + n_linear]

    def with_one_more(self, shown: Sequence[_Column], column: _Column) -> _Posterior:
        """Return what one more effect does beside those that are shown."""
        normal, right = self._normal([*shown, column], n_certain=len(shown))
        covariance = np.linalg.pinv(normal[:-1, :-1], hermitian=True)
        moved = -covariance @ normal[:-1, -1]
        information = float(normal[-1, -1] + normal[-1, :-1] @ moved)
        prior = column.spread**2 * self._scale(column)
        if not information > _TINY / prior:
            return _Posterior(column, 0.0, 0.0, prior, moved[: self.n_known])
        value, variance = float(right[-1] + right[:-1] @ moved) / information, 1.0 / information
        mean, left = value * prior / (prior + variance), prior * variance / (prior + variance)
        log_ratio = 0.5 * (value * mean / variance + np.log(left / prior))
        if column.of_torque:
            # Rotors lose torque, and win none.
            mean, left, above = _positive(mean, left)
            log_ratio += np.log(2.0 * above)
        return _Posterior(column, float(log_ratio), mean, left, moved[: self.n_known])

    def shift(self, shown: Sequence[_Column]) -> tuple[FloatArray, FloatArray]:
        """Return by how much effects that are shown move the estimates, and the covariance then."""
        normal, right = self._normal(shown, n_certain=len(shown))
        covariance = np.linalg.pinv(normal, hermitian=True)
        return (covariance @ right)[: self.n_known], covariance[: self.n_known, : self.n_known]

    def fit_of(
        self,
        place: int,
        fit: SpectralFit,
        shift: tuple[FloatArray, FloatArray],
        found: Sequence[_Posterior],
    ) -> SpectralFit:
        """Return the estimate of an axis with the effects that are shown, and what one more may be."""
        axis, own = self.axes[place], self.own(place)[: _AXES + 2]
        moved, covariance = shift[0][own], shift[1][np.ix_(own, own)]
        for likely, each in zip(_probabilities(found), found, strict=True):
            by_effect = np.outer(each.moved[own], each.moved[own])
            covariance = covariance + likely * (each.mean**2 + each.variance) * by_effect
        gain = float(self.theta[place][0] + moved[_AXES])
        slopes = figures_by_coordinates(axis.number, gain, self.actuator)
        spread = few_blocks(axis.run.size) ** 2 * slopes @ covariance @ slopes.T
        half_width = float(np.hypot(NORMAL_95 * np.sqrt(spread[0, 0]), GYRO_SYSTEMATIC * gain))
        return replace(fit, mean=fit.mean + slopes @ moved, covariance=spread, half_width=half_width)

    def _scale(self, column: _Column) -> float:
        """Return the square of what one unit of a coefficient is: of lost torque, the mean effectiveness."""
        gains = [
            float(theta[0])
            for axis, theta in zip(self.axes, self.theta, strict=True)
            if axis.number in column.axes
        ]
        return float(np.mean(np.square(gains))) if column.of_torque and len(column.axes) == 1 else 1.0

    def _normal(self, columns: Sequence[_Column], *, n_certain: int) -> tuple[FloatArray, FloatArray]:
        """Return the normal equations with some effects, the first of them with priors of their size."""
        n = self.n_known + len(columns)
        normal, right = np.zeros((n, n)), np.zeros(n)
        normal[:_AXES, :_AXES], right[:_AXES] = np.eye(_AXES), -self.actuator.coordinates
        for place, axis in enumerate(self.axes):
            own = [number for number, column in enumerate(columns) if axis.number in column.axes]
            where = np.concatenate([self.own(place), [self.n_known + number for number in own]]).astype(int)
            rows, left = self._rows(place, [columns[number] for number in own])
            normal[np.ix_(where, where)] += rows.T @ rows
            right[where] += rows.T @ left
        for number, column in enumerate(columns[:n_certain]):
            normal[self.n_known + number, self.n_known + number] += 1.0 / (
                column.spread**2 * self._scale(column)
            )
        return normal, right

    def _rows(self, place: int, columns: Sequence[_Column]) -> tuple[FloatArray, FloatArray]:
        """Return the equations of an axis with effects, and what is left of them.

        In the moments of the commanded torque the columns of effects are new; their own instruments add
        moments of everything.
        """
        axis, known = self.axes[place], self.known[place]
        unit = [float(self.theta[place][0]) if len(column.axes) > 1 else 1.0 for column in columns]
        effects = [
            scale * _acting(axis, column, self.actuator)
            for scale, column in zip(unit, columns, strict=True)
        ]
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

    def _own_moments(
        self, place: int, instrument: ComplexArray, effects: Sequence[ComplexArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the moments of an instrument that is none of the commanded torque's, in standard deviations."""
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


def _acting(axis: AxisMoments, column: _Column, actuator: SharedActuator) -> ComplexArray:
    """Return the acceleration that one unit of an effect makes of an axis, shape (n_blocks, n_lines)."""
    values, by_slope = (each[:, :, axis.number] for each in (column.values, column.by_slope))
    if not column.of_torque:
        return axis.gyro * values
    response, slope = axis.response(actuator)
    return -(response * values + slope * by_slope)


def _without(axis: AxisMoments, told: ComplexArray, others: Sequence[ComplexArray]) -> ComplexArray:
    """Return an instrument without what other instruments hold of it, band by band."""
    widths = np.diff(axis.edges)
    for other in others:
        power = np.maximum(axis.power(other).sum(axis=0), _TINY)
        held = axis.summed((other.conj() * told).sum(axis=0)) / power
        told = told - np.repeat(held, widths) * other
    return told


def _columns(
    solution: SpectralSolution, spectra: BlockSpectra, records: Sequence[CommandRecord], data: FlightData
) -> Iterator[_Column]:
    """Yield the columns of all effects, at each level."""
    torques = [record.segment.torque for record in records]
    told = _told_in_time(solution.told, spectra, [len(each) for each in torques], data.sample_period_s)
    moved = tuple(axis.number for axis in solution.axes)

    def of_torque(
        kind: _Kind, lost: Callable[[FloatArray], FloatArray], n_levels: int, *, together: bool = False
    ) -> Iterator[_Column]:
        both = [
            spectra_of([lost(each) for each in signals], records, data) for signals in (torques, told)
        ]
        if both[0] is None or both[1] is None:
            return
        for axes in (moved,) if together else tuple((axis,) for axis in moved):
            yield _Column(
                kind, axes, both[0].values, both[0].by_slope, both[1].values, True, _LOST, 1.0 / n_levels
            )

    sizes = np.abs(np.concatenate(torques))
    for level in np.quantile(sizes, _DEAD_ZONES, axis=0):
        yield from of_torque("dead zone", lambda u, at=level: np.clip(u, -at, at), len(_DEAD_ZONES))
    for level in np.quantile(sizes, _LIMITS, axis=0):
        yield from of_torque("limit", lambda u, at=level: u - np.clip(u, -at, at), len(_LIMITS))
    period_s, lag_s = data.sample_period_s, solution.actuator.lag_s
    yield from of_torque("slow spin-down", lambda u: _not_braked(u, period_s, lag_s), 1)
    per_thrust = None if data.input is None else data.input.torque_per_thrust
    if per_thrust is not None and np.isfinite(per_thrust).all() and np.any(per_thrust):
        by_torque = np.linalg.pinv(per_thrust)
        rotors = np.abs(np.concatenate(torques) @ by_torque.T)
        for level in np.quantile(rotors, _DEAD_ZONES):
            yield from of_torque(
                "dead zone of rotors",
                lambda u, at=level: np.clip(u @ by_torque.T, -at, at) @ per_thrust.T,
                len(_DEAD_ZONES),
                together=True,
            )
    yield from _tilts(records, data, moved)


def _tilts(
    records: Sequence[CommandRecord], data: FlightData, moved: Sequence[int]
) -> Iterator[_Column]:
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
                    "tilt", (axis,), spectra.values, spectra.by_slope, None, False, _TILT_1_S2, 1.0
                )


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
