"""Filters and gains together: settings of the filters that leave gusts less, or motors less noise.

Each setting that the firmware version has is ranked by the best gains behind it: a low-pass costs phase,
which gains pay for, and a notch costs less of it than a low-pass that takes as much from a line. These are
the gains that a next flight behind the same filters would be given, so that flights end where they are
promised to. All axes have one objective: gust error and noise of the command, each over what gains alone
leave. No axis may end with more of either. What is chosen goes through the whole search for gains afterwards,
with every vehicle that the flight allows.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from types import MappingProxyType
from typing import Final, NamedTuple, Protocol

import numpy as np

from quadid_logs.control.separate_gains import PENALTY, Quick
from quadid_logs.data.tuning import Cutoffs, FilterChoices, FilterTrial, GainChange, written_hz

#: In one flight a cut-off is halved or doubled at most: as far as gains go, and half or twice the filter's
#: delay.
_MOST: Final = 2.0
#: By so much cut-offs are moved: first over half of that way, then by what is left between.
_STEPS: Final = (math.sqrt(_MOST), _MOST**0.25)
#: A search that goes on for longer comes back to what it left.
_MOST_ROUNDS: Final = 4
#: Filters are changed for a tenth of gust error and noise of an axis, as gains are for one of gust error.
WORTH: Final = 0.10
#: Less than this part of a cut-off is no change, nor of what is to be small.
SAME: Final = 0.02
#: An axis may lose this part of gust error or noise to others: effectiveness is not the same within 5 % from
#: flight to flight, so that no flight would tell it.
MOST_LOST: Final = 0.05
#: At a line that stands, filters alone let pass no more than as flown, but for rounding: half a decibel.
#: It may be a mode of the frame, which raises the loop by up to 27 dB (docs/loop.md): below, it closes none.
_AT_LINES: Final = 1.06
_MODE_PEAK: Final = 22.0
#: Of the noise that is accepted, 5 % of the command's range: less than one of the thousand steps of a PWM
#: output is no noise.
_LEAST_NOISE: Final = 0.02
#: Part of the sum that decides where the larger of two is as small as it gets.
_AUGMENTED: Final = 0.1
#: Beyond e to this power nothing is told apart.
_ENOUGH: Final = 100.0


class Together(NamedTuple):
    """What gains behind other filters make of gust error and noise, against gains alone.

    ``worse`` is the larger of both ratios, as a logarithm with a part of their sum, ``won`` their sum, and
    ``lost`` what is more with other filters.
    """

    worse: float
    won: float
    lost: float


def together(new: Quick, alone: Quick, too_noisy: float) -> Together:
    """Hold gains behind other filters against gains alone.

    What is won is shared: of the two ratios the larger one counts, by the augmented Chebyshev norm (R. E.
    Steuer and E.-U. Choo, 1983).

    Parameters
    ----------
    new, alone : Quick
    too_noisy : float
        Noise as flown over what is accepted, NaN where the log does not tell it.
    """
    least = _LEAST_NOISE / too_noisy if too_noisy > 0.0 else sys.float_info.min
    ratios = [math.log(new.cost / alone.cost), math.log(max(new.noise, least) / max(alone.noise, least))]
    lost = max(*ratios, 0.0)
    if alone.noise <= least or not too_noisy > 0.0:
        # There is no noise to be won, or nobody knows it.
        ratios.pop()
    return Together(max(ratios) + _AUGMENTED * sum(ratios), sum(ratios), lost)


class Behind(Protocol):
    """One axis behind some filters; see `SeparateGains`."""

    def quick(self, begin: Mapping[str, float]) -> Quick:
        """Return the best gains, and what they make."""

    def passes(self, frequency_hz: float) -> tuple[float, float]:
        """Return what filters let pass at a frequency over that as flown, and the gain of the loop."""

    def phase_lost_deg(self) -> float:
        """Return the phase that filters lose at the crossover, less that of the flown ones [deg]."""


class Filterable(Protocol):
    """The search for the gains of one axis, behind the flown filters or others."""

    @property
    def too_noisy(self) -> float:
        """Noise of the command as flown over what is accepted; NaN where the log does not tell it."""

    def best(self) -> tuple[Behind, Mapping[str, float]] | None:
        """Return the search behind the flown filters, and the factors that it found."""

    def filtered(self, filters: Mapping[str, float]) -> Behind | None:
        """Return the search behind other filters."""


class Changes(NamedTuple):
    """Parameters of filters for the next flight, those of all axes and those of each, and what they bring.

    ``cost`` and ``noise`` are by axis, over those of ``alone``, the best gains behind the flown filters, and
    ``factors`` of the gains. ``cutoffs`` names the low-passes among the parameters, ``trials`` is what was
    looked at.
    """

    shared: Mapping[str, float]
    own: Mapping[str, Mapping[str, float]]
    cost: Mapping[str, float]
    noise: Mapping[str, float]
    factors: Mapping[str, Mapping[str, float]]
    alone: Mapping[str, Quick]
    cutoffs: frozenset[str] = frozenset()
    trials: Mapping[str, tuple[FilterTrial, ...]] = MappingProxyType({})

    def of(self, axis: str, parameters: Mapping[str, float]) -> dict[str, GainChange]:
        """Return the changes of one axis by parameter; NaN for one that the log does not hold."""
        both = {**self.shared, **self.own.get(axis, {})}
        return {
            name: GainChange(parameters.get(name, math.nan), value, value)
            for name, value in both.items()
            if parameters.get(name) != value
        }

    def without_own(self, axis: str) -> Changes:
        """Return the changes with one axis' own filters as they flew."""
        return self._replace(own={name: one for name, one in self.own.items() if name != axis})

    def told(self, axis: str, new: Quick, old: Quick, too_noisy: float, phase_deg: float) -> Changes:
        """Return the changes with what one axis' best gains make, once these were searched for in full."""
        trials = self.trials.get(axis, ())
        last = (FilterTrial(phase_deg, new.noise * too_noisy, new.cost),)
        return self._replace(
            cost={**self.cost, axis: new.cost / old.cost},
            noise={**self.noise, axis: new.noise / old.noise},
            trials={**self.trials, axis: (*trials[:-1], *last)} if trials else self.trials,
        )


@dataclass(frozen=True, kw_only=True)
class _State:
    """Settings of filters, and by axis what the best gains behind them make."""

    shared: Mapping[str, float] = field(default_factory=dict)
    own: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    found: Mapping[str, Quick] = field(default_factory=dict)


def design_filters(
    axes: Mapping[str, Filterable],
    choices: FilterChoices,
    parameters: Mapping[str, float],
    still_hz: Sequence[float],
    *,
    shared: bool,
) -> Iterator[Changes]:
    """Yield settings of the filters for each choice of notches, the least gust error and noise first.

    Parameters
    ----------
    axes : mapping of str to Filterable
        By axis.
    choices : FilterChoices
    parameters : mapping of str to float
        That flew.
    still_hz : sequence of float
        Lines that do not move with the rotors: what passes there is not raised.
    shared : bool
        Filters of all axes may be changed: every axis is known.

    Yields
    ------
    Changes
        Only what is clearly better than the flown ones. The whole search for gains may turn the first one
        down.
    """
    yield from _Design(axes, choices, parameters, still_hz).found(shared=shared)


#: An axis and its filters.
_Key = tuple[str, frozenset[tuple[str, float]]]


class _LowPass(NamedTuple):
    """Cut-offs that move together, of one axis or of all (""), and every axis that they are in."""

    axis: str
    cutoffs: Cutoffs
    axes: tuple[str, ...]


class _Design:
    def __init__(
        self,
        axes: Mapping[str, Filterable],
        choices: FilterChoices,
        parameters: Mapping[str, float],
        still_hz: Sequence[float],
    ) -> None:
        self._axes, self._choices, self._parameters = axes, choices, parameters
        self._still_hz = still_hz
        self._alone: dict[str, Quick] = {}
        self._known: dict[_Key, Quick | None] = {}
        self._trials: dict[str, list[FilterTrial]] = {axis: [] for axis in axes}

    def found(self, *, shared: bool) -> Iterator[Changes]:
        """Yield the settings: each set of notches with low-passes that suit it, the best of these first."""
        for axis, search in self._axes.items():
            best = search.best()
            if best is None:
                return
            # Gains alone end as far away as gains behind other filters, and by the same estimate.
            alone, (_, factors) = search.filtered({}), best
            if alone is None:
                return
            each = [alone.quick(one) for one in (factors, dict.fromkeys(factors, 1.0))]
            quick = min(each, key=lambda one: (one.missing, one.cost))
            self._known[axis, frozenset()] = self._alone[axis] = quick
        begin = _State(found=self._alone)
        low_passes = [
            _LowPass(axis, cutoffs, (axis,))
            for axis in self._axes
            for cutoffs in self._choices.own.get(axis, ())
        ]
        states = [begin]
        if shared:
            every = tuple(self._axes)
            low_passes = [_LowPass("", cutoffs, every) for cutoffs in self._choices.shared] + low_passes
            notched = (replace(begin, shared=dict(notches)) for notches in self._choices.notches)
            states += [one for state in notched if (one := self._with(state, every)) is not None]
        first, last = _STEPS
        coarse = [self._settled(state, low_passes, first) for state in states]
        for state in sorted(coarse, key=self._total):
            found = self._worth(self._settled(state, low_passes, last))
            if found is not None:
                yield found

    def _settled(self, state: _State, low_passes: Sequence[_LowPass], step: float) -> _State:
        """Move low-passes down and up by a step while that helps."""
        for _ in range(_MOST_ROUNDS):
            before = state
            for one in low_passes:
                for scale in (1.0 / step, step):
                    moved = self._moved(state, one, scale)
                    if moved is not None and not one.axis:
                        moved = self._countered(moved, one, low_passes, scale)
                    if moved is not None and self._is_better(moved, state):
                        state = moved
                        break
            if state is before:
                break
        return state

    def _countered(
        self, state: _State, shared: _LowPass, low_passes: Sequence[_LowPass], scale: float
    ) -> _State:
        """Move the other low-passes against one that all axes share, where that helps.

        What a low-pass of the gyro takes from noise, the one of D may let pass: one alone gains nothing.
        """
        for one in low_passes:
            other = None if one is shared else self._moved(state, one, 1.0 / scale)
            if other is not None and self._is_better(other, state):
                state = other
        return state

    def _is_better(self, new: _State, old: _State) -> bool:
        return self._total(new) < self._total(old) - SAME

    def _moved(self, state: _State, low_pass: _LowPass, scale: float) -> _State | None:
        """Return the state with cut-offs times a scale, None where that moves none or leaves no gains."""
        axis, cutoffs, axes = low_pass
        before = state.own.get(axis, {}) if axis else state.shared
        # Within the firmware's range, and half to twice the flown one.
        changed = {}
        for name, ends in cutoffs.items():
            flown = self._parameters[name]
            low, high = max(min(ends[0], flown), flown / _MOST), min(max(ends[1], flown), flown * _MOST)
            wanted = float(np.clip(scale * before.get(name, flown), low, high))
            changed[name] = flown if abs(wanted / flown - 1.0) < SAME else written_hz(wanted)
        # What is as flown is no change.
        kept = {name: one for name, one in before.items() if name not in changed}
        values = kept | {name: one for name, one in changed.items() if one != self._parameters[name]}
        if values == before:
            return None
        if axis:
            return self._with(replace(state, own={**state.own, axis: values}), axes)
        return self._with(replace(state, shared=values), axes)

    def _with(self, state: _State, axes: Sequence[str]) -> _State | None:
        """Return the state with the best gains behind its filters; None where some axis has none."""
        found = dict(state.found)
        for axis in axes:
            key, filters = self._key(state, axis)
            if key not in self._known:
                self._known[key] = self._quick(axis, filters, state.found[axis].factors)
            if (quick := self._known[key]) is None:
                return None
            found[axis] = quick
        return replace(state, found=found)

    def _key(self, state: _State, axis: str) -> tuple[_Key, dict[str, float]]:
        filters = {**state.shared, **state.own.get(axis, {})}
        return (axis, frozenset(filters.items())), filters

    def _quick(self, axis: str, filters: Mapping[str, float], begin: Mapping[str, float]) -> Quick | None:
        search = self._axes[axis].filtered(filters)
        if search is None:
            return None
        # At a line that may be a mode of the frame, filters that raise the loop could close it.
        passed = (search.passes(line_hz) for line_hz in self._still_hz)
        if any(more > _AT_LINES and loop * _MODE_PEAK > 1.0 for more, loop in passed):
            return None
        found = search.quick(begin)
        if found.missing == 0.0:
            self._trials[axis].append(self._trial(axis, found, search.phase_lost_deg()))
        return found

    def _trial(self, axis: str, found: Quick, phase_deg: float) -> FilterTrial:
        return FilterTrial(phase_deg, found.noise * self._axes[axis].too_noisy, found.cost)

    def _total(self, state: _State) -> float:
        """Return what is to be small, over all axes, and what gains miss of limits beyond gains alone."""
        total = 0.0
        for axis, found in state.found.items():
            alone = self._alone[axis]
            both = together(found, alone, self._axes[axis].too_noisy)
            total += both.worse + PENALTY * max(both.lost - MOST_LOST, 0.0)
            total += min(PENALTY * max(found.missing - alone.missing, 0.0), _ENOUGH)
        return total

    def _worth(self, state: _State) -> Changes | None:
        """Return the changes where they bring as much as a change of gains is to bring."""
        both = [(axis, found, self._alone[axis]) for axis, found in state.found.items()]
        won = sum(together(new, old, self._axes[axis].too_noisy).won for axis, new, old in both)
        # Where an axis loses too much, the sum of what is to be small is above that of the flown ones.
        if not (state.shared or any(state.own.values())) or won > -WORTH or self._total(state) > 0.0:
            return None
        # What was looked at, the flown setting first and the chosen one last.
        trials = {}
        for axis, one in self._axes.items():
            chosen = one.filtered({**state.shared, **state.own.get(axis, {})})
            if chosen is not None and math.isfinite(one.too_noisy):
                first = self._trial(axis, self._alone[axis], 0.0)
                last = self._trial(axis, state.found[axis], chosen.phase_lost_deg())
                trials[axis] = (first, *self._trials[axis], last)
        return Changes(
            shared=state.shared,
            own={axis: one for axis, one in state.own.items() if one},
            cost={axis: new.cost / old.cost for axis, new, old in both},
            noise={axis: new.noise / old.noise for axis, new, old in both},
            factors={axis: one.factors for axis, one in state.found.items()},
            alone=self._alone,
            cutoffs=frozenset(
                name for one in chain(self._choices.shared, *self._choices.own.values()) for name in one
            ),
            trials=trials,
        )
