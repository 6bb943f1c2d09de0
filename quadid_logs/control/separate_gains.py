"""P, I, D and the angle gain of one axis, each by itself: where one factor on all of them is not enough."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.control.attitude import Attitude, attitude_of, bandwidth_hz, resonance_db
from quadid_logs.control.gain_paths import GainPaths, gain_paths
from quadid_logs.control.guard import Case
from quadid_logs.control.loop import close, integrators
from quadid_logs.control.margins import POINTS_AT_ONCE, figures_of, unmodelled
from quadid_logs.control.scaled_loop import N_LIMITS, HeldLoops, Kept, ScaledLoops, spare_of
from quadid_logs.control.torque_noise import Gusts, Spectrum, gusts_of, lowest_noise_hz, noise_band
from quadid_logs.data.closed_loop import LoopMargins, Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.tuning import GainChange, GainNames, Limits
from quadid_logs.maths.band import ComplexArray

#: The controller of one axis with some parameters changed, None where they make none.
Rebuild = Callable[[Mapping[str, float]], AxisController | None]
#: Least and largest factor on each gain.
_Bounds = Mapping[str, tuple[float, float]]

#: Gains are searched within these factors of the flown ones.
_BOUNDS: Final = (0.25, 4.0)
#: Filters stay for several flights: behind them gains are searched as far as two flights go.
_IN_THE_END: Final = _BOUNDS[1] ** 2
#: What a disturbance of the attitude may be raised by at most [dB] (ADS-33E practice, `attitude_of`).
_MOST_PEAK_DB: Final = 5.0
#: Answers to set-points overshoot no more than those of this damping ratio (ADS-33E-PRF 3.3.2, mid-term
#: response to control inputs, level 1).
_MOST_RESONANCE_DB: Final = resonance_db(0.35)
#: A missing hundredth of a limit weighs more than any rejection of gusts that it could be paid with.
PENALTY: Final = 30.0
#: The search ends where the error changes by less than this part, or after so many steps; it changes gains by
#: so much to see what that does, as logarithms.
_TOLERANCE: Final = 1e-3
_MOST_STEPS: Final = 20
_DIFFERENCE: Final = 1e-3
#: What may be worse than flown at the price of the error: how fast the attitude follows, what the integral
#: holds.
_N_BURDENS: Final = 2
#: Vehicles that turn out to decide are added so many times.
_ROUNDS: Final = 6
_DECISIVE: Final = 4
_HALVINGS: Final = 6
#: Of each gain, so many are tried to begin with.
_GRID: Final = 3
_STARTS: Final = 2
#: Where none keep the limits, the search goes on in so many steps.
_MOST_TRIALS: Final = 100
#: Part of the vehicles that a change of gains is to be better for, and that keep the limits.
_WORST: Final = 0.975
#: Of the way to gains that some vehicles do not bear, what is tried.
_PARTS: Final = (1.0, 0.85, 0.7, 0.5, 0.35)
#: Less than a hundredth of a gain is no change that a flight would show.
_UNCHANGED: Final = 0.01
#: Gains this near to the target are at it.
_SAME: Final = 0.05
#: The search ends this near to the limits.
_ROUNDING: Final = 0.005
#: A rough search, to rank filters by.
_FEW_STEPS: Final = 8
#: Of the bodies, those of the vehicle as it flies: in other conditions a vehicle decides once it lacks.
_AS_FLOWN: Final = 2
#: Where the loop's gain is this small, it may be twice as large, or four times, without a change of
#: stability.
SMALL_LOOP: Final = 0.1


def may_rise(gain_db: FloatArray | float, most_up: float) -> FloatArray:
    """Return by how much a controller's gain may rise in one flight.

    Parameters
    ----------
    gain_db : ndarray or float
        Gain margin of the next flight in the worst vehicle that is allowed.
    most_up : float
        With the gain margin that is to be kept.

    Returns
    -------
    ndarray
        Were the vehicle's gain as many times higher than is told, the next flight would just be stable.
        Gains go no further than they are searched.
    """
    return np.clip(10.0 ** (np.asarray(gain_db) / 20.0), most_up, max(most_up, _BOUNDS[1]))


def least_gain_db(margins: LoopMargins) -> float:
    """Return the worst gain margin of the loops of an axis [dB], infinite where they have none."""
    both = (margins.rate, margins.full)
    told = (one.gain_margin_db for one in both if one is not None)
    return min((one.ci95[0] for one in told if one is not None), default=math.inf)


class Step(NamedTuple):
    """Gains for the next flight, the controller that they make, the margins that it promises.

    ``more_flights`` lie between it and the gains that would be kept.
    """

    gains: Mapping[str, GainChange]
    controller: AxisController
    promised: LoopMargins
    more_flights: int


class _Loop(NamedTuple):
    """Loops of the estimate over frequency, one for each set of gains; see `attitude_of`."""

    rate: ComplexArray
    full: ComplexArray | None
    to_rate: ComplexArray

    @property
    def whole(self) -> ComplexArray:
        """With all that closes it."""
        return self.rate if self.full is None else self.full


class Quick(NamedTuple):
    """Factors on gains, and what they make of the flown vehicle's gusts and noise.

    ``cost`` is as of `SeparateGains.cost`, ``noise`` the command's over that of the flown gains and filters,
    ``missing`` what the decisive vehicles lack of all limits.
    """

    factors: Mapping[str, float]
    cost: float
    noise: float
    missing: float


class Disturbed(NamedTuple):
    """What disturbs an axis as it flew: the acceleration of gusts and where it is known, and the command.

    ``most_noise`` is the standard deviation of the command that noise may make.
    """

    gusts: Spectrum | None
    gust_band_hz: tuple[float, float]
    command: Spectrum | None
    crossover_hz: float
    most_noise: float


class _Varied(NamedTuple):
    """The gains of an axis as they flew: those that are varied, and what goes with them.

    ``with_d`` is the other end of a range of D, ``common`` what multiplies P, I and D.
    """

    names: GainNames
    now: Mapping[str, float]
    with_d: Mapping[str, float]
    common: Mapping[str, float]

    def values(self, factors: Mapping[str, float], *, exact: bool = False) -> dict[str, float]:
        """Return gains by parameter, as they stand in a file; or not rounded to that, each by itself."""
        written = float if exact else self.names.written
        of_d = factors.get(self.names.derivative, 1.0)
        beyond = 1.0 if exact else self._beyond(factors)
        pairs = {
            name: (factor if name == self.names.angle else factor / beyond, self.now[name])
            for name, factor in factors.items()
        }
        pairs |= {name: (of_d, value) for name, value in self.with_d.items()}
        if beyond > 1.0:
            pairs |= {name: (beyond, value) for name, value in self.common.items()}
        # What stays is not rounded, either.
        return {
            name: now if factor == 1.0 else written(factor * now) for name, (factor, now) in pairs.items()
        }

    def as_written(self, factors: Mapping[str, float]) -> dict[str, float]:
        """Return the factors that the gains of a file make, which are rounded."""
        values, beyond = self.values(factors), self._beyond(factors)
        return {
            name: values[name] * (1.0 if name == self.names.angle else beyond) / self.now[name]
            for name in factors
        }

    def highest(self, name: str) -> float:
        """Return the largest factor on a gain that the firmware documents.

        What multiplies P, I and D takes each of them beyond its own range.
        """
        own = self.names.factors(name, self.now[name])[1]
        if name == self.names.angle:
            return own
        return own * math.prod(self.names.factors(one, value)[1] for one, value in self.common.items())

    def _beyond(self, factors: Mapping[str, float]) -> float:
        """Return what P, I and D leave to the gain that multiplies them: what is beyond their own ranges."""
        own = (name for name in factors if self.common and name != self.names.angle)
        beyond = (factors[name] / self.names.factors(name, self.now[name])[1] for name in own)
        return max(1.0, max(beyond, default=1.0))


def separate_gains(
    case: Case,
    held: HeldLoops,
    flown_kept: Kept,
    rebuild: Rebuild,
    limits: Limits,
    disturbed: Disturbed,
    *,
    rising: bool = True,
) -> SeparateGains | None:
    """Return the search for the gains of one axis, each by itself.

    Parameters
    ----------
    case : Case
    held : HeldLoops
        With the gains that flew, around the vehicles that the next flight allows.
    flown_kept : Kept
        How much of the limits these keep.
    rebuild : callable
    limits : Limits
    disturbed : Disturbed
    rising : bool
        Whether gains may be higher than flown.

    Returns
    -------
    SeparateGains or None
        None where there is no gain to vary, or the controller is no sum over its gains.
    """
    varied, loops = _varied(case), held.loops
    paths = _taken_apart(varied, loops.controller, loops.frequency_hz, rebuild)
    if paths is None:
        return None
    began = None if case.found is None else case.found.began
    return SeparateGains(varied, paths, held, flown_kept, rebuild, limits, disturbed, began, rising=rising)


def _varied(case: Case) -> _Varied:
    names = case.names
    own = (names.proportional, names.integral, names.derivative)
    flown = {name: case.parameters.get(name, 0.0) for name in (*own, names.angle)}
    now = {name: value for name, value in flown.items() if np.isfinite(value) and value > 0.0}
    ends = names.scaled if names.derivative in names.scaled else ()
    with_d = {name: case.parameters[name] for name in ends if name not in own}
    common = {name: case.parameters[name] for name in names.common if case.parameters[name] > 0.0}
    return _Varied(names, now, with_d, common)


def _taken_apart(
    varied: _Varied, controller: AxisController, frequency_hz: FloatArray, rebuild: Rebuild
) -> GainPaths | None:
    """Return the controller's answers by gains, None where they are no sums over them."""
    if not varied.now:
        return None
    own = [name for name in varied.now if name != varied.names.angle]
    doubled = {name: rebuild(varied.values({name: 2.0}, exact=True)) for name in own}
    all_of_them = dict.fromkeys(varied.now, 2.0)
    both = (all_of_them, rebuild(varied.values(all_of_them, exact=True)))
    angle = varied.names.angle if varied.names.angle in varied.now else ""
    return gain_paths(doubled, controller, both, angle, frequency_hz)


class SeparateGains:
    """The search for the gains of one axis: see `separate_gains`."""

    def __init__(
        self,
        varied: _Varied,
        paths: GainPaths,
        held: HeldLoops,
        flown_kept: Kept,
        rebuild: Rebuild,
        limits: Limits,
        disturbed: Disturbed,
        began: AxisController | None,
        *,
        rising: bool,
    ) -> None:
        loops = held.loops
        self._varied, self._names, self._now = varied, varied.names, varied.now
        self._paths, self._loops, self._rebuild, self._limits = paths, loops, rebuild, limits
        self._refiltered = False
        self._held = held
        self._groups = tuple(_groups(held))
        #: Of each group: the estimate, and those that are the worst in what limits the gains.
        self._decisive = [np.zeros(one.every.part.size, dtype=np.bool_) for one in self._groups]
        self._decisive[1][0] = True
        # Where drawn vehicles are to keep less, the estimate decides by itself.
        self._decisive[0][0] = held.drawn < 1.0
        self._latest: _Vehicles | None = None
        #: Gains of a file that were borne, and the part of the limits that they keep.
        self._borne: dict[tuple[tuple[str, float], ...], float] = {}
        #: What the search requires, over that: gains in a file are rounded.
        self._aim = 1.0
        self._rising, self._highest = rising, _BOUNDS[1] if rising else 1.0
        self._integral = 1.0
        self._noise = _Noise(disturbed, loops)
        self._gusts = _gusts(disturbed, loops.plants.at(slice(0, 1)), loops.frequency_hz)
        self._enough = Kept(*(min(1.0 - 2.0 * _ROUNDING, one) for one in flown_kept))
        crossover = loops.first(1).margins().rate.crossover_hz
        self._above = loops.frequency_hz >= (0.0 if crossover is None else crossover.value)
        self._flown = dict.fromkeys(self._now, 1.0)
        if crossover is not None and rising:
            self._integral = self._most_integral()
        flown_answers = paths.at(_sets(self._flown))
        self._flown_whole = flown_answers[0, 0] + flown_answers[0, 1]
        self._flown_answer = np.abs(self._flown_whole[self._above])
        # No pilot wants a vehicle that follows more slowly, as gusts alone would have it.
        flown_loop = self._loop(flown_answers)
        self._flown_hz = float(self._attitude(flown_loop).bandwidth_hz[0])
        if began is not None:
            # What steps on the way made faster is no wish of the pilot's.
            self._flown_hz = min(self._flown_hz, _bandwidth_hz(began, loops))
        self._flown_error_rad = float(self._gusts.attitude_rad(flown_loop.whole)[0])

    def anew(self) -> SeparateGains:
        """Return a search that learns by itself which vehicles decide."""
        other = copy(self)
        other._decisive = [one.copy() for one in self._decisive]
        other._latest = None
        return other

    def behind(self, filters: Mapping[str, float], log_hz: float) -> SeparateGains | None:
        """Return the search behind other filters; what is better or noisier is still told of what flew.

        Parameters
        ----------
        filters : mapping of str to float
            By parameter.
        log_hz : float
            Rate of the rows that show the noise: what they may hide counts as its worst.

        Returns
        -------
        SeparateGains or None
            None where these make no controller, or one of another rate.
        """

        def filtered(changes: Mapping[str, float]) -> AxisController | None:
            return self._rebuild({**filters, **changes})

        controller, frequency_hz = filtered({}), self._loops.frequency_hz
        if controller is None or controller.period_s != self._loops.controller.period_s:
            return None
        paths = _taken_apart(self._varied, controller, frequency_hz, filtered)
        if paths is None:
            return None
        other = self.anew()
        other._paths, other._rebuild, other._refiltered = paths, filtered, True
        other._borne = {}
        other._noise = self._noise.behind(log_hz)
        # Filters are for where flights end, however far that is, and the estimate is what later ones know.
        if self._rising:
            other._highest = max(self._highest, _IN_THE_END)
        for one in other._decisive:
            one[:] = False
        other._decisive[0][0] = True
        return other

    def target(self, common: float) -> dict[str, float]:
        """Return by parameter the factor at which gusts are rejected best, the limits being kept.

        Parameters
        ----------
        common : float
            The best factor on P, I and D together.
        """
        self._highest = max(self._highest, common)
        begin = self._begin(common)
        self._add_decisive(begin)
        bounds = {name: (_BOUNDS[0], self._most(name)) for name in self._now}
        return self._searched(begin, bounds)

    def target_near(self, begin: Mapping[str, float]) -> dict[str, float]:
        """Return what `target` does, searched near some factors alone."""
        self._add_decisive(begin)
        bounds = {name: (_BOUNDS[0], self._most(name)) for name in self._now}
        return self._searched(dict(begin), bounds, everywhere=False)

    def _searched(
        self,
        begin: dict[str, float],
        bounds: _Bounds,
        most_up: float = np.inf,
        *,
        everywhere: bool = True,
    ) -> dict[str, float]:
        """Search until the vehicles that decide are known; return the best factors that all of them bear."""
        tried: list[dict[str, float]] = []
        begins, borne = [begin, *(self._best_of_a_grid(bounds, most_up) if everywhere else ())], False
        while not borne and len(tried) < _ROUNDS:
            tried.append(self._search(begins, bounds, most_up))
            if self._least_kept(tried[-1]) < -_ROUNDING:
                # Some of the vehicles bear no gains: nor do they with others beside them.
                break
            borne = self._bear(tried[-1], 1.0 - _ROUNDING)
            if not borne and not self._add_decisive(tried[-1]) and not self._aim_higher(tried[-1]):
                break
            begins = [tried[-1]]
        self._aim = 1.0
        # What is borne is the best of its kind; but gains that flew may keep as much at less cost.
        ends = tried[-1:] if borne else [end for one in tried if (end := self._up_to_the_limits(one))]
        if (not ends or min(map(self.cost, ends)) > 1.0) and self.keeps(self._flown):
            ends = [*ends, self._flown]
        # What ranked filters may be better than where a search ends that looks at more vehicles.
        if self._refiltered and not borne and self.keeps(begin):
            ends = [*ends, begin]
        return min(ends, key=self.cost, default=tried[-1])

    def _aim_higher(self, factors: Mapping[str, float]) -> bool:
        """Ask for more of the limits where gains keep them until they are rounded; tell whether they do."""
        exact, written = (self._least_kept(one) for one in (factors, self._varied.as_written(factors)))
        rounded_off = exact >= -_ROUNDING > written > -1.0
        if rounded_off:
            self._aim /= 1.0 + written
        return rounded_off

    def _least_kept(self, factors: Mapping[str, float]) -> float:
        """Return how much the decisive vehicles keep of the limits, beyond what is required."""
        return float(np.min(self._spare(self._paths.at(_sets(factors))))) - 1.0

    def _add_decisive(self, factors: Mapping[str, float]) -> bool:
        """Add the vehicles that lack most with some gains, for each limit; tell whether any is new."""
        answers, self._latest, added = self._paths.at(_sets(factors)), None, 0
        for place, (group, decisive) in enumerate(zip(self._groups, self._decisive, strict=True)):
            kept = self._spare_of(answers * group.later, group.every)[0]
            rank = round((1.0 - _WORST) * (len(kept) - 1))
            worst = np.argsort(kept, axis=0, kind="stable")[rank : rank + _DECISIVE]
            lacking = np.take_along_axis(kept, worst, axis=0) < 1.0
            lacking[0] |= place < _AS_FLOWN
            before = np.count_nonzero(decisive)
            decisive[worst[lacking]] = True
            added += int(np.count_nonzero(decisive) - before)
        return bool(added)

    def _best_of_a_grid(self, bounds: _Bounds, most_up: float) -> list[dict[str, float]]:
        """Return the best of factors far apart: a search ends where it is best nearby."""
        names = list(bounds)
        each = [np.unique(np.geomspace(low, high, _GRID)) for low, high in bounds.values()]
        points = np.stack(np.meshgrid(*each, indexing="ij"), axis=-1).reshape(-1, len(names))
        values = self._values(dict(zip(names, points.T, strict=True)), most_up)
        best = points[np.argsort(values, kind="stable")[:_STARTS]]
        return [dict(zip(names, one, strict=True)) for one in best.tolist()]

    def _up_to_the_limits(self, target: Mapping[str, float]) -> dict[str, float] | None:
        """Return how far some vehicles bear the way from the flown gains to a target, None for nowhere."""
        for part in _PARTS:
            if self.keeps(factors := _towards(target, part)):
                return factors
        return None

    def _begin(self, factor: float) -> dict[str, float]:
        """Return a factor on P, I and D as far as each may go."""
        own = {name: 1.0 if name == self._names.angle else factor for name in self._now}
        return {name: float(np.clip(one, _BOUNDS[0], self._most(name))) for name, one in own.items()}

    def _most(self, name: str) -> float:
        """Return the largest factor on a gain that is searched, or that the firmware documents."""
        highest = max(self._highest, self._integral) if name == self._names.integral else self._highest
        return min(highest, self._varied.highest(name))

    def _most_integral(self) -> float:
        """Return the factor at which the integral answers as much as P at the crossover.

        It holds what is slower, where its gain may be far from what a loop bears.
        """
        own = [name for name in (self._names.proportional, self._names.integral) if name in self._now]
        place, flown = int(np.argmax(self._above)), self._paths.at(_sets(self._flown))[0, 0]
        twice = (self._paths.at(_sets({**self._flown, name: 2.0}))[0, 0] for name in own)
        answers = [float(np.abs(one - flown)[place]) for one in twice]
        return answers[0] / answers[1] if len(answers) > 1 and answers[1] > 0.0 else 1.0

    def _search(
        self, begins: list[dict[str, float]], bounds: _Bounds, most_up: float, *, rough: bool = False
    ) -> dict[str, float]:
        """Search from some factors for the least attitude error; return the best of ends and beginnings."""
        from scipy.optimize import NonlinearConstraint, minimize

        names = list(begins[0])
        limits = [(math.log(low), math.log(high)) for low, high in map(bounds.__getitem__, names)]

        def factors(logs: FloatArray) -> dict[str, float]:
            return dict(zip(names, np.exp(logs).tolist(), strict=True))

        def value(logs: FloatArray) -> float:
            return float(self._values(_sets(factors(logs)), most_up)[0])

        told = _Slopes(lambda logs: self._weighed(dict(zip(names, np.exp(logs).T, strict=True)), most_up))
        found = list(begins)
        for begin in begins:
            end = minimize(
                told.cost,
                told.begin(np.log([begin[name] for name in names])),
                method="SLSQP",
                jac=told.cost_slope,
                bounds=[*limits, *[(0.0, np.inf)] * _N_BURDENS],
                constraints=NonlinearConstraint(told.kept, 0.0, np.inf, jac=told.kept_slope),
                options={"maxiter": _FEW_STEPS if rough else _MOST_STEPS, "ftol": _TOLERANCE},
            )
            found.append(factors(end.x[: len(names)]))
        each = {name: np.array([one[name] for one in found]) for name in names}
        best = found[int(np.argmin(self._values(each, most_up)))]
        if rough or np.min(self._told(_sets(best), most_up)[1]) >= -_ROUNDING:
            return best
        # No gains keep all limits: as near to them as it gets, and that has corners.
        end = minimize(
            value,
            [math.log(best[name]) for name in names],
            method="Nelder-Mead",
            bounds=limits,
            options={"maxiter": _MOST_TRIALS, "xatol": _UNCHANGED, "fatol": _UNCHANGED},
        )
        return factors(end.x)

    def _values(self, factors: Mapping[str, FloatArray], most_up: float = np.inf) -> FloatArray:
        """Return what is to be small, and what is missing of the limits, for each set of gains."""
        error, kept = self._told(factors, most_up)
        return np.asarray(error + PENALTY * np.sum(np.maximum(-kept, 0.0), axis=1))

    def _told(
        self, factors: Mapping[str, FloatArray], most_up: float = np.inf
    ) -> tuple[FloatArray, FloatArray]:
        """Return what is to be small, a logarithm, and how much is kept of each limit beyond it.

        That is the `cost`. For each of several sets of gains: (n_sets,), (n_sets, n_limits).
        """
        value, kept, burdens = self._weighed(factors, most_up)
        return value + np.sum(np.maximum(burdens, 0.0), axis=1), kept

    def _weighed(
        self, factors: Mapping[str, FloatArray], most_up: float = np.inf
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what `_told` does without burdens, and these: (n_sets,), (n_sets, n_limits), `_burdens`."""
        answers = self._paths.at(factors)
        loop = self._loop(answers)
        attitude = self._attitude(loop)
        kept = [
            self._spare(answers).reshape(len(answers), -1) - 1.0,
            1.0 - np.maximum(attitude.peak_db, 0.0)[:, np.newaxis] / _MOST_PEAK_DB,
            1.0 - np.maximum(attitude.resonance_db, 0.0)[:, np.newaxis] / _MOST_RESONANCE_DB,
            -self._noise.beyond(loop)[:, np.newaxis],
        ]
        if np.isfinite(most_up):
            kept.append(np.log(self._may_rise(kept[0] + 1.0, most_up) / self._rises(factors))[:, np.newaxis])
        value = np.log(self._gusts.attitude_rad(loop.whole))
        return value, np.minimum(np.concatenate(kept, axis=1), 1.0), self._burdens(factors, attitude)

    def _burdens(self, factors: Mapping[str, FloatArray], attitude: Attitude) -> FloatArray:
        """Return how much more slowly the attitude follows, and how much less the integral holds.

        Logarithms, (n_sets, _N_BURDENS), below zero where they are no burden.
        """
        # A load off centre and a bent arm are in no spectrum of gusts: the integral falls with P.
        integral, proportional = (
            factors.get(name, np.ones(attitude.bandwidth_hz.shape))
            for name in (self._names.integral, self._names.proportional)
        )
        weaker = np.minimum(proportional, 1.0) / integral
        return np.stack([np.log(self._flown_hz / attitude.bandwidth_hz), np.log(weaker)], axis=1)

    def _may_rise(self, spare: FloatArray, most_up: float) -> FloatArray:
        """Return by how much the controller's gain may rise, (n_sets,), for what vehicles keep of limits.

        ``spare`` is that of each vehicle and limit, (n_sets, n_vehicles * n_limits): see `may_rise`.
        """
        loops = 1 if self._loops.angle is None else 2
        each = spare.reshape(len(spare), -1, loops, N_LIMITS)
        gain_db = self._limits.gain_db * np.min(each[..., 0], axis=(1, 2))
        return np.asarray(may_rise(gain_db, most_up))

    def _at(self, factors: Mapping[str, FloatArray]) -> _Loop:
        """Return the loops of the estimate with other gains."""
        return self._loop(self._paths.at(factors))

    def _loop(self, answers: ComplexArray) -> _Loop:
        """Return the loops of the estimate behind a controller's answers (n_sets, 3, n_frequencies)."""
        back, by_angle, forward = np.moveaxis(self._loops.body[0] * answers, 1, 0)
        return _Loop(back, back + by_angle if self._loops.angle is not None else None, forward)

    def _answer(self, factors: Mapping[str, FloatArray]) -> FloatArray:
        """Return the size of the command's answer to the rate from the crossover up, by all paths."""
        back, by_angle, _ = np.moveaxis(self._paths.at(factors)[..., self._above], 1, 0)
        return np.asarray(np.abs(back + by_angle))

    def _rises(self, factors: Mapping[str, FloatArray]) -> FloatArray:
        """Return by how much more the controller answers than as flown, from the crossover up; (n_sets,).

        Other filters answer more far above it, where no loop is closed any more: there it does not count.
        """
        answer = self._answer(factors)
        rises = answer / self._flown_answer
        if self._refiltered:
            loop = answer * np.abs(self._loops.body[0][self._above])
            rises = np.where(loop > SMALL_LOOP, rises, 0.0)
        return np.asarray(np.max(rises, axis=1))

    def _attitude(self, loop: _Loop) -> Attitude:
        return attitude_of(self._loops.frequency_hz, loop.rate, loop.full, loop.to_rate)

    def _spare(self, answers: ComplexArray) -> FloatArray:
        """Return how much of each limit the decisive vehicles keep, as `_spare_of`."""
        if self._latest is None:
            # A search asks for the same ones hundreds of times.
            some = [one.some(which) for one, which in zip(self._groups, self._decisive, strict=True)]
            self._latest = _Vehicles(*(np.concatenate(each) for each in zip(*some, strict=True)))
        return self._spare_of(answers, self._latest)

    def _spare_of(self, answers: ComplexArray, vehicles: _Vehicles) -> FloatArray:
        """Return how much of each limit vehicles keep.

        Shape (n_sets, n_vehicles, n_limits), for answers of a controller (n_sets, 3, n_frequencies).
        """
        (body, part, damping), frequency_hz = vehicles, self._loops.frequency_hz
        back, by_angle, _ = np.moveaxis(answers, 1, 0)
        # The rate loop and the whole one, where it is known: (n_sets, n_loops, n_frequencies).
        both = np.stack([back] if self._loops.angle is None else [back, back + by_angle], axis=1)
        poles = integrators(self._loops.controller) + np.arange(both.shape[1])
        # So few sets at a time that their loops stay in the processor's cache.
        at_once = max(POINTS_AT_ONCE // (body.size * poles.size), 1)
        kept = []
        for first in range(0, len(both), at_once):
            some = body[:, np.newaxis] * both[first : first + at_once, np.newaxis]
            n_plants = len(some) * len(body)
            figures = figures_of(
                frequency_hz,
                some.reshape(-1, frequency_hz.size),
                np.tile(poles, n_plants),
                np.tile(np.repeat(damping > 0.0, poles.size), len(some)),
            )
            kept.append(spare_of(figures, self._limits))
        each = np.concatenate(kept).reshape(len(answers), len(body), -1)
        return np.asarray(each / (self._aim * part[:, np.newaxis]))

    def _bear(self, factors: Mapping[str, float], part: float) -> bool:
        """Tell whether some vehicles keep a part of all limits, with the gains of a file."""
        values = self._varied.values(factors)
        gains = tuple(sorted(values.items()))
        # Where a search ends is asked once more, for less of the limits.
        if self._borne.get(gains, 0.0) >= part:
            return True
        controller = self._rebuild(values)
        borne = controller is not None and self._held.keep_with(controller, self._limits, Kept(part, part))
        if borne:
            self._borne[gains] = part
        return borne

    def keeps(self, target: Mapping[str, float]) -> bool:
        """Tell whether the limits are kept at a target: without that, no step towards it is worth a flight.

        Parameters
        ----------
        target : mapping of str to float
            Factors.
        """
        return self._bear(target, 1.0 - 2.0 * _ROUNDING)

    def cost(self, factors: Mapping[str, float]) -> float:
        """Return what is to be small with other gains, over that of the flown ones.

        Returns
        -------
        float
            The attitude error of gusts, times how much more slowly the attitude follows, times how much less
            the integral holds.
        """
        sets = _sets(factors)
        burdens = self._burdens(sets, self._attitude(self._at(sets)))
        return math.exp(np.sum(np.maximum(burdens, 0.0))) * self.gust_error(factors)

    def gust_error(self, factors: Mapping[str, float]) -> float:
        """Return the attitude error of gusts with other gains, over that of the flown ones."""
        whole = self._at(_sets(factors)).whole
        return float(self._gusts.attitude_rad(whole)[0] / self._flown_error_rad)

    def quick(self, begin: Mapping[str, float]) -> Quick:
        """Search roughly from some factors, around the vehicles that decide: to rank filters by."""
        bounds = {name: (_BOUNDS[0], self._most(name)) for name in self._now}
        near = {name: float(np.clip(one, *bounds[name])) for name, one in begin.items()}
        return self.told_of(self._search([near], bounds, np.inf, rough=True))

    def told_of(self, factors: Mapping[str, float]) -> Quick:
        """Tell what factors cost, how noisy they are, and what they miss, around the decisive vehicles."""
        kept = self._told(_sets(factors))[1]
        noise = self._noise.ratio(self._at(_sets(factors)))
        missing = float(np.sum(np.maximum(-kept[0] - _ROUNDING, 0.0)))
        return Quick(dict(factors), self.cost(factors), float(noise[0]), missing)

    def phase_lost_deg(self) -> float:
        """Return the phase that filters lose at the flown crossover, less that of the flown ones [deg]."""
        back, by_angle, _ = self._paths.at(_sets(self._flown))[0]
        place = int(np.argmax(self._above))
        return -float(np.degrees(np.angle((back + by_angle)[place] / self._flown_whole[place])))

    def passes(self, frequency_hz: float) -> tuple[float, float]:
        """Return the gain from gyro to command at a frequency over that as flown, and the gain of the loop.

        Returns
        -------
        tuple of float
            Both with the flown gains: what the filters alone make of it.
        """
        back, by_angle, _ = self._paths.at(_sets(self._flown))[0]
        answer = np.abs(back + by_angle)
        both = (answer / np.abs(self._flown_whole), answer * np.abs(self._loops.body[0]))
        more, loop = (float(np.interp(frequency_hz, self._loops.frequency_hz, one)) for one in both)
        return more, loop

    def in_reach(self, common: float) -> float:
        """Return the `cost` of the best gains if the vehicle were known to be the estimate.

        Parameters
        ----------
        common : float
            A factor on P, I and D to begin at.
        """
        alone = self.anew()
        for one in alone._decisive:
            one[:] = False
        alone._decisive[0][0] = True
        bounds = {name: (_BOUNDS[0], self._most(name)) for name in self._now}
        begins = [self._begin(common), *alone._best_of_a_grid(bounds, np.inf)]
        return alone.cost(alone._search(begins, bounds, np.inf))

    def worst_error(self, factors: Mapping[str, float]) -> float:
        """Return the attitude error of gusts over that of the flown gains, in 97.5 % of the vehicles."""
        back, by_angle, _ = self._paths.at(factors)
        flown, other = (
            self._gusts.attitude_rad(self._loops.body * answer)
            for answer in (self._flown_whole, back + by_angle)
        )
        return float(np.quantile(other / flown, _WORST))

    def common(self, factor: float) -> float:
        """Return the `cost` of one factor on P, I and D."""
        return self.cost({name: 1.0 if name == self._names.angle else factor for name in self._now})

    def step(self, target: Mapping[str, float], most_up: float) -> Step | None:
        """Return the gains of the next flight on the way to a target.

        Parameters
        ----------
        target : mapping of str to float
            Factors.
        most_up : float
            By which the controller's gain may rise in one flight, from the crossover up, whatever margin that
            leaves above the limits: more where it leaves as much more (`may_rise`).

        Returns
        -------
        Step or None
            Each gain lies between the flown one and its target: those of them that reject gusts best. No
            vehicle of those that the next flight allows has less margin than is to be kept, or than it had.
            None where there are no such gains.
        """
        if all(factor == 1.0 for factor in target.values()) and not self._refiltered:
            return None
        best = dict(target)
        if not self._is_small_step(target, most_up):
            # The largest part of the way that is borne.
            low, high = 0.0, 1.0
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                small = self._is_small_step(_towards(target, middle), most_up)
                low, high = (middle, high) if small else (low, middle)
            near = _towards(target, low)
            # No gain goes beyond its target, to come back later.
            bounds = {name: (min(1.0, factor), max(1.0, factor)) for name, factor in target.items()}
            best = self._searched(near, bounds, most_up)
        found = self._promised(best, most_up)
        low, high = 0.0, 1.0
        for _ in range(0 if found is not None else _HALVINGS):
            middle = 0.5 * (low + high)
            tried = self._promised(_towards(best, middle), most_up)
            low, high, found = (low, middle, found) if tried is None else (middle, high, tried)
        if found is None:
            return None
        factors, controller, promised = found
        more_flights = 0
        if not all(abs(target[name] / factor - 1.0) < _SAME for name, factor in factors.items()):
            now, then = (self._answer(_sets(one))[0] for one in (factors, target))
            rise = math.log(float(np.max(then / now)))
            more_flights = max(math.ceil(rise / math.log(most_up) - _ROUNDING), 1)
        following, wanted = self._varied.values(factors), self._varied.values(target)
        common = {name: now for name, now in self._varied.common.items() if name in {**following, **wanted}}
        gains = {
            name: GainChange(now, following.get(name, now), wanted.get(name, now))
            for name, now in {**self._now, **self._varied.with_d, **common}.items()
        }
        return Step(gains, controller, promised, more_flights)

    def _is_small_step(self, factors: Mapping[str, float], most_up: float) -> bool:
        """Tell whether the controller's gain rises by no more than it may, by the vehicles that decide."""
        sets = _sets(factors)
        spare = self._spare(self._paths.at(sets)).reshape(1, -1)
        return bool(self._rises(sets)[0] <= self._may_rise(spare, most_up)[0])

    def _promised(
        self, factors: Mapping[str, float], most_up: float
    ) -> tuple[dict[str, float], AxisController, LoopMargins] | None:
        """Return gains with what they promise, None where some vehicles keep too little."""
        changed = {name: 1.0 if abs(one - 1.0) < _UNCHANGED else one for name, one in factors.items()}
        controller = self._rebuild(self._varied.values(changed))
        if controller is None:
            return None
        promised = self._loops.of(controller).margins()
        if not self._held.keep_with(controller, self._limits, self._enough, promised):
            return None
        # Steps are cut at the limit, which rounding may be beyond.
        if self._rises(_sets(changed))[0] > (1.0 + _UNCHANGED) * may_rise(least_gain_db(promised), most_up):
            return None
        return changed, controller, promised


class _Vehicles(NamedTuple):
    """Vehicles of which a part of the limits is required.

    Answers (n_plants, n_frequencies), parts and damping (n_plants,).
    """

    body: ComplexArray
    part: FloatArray
    damping: FloatArray


class _Group(NamedTuple):
    """Vehicles in one condition, as they are told or with dynamics that nobody measured.

    ``later`` is what these make of their answers, (n_frequencies,).
    """

    every: _Vehicles
    later: ComplexArray

    def some(self, which: BoolArray) -> _Vehicles:
        """Return the vehicles that are marked, (n_plants,), with what nobody measured."""
        body, part, damping = self.every
        return _Vehicles(body[which] * self.later, part[which], damping[which])


def _groups(held: HeldLoops) -> Iterator[_Group]:
    """Yield the vehicles as they fly, then in each other condition; either as told, then as nobody measured.

    A mode of the frame may bear unmodelled dynamics better.
    """
    loops = held.loops
    later = unmodelled(loops.frequency_hz, loops.known_hz)
    for one, required in ((loops, held.drawn), *((one, held.part) for one in held.otherwise)):
        part = np.full(one.plants.damping.size, required)
        as_told = part.copy()
        if one is loops:
            as_told[0] = 1.0
        yield _Group(_Vehicles(one.body, as_told, one.plants.damping), np.ones_like(later))
        yield _Group(_Vehicles(one.body, part, one.plants.damping), later)


class _Noise:
    """Noise of the command with other gains, from what the log shows of it with those that flew."""

    def __init__(self, disturbed: Disturbed, loops: ScaledLoops) -> None:
        whole = loops.first(1).whole()
        self._flown = loops.rate[0] / (1.0 + (loops.rate[0] if whole is None else whole[0]))
        self._frequency_hz = loops.frequency_hz
        self._above = self._frequency_hz >= lowest_noise_hz(disturbed.crossover_hz)
        #: Of the noise in the command at each of the frequencies, None where it is not known.
        self._power: FloatArray | None = None
        command, band = disturbed.command, None
        if command is not None and np.isfinite(disturbed.crossover_hz):
            band = noise_band(command, disturbed.crossover_hz)
        if command is not None and band is not None:
            at_hz, power = command.frequency_hz[band], command.density[band] * command.frequency_hz[0]
            place = np.interp(at_hz, self._frequency_hz, np.arange(self._frequency_hz.size))
            before = np.minimum(place.astype(np.int64), self._frequency_hz.size - 2)
            self._power = np.zeros(self._frequency_hz.shape)
            np.add.at(self._power, before, power * (1.0 - (place - before)))
            np.add.at(self._power, before + 1, power * (place - before))
        self._aliases: list[IntArray] = []
        now = 0.0 if self._power is None else float(np.sqrt(np.sum(self._power)))
        #: Of the noise as flown.
        self._most_ratio = max(disturbed.most_noise / now, 1.0) if now > 0.0 else 1.0

    def behind(self, log_hz: float) -> _Noise:
        """Return the noise for other filters: what rows of this rate may hide counts as its worst."""
        other = copy(self)
        other._aliases = aliases(self._frequency_hz, log_hz)
        return other

    def ratio(self, loop: _Loop) -> FloatArray:
        """Return the command's noise over that as flown; where that is unknown, at the worst frequency.

        Shape (n_sets,).
        """
        ratio = np.abs(loop.rate / (1.0 + loop.whole) / self._flown)
        if self._power is None:
            return np.asarray(np.max(ratio[:, self._above], axis=1, initial=0.0))
        for places in self._aliases:
            ratio = np.maximum(ratio, ratio[:, places])
        return np.asarray(np.sqrt(ratio**2 @ self._power / np.sum(self._power)))

    def beyond(self, loop: _Loop) -> FloatArray:
        """Return by how much the command is noisier than it may be; where that is unknown, than it was.

        Shape (n_sets,).
        """
        return np.asarray(self.ratio(loop) / (1.0 if self._power is None else self._most_ratio) - 1.0)


def aliases(frequency_hz: FloatArray, log_hz: float) -> list[IntArray]:
    """Return for each frequency the places of those that rows of a log show at it, beyond half their rate.

    Rows are some of the loop's steps: what is at f in them may be at any multiple of their rate, less or
    more f.
    The worst of these counts where filters let more of it pass.
    """
    highest_hz = float(frequency_hz[-1])
    found = []
    for multiple in range(1, 1 + int(highest_hz / log_hz + 0.5)):
        for alias_hz in (multiple * log_hz - frequency_hz, multiple * log_hz + frequency_hz):
            seen = (frequency_hz <= 0.5 * log_hz) & (alias_hz > 0.5 * log_hz) & (alias_hz <= highest_hz)
            places = np.searchsorted(frequency_hz, np.minimum(alias_hz, highest_hz))
            found.append(
                np.where(seen, np.minimum(places, frequency_hz.size - 1), np.arange(frequency_hz.size))
            )
    return found


class _Slopes:
    """What a search asks for, with slopes by differences: all gains are changed in one go.

    Burdens count above zero alone, which has an edge where the flown gains are, and a search by slopes would
    stay there. So each has a variable that is not below it nor below zero, and these are what is small.
    """

    def __init__(self, told: Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]) -> None:
        self._told = told
        self._known: dict[bytes, tuple[FloatArray, FloatArray, FloatArray]] = {}
        self._slopes: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def begin(self, logs: FloatArray) -> FloatArray:
        """Return logarithms of factors with the least variables of burdens, (n_names + _N_BURDENS,)."""
        return np.append(logs, np.maximum(self._at(logs)[2][0], 0.0))

    def cost(self, variables: FloatArray) -> float:
        """Return what is to be small at variables as of `begin`."""
        logs, burdens = np.split(variables, [-_N_BURDENS])
        return float(self._at(logs)[0][0] + np.sum(burdens))

    def kept(self, variables: FloatArray) -> FloatArray:
        """Return what is to be above zero, (n_limits + _N_BURDENS,)."""
        logs, burdens = np.split(variables, [-_N_BURDENS])
        _, kept, least = self._at(logs)
        return np.append(kept[0], burdens - least[0])

    def cost_slope(self, variables: FloatArray) -> FloatArray:
        """Return how what is to be small changes with each variable."""
        return self._slope(variables)[0]

    def kept_slope(self, variables: FloatArray) -> FloatArray:
        """Return how what is to be above zero changes with each variable."""
        return self._slope(variables)[1]

    def _at(self, logs: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        key = logs.tobytes()
        if key not in self._known:
            self._known[key] = self._told(logs[np.newaxis])
        return self._known[key]

    def _slope(self, variables: FloatArray) -> tuple[FloatArray, FloatArray]:
        logs = variables[:-_N_BURDENS]
        key = logs.tobytes()
        if key not in self._slopes:
            changed = self._told(logs + _DIFFERENCE * np.eye(logs.size))
            cost, kept, least = (
                ((new - old) / _DIFFERENCE).T for new, old in zip(changed, self._at(logs), strict=True)
            )
            one = np.eye(_N_BURDENS)
            of_burdens = np.vstack([np.zeros((len(kept), _N_BURDENS)), one])
            self._slopes[key] = (
                np.append(cost, np.ones(_N_BURDENS)),
                np.hstack([np.vstack([kept, -least]), of_burdens]),
            )
        return self._slopes[key]


def _towards(target: Mapping[str, float], part: float) -> dict[str, float]:
    """Return the factors at a part of the way to a target."""
    return {name: float(factor**part) for name, factor in target.items()}


def _sets(factors: Mapping[str, float]) -> dict[str, FloatArray]:
    """Return one set of factors as the first of several."""
    return {name: np.array([factor]) for name, factor in factors.items()}


def _bandwidth_hz(controller: AxisController, loops: ScaledLoops) -> float:
    """Return the bandwidth of the estimate's attitude with another controller [Hz]."""
    loop = close(controller, loops.plants.at(slice(0, 1)), loops.frequency_hz)
    follows = loop.target_to_rate if loop.full is None else (loop.full - loop.rate) / (1.0 + loop.full)
    return float(bandwidth_hz(loops.frequency_hz, follows)[0])


def _gusts(disturbed: Disturbed, estimate: Plant, frequency_hz: FloatArray) -> Gusts:
    """Return what gusts make of the attitude; of gusts that the log tells nothing of, alike everywhere."""
    found = None
    if disturbed.gusts is not None:
        found = gusts_of(disturbed.gusts, estimate, disturbed.gust_band_hz, frequency_hz)
    if found is not None:
        return found
    flat = Spectrum(frequency_hz, np.ones(frequency_hz.shape))
    return gusts_of(flat, estimate, (0.0, np.inf), frequency_hz) or Gusts(frequency_hz, np.ones(0))
