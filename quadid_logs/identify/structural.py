"""Whether one more effect in the equations would make another effectiveness of the same flight.

A dead zone, a limit, a second lag, a moment of the tilt, an arm that bends: each is one more column. Fitted
beside the others, its coefficient says whether the flight holds it, and by how much the effectiveness moves
says whether it matters. Lag and delay follow it to first order, as does all else that was fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.flight import InputDescription
from quadid_logs.data.model import Effect, EffectCheck, StructuralCheck, TimingCheck
from quadid_logs.identify.actuator_model import ActuatorModel, FitProblem, KnownActuator, free_actuator_model
from quadid_logs.identify.design import Design
from quadid_logs.identify.first_stage import first_stage
from quadid_logs.identify.fit import PooledFit, Regression, fit_pooled, lay_out
from quadid_logs.identify.inference import MIN_CLUSTERS, Estimate, clusters_of
from quadid_logs.identify.instruments import from_attitude
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.terms import MOST_DAMPING_1_S, YAW_REACTION
from quadid_logs.maths.band import ComplexArray, delay_response, lag_response
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.random_effect import random_effect
from quadid_logs.maths.recurrence import lag
from quadid_logs.maths.rotations import tilt_from_rates
from quadid_logs.vocabulary import RATE_SYMBOLS, TORQUE_SYMBOLS

#: Squared coefficient over its variance above which an effect is there. Some twenty are tried for each of
#: three axes, variances from some thirty clusters are known to a quarter, and feedback that is not taken out
#: makes up to 40 of a flight without any effect.
EFFECT_SEEN: Final = 60.0
#: An effect that is the model's error explains a good part of what the model leaves.
_EFFECT_EXPLAINS = 0.25
#: Without set-points small torques are mostly answers to gusts, and seem to have less effect (up to 0.46).
_EXPLAINS_WITHOUT_SETPOINTS = 0.5
#: Where one axis shows a dead zone or a limit all have it, for their rotors are the same: left to say is how
#: large it is there. Three standard deviations; at one of eight levels noise reaches that once in fifty.
_ON_ANOTHER_AXIS = 9.0
#: From here on an effect may be there, and the interval covers what the effectiveness would be with it: by
#: chance on one axis in two hundred, at any of the dozen that are tried, and the price is width alone.
_EFFECT_POSSIBLE = 12.0
_POSSIBLY_EXPLAINS = 0.05
#: All of a command is lost below a dead zone, and of the levels one is at most four times that. Where 163
#: flights without a dead zone seemed to have one, none lost more than a twentieth: thrust that bends.
_LEAST_OF_LEVEL = 0.25
#: Effects that are lost torque of some size, not another shape of the response.
_OF_AMPLITUDE: Final = ("threshold", "rotor threshold", "limit")
#: An effect that would shift the effectiveness by more leaves no number.
LARGEST_SHIFT: Final = 0.5
#: An effectiveness that a dead zone or a limit may change by more than this is no number to rely on without
#: another flight: of 254 usable axes of simulated flights four had that, three of them 14 to 24 % off.
LARGE_SHIFT: Final = 0.1
#: What can pass for a wrong time of the torque.
_OF_TIME: Final[frozenset[Effect]] = frozenset({"mode", "second lag", "asymmetry"})
#: Beyond a limit, torque has no effect: in simulated flights 0.6 and more of its coefficient goes to the
#: torque that is cut off there. A curve that bends (0.1 to 0.3, firmware without a limit) is none.
_LEAST_LOST = 0.5
#: Where a dead zone or a limit is looked for, as quantiles of the torque's size.
_LEVELS: Final = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.96)
#: Where a limit only: of steps with pauses between, the first peaks alone reach it.
_PEAKS: Final = (0.98, 0.99)
#: Frames and arms of multirotors bend from some hertz on; a mode is as wide as the steps between these.
_MODES_HZ: Final = (3.0, 4.0, 5.0, 6.0, 7.0, 8.5, 10.0, 12.0)
#: Loads swing on strings of half a metre to two, at 0.35 to 0.8 Hz.
_SWINGS_HZ: Final = (0.35, 0.45, 0.6, 0.8)
#: With fewer samples a cycle, what a mode does and what the torque does between two samples are alike: a log
#: of 20 Hz, fitted up to 2.5 Hz, would show flanks of modes that no vehicle has.
_MODE_SAMPLES_PER_CYCLE = 8.0
#: Damping ratio at which a mode is looked for: wider than any, so that the steps leave no gap.
_MODE_DAMPING = 0.1
#: Relative singular value below which columns are one and the same.
_SAME_COLUMN = 1e-7
#: Without set-points the effectiveness of simulated flights in gusts is low by up to this many times the
#: fraction of the acceleration that is not explained, in 19 of 20.
_FEEDBACK = 3.0
#: A change of the effectiveness lasts longer than this; the answer to a gust does not.
_PERSISTENCE_S = 0.5
#: Below, the lag of a rotor moves no torque by as much as can be seen [s].
_LEAST_LAG_S = 0.002

_Response = Callable[[ComplexArray], ComplexArray]


class _Candidate(NamedTuple):
    """Columns (n_train, 3, n) that one effect adds to the equations of the axes, and where it is looked for.

    ``of_predicted``: the same function of the torque that follows from the instruments, an instrument for it.
    """

    effect: Effect
    columns: FloatArray
    place: FloatArray
    of_predicted: FloatArray | None = None


class _Extended(NamedTuple):
    """What an effect does to an equation.

    ``coefficient`` is that of its first column over the effectiveness, ``held`` that of the on-axis torque in
    what the other columns hold of it.
    """

    statistic: float
    explained: float
    shift: float
    coefficient: float
    held: float


class _EquationRows(NamedTuple):
    """The training rows of one equation, with lag and delay to first order among its columns.

    ``columns`` (n_train, n), ``explained`` what the instruments make of them, ``solve`` (n, n_train) its
    pseudo-inverse, ``residual`` and ``clusters`` (n_train,); ``own`` is the number of the column of the
    on-axis torque, ``gain`` its coefficient.
    """

    regression: Regression
    columns: FloatArray
    explained: FloatArray
    solve: FloatArray
    residual: FloatArray
    clusters: IntArray
    own: int
    gain: float

    @classmethod
    def of(
        cls, regression: Regression, own: int, axis: int, times: FloatArray, clusters: IntArray
    ) -> _EquationRows:
        """Lay out the equation of one axis; `times` (n_train, n) are derivatives by lag and delay."""
        used = np.flatnonzero(regression.used[axis])
        columns = np.column_stack([regression.Z[:, used], times])
        explained = np.column_stack([regression.explained[:, used], regression.project(times)])
        solve = _pseudo_inverse(explained)
        theta = solve @ regression.Y[:, axis]
        place = int(np.flatnonzero(used == own)[0])
        residual = regression.Y[:, axis] - columns @ theta
        return cls(regression, columns, explained, solve, residual, clusters, place, float(theta[place]))

    @property
    def alone(self) -> FloatArray:
        """The part of the on-axis torque that no other column holds; shape (n_train,)."""
        row = self.solve[self.own]
        return np.asarray(row / (row @ row))

    def extended(self, extra: FloatArray, also: FloatArray | None) -> _Extended:
        """Fit with more columns (n_train, n_extra), and `also` as their instruments.

        By the theorem of Frisch, Waugh and Lovell only the part of them that the others do not hold counts.
        The variance is that of scores summed over clusters.
        """
        explained = self._instrumented(extra, also)
        load = self.solve @ explained
        alone = explained - self.explained @ load
        bread = np.linalg.pinv(alone.T @ alone, hermitian=True)
        coefficient = bread @ (alone.T @ self.residual)
        left = self.residual - (extra - self.columns @ load) @ coefficient
        scores = np.column_stack([np.bincount(self.clusters, column * left) for column in alone.T])
        variance = bread @ (scores.T @ scores) @ bread
        statistic = coefficient @ np.linalg.pinv(variance, hermitian=True) @ coefficient
        explains = 1.0 - (left @ left) / max(float(self.residual @ self.residual), np.finfo(float).tiny)
        shift = -(load @ coefficient)[self.own] / self.gain
        return _Extended(
            statistic=float(statistic),
            explained=float(explains),
            shift=float(shift),
            coefficient=float(coefficient[0] / self.gain),
            held=float(load[self.own, 0]),
        )

    def _instrumented(self, extra: FloatArray, also: FloatArray | None) -> FloatArray:
        """Return what the instruments, and `also` beside them, make of more columns."""
        explained = self.regression.project(extra)
        if also is None:
            return explained
        beyond = also - self.regression.project(also)
        return np.asarray(explained + beyond @ np.linalg.lstsq(beyond, extra, rcond=_SAME_COLUMN)[0])


def _pseudo_inverse(columns: FloatArray) -> FloatArray:
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.pinv(columns / size, rcond=_SAME_COLUMN) / size[:, np.newaxis])


def check_structure(
    problem: FitProblem,
    model: ActuatorModel,
    fit: PooledFit,
    described: InputDescription | None,
    known: KnownActuator | None = None,
) -> StructuralCheck:
    """Extend each equation by one effect after the other, and compare parts of the flight with each other.

    Parameters
    ----------
    problem : FitProblem
        Whose axes are looked at.
    model : ActuatorModel
    fit : PooledFit
        To the rows of the model.
    described : InputDescription or None
        As of `quadid_logs.identify.actuator_model.find_actuator_model`.
    known : KnownActuator, optional
        The actuator was known before the fit: whether the torque is late, too.

    Returns
    -------
    StructuralCheck
    """
    structure, axes = problem.structure, problem.axes
    free = None
    if not known and axes and model.actuator.delay_s <= np.nan_to_num(fit.delay_half_width_s):
        # Where the delay reaches zero, the torque may come after the motion that it causes.
        free = free_actuator_model(problem, model, described)
    # Beside a torque from another time no effect could be told: each would make up for that.
    model = free or model
    design = model.design
    regression = lay_out(design, structure, model.actuator, fit.kept, all_instruments=True)
    lag_s, delay_s = model.actuator.lag_s, model.actuator.delay_s
    train, clusters = design.train, clusters_of(design)
    by_time = [design.torque.by_delay(lag_s, delay_s)[train]]
    if lag_s >= _LEAST_LAG_S:
        by_time.append(design.torque.by_lag(lag_s, delay_s)[train])
    equations = {
        axis: _EquationRows.of(
            regression,
            structure.columns.index(TORQUE_SYMBOLS[axis]),
            axis,
            np.column_stack([each[:, axis] for each in by_time]),
            clusters,
        )
        for axis in axes
    }
    # A torque that never changes has no effectiveness.
    equations = {axis: each for axis, each in equations.items() if each.gain != 0.0 and each.residual.any()}
    persistence, spread = _variation(design, equations)
    flight_gain, flight_half_width = _by_flight(design, equations)

    effects: tuple[EffectCheck, ...] = ()
    if equations:
        candidates = _candidates(design, model, regression)
        dead_zones = _dead_zones(design, model, described)
        effects = (*_effects(candidates, equations), *_of_rotors(dead_zones, equations))
    stage = first_stage(design)
    in_common, own = structure.on_axis(regression.solve()), np.zeros(3)
    for axis, equation in equations.items():
        own[axis] = np.clip(equation.gain / in_common[axis] - 1.0, -LARGEST_SHIFT, LARGEST_SHIFT)
    return StructuralCheck(
        effects=effects,
        timing=known.timing if known else None if free is None else _timing(problem, free, fit),
        flight_gain=flight_gain,
        flight_half_width=flight_half_width,
        persistence=persistence,
        spread=spread,
        feedback=_feedback(design, fit),
        instrumented=design.instruments is not None,
        own_timing=own,
        strength=np.full(3, np.nan) if stage is None else np.asarray(stage.statistic / stage.needed),
    )


def with_alternatives(structure: Structure, estimate: Estimate, check: StructuralCheck) -> Estimate:
    """Widen the intervals of the on-axis effectiveness to what it would be with effects that may be there.

    Parameters
    ----------
    structure : Structure
    estimate : Estimate
    check : StructuralCheck

    Returns
    -------
    Estimate
    """
    low, high = estimate.low.copy(), estimate.high.copy()
    for axis in range(3):
        place = axis, len(structure.terms) + axis
        gain = estimate.theta[place]
        of_timing = 0.0 if check.timing is None else check.timing.shift[axis]
        # How much larger, relative, the effectiveness is with what is seen, and with what may be there.
        there, may_be = seen_effects(check, axis), _possible(check, axis)
        seen = np.array([0.0, max(there, key=_explained).shift] if there else [0.0])
        # An amplitude that is lost makes the effectiveness low. A misfit of the response that looks like one
        # of the others may be of something that moves it the other way.
        opposite = [-each.shift for each in may_be if each.effect not in _OF_AMPLITUDE]
        possible = np.array([0.0, *(each.shift for each in may_be), *opposite])
        # An effect on another axis may have made the lag and the delay that all have in common.
        elsewhere = any(seen_effects(check, other) for other in range(3) if other != axis)
        own = check.own_timing[axis] if elsewhere else 0.0
        # The dead zone of the rotors that the axis has, or may have.
        lost = [
            1.0 + each.most
            for each in check.effects
            if (each.axis, each.effect) == (axis, "rotor threshold") and each.statistic >= _EFFECT_POSSIBLE
        ]
        factors = np.array([1.0, *(1.0 + of_timing) * (1.0 + seen), 1.0 + own, *lost])
        others = gain * (1.0 + possible)
        low[place] = min((low[place] * factors).min(), others.min())
        high[place] = max((high[place] * factors).max(), others.max())
        # A controller that answers disturbances makes an effectiveness too low, by no more than this.
        high[place] = gain + np.hypot(high[place] - gain, gain * check.feedback[axis])
        # The next flight has its own battery, trim and weather: several flights show how much that matters.
        between = (
            gain * random_effect(check.flight_gain[:, axis], check.flight_half_width[:, axis]).half_width
        )
        low[place] = gain - np.hypot(gain - low[place], between)
        high[place] = gain + np.hypot(high[place] - gain, between)
    return estimate._replace(low=low, high=high)


def with_unseen_damping(structure: Structure, estimate: Estimate) -> Estimate:
    """Widen the interval of a yaw effectiveness that was fitted with a reaction but without damping.

    Parameters
    ----------
    structure : Structure
    estimate : Estimate

    Returns
    -------
    Estimate

    Notes
    -----
    (B + E s) / (s + a) is (B - a E + E s) / s but for what goes with 1 / s^2: the effectiveness comes out
    low by the damping times the reaction E, which in a small vehicle is a tenth and more.
    """
    if YAW_REACTION not in structure.terms:
        return estimate
    damping, reaction = (structure.columns.index(name) for name in (RATE_SYMBOLS[2], YAW_REACTION.symbol))
    if estimate.kept[2, damping] or not estimate.kept[2, reaction]:
        return estimate
    high = estimate.high.copy()
    high[2, len(structure.terms) + 2] += abs(estimate.theta[2, reaction]) * MOST_DAMPING_1_S[2]
    return estimate._replace(high=high)


def evidence_needed(check: StructuralCheck, effect: EffectCheck) -> tuple[float, float]:
    """Return what an effect must reach to be there beyond chance, and to be much of the model's error.

    Parameters
    ----------
    check : StructuralCheck
    effect : EffectCheck
        One of its effects.

    Returns
    -------
    statistic : float
    explained : float
        Fraction of the residual.
    """
    if effect.effect == "rotor threshold":
        # A shape that nothing else has: air explains no part of it.
        return EFFECT_SEEN, 0.0
    if effect.effect not in _OF_AMPLITUDE:
        return EFFECT_SEEN, _EFFECT_EXPLAINS
    dead = effect.effect == "threshold"
    explained = _EXPLAINS_WITHOUT_SETPOINTS if dead and not check.instrumented else _EFFECT_EXPLAINS
    others = (each for each in check.effects if each.effect == effect.effect and each.axis != effect.axis)
    if any(each.statistic >= EFFECT_SEEN and each.explained >= explained for each in others):
        return _ON_ANOTHER_AXIS, 0.0
    return EFFECT_SEEN, explained


def is_seen(check: StructuralCheck, effect: EffectCheck) -> bool:
    """Say whether an effect is there beyond chance and is much of the model's error.

    Parameters
    ----------
    check : StructuralCheck
    effect : EffectCheck
        One of its effects.

    Returns
    -------
    bool
    """
    statistic, explained = evidence_needed(check, effect)
    return effect.statistic >= statistic and effect.explained >= explained


def seen_effects(check: StructuralCheck, axis: int) -> list[EffectCheck]:
    """Return the effects that an axis has.

    Parameters
    ----------
    check : StructuralCheck
    axis : int

    Returns
    -------
    list of EffectCheck
    """
    return [each for each in check.effects if each.axis == axis and is_seen(check, each)]


def is_late(check: StructuralCheck, period_s: float) -> bool:
    """Say whether the torque carries the time of a later motion.

    Parameters
    ----------
    check : StructuralCheck
    period_s : float
        Between samples: a stamp may be that of a step's begin or end, and nothing within one is late.

    Returns
    -------
    bool
        False where an effect explains it: what bends beside the gyro shows what has yet to come.
    """
    timing = check.timing
    late = timing is not None and timing.delay_s + timing.half_width_s < -period_s
    return late and not any(is_seen(check, each) and each.effect in _OF_TIME for each in check.effects)


def possible_losses(check: StructuralCheck, axis: int) -> list[EffectCheck]:
    """Return the dead zones and limits that an axis may have: not clear enough to be seen.

    Parameters
    ----------
    check : StructuralCheck
    axis : int

    Returns
    -------
    list of EffectCheck
        None where an effect is seen, whose shadows the others are.
    """
    return [each for each in _possible(check, axis) if each.effect in _OF_AMPLITUDE]


def _possible(check: StructuralCheck, axis: int) -> list[EffectCheck]:
    """Return the effects that an axis may have, and its interval covers; none where one is seen."""
    if seen_effects(check, axis):
        return []
    return [each for each in check.effects if each.axis == axis and _is_possible(check, each)]


def _explained(effect: EffectCheck) -> float:
    return effect.explained


def _is_possible(check: StructuralCheck, effect: EffectCheck) -> bool:
    """Say whether the interval is to cover the effectiveness with an effect that is not seen clearly.

    A mode in the band is then any combination of gain and lag. The rotors of all axes are the same: a dead
    zone that may be on one may be on all.
    """
    if effect.effect == "rotor threshold":
        return effect.statistic >= _EFFECT_POSSIBLE
    if effect.effect == "mode" or abs(effect.shift) > LARGEST_SHIFT:
        return False
    same = [each for each in check.effects if each.effect == effect.effect == "threshold"]
    evidence = max((each.statistic for each in same if _is_part(each)), default=effect.statistic)
    return evidence >= _EFFECT_POSSIBLE and _is_part(effect)


def _is_part(effect: EffectCheck) -> bool:
    """Say whether an effect is enough of the model's error to matter to an interval.

    A moment of the tilt is one column, not the likeliest of a dozen levels or frequencies: beyond chance it
    counts whatever it explains. A load that swings is three, and what gusts and attitude loop make of a tilt
    looks like it; it explains half and more of what the model leaves.
    """
    least = {"tilt": -np.inf, "swing": _EFFECT_EXPLAINS}.get(effect.effect, _POSSIBLY_EXPLAINS)
    return bool(effect.explained >= least)


def _effects(candidates: Iterable[_Candidate], equations: dict[int, _EquationRows]) -> Iterable[EffectCheck]:
    """Return the likeliest level or frequency of each kind of effect, axis by axis.

    That is the one furthest beyond chance, of several limits that are clear the one that explains most.
    """
    best: dict[tuple[int, Effect], EffectCheck] = {}
    for candidate in candidates:
        for axis, equation in equations.items():
            if candidate.effect in ("tilt", "swing") and axis == 2:
                continue
            also = None if candidate.of_predicted is None else candidate.of_predicted[:, axis]
            found = equation.extended(candidate.columns[:, axis], also)
            # The torque below a level has less effect (dead zone), or only that below it has any (limit).
            check = _checked(candidate, axis, found)
            effect = check.effect
            known = best.get((axis, effect))
            if check.statistic > 0.0 and (known is None or _fits(check) > _fits(known)):
                best[axis, effect] = check
    return best.values()


def _fits(effect: EffectCheck) -> tuple[float, float]:
    """Return by what the likeliest of several levels or frequencies is chosen.

    Far beyond a limit, where fewer samples are, the statistic may still grow.
    """
    clear = effect.effect == "limit" and effect.statistic >= EFFECT_SEEN
    return (EFFECT_SEEN, effect.explained) if clear else (effect.statistic, 0.0)


def _checked(candidate: _Candidate, axis: int, found: _Extended) -> EffectCheck:
    """Say what an effect does to an axis.

    The torque below a level has less effect (dead zone), or only that below it has any (limit). By what the
    instruments tell, a coefficient may be beyond chance and yet leave more than there was: that is no effect,
    but for the tilt, which no level or frequency was chosen for.
    """
    limited = candidate.effect in _OF_AMPLITUDE and found.coefficient > 0.0
    goes_on = limited and found.shift > -_LEAST_LOST
    dead = candidate.effect == "limit" and not limited
    there = (found.explained > 0.0 or candidate.effect == "tilt") and not goes_on and not dead
    return EffectCheck(
        axis=axis,
        effect="limit" if limited else candidate.effect,
        statistic=found.statistic if there else 0.0,
        explained=found.explained,
        # Below a limit, the torque and the torque cut off are one.
        shift=found.shift + (found.coefficient if limited else 0.0),
        place=float(candidate.place[axis]),
    )


def _candidates(design: Design, model: ActuatorModel, regression: Regression) -> Iterator[_Candidate]:
    """Yield all effects that are looked for."""
    # The torque cut off at one level after the other.
    torques = [chunk.torque for chunk in design.chunks]
    behind = _behind(design, model, torques)
    predicted = None if design.instruments is None else regression.project(behind)
    levels = np.quantile(np.abs(np.concatenate(torques)), [*_LEVELS, *_PEAKS], axis=0)
    for number, level in enumerate(levels):
        cut_off = _behind(design, model, [np.clip(torque, -level, level) for torque in torques])
        instrument = None if predicted is None else np.clip(predicted, -level, level)[..., np.newaxis]
        effect: Effect = "threshold" if number < len(_LEVELS) else "limit"
        yield _Candidate(effect, cut_off[..., np.newaxis], level, instrument)
    yield from _modes(design, model)
    none = np.full(3, np.nan)
    yield from _tilts(design)
    if model.actuator.lag_s >= _LEAST_LAG_S:
        curved = _shaped(design, model, lambda s: (s * lag_response(s, model.actuator.lag_s)) ** 2)
        yield _Candidate("second lag", curved[..., np.newaxis], none)
        if model.rotors is None:
            # While the torque rises, half of the rotors spin up and half down, and the thrust of all is off
            # by what the torque lacks, rectified and lagged: that much rotors that spin down more slowly take
            # from it, in the direction of its change.
            period_s, lag_s = design.sample_period_s, model.actuator.lag_s
            found = []
            for chunk in design.chunks:
                lacking = chunk.torque - lag(chunk.torque, period_s, lag_s)
                found.append(np.sign(lacking) * lag(np.abs(lacking), period_s, lag_s))
            yield _Candidate("asymmetry", _behind(design, model, found)[..., np.newaxis], none)


def _shaped(design: Design, model: ActuatorModel, response: _Response) -> FloatArray:
    """Return the torque behind the actuator and one more response, on the training rows; (n_train, 3)."""
    lag_s, delay_s = model.actuator.lag_s, model.actuator.delay_s
    return design.torque.shaped(lambda s: response(s) * lag_response(s, lag_s) * delay_response(s, delay_s))[
        design.train
    ]


def _behind(design: Design, model: ActuatorModel, torques: list[FloatArray]) -> FloatArray:
    """Return other torques, one (n_samples, 3) per chunk, behind the actuator; shape (n_train, 3)."""
    lag_s, delay_s = model.actuator.lag_s, model.actuator.delay_s
    return design.torque.replaced(torques).behind(lag_s, delay_s)[design.train]


class _DeadZone(NamedTuple):
    """A level of a rotor's thrust about the mean of all, and the torque (n_train, 3) of what is below it."""

    level: float
    below: FloatArray


def _dead_zones(
    design: Design, model: ActuatorModel, described: InputDescription | None
) -> Iterator[_DeadZone]:
    """Yield the levels that are looked for, none where the thrust of each rotor is not known."""
    per_thrust = None if described is None else described.torque_per_thrust
    thrusts = [chunk.rotor_thrust for chunk in design.chunks if chunk.rotor_thrust is not None]
    if per_thrust is None or len(thrusts) < len(design.chunks):
        return
    apart = [each - each.mean(axis=1, keepdims=True) for each in thrusts]
    for level in np.quantile(np.abs(np.concatenate(apart)), _LEVELS).tolist():
        torques = [np.clip(each, -level, level) @ per_thrust.T for each in apart]
        yield _DeadZone(level, _behind(design, model, torques))


def _of_rotors(
    dead_zones: Iterable[_DeadZone], equations: dict[int, _EquationRows]
) -> tuple[EffectCheck, ...]:
    """Return what a dead zone of each rotor does, which follows no command near the mean of all rotors.

    Torques about several axes move a rotor by their sum, so that no level of one torque tells it. The level,
    and how much is lost below it, are those of all axes together.
    """
    best: dict[int, _Extended] = {}
    lost, place = _Lost(0.0, 0.0), np.nan
    for level, below in dead_zones:
        found = {axis: each.extended(below[:, [axis]], None) for axis, each in equations.items()}
        of_level = _Lost.of([each for each in found.values() if each.statistic > 0.0])
        # By the instruments a coefficient may be beyond chance and yet leave more than there was: no effect.
        explains = sum(each.explained for each in found.values()) > 0.0
        if explains and of_level.fraction > _LEAST_OF_LEVEL and of_level.statistic > lost.statistic:
            best, lost, place = found, of_level, level
    explained = max((each.explained for each in best.values()), default=0.0)
    most = lost.fraction * (1.0 + NORMAL_95 / np.sqrt(max(lost.statistic, 1.0)))
    return tuple(
        EffectCheck(
            axis=axis,
            effect="rotor threshold",
            statistic=lost.statistic,
            explained=explained,
            shift=_restored(lost.fraction * each.held),
            most=_restored(most * each.held),
            place=place,
        )
        for axis, each in best.items()
    )


class _Lost(NamedTuple):
    """The fraction that is lost of what is below a level, by all axes, and its square over its variance."""

    fraction: float
    statistic: float

    @classmethod
    def of(cls, found: Sequence[_Extended]) -> _Lost:
        """Return the mean over axes, each by its variance."""
        each = np.array([-one.coefficient / (1.0 + one.shift) for one in found])
        information = np.array([one.statistic for one in found]) / each**2
        total = float(information.sum())
        if not 0.0 < total < np.inf:
            return cls(0.0, 0.0)
        fraction = float(information @ each) / total
        return cls(fraction, fraction**2 * total)


def _restored(lost: float) -> float:
    """Return how much larger an effectiveness is of which a fraction was lost."""
    return lost / (1.0 - lost) if lost < 1.0 else np.inf


def _modes(design: Design, model: ActuatorModel) -> Iterator[_Candidate]:
    """Yield what modes of one frequency after the other make of the torque, in either phase."""
    highest_hz = 1.0 / (_MODE_SAMPLES_PER_CYCLE * design.sample_period_s)
    for frequency_hz in (each for each in _MODES_HZ if each <= highest_hz):
        both = [_shaped(design, model, response) for response in _resonance(frequency_hz)]
        yield _Candidate("mode", np.stack(both, axis=-1), np.full(3, frequency_hz))


def _tilts(design: Design) -> Iterator[_Candidate]:
    """Yield roll and pitch, and with them what a load makes of both that swings at one frequency.

    The string pulls along the angle between vehicle and load, and the load follows the vehicle, which
    moves where its thrust is tilted to.
    """
    spectra = []
    for chunk, grid in zip(design.chunks, design.torque.grids, strict=True):
        angles = chunk.attitude_rad
        if angles is None:
            angles = tilt_from_rates(chunk.body_rate_rad_s, design.sample_period_s)
        spectra.append(grid.spectrum_of(np.column_stack([angles[:, :2], np.zeros(chunk.n_samples)])))

    def behind(response: _Response) -> FloatArray:
        each = zip(design.torque.grids, spectra, strict=True)
        rows = np.concatenate([grid.lay(spectrum, response(grid.s)) for grid, spectrum in each])
        return design.high_pass(rows, design.high_pass_hz)[design.train]

    tilt = behind(np.ones_like)
    yield _Candidate("tilt", tilt[..., np.newaxis], np.full(3, np.nan))
    # Below the fitted band there is no swing, but its flank, which is any slow moment.
    for frequency_hz in (each for each in _SWINGS_HZ if each >= design.high_pass_hz):
        swings = [behind(response) for response in _resonance(frequency_hz)]
        yield _Candidate("swing", np.stack([tilt, *swings], axis=-1), np.full(3, frequency_hz))


def _resonance(frequency_hz: float) -> tuple[_Response, _Response]:
    """Return deflection and rate of a resonance: in any phase it is a sum of the two."""
    omega = 2.0 * np.pi * frequency_hz

    def deflection(s: ComplexArray) -> ComplexArray:
        found = omega**2 / (s**2 + 2.0 * _MODE_DAMPING * omega * s + omega**2)
        return np.asarray(found, dtype=np.complex128)

    return deflection, lambda s: s / omega * deflection(s)


def _variation(design: Design, equations: dict[int, _EquationRows]) -> tuple[FloatArray, FloatArray]:
    """Return how much deviations of the effectiveness go on, and the rms of those that do; (3,) each."""
    persistence, spread = np.full(3, np.nan), np.full(3, np.nan)
    half_second = np.floor((design.time_s - design.time_s[0]) / _PERSISTENCE_S)[design.train]
    number, part = np.unique(half_second, return_inverse=True)
    next_to = np.diff(number) == 1.0
    for axis, equation in equations.items():
        alone = equation.alone
        information = np.bincount(part, alone**2)
        score = np.bincount(part, alone * equation.residual)
        products = (score[1:] * score[:-1])[next_to]
        by_chance = np.sqrt(np.sum(products**2))
        if by_chance > 0.0:
            persistence[axis] = np.sum(products) / by_chance
            # Where the residual of one half second goes with that of the next, it is no noise.
            lasting = max(float(np.sum(products)), 0.0) / np.sum(
                (information[1:] * information[:-1])[next_to]
            )
            spread[axis] = np.sqrt(lasting) / abs(equation.gain)
    return persistence, spread


def _by_flight(design: Design, equations: dict[int, _EquationRows]) -> tuple[FloatArray, FloatArray]:
    """Return each flight's on-axis effectiveness over that of all, its half width; (n_flights, 3) each."""
    flight = np.array([chunk.flight for chunk in design.chunks])[design.chunk][design.train]
    flights = np.unique(flight)
    shape = (flights.size if flights.size > 1 else 0, 3)
    gain, half_width = np.full(shape, np.nan), np.full(shape, np.nan)
    for axis, equation in equations.items():
        information, square, n_clusters = np.zeros((3, shape[0]))
        for row in range(shape[0]):
            rows = flight == flights[row]
            alone, clusters = equation.alone[rows], np.unique(equation.clusters[rows], return_inverse=True)[1]
            if not alone @ alone > 0.0:
                continue
            information[row] = alone @ alone
            change = alone @ equation.residual[rows] / information[row]
            scores = np.bincount(clusters, alone * (equation.residual[rows] - change * alone))
            square[row], n_clusters[row] = scores @ scores, clusters.max() + 1
            gain[row, axis] = 1.0 + change / equation.gain
        if not information.any():
            continue
        # A short flight has too few seconds to tell its own disturbances: those of all stand for them.
        told = n_clusters >= MIN_CLUSTERS
        free = max(float(n_clusters.sum() - np.count_nonzero(n_clusters)), 1.0)
        common = square.sum() / information.sum() * n_clusters.sum() / free
        variance = np.full(shape[0], np.nan)
        np.divide(np.where(told, square / np.maximum(information, 1e-300), common), information,
                  out=variance, where=information > 0.0)  # fmt: skip
        half_width[:, axis] = NORMAL_95 * np.sqrt(variance) / abs(equation.gain)
    return gain, half_width


def _timing(problem: FitProblem, free: ActuatorModel, fit: PooledFit) -> TimingCheck:
    """Say what a delay that may be negative makes of the effectiveness."""
    again = fit_pooled(free.design, problem.structure, free.actuator, fit.kept)
    gain, free_gain = problem.structure.on_axis(fit.theta), problem.structure.on_axis(again.theta)
    shift = np.divide(free_gain, gain, out=np.ones(3), where=gain != 0.0) - 1.0
    roll, pitch, yaw = (shift[axis] if axis in problem.axes else 0.0 for axis in range(3))
    return TimingCheck(
        delay_s=free.actuator.delay_s,
        half_width_s=again.delay_half_width_s,
        shift=(float(roll), float(pitch), float(yaw)),
    )


def _feedback(design: Design, fit: PooledFit) -> FloatArray:
    """Return how much larger the on-axis effectiveness may be because of feedback, relative; shape (3,).

    Of disturbances d the controller makes the torque -T d / B, T the closed loop, at most about one: least
    squares then find B less the fraction of the torque's variance that answers d (U. Forssell and L. Ljung,
    Automatica 35, 1999). Seen is what the loop leaves of d, a good part of which passes for the model.
    """
    unexplained = np.clip(1.0 - fit.r2[:3], 0.0, 1.0)
    higher = _FEEDBACK * unexplained / np.maximum(1.0 - unexplained, 0.5)
    # Set-points are feedback themselves as far as an angle controller makes them of the attitude.
    return np.asarray(higher if design.instruments is None else higher * from_attitude(design))
