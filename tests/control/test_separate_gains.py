"""The search for gains, each by itself."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from quadid_logs.arrays import FloatArray
from quadid_logs.control import separate_gains
from quadid_logs.control.scaled_loop import Kept
from quadid_logs.control.separate_gains import SeparateGains


class TwoGains(SeparateGains):
    """Two gains that are to be high, at most e; either is a burden as far as it is above the other."""

    def __init__(self) -> None:
        pass

    def _weighed(
        self,
        factors: Mapping[str, FloatArray],
        most_up: float = np.inf,  # noqa: ARG002
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        first, second = np.log(factors["first"]), np.log(factors["second"])
        above = 3.0 * (first - second)
        return -first - second, 1.0 - first[:, np.newaxis], np.stack([above, -above], axis=1)


@pytest.mark.parametrize("begin", [0.5, 1.0, 2.0])
def test_a_search_leaves_gains_at_which_burdens_begin(begin: float) -> None:
    """The cost has an edge there: any one gain alone makes it worse, both together better."""
    bounds = {"first": (0.25, 4.0), "second": (0.25, 4.0)}
    found = TwoGains()._search([{"first": begin, "second": begin}], bounds, np.inf)
    assert found == pytest.approx({"first": np.e, "second": np.e}, rel=0.01)


class Limits:
    """Vehicles that keep so much of the limits with any gains, and count how often they are asked."""

    def __init__(self, kept: float) -> None:
        self.kept, self.asked = kept, 0

    def keep_with(self, controller: object, limits: object, enough: Kept) -> bool:  # noqa: ARG002
        self.asked += 1
        return self.kept >= enough.as_flown


class Bearing(SeparateGains):
    """A search of which nothing but the vehicles that bear gains is there."""

    def __init__(self, vehicles: Limits) -> None:
        names = SimpleNamespace(values=lambda factors: factors)
        self.__dict__ |= {"_varied": names, "_held": vehicles, "_limits": None, "_borne": {}}
        self._rebuild = lambda gains: cast("Any", gains)


def test_gains_that_are_borne_are_not_held_against_less_of_the_limits_again() -> None:
    """Two ends of a search ask that of the same gains."""
    vehicles = Limits(0.99)
    search = Bearing(vehicles)
    assert search._bear({"first": 2.0}, 0.99)
    assert search._bear({"first": 2.0}, 0.98)
    assert vehicles.asked == 1


@pytest.mark.parametrize("gains", [{"first": 2.0}, {"first": 3.0}])
def test_gains_that_bear_less_are_asked_for_more(gains: Mapping[str, float]) -> None:
    """What other gains bear says nothing of these."""
    vehicles = Limits(0.98)
    search = Bearing(vehicles)
    assert search._bear({"first": 2.0}, 0.98)
    assert not search._bear(gains, 0.99)


def test_behind_other_filters_gains_are_asked_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """These take phase: what was borne need not be."""
    controller = SimpleNamespace(period_s=0.0025)
    search = Bearing(Limits(1.0))
    search._rebuild = lambda _: cast("Any", controller)
    search.__dict__ |= {
        "_loops": SimpleNamespace(frequency_hz=None, controller=controller),
        "_decisive": [np.zeros(1, dtype=np.bool_)],
        "_rising": False,
        "_noise": SimpleNamespace(behind=lambda _: None),
    }
    monkeypatch.setattr(separate_gains, "_taken_apart", lambda *given: given)
    assert search._bear({"first": 2.0}, 0.99)
    other = search.behind({"cutoff": 20.0}, 400.0)
    assert other is not None
    other.__dict__ |= {"_varied": search._varied, "_held": Limits(0.9)}
    assert not other._bear({"first": 2.0}, 0.99)
