"""P, I, D and the angle gain of one axis, each by itself: where one factor on all of them is not enough."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.control.guard import Case
from quadid_logs.control.scaled_loop import ScaledLoops, scaled_loops, spare
from quadid_logs.data.closed_loop import LoopMargins
from quadid_logs.data.controller import AxisController
from quadid_logs.data.tuning import GainChange, Limits

#: The controller of one axis with some parameters changed, None where they make none.
Rebuild = Callable[[Mapping[str, float]], AxisController | None]
#: What a controller costs where it keeps the limits: the attitude error of gusts over that of the flown one,
#: and by how much the command's noise is beyond what is bearable.
Cost = Callable[[AxisController], tuple[float, float]]

#: Steps of the search, one gain at a time, each until none helps.
_STEPS: Final = (1.5, 1.2, 1.07)
_MOST_SWEEPS: Final = 8
#: Less is no improvement.
_IMPROVEMENT: Final = 1e-3
#: Gains are searched within these factors of the flown ones.
_BOUNDS: Final = (0.25, 4.0)
#: Of the flown I over P at least this is left: a load off centre and a bent arm are in no spectrum of gusts.
_LEAST_INTEGRAL: Final = 0.5
#: A missing tenth of a margin weighs more than any rejection of gusts.
_PENALTY: Final = 100.0
_HALVINGS: Final = 5
#: The search ends this near to the limits.
_ROUNDING: Final = 0.005


class Step(NamedTuple):
    """Gains for the next flight, the controller that they make, and the margins that it promises."""

    gains: Mapping[str, GainChange]
    controller: AxisController
    promised: LoopMargins


class SeparateGains:
    """The search for the gains of one axis.

    Parameters
    ----------
    case : Case
    loops : ScaledLoops
        With the gains that flew, around the vehicles that the next flight allows.
    rebuild : callable
    limits : Limits
    cost : callable
    """

    def __init__(self, case: Case, loops: ScaledLoops, rebuild: Rebuild, limits: Limits, cost: Cost) -> None:
        names = case.names
        varied = (names.proportional, names.integral, names.derivative, names.angle)
        flown = {name: case.parameters.get(name, 0.0) for name in varied}
        self._now = {name: value for name, value in flown.items() if np.isfinite(value) and value > 0.0}
        self._names, self._loops, self._rebuild, self._limits = names, loops, rebuild, limits
        self._cost = cost
        self._estimate = loops.plants.at(slice(0, 1))
        alone = spare(loops.first(1).margins(), limits)
        self._flown_spare = spare(loops.margins(), limits)
        # The worst vehicle keeps this much of what the estimate does, with other gains about as much.
        self._reserve = self._flown_spare / alone if alone > 0.0 else 1.0

    def target(self) -> dict[str, float]:
        """Return by parameter the factor at which gusts are rejected best, the limits being kept."""
        factors = dict.fromkeys(self._now, 1.0)
        best = self._value(factors)
        for step in _STEPS:
            for _ in range(_MOST_SWEEPS):
                before = best
                for name in factors:
                    for change in (step, 1.0 / step):
                        tried = {**factors, name: factors[name] * change}
                        value = self._value(tried)
                        if value < best * (1.0 - _IMPROVEMENT):
                            factors, best = tried, value
                if best >= before * (1.0 - _IMPROVEMENT):
                    break
        return factors

    def _value(self, factors: Mapping[str, float]) -> float:
        if not all(self._allowed(name, factor) for name, factor in factors.items()):
            return np.inf
        integral, proportional = (
            factors.get(name, 1.0) for name in (self._names.integral, self._names.proportional)
        )
        if integral < _LEAST_INTEGRAL * proportional:
            return np.inf
        controller = self._rebuild(self._values(factors))
        if controller is None:
            return np.inf
        error, noise = self._cost(controller)
        return error + _PENALTY * (self._missing(controller) + noise)

    def _missing(self, controller: AxisController) -> float:
        """Return how much of the limits the worst vehicle is expected to miss."""
        loops = scaled_loops(controller, self._estimate, self._loops.known_hz)
        return max(1.0 - self._reserve * spare(loops.margins(), self._limits), 0.0)

    def keeps(self, target: Mapping[str, float]) -> bool:
        """Tell whether the limits are kept at a target: without that, no step towards it is worth a flight.

        Parameters
        ----------
        target : mapping of str to float
            Factors.

        Returns
        -------
        bool
        """
        controller = self._rebuild(self._values(target))
        return controller is not None and self._missing(controller) <= _ROUNDING

    def _allowed(self, name: str, factor: float) -> bool:
        low, high = _BOUNDS
        highest = self._names.highest.get(name, np.inf)
        return low <= factor <= high and (factor <= 1.0 or factor * self._now[name] <= highest)

    def _values(self, factors: Mapping[str, float]) -> dict[str, float]:
        return {name: self._names.written(factor * self._now[name]) for name, factor in factors.items()}

    def step(self, target: Mapping[str, float], bounds: tuple[float, float]) -> Step | None:
        """Return the gains of the next flight on the way to a target.

        Parameters
        ----------
        target : mapping of str to float
            Factors.
        bounds : tuple of float
            Of the factors in one flight.

        Returns
        -------
        Step or None
            All gains go the same part of their way, and no vehicle of those that the next flight allows has
            less margin than is to be kept, or than it had. None where there is no such way.
        """
        logs = np.log(list(target.values()))
        low, high = np.log(bounds)
        if not logs.size or not logs.any():
            return None
        part = min(1.0, low / min(logs.min(), low), high / max(logs.max(), high))
        for _ in range(_HALVINGS):
            factors = {name: float(factor**part) for name, factor in target.items()}
            controller = self._rebuild(self._values(factors))
            if controller is None:
                return None
            promised = scaled_loops(controller, self._loops.plants, self._loops.known_hz).margins()
            if spare(promised, self._limits) >= min(1.0, self._flown_spare):
                return Step(self._changes(factors, target), controller, promised)
            part *= 0.5
        return None

    def _changes(self, factors: Mapping[str, float], target: Mapping[str, float]) -> dict[str, GainChange]:
        following, wanted = self._values(factors), self._values(target)
        return {
            name: GainChange(now, now, now)
            if factors[name] == 1.0
            else GainChange(now, following[name], wanted[name])
            for name, now in self._now.items()
        }
