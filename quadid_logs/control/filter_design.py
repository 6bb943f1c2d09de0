"""Filters and gains together: settings of the filters that leave gusts less, or motors less noise.

Each setting that the firmware version has is ranked by the best gains behind it: a low-pass costs phase,
which gains pay for, and a notch costs less of it than a low-pass that takes as much from a line. What is
chosen goes through the whole search for gains afterwards, with every vehicle that the flight allows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from types import MappingProxyType
from typing import Final, NamedTuple, Protocol

import numpy as np

from quadid_logs.control.separate_gains import Quick, SeparateGains
from quadid_logs.data.tuning import Cutoffs, FilterChoices, FilterTrial, GainChange, written_hz

#: In one flight a cut-off is halved or doubled at most: as far as gains go, and half or twice the filter's
#: delay.
_SCALES: Final = (0.5, 0.7, 1.41, 2.0)
#: Beside a setting found, what is looked at again once the others have changed.
_BESIDE: Final = (0.84, 1.2)
#: What no flight would show, as a part of gust error or noise: the less noisy setting is taken then.
_NO_DIFFERENCE: Final = 0.05
#: Filters are changed for a tenth of gust error or noise, as gains are, and where nothing gets worse.
_WORTH: Final = 0.10
_NO_WORSE: Final = 0.02
#: At a line that stands, filters alone let pass no more than as flown, but for rounding: half a decibel.
#: It may be a mode of the frame, which raises the loop by up to 27 dB (docs/loop.md): below, it closes none.
_AT_LINES: Final = 1.06
_MODE_PEAK: Final = 22.0
#: Of the noise that is accepted, what no motor shows: less is no reason to choose a filter.
_UNHEARD: Final = 0.1
#: What is noisier than accepted is to lose 3 dB in one flight.
_QUIETER: Final = 0.7


def most_noise(alone: float) -> float:
    """Return what noise the gains behind other filters may make, over what is accepted.

    Parameters
    ----------
    alone : float
        That of the best gains behind the flown filters, over what is accepted.

    Returns
    -------
    float
        No more than those make, unless nobody hears it; less where they make too much.
    """
    return max(alone if alone <= 1.0 else max(_QUIETER * alone, 1.0), _UNHEARD)


class Filterable(Protocol):
    """The search for the gains of one axis, behind the flown filters or others."""

    @property
    def too_noisy(self) -> float:
        """Noise of the command as flown over what is accepted; NaN where the log does not tell it."""

    def best(self) -> tuple[SeparateGains, Mapping[str, float]] | None:
        """Return the search behind the flown filters, and the factors that it found."""

    def filtered(self, filters: Mapping[str, float]) -> SeparateGains | None:
        """Return the search behind other filters."""


class Changes(NamedTuple):
    """Parameters of filters for the next flight, those of all axes and those of each, and what they bring.

    ``cost`` and ``noise`` are by axis, over those of the best gains behind the flown filters; ``cutoffs``
    names the low-passes among the parameters, ``trials`` is what was looked at.
    """

    shared: Mapping[str, float]
    own: Mapping[str, Mapping[str, float]]
    cost: Mapping[str, float]
    noise: Mapping[str, float]
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
) -> tuple[Changes, ...]:
    """Choose settings of the filters.

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

    Returns
    -------
    tuple of Changes
        The chosen one, which is the quietest of those that no flight would tell apart, then the one that
        leaves least of gusts: the next flight may bear that where the quietest would be worse. Empty where
        none is clearly better than the flown one.
    """
    return _Design(axes, choices, parameters, still_hz).found(shared=shared)


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
        self._begin: Mapping[str, Quick] = {}
        self._trials: dict[str, list[FilterTrial]] = {axis: [] for axis in axes}
        self._steadiest: _State | None = None

    def found(self, *, shared: bool) -> tuple[Changes, ...]:
        """Return the settings, in the order in which they matter: notches, low-passes of all, of each."""
        found = {}
        for axis, one in self._axes.items():
            best = one.best()
            if best is None:
                return ()
            found[axis] = best[0].told_of(best[1])
        self._begin = found
        state = begin = _State(found=found)
        if shared:
            notched = [
                replace(begin, shared={**begin.shared, **notches}) for notches in self._choices.notches
            ]
            state = self._chosen(begin, (self._with(one, tuple(self._axes)) for one in notched))
            for cutoffs in self._choices.shared:
                state = self._chosen(state, self._scaled(state, cutoffs, _SCALES))
            if not any(notches.keys() <= state.shared.keys() for notches in self._choices.notches):
                # A notch may let a low-pass be opened, which makes it worth its phase: both in one.
                scaled = (
                    self._scaled(one, cutoffs, (1.41, 2.0))
                    for one in notched
                    for cutoffs in self._choices.shared
                )
                state = self._chosen(state, chain.from_iterable(scaled))
        for axis in self._axes:
            for cutoffs in self._choices.own.get(axis, ()):
                state = self._chosen(state, self._scaled(state, cutoffs, _SCALES, axis))
        if shared:
            for cutoffs in self._choices.shared:
                state = self._chosen(state, self._scaled(state, cutoffs, _BESIDE))
        both = [state] if self._steadiest in (None, state) else [state, self._steadiest]
        return tuple(one for one in (self._worth(begin, each) for each in both) if one is not None)

    def _scaled(
        self, state: _State, cutoffs: Cutoffs, scales: Sequence[float], axis: str = ""
    ) -> Iterator[_State | None]:
        """Yield the state with cut-offs times each scale but one, of all axes or of one."""
        before = state.own.get(axis, {}) if axis else state.shared
        for scale in scales:
            # Within the firmware's range, and half to twice the flown one.
            changed = {}
            for name, ends in cutoffs.items():
                flown = self._parameters[name]
                low, high = (
                    max(min(ends[0], flown), _SCALES[0] * flown),
                    min(max(ends[1], flown), _SCALES[-1] * flown),
                )
                wanted = float(np.clip(scale * before.get(name, flown), low, high))
                changed[name] = flown if abs(wanted / flown - 1.0) < _NO_WORSE else written_hz(wanted)
            # What is as flown is no change.
            kept = {name: one for name, one in before.items() if name not in changed}
            values = kept | {name: one for name, one in changed.items() if one != self._parameters[name]}
            if axis:
                yield self._with(replace(state, own={**state.own, axis: values}), (axis,))
            else:
                yield self._with(replace(state, shared=values), tuple(self._axes))

    def _with(self, state: _State, axes: Sequence[str]) -> _State | None:
        """Return the state with the best gains behind its filters; None where some axis has none."""
        found = dict(state.found)
        for axis in axes:
            filters = {**state.shared, **state.own.get(axis, {})}
            if not filters:
                found[axis] = self._begin[axis]
                continue
            search = self._axes[axis].filtered(filters)
            if search is None:
                return None
            # At a line that may be a mode of the frame, filters that raise the loop could close it.
            passed = (search.passes(line_hz) for line_hz in self._still_hz)
            if any(more > _AT_LINES and loop * _MODE_PEAK > 1.0 for more, loop in passed):
                return None
            found[axis] = search.quick(state.found[axis].factors)
            if found[axis].missing == 0.0:
                self._trials[axis].append(self._trial(axis, found[axis], search.phase_lost_deg()))
        return replace(state, found=found)

    def _trial(self, axis: str, found: Quick, phase_deg: float) -> FilterTrial:
        return FilterTrial(phase_deg, found.noise * self._axes[axis].too_noisy, found.cost)

    def _value(self, axis: str, found: Quick) -> float:
        """Return what is to be small: gusts, what is missing of limits, and noise beyond what is accepted."""
        noise = self._axes[axis].too_noisy * found.noise
        beyond = math.log(max(noise, 1.0)) if math.isfinite(noise) else 0.0
        return math.log(found.value) + beyond

    def _total(self, state: _State) -> float:
        return sum(self._value(axis, found) for axis, found in state.found.items())

    def _noise(self, state: _State) -> float:
        """Return the logarithm of the noise of all commands, none of them below what nobody hears."""
        told = (
            found.noise
            if math.isnan(self._axes[axis].too_noisy)
            else max(found.noise * self._axes[axis].too_noisy, _UNHEARD)
            for axis, found in state.found.items()
        )
        return sum(math.log(one) for one in told)

    def _chosen(self, now: _State, others: Iterator[_State | None]) -> _State:
        """Return the best state; of those that no flight would tell apart, the one with the least noise."""
        states = [now, *(one for one in others if one is not None)]
        totals = [self._total(one) for one in states]
        near = [
            one
            for one, total in zip(states, totals, strict=True)
            if total <= min(totals) + _NO_DIFFERENCE * len(now.found)
        ]
        best = min(near, key=self._noise)
        steadiest = states[int(np.argmin(totals))]
        if self._steadiest is None or self._total(steadiest) < self._total(self._steadiest):
            self._steadiest = steadiest
        # No setting is changed for nothing.
        return (
            now
            if now in near and self._noise(now) <= self._noise(best) + _NO_DIFFERENCE * len(now.found)
            else best
        )

    def _worth(self, begin: _State, state: _State) -> Changes | None:
        """Return the changes where one axis gains by a tenth and none loses."""
        if not state.shared and not any(state.own.values()):
            return None
        better = {
            axis: self._value(axis, found) - self._value(axis, begin.found[axis])
            for axis, found in state.found.items()
        }
        quieter = self._noise(state) - self._noise(begin)
        lost = max(better.values()) > _NO_WORSE
        if lost or not (min(better.values()) < -_WORTH or quieter < -_WORTH * len(better)):
            return None
        both = [(axis, found, begin.found[axis]) for axis, found in state.found.items()]
        # What was looked at, the flown setting first and the chosen one last.
        trials = {}
        for axis, one in self._axes.items():
            chosen = one.filtered({**state.shared, **state.own.get(axis, {})})
            if chosen is not None and math.isfinite(one.too_noisy):
                first = self._trial(axis, begin.found[axis], 0.0)
                last = self._trial(axis, state.found[axis], chosen.phase_lost_deg())
                trials[axis] = (first, *self._trials[axis], last)
        return Changes(
            shared=state.shared,
            own={axis: one for axis, one in state.own.items() if one},
            cost={axis: new.cost / old.cost for axis, new, old in both},
            noise={axis: new.noise / old.noise for axis, new, old in both},
            cutoffs=frozenset(
                name for one in chain(self._choices.shared, *self._choices.own.values()) for name in one
            ),
            trials=trials,
        )
