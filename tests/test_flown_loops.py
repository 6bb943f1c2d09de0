"""The study of flown promises: intervals of which the facing halves count, and a spread beyond chance."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from quadid_logs.data.closed_loop import Estimated
from study import flown_loops
from study.flown_loops import Flight, pairs, spread


def margins(crossover_hz: float, low: float, high: float) -> SimpleNamespace:
    none = dict.fromkeys(("gain_margin_db", "phase_margin_deg"))
    return SimpleNamespace(rate=SimpleNamespace(crossover_hz=Estimated(crossover_hz, (low, high)), **none))


def flights(monkeypatch: pytest.MonkeyPatch, promised: list[SimpleNamespace]) -> list[Flight]:
    """Return flights that promise these margins with whatever gains, and tell as many of their own."""
    each = [Flight(SimpleNamespace(number=n), {}, margins(10.0, 8.0, 11.0)) for n in range(len(promised))]
    monkeypatch.setattr(flown_loops, "margins_with", lambda result, *_, **__: promised[result.number])
    return each


def test_a_difference_is_held_against_the_halves_of_both_intervals_that_face_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Told 10 (8 to 11), promised 5 (4 to 9): 5 apart, of which 4 and 2 are open.
    some = flights(monkeypatch, [margins(5.0, 4.0, 9.0), margins(5.0, 4.0, 9.0)])
    (one, _) = pairs(some, "roll")
    assert one.difference == pytest.approx(100.0)
    assert one.beyond == pytest.approx(5.0 / 20.0**0.5)


def test_flights_that_differ_as_their_intervals_say_have_no_spread(monkeypatch: pytest.MonkeyPatch) -> None:
    some = flights(monkeypatch, [margins(10.0, 9.0, 11.0), margins(10.4, 9.4, 11.4)])
    assert spread(some, "roll").beyond_chance == 0.0


def test_the_spread_of_flights_that_are_known_exactly_is_their_standard_deviation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sharp = [margins(value, value * 0.9999, value * 1.0001) for value in (10.0, 11.0, 12.1)]
    # Logarithms ln(1.1) apart.
    assert spread(flights(monkeypatch, sharp), "roll").beyond_chance == pytest.approx(0.0953, abs=2e-4)
