"""The next gains of one axis: those that reject gusts best and keep the margins, each gain by itself.

The worst of the vehicles that the flight allows decides what is changed, not the estimate; uncertainty alone
lowers nothing. One common factor of P, I and D stands where the gains one by one are not clearly better. A
flight changes gains by one step; what is promised of it is computed from the values that stand in the file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.axis_without_model import AxisWithoutModel, axis_without_model
from quadid_logs.control.filter_design import Changes, Filterable, design_filters, together
from quadid_logs.control.filter_findings import filter_findings
from quadid_logs.control.filter_guard import Refiltered, are_worth_it, is_no_worse, with_flown_filters
from quadid_logs.control.guard import Case, obstacles
from quadid_logs.control.loop import rate_loop
from quadid_logs.control.next_flight import of_next_flight
from quadid_logs.control.off_nominal import N_PLANTS, OffNominal
from quadid_logs.control.scaled_loop import HeldLoops, Kept, ScaledLoops, scaled_loops, spare
from quadid_logs.control.separate_gains import (
    Disturbed,
    Rebuild,
    SeparateGains,
    Step,
    least_gain_db,
    may_rise,
    separate_gains,
)
from quadid_logs.control.step import Steps
from quadid_logs.control.torque_noise import (
    Noise,
    attitude_error,
    logged_spectrum,
    residual_spectrum,
    torque_noise,
    torque_spectrum,
)
from quadid_logs.data.catalogue import MOST_NOISE
from quadid_logs.data.closed_loop import AxisLoop, LoopMargins, Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.model import Model
from quadid_logs.data.off_nominal import ConditionKind
from quadid_logs.data.tuning import GOOD, POOR, AxisTuning, FilterChoices, GainChange, Limits
from quadid_logs.diagnose import remedied
from quadid_logs.diagnose.findings import finding, rounded
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.vocabulary import AXES

#: In one flight gains rise by no more than the gain margin that is to be kept: 6 dB. Were the vehicle's own
#: gain so much higher than is told, the next flight would just be stable. Where the worst vehicle has more
#: than that with the next gains, they may rise by as much (`may_rise`). They fall by no more than half.
MOST_UP: Final = 2.0
MOST_DOWN: Final = 0.5
#: Within these nothing is gained: effectiveness is not the same within some per cent from flight to flight,
#: and less than a decibel of rejection is no reason to change what flies.
_SAME: Final = (0.95, 1.10)
#: Gains this near to the best are right as they are: attitude error in gusts over that of the best.
_NEAR_BEST: Final = 1.3
#: Costs this near to each other are the same; of the way between two, a search goes on within these parts.
_SAME_COST: Final = 1.03
_WITHIN: Final = (0.1, 0.9)
#: Of the limits, what a loop that is close to instability does not keep any more.
_POOR: Final = min(POOR.gain_db / GOOD.gain_db, POOR.phase_deg / GOOD.phase_deg)
#: What margins may cost: so many times the attitude error of gusts, or as slow an attitude, or as little left
#: of the integral.
_MOST_COST: Final = 4.0
#: Factors that are searched, and how far apart the first look at them is.
_SEARCHED: Final = (0.1, 10.0)
_COARSE: Final = 1.25
_HALVINGS: Final = 5
#: The search looks at some of the drawn vehicles; all of them have the last word.
_FEW_DRAWS: Final = 81
_BACK_OFF: Final = 0.98
_MOST_BACK_OFF: Final = 15
#: A factor that does not reach the limits has to come nearer to them by this to be worth a flight.
_BETTER: Final = 1.1
#: Why gains are changed each by itself.
_AS_TOLD_TITLE: Final = (
    "Change these gains: the flown gains leave too little margin in the model, and the next ones enough"
)
_BETTER_TITLE: Final = (
    "Change these gains: the next ones reject gusts better, and margins stay above the limits"
)
_LACKING_TITLE: Final = "Change these gains: they leave too little margin"
#: Twice the cut-off halves a filter's delay: so it takes a third of the phase margin that is to be kept.
_MUCH_PHASE_DEG: Final = 7.5


class Found(NamedTuple):
    """A factor of P, I and D and what decided it; ``reached`` where it keeps the limits."""

    factor: float
    reached: bool
    held_by: str = ""


class _Step(NamedTuple):
    """What the next flight changes, and the margins that all drawn vehicles have then."""

    factor: float
    controller: AxisController
    promised: LoopMargins


class Axis(NamedTuple):
    """What is known of one axis, its model per unit of command, and how its controller is made anew."""

    case: Case
    model: Model | None
    rebuild: Rebuild
    off_nominal: OffNominal | None = None


class FilterWishes(NamedTuple):
    """What of the filters may be set, and the lines of the gyro that do not move with the rotors [Hz]."""

    choices: FilterChoices = FilterChoices()
    still_hz: tuple[float, ...] = ()


def tune_axes(
    axes: Mapping[str, Axis], limits: Limits, *, apart: bool = False, filters: FilterWishes | None = None
) -> dict[str, AxisTuning]:
    """Recommend the gains of the next flight, and its filters with them.

    Parameters
    ----------
    axes : mapping of str to Axis
        By axis.
    limits : Limits
    apart : bool
        P, I, D and the angle gain each by itself where that rejects gusts better, not by one factor on P, I
        and D alone. Where no common factor keeps the limits, this is tried in any case.
    filters : FilterWishes, optional
        Filters may be changed with the gains.
    """
    if filters is not None:
        axes = {axis: _with_rows(one) for axis, one in axes.items()}
    searches = {axis: _searched(one, limits, apart=apart) for axis, one in axes.items()}
    tuned: dict[str, AxisTuning] = {}
    known: dict[str, _Search] = {}
    for axis, one in axes.items():
        if (search := searches[axis]) is None:
            now = None if one.case.found is None else one.case.found.margins
            tuned[axis] = AxisTuning(verdict="refused", reasons=tuple(obstacles(one.case)), now=now)
        else:
            tuned[axis], known[axis] = _decided(*search, apart=apart)
    if filters is not None and apart:
        changed: dict[str, AxisTuning] = {}
        if known:
            parameters = next(iter(known.values())).parameters
            both: dict[str, Filterable] = {**known, **_without_model(axes, known)}
            choices = replace(
                filters.choices, own={axis: one for axis, one in filters.choices.own.items() if axis in known}
            )
            settings = design_filters(
                both, choices, parameters, filters.still_hz, shared=set(both) == set(AXES)
            )
            borne = (steps for one in settings if (steps := _filter_steps(known, tuned, one)))
            changed = next(borne, {})
        tuned = {axis: changed.get(axis) or with_flown_filters(axis, one) for axis, one in tuned.items()}
    tuned = {axis: _with_off_nominal(axes[axis], one, limits) for axis, one in tuned.items()}
    for axis, found in tuned.items():
        case, reasons = axes[axis].case, found.reasons
        if case.found is not None and case.found.by_earlier and found.verdict != "refused":
            # The gains follow from earlier flights, where this one tells too little of the axis.
            verdict = case.diagnosis.axes.get(axis)
            codes = [] if verdict is None else list(verdict.reasons)
            reasons = (*reasons, _found("QL627", case, {"codes": codes}))
        advised = remedied(reasons, case.log.autopilot, case.log.version)
        tuned[axis] = replace(found, reasons=tuple(advised))
    return tuned


def _with_rows(axis: Axis) -> Axis:
    """Return an axis with the command of faster rows: filters may let pass what the data folded down."""
    case = axis.case
    rows = logged_spectrum(case.log, case.data, AXES.index(case.axis))
    return axis._replace(case=replace(case, rows=rows))


def _without_model(axes: Mapping[str, Axis], known: Mapping[str, _Search]) -> Mapping[str, AxisWithoutModel]:
    """Return yaw where roll and pitch alone are known: its loop crosses over below theirs."""
    if set(known) != {"roll", "pitch"} or (yaw := axes.get("yaw")) is None:
        return {}
    crossover_hz = max(one.crossover_hz for one in known.values())
    found = axis_without_model(yaw.case, yaw.rebuild, crossover_hz) if np.isfinite(crossover_hz) else None
    return {} if found is None else {"yaw": found}


def _with_off_nominal(axis: Axis, found: AxisTuning, limits: Limits) -> AxisTuning:
    """Add the margins of vehicles that are otherwise than they flew, and where they break the limits."""
    case, controller = axis.case, axis.case.controller
    if axis.off_nominal is None or controller is None or found.now is None or case.plants is None:
        return found
    following = None
    if found.verdict != "refused":
        following = axis.rebuild({name: one.next for name, one in found.changes.items()})
    plants = of_next_flight(case.plants).at(slice(0, N_PLANTS))
    loops = scaled_loops(controller, plants, 0.0 if case.found is None else case.found.known_hz)
    told = axis.off_nominal.margins(loops, following, limits)
    broken = [one for one in told if one.spare < _SAME[0]]
    reasons = found.reasons
    if broken and found.verdict != "refused":
        worst = min(broken, key=lambda one: one.spare)
        evidence = {
            "worst": _words(worst.condition.kind),
            "part_of_limits": rounded(worst.spare, 3),
            "conditions": [_words(one.condition.kind) for one in broken],
        }
        reasons = (*reasons, _found("QL675", case, evidence))
    return replace(found, off_nominal=told, reasons=reasons)


def _words(kind: ConditionKind) -> str:
    return kind.value.replace("_", " ")


def _searched(axis: Axis, limits: Limits, *, apart: bool) -> tuple[_Search, Callable[[], _Search]] | None:
    """Return the search of an axis, with and without modes that are merely possible; None if refused."""
    case, model, rebuild, off_nominal = axis
    found, plants, controller = case.found, case.plants, case.controller
    if (
        any(True for _ in obstacles(case))
        or model is None
        or found is None
        or plants is None
        or controller is None
    ):
        return None
    following = of_next_flight(plants)

    def held(plants: Plant) -> HeldLoops:
        loops = scaled_loops(controller, plants, found.known_hz)
        return HeldLoops(loops, () if off_nominal is None else off_nominal.corners(loops))

    search = _Search(case, held(following), model, rebuild, limits, apart=apart)
    possible = following.modes is not None and (found.frame is None or not found.frame.seen)

    def without_modes() -> _Search:
        if not possible:
            return search
        # What the flight only leaves possible holds gains, as noise does, and is no reason to lower them.
        return _Search(case, held(following._replace(modes=None)), model, rebuild, limits, apart=apart)

    return search, without_modes


def _filter_steps(
    searches: Mapping[str, _Search], alone: Mapping[str, AxisTuning], found: Changes
) -> dict[str, AxisTuning]:
    """Return the axes that some filters leave better in the end, by a next flight that bears them."""
    known = {}
    for axis, search in searches.items():
        # Behind its own filters and those of all, or behind the latter only.
        both = (found, found.without_own(axis)) if axis in found.own else (found,)
        every = [search.with_filters(one) for one in both]
        good = [one for one in every if one is not None and is_no_worse(one, alone[axis])]
        if good:
            known[axis] = min(good, key=lambda one: one.in_the_end.worse)
    # What all axes share changes for all of them, or not at all.
    if not found.shared:
        known = {axis: one for axis, one in known.items() if are_worth_it([one])}
    elif len(known) < len(searches) or not are_worth_it(known.values()):
        known = {}
    return {axis: one.tuning for axis, one in known.items()}


def _decided(
    search: _Search, without_modes: Callable[[], _Search], *, apart: bool
) -> tuple[AxisTuning, _Search]:
    """Change what the flight supports, and keep what it does not contradict.

    ``without_modes`` searches without the modes of the frame that the log merely cannot rule out. The search
    is returned with what it required of the gains: behind other filters they are held against that.
    """
    target = search.target()
    separate = search.apart(target) if apart or not target.reached else None
    strict = search
    if separate is None and not target.reached and (relaxed := strict.no_less_than_flown()) is not None:
        # No gains keep the limits in every condition: those that keep them as the vehicle flies come first.
        search, target = relaxed, relaxed.target()
        separate = search.apart(target) if apart or not target.reached else None
    # Uncertainty is no reason to reject gusts much worse than what flies, or than what the estimate takes.
    cost = search.cost_of(separate, target) if apart else 0.0
    if cost > _NEAR_BEST and (relaxed := search.relaxed(cost)) is not None:
        nearer, cost = relaxed.apart(Found(1.0, reached=False)), relaxed.reached_cost()
        separate, search = (separate, search) if nearer is None else (nearer, relaxed)
    if cost > _NEAR_BEST and not strict.is_kept_as_told() and (plain := without_modes()) is not strict:
        # Nor is a mode that the log merely does not rule out: gains fall as far as without any.
        lower = _decided(plain, lambda: plain, apart=apart)
        if strict.bears(lower[0]):
            return lower
    if separate is not None:
        return separate, search
    if target.reached and target.factor > _SAME[1]:
        return search.tuning(target), search
    plain = without_modes()
    if plain is strict:
        plain = search
    elif search is not strict:
        plain = plain.no_less_than_flown() or plain
    if plain.is_kept_as_told():
        return plain.stay(target, held=plain is not search and not search.is_kept()), search
    if plain is search:
        return search.tuning(target), search
    target = plain.target()
    separate = plain.apart(target) if apart or not target.reached else None
    return plain.tuning(target) if separate is None else separate, search


class _Search:
    """The search for the factor of one axis."""

    def __init__(
        self,
        case: Case,
        held: HeldLoops,
        model: Model,
        rebuild: Rebuild,
        limits: Limits,
        *,
        apart: bool,
    ) -> None:
        self._apart, self._model = apart, model
        number, loops = AXES.index(case.axis), held.loops
        self._case, self._loops, self._rebuild, self._limits = case, loops, rebuild, limits
        self._conditions, self._few_conditions = held, held.first(_FEW_DRAWS)
        self._few = self._few_conditions.loops
        self._flown_kept = held.kept(limits)
        self._flown_spare = self._flown_kept.as_flown
        self._told_spare = spare(loops.first(1)._replace(known_hz=np.inf).margins(), limits)
        self._now = {name: case.parameters[name] for name in case.names.scaled}
        estimate = loops.plants.at(slice(0, 1))
        self._torque = torque_spectrum(case.data, number, loops.controller, estimate, case.rows)
        self._gusts = residual_spectrum(model.fit, number)
        low_hz = 0.3 if model.band is None else float(model.band.low_hz[0])
        self._gust_band_hz = (low_hz, model.smoothing_hz)
        self._best: tuple[SeparateGains, Mapping[str, float]] | None = None

    @property
    def parameters(self) -> Mapping[str, float]:
        """That flew."""
        return self._case.parameters

    def bears(self, tuning: AxisTuning) -> bool:
        """Tell whether gains leave all vehicles as much of the limits as those that flew."""
        controller = self._rebuild({name: one.next for name, one in tuning.gains.items()})
        if tuning.verdict != "change" or controller is None:
            return False
        return self._conditions.keep_with(controller, self._limits, self._flown_kept)

    def no_less_than_flown(self) -> _Search | None:
        """Return the search that asks for no more in other conditions than flew; None where that was all."""
        if self._flown_kept.otherwise >= 1.0:
            return None
        held = self._conditions.no_less_than_flown(self._limits)
        return _Search(self._case, held, self._model, self._rebuild, self._limits, apart=self._apart)

    def relaxed(self, cost: float) -> _Search | None:
        """Return the search for gains with which drawn vehicles keep as much of the limits as is worth it.

        The estimate keeps the limits. Of the others, in each condition, as much is required as costs no more
        than `_NEAR_BEST` times what flies: from what they flew with, and none close to instability, whatever
        that takes, up to the limits, which take ``cost``.

        Parameters
        ----------
        cost : float
            As of `cost_of`, infinite where no gains keep the limits.

        Returns
        -------
        _Search or None
            None where the flown gains keep the limits as estimated, or are close to instability themselves:
            that is no uncertainty. And where the limits are worth what they cost.
        """
        if self.is_kept_as_told() or self._told_spare < _POOR:
            return None
        least = self._conditions.as_told(self._limits, _POOR)

        def required(part: float) -> _Search:
            held = self._conditions.nearer(least, part)
            return _Search(self._case, held, self._model, self._rebuild, self._limits, apart=self._apart)

        best = required(0.0)
        lowest = best.reached_cost()
        most = max(_NEAR_BEST, lowest)
        if not np.isfinite(lowest) or cost <= most:
            return None
        low, high = (0.0, lowest), (1.0, cost)
        for _ in range(_HALVINGS):
            if low[1] >= most / _SAME_COST:
                break
            # The cost rises about as the logarithm of what is required.
            way = math.log(most / low[1]) / math.log(high[1] / low[1]) if math.isfinite(high[1]) else 0.5
            part = low[0] + float(np.clip(way, *_WITHIN)) * (high[0] - low[0])
            tried = required(part)
            reached = tried.reached_cost(best.best())
            if reached > most:
                high = (part, reached)
                continue
            best, low = tried, (part, reached)
        return best

    def reached_cost(self, near: tuple[SeparateGains, Mapping[str, float]] | None = None) -> float:
        """Return the cost of the best gains one by one, infinite where none keep what is required.

        Parameters
        ----------
        near : tuple, optional
            As of `best`: where the search begins, instead of everywhere.
        """
        if self._best is None and near is not None and (search := self._separate()) is not None:
            self._best = search, search.target_near(near[1])
        best = self.best()
        if best is None or not best[0].keeps(best[1]):
            return float("inf")
        return best[0].cost(best[1])

    def cost_of(self, separate: AxisTuning | None, common: Found) -> float:
        """Return the cost, over the flown gains, of those found each by itself, or of a factor on all."""
        best = self.best()
        if best is None or (separate is None and not common.reached):
            return float("inf")
        search, target = best
        return search.common(common.factor) if separate is None else search.cost(target)

    @cached_property
    def too_noisy(self) -> float:
        """Noise of the command as flown over what is accepted; NaN where the log does not tell it."""
        noise = self._noise_of(self._loops.controller)
        return float("nan") if noise is None else noise.now / MOST_NOISE

    def best(self) -> tuple[SeparateGains, Mapping[str, float]] | None:
        """Return the search for gains one by one behind the flown filters, and the factors that it found."""
        if self._best is None and (search := self._separate()) is not None:
            self._best = search, search.target(1.0)
        return self._best

    def filtered(self, filters: Mapping[str, float]) -> SeparateGains | None:
        """Return the search for gains one by one behind other filters."""
        best = self.best()
        if best is None:
            return None
        return best[0].behind(filters, self._case.log_hz)

    def is_kept(self) -> bool:
        """Tell whether the worst of the vehicles that the next flight allows keeps the limits as flown."""
        return self._flown_spare >= _SAME[0]

    def is_kept_as_told(self) -> bool:
        """Tell whether the flown gains keep the limits, uncertainty aside."""
        return self._told_spare >= _SAME[0]

    def stay(self, target: Found, *, held: bool) -> AxisTuning:
        """Return that the flown gains stay; a change takes evidence, and uncertainty lowers nothing.

        ``held`` tells that a frame that may bend is what holds them.
        """
        kept = self._keep(Found(1.0, reached=True, held_by=target.held_by))
        if self.is_kept():
            return replace(kept, reasons=(_found("QL645", self._case, {}), *kept.reasons)) if held else kept
        if self._flown_spare >= _POOR:
            return replace(kept, reasons=(_found("QL646", self._case, self._spread()), *kept.reasons[1:]))
        loose = _found("QL618", self._case, self._spread(), "warning")
        return AxisTuning(verdict="refused", reasons=(loose,), now=self._margins_now())

    def _spread(self) -> dict[str, object]:
        """Return half of the 95 % intervals of effectiveness and of the phase at the crossover."""
        plants = self._loops.plants
        relative = NORMAL_95 * float(np.std(plants.effectiveness[1:]) / plants.effectiveness[0])
        told: dict[str, object] = {"effectiveness_percent": rounded(100.0 * relative, 3)}
        crossover_hz = self.crossover_hz
        if np.isfinite(crossover_hz):
            loop = rate_loop(self._loops.controller, plants, np.array([crossover_hz]))[:, 0]
            half_deg = NORMAL_95 * float(np.degrees(np.std(np.angle(loop[1:] / loop[0]))))
            told["phase_deg"] = rounded(half_deg, 3)
        return told

    def target(self) -> Found:
        """Return the factor that the vehicle bears, whatever it flies with now."""
        n_factors = round(np.log(_SEARCHED[1] / _SEARCHED[0]) / np.log(_COARSE)) + 1
        factors = self._worth_it(np.geomspace(*_SEARCHED, n_factors))
        # The worst vehicle bears no more than the estimate, which is quick to look at.
        alone = self._loops.spare_alone(factors, self._limits)
        borne = (place for place in reversed(range(len(factors))) if alone[place] >= 1.0)
        last = next((place for place in borne if self._bears(factors[place])), None)
        if last is None:
            best = float(factors[int(np.argmax(alone))])
            better = self._score(best) > _BETTER * self._score(1.0)
            return Found(best if better else 1.0, reached=False)
        if last == len(factors) - 1:
            return self._held(float(factors[last]))
        low, high = float(factors[last]), float(factors[last + 1])
        for _ in range(_HALVINGS):
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if self._bears(middle) else (low, middle)
        return self._held(low)

    def _worth_it(self, factors: FloatArray) -> FloatArray:
        """Return the factors that cost no more than margins are worth; all of a loop close to instability."""
        search = None if self._told_spare < _POOR else self._separate()
        if search is None:
            return factors
        return np.array([one for one in factors.tolist() if one >= 1.0 or search.common(one) <= _MOST_COST])

    def _held(self, factor: float) -> Found:
        """Lower a factor to what noise, the mixer and the documented ranges allow; never below what flies."""
        highest = [
            self._case.names.factors(name, value)[1] for name, value in self._now.items() if value > 0.0
        ]
        allowed = {"QL637": min(highest, default=np.inf)}
        if at_limits := self._case.at_limits:
            allowed[at_limits] = 1.0
        if factor > 1.0:
            allowed |= self._by_noise(factor)
        code = min(allowed, key=lambda one: allowed[one])
        if allowed[code] >= factor:
            return Found(factor, reached=True)
        # Low gains may lack phase, too: what holds them then holds them below the limits.
        reached = self._bears(allowed[code], _SAME[0])
        return Found(allowed[code], reached=reached, held_by=code)

    def _by_noise(self, factor: float) -> dict[str, float]:
        """Return by code the factor up to which the command's noise is bearable."""
        if self._noise(factor) is None:
            return {"QL640": 1.0}
        for smaller in np.geomspace(factor, 1.0, 16):
            noise = self._noise(float(smaller))
            if noise is not None and noise.next <= MOST_NOISE:
                return {"QL632": float(smaller)}
        return {"QL632": 1.0}

    def _noise(self, factor: float) -> Noise | None:
        controller = self._controller(factor)
        return None if controller is None else self._noise_of(controller)

    def _noise_of(self, controller: AxisController) -> Noise | None:
        crossover_hz = self.crossover_hz
        if self._torque is None or not np.isfinite(crossover_hz):
            return None
        both = (self._loops.controller, controller)
        return torque_noise(self._torque, both, self._estimate(), crossover_hz)

    @property
    def crossover_hz(self) -> float:
        """Return where the flown rate loop crosses over, NaN for nowhere."""
        crossover = self._margins_now().rate.crossover_hz
        return float("nan") if crossover is None else crossover.value

    def _margins_now(self) -> LoopMargins:
        margins = (self._case.found or AxisLoop()).margins
        return margins if margins is not None else self._few.margins()

    def _estimate(self) -> Plant:
        return self._loops.plants.at(slice(0, 1))

    def _score(self, factor: float) -> float:
        return min(self._few_conditions.kept(self._limits, factor))

    def _bears(self, factor: float, part: float = 1.0) -> bool:
        return self._few_conditions.keep(self._limits, Kept(part, part), factor)

    def _controller(self, factor: float) -> AxisController | None:
        return self._rebuild(self._written(factor))

    def _written(self, factor: float) -> dict[str, float]:
        """Return P, I and D by parameter, so many times as high as flown, as they stand in a file."""
        return {name: self._case.names.written(factor * value) for name, value in self._now.items()}

    def tuning(self, target: Found) -> AxisTuning:
        """Return the step towards the target, with what it promises."""
        low, high = _SAME
        if low <= target.factor <= high or not any(self._now.values()):
            return self._keep(target)
        step = self._step(target)
        if step is None or step.factor == 1.0:
            return self._keep(target)
        if step.factor < target.factor < 1.0:
            # The last step down had to go further to keep the limits: that is the target.
            target = target._replace(factor=step.factor)
        following, wanted = self._written(step.factor), self._written(target.factor)
        if following == self._now:
            return self._keep(target)
        gains = {
            name: GainChange(now=now, next=following[name], target=wanted[name])
            for name, now in self._now.items()
        }
        reasons = tuple(self._reasons("change", target, step))
        # Flights between the next gains and those that would be kept as the target.
        left = [change.target / change.next for change in gains.values() if change.next > 0.0 < change.target]
        n_more = 0
        while not all(low <= each <= high for each in left):
            left = [each / min(max(each, MOST_DOWN), MOST_UP) for each in left]
            n_more += 1
        further = Step(gains, step.controller, step.promised, n_more)
        # Flights between the next gains and the first that keep the limits.
        factor, n_flights = step.factor, 0
        missing = spare(step.promised, self._limits) < 1.0
        while missing and not low <= target.factor / factor <= high:
            factor *= min(max(target.factor / factor, MOST_DOWN), MOST_UP)
            n_flights += 1
            missing = spare(self._few.margins(factor), self._limits) < 1.0
        return self._described("change", reasons, further, n_flights)

    def apart(self, common: Found) -> AxisTuning | None:
        """Return the step towards the best gains, each by itself; None where one factor does as well."""
        search = self._separate()
        if search is None:
            return None
        if self._best is None or common.reached:
            self._best = search, search.target(common.factor)
        search, target = self._best
        low, high = _SAME
        if all(low <= factor <= high for factor in target.values()) or not search.keeps(target):
            return None
        # Margins are worth much, and not everything: beyond, one factor comes as near to them as it can.
        others = search.common(common.factor) if common.reached else _MOST_COST * _SAME[1]
        if self.is_kept_as_told():
            # No gain is changed for less, nor for what is not seen in the worst of the vehicles.
            others = min(others, 1.0)
            if search.worst_error(target) >= 1.0:
                return None
        if others < _SAME[1] * search.cost(target):
            return None
        step = search.step(target, MOST_UP)
        if step is None:
            return None
        factors = {name: rounded(factor, 3) for name, factor in target.items()}
        title = _LACKING_TITLE if self._conditions.drawn == 1.0 else _AS_TOLD_TITLE
        if self.is_kept_as_told():
            title = _BETTER_TITLE
        reasons = [replace(_found("QL641", self._case, {"target_factors": factors}), title=title)]
        if any(one.next != one.target for one in step.gains.values()):
            reasons.append(_found("QL633", self._case, {}))
        if code := self._case.at_limits:
            reasons.append(_found(code, self._case, self._evidence(code)))
        if spare(step.promised, self._limits) < 1.0:
            reasons.extend(filter_note(self._case, self._rebuild, self._loops))
        return self._described("change", tuple(reasons), step)

    def with_filters(self, chosen: Changes) -> Refiltered | None:
        """Return the step towards the best gains behind other filters.

        None where none keeps the limits, or none of the filters is of this axis.
        """
        axis = self._case.axis
        filters = chosen.of(axis, self.parameters)
        search = self.filtered({name: one.next for name, one in filters.items()})
        if not filters or search is None:
            return None
        # What filters bring in the end is told by the estimate; every vehicle is to bear the next flight.
        new, old = search.quick(chosen.factors[axis]), chosen.alone[axis]
        target = search.target(1.0)
        step = search.step(target, MOST_UP) if search.keeps(target) else None
        if step is None or new.missing > old.missing:
            return None
        chosen = chosen.told(axis, new, old, self.too_noisy, search.phase_lost_deg())
        reasons = filter_findings(axis, filters, chosen)
        if any(one.next != one.target for one in step.gains.values()):
            reasons.append(_found("QL633", self._case, {}))
        described = self._described("change", tuple(reasons), step)
        tuning = replace(described, filters=filters, filter_trials=chosen.trials.get(axis, ()))
        return Refiltered(tuning, together(new, old, self.too_noisy))

    def _separate(self) -> SeparateGains | None:
        """Return a search for gains one by one; None where there is none."""
        return None if self._unsearched is None else self._unsearched.anew()

    @cached_property
    def _unsearched(self) -> SeparateGains | None:
        disturbed = Disturbed(self._gusts, self._gust_band_hz, self._torque, self.crossover_hz, MOST_NOISE)
        return separate_gains(
            self._case,
            self._conditions,
            self._flown_kept,
            self._rebuild,
            self._limits,
            disturbed,
            rising=not self._case.at_limits,
        )

    def _why_kept(self, target: Found) -> Finding:
        """Return that the gains are right, or that better ones are in reach of a vehicle known better."""
        factor = {"target_factor": rounded(target.factor, 3)}
        search = self._separate() if self._apart else None
        if search is None or (error := search.in_reach(target.factor)) > 1.0 / _NEAR_BEST:
            return _found("QL634", self._case, factor)
        percent, known_to_hz = round(100.0 * (1.0 - error)), rounded(self._loops.known_hz, 3)
        told = {**factor, "less_attitude_error_percent": percent, "known_to_hz": known_to_hz}
        title = (
            f"Keep these gains: others might reject gusts better by {percent} %, but this flight does not "
            "show enough margin for them"
        )
        return finding("QL647", "info", told, axes=(self._case.axis,), title=title)

    def _keep(self, target: Found) -> AxisTuning:
        """Return that the flown gains are right, or that no others keep the limits either."""
        low, high = _SAME
        if (code := self._case.at_limits) and (self.is_kept() or not target.reached):
            # What higher gains would do was not searched for: nothing says that these are right.
            return self._refused([_found(code, self._case, self._evidence(code), "warning")])
        if not target.reached or (self._flown_spare < low and not low <= target.factor <= high):
            # No gains keep the limits, and this holds them.
            out = [_found("QL624", self._case, {"to_be_kept": self._limits._asdict()}, "warning")]
            if target.held_by:
                out.append(_found(target.held_by, self._case, self._evidence(target.held_by)))
            out += filter_note(self._case, self._rebuild, self._loops)
            return self._refused(out)
        gains = {name: GainChange(now, now, now) for name, now in self._now.items()}
        # What the next flight may differ in widens what is promised of it, with kept gains too.
        step = _Step(1.0, self._loops.controller, self._loops.margins())
        reasons = tuple(self._reasons("keep", target, step))
        return self._described("keep", reasons, Step(gains, step.controller, step.promised, 0))

    def _refused(self, reasons: Sequence[Finding]) -> AxisTuning:
        return AxisTuning(
            verdict="refused", reasons=tuple(reasons), now=(self._case.found or AxisLoop()).margins
        )

    def _step(self, target: Found) -> _Step | None:
        """Return the change for the next flight; what reaches the limits keeps them in all drawn vehicles."""
        # The gain margin falls as the factor rises: both are alike at the root of what flew.
        most_up = float(may_rise(0.5 * least_gain_db(self._loops.margins()), MOST_UP))
        factor = min(max(target.factor, MOST_DOWN), most_up)
        # Where the flown gains are below the limits, a raise towards them has not reached them yet. A step
        # down that is not the last one has not, either; the last one goes further down until it has.
        last_down = factor < 1.0 and target.reached and factor >= target.factor
        enough = Kept(1.0, 1.0) if last_down else self._flown_kept if factor > 1.0 else Kept(0.0, 0.0)
        end, found = (1.0 if factor > 1.0 else MOST_DOWN), None
        for _ in range(_MOST_BACK_OFF):
            controller = self._controller(factor)
            if controller is None:
                return None
            promised = self._loops.of(controller).margins()
            if factor == end or self._conditions.keep_with(controller, self._limits, enough, promised):
                return _Step(factor, controller, promised)
            found = _Step(factor, controller, promised)
            factor = max(factor * _BACK_OFF, end)
        return found if last_down else None

    def _described(
        self,
        verdict: str,
        reasons: tuple[Finding, ...],
        step: Step,
        to_limits: int | None = None,
    ) -> AxisTuning:
        """Put together what is recommended and what it promises; without a count, the target keeps limits."""
        controller, noise = step.controller, self._noise_of(step.controller)
        if to_limits is None:
            to_limits = step.more_flights if spare(step.promised, self._limits) < 1.0 else 0
        nothing, steps = float("nan"), Steps(self._loops.plants)
        both = (self._loops.controller, controller)
        return AxisTuning(
            verdict="keep" if verdict == "keep" else "change",
            reasons=reasons,
            gains=step.gains,
            now=self._margins_now(),
            next=step.promised,
            step_now=steps.of(self._loops.controller),
            step_next=steps.of(controller),
            attitude_error=nothing
            if self._gusts is None
            else attitude_error(self._gusts, both, self._estimate(), self._gust_band_hz),
            torque_noise=nothing if noise is None else noise.now,
            torque_noise_next=nothing if noise is None else noise.next,
            more_flights=step.more_flights,
            flights_to_limits=to_limits,
        )

    def _reasons(self, verdict: str, target: Found, step: _Step) -> Iterator[Finding]:
        """Yield why, the decisive one first."""
        factor, promised = step.factor, step.promised
        case, told = self._case, {"factor": rounded(factor, 3), "target_factor": rounded(target.factor, 3)}
        if verdict == "keep":
            yield self._why_kept(target)
        elif factor < 1.0:
            yield _found("QL630", case, told)
        elif self._flown_spare < _SAME[0]:
            yield _found("QL660", case, told)
        else:
            yield _found("QL631", case, told)
        if not target.reached:
            yield _found("QL638", case, {"to_be_kept": self._limits._asdict()})
        if target.held_by:
            yield _found(target.held_by, case, self._evidence(target.held_by))
        if verdict == "change" and abs(factor / target.factor - 1.0) > 1.0 - _SAME[0]:
            yield _found("QL633", case, told)
        if factor < 1.0 or not target.reached:
            yield from filter_note(case, self._rebuild, self._loops)
        outer = promised.full or promised.rate
        if outer.extrapolated:
            yield _found("QL639", case, {"known_to_hz": rounded(self._loops.known_hz, 3)})

    def _evidence(self, code: str) -> dict[str, object]:
        """Return the numbers behind a limit."""
        if code == self._case.at_limits:
            return {"fraction_at_limits": rounded(self._case.limited_fraction, 3)}
        noise = self._noise(1.0)
        if code == "QL632" and noise is not None:
            return {"fraction_of_range": rounded(noise.now, 3), "fraction_accepted": MOST_NOISE}
        return {}


def filter_note(case: Case, rebuild: Rebuild, loops: ScaledLoops) -> Iterator[Finding]:
    """Yield which low-pass limits the vehicle most, where twice its cut-off would give much phase back.

    Parameters
    ----------
    case : Case
    rebuild : callable
    loops : ScaledLoops
        With the gains that flew.

    Yields
    ------
    Finding
        A note: filters are never loosened in a file.
    """
    estimate = loops.plants.at(slice(0, 1))
    before = _phase_deg(loops.controller, estimate)
    freed = {
        name: _phase_deg(other, estimate)
        for name in case.names.low_passes
        if 0.0 < (cutoff_hz := case.parameters.get(name, 0.0)) < np.inf
        and (other := rebuild({name: 2.0 * cutoff_hz})) is not None
    }
    most = max(freed, key=lambda name: freed[name], default="")
    if not most or before == -np.inf or freed[most] - before < _MUCH_PHASE_DEG:
        return
    cutoff_hz, after = case.parameters[most], freed[most]
    told = {
        "parameter": most,
        "cutoff_hz": cutoff_hz,
        "phase_margin_deg": rounded(before, 2),
        "phase_margin_with_twice_that_deg": rounded(after, 2),
    }
    title = (
        f"A filter, not the gain, limits {case.axis}: with {most} at {2.0 * cutoff_hz:g} Hz instead of "
        f"{cutoff_hz:g} Hz, the rate loop would keep {rounded(after, 2):g} instead of "
        f"{rounded(before, 2):g} degrees"
    )
    yield finding("QL636", "info", told, axes=(case.axis,), title=title)


def _phase_deg(controller: AxisController, plant: Plant) -> float:
    """Return the phase margin of the rate loop; minus infinity where it is unstable or crosses nowhere."""
    found = scaled_loops(controller, plant, np.inf).margins().rate.phase_margin_deg
    return -np.inf if found is None else found.value


def _found(code: str, case: Case, evidence: Mapping[str, object], level: str = "info") -> Finding:
    return finding(code, "warning" if level == "warning" else "info", evidence, axes=(case.axis,))
