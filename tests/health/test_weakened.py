"""A rotor that gives less than in an earlier flight is told from a load that was moved, and from wind."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from quadid_logs.data.health import Quantity, RotorBalance
from quadid_logs.health.rotors import _Balances, _without_turns, weakened

HALF = 0.5**0.5
#: Forward, right and spin: front right, back left (counter-clockwise), front left, back right.
QUAD = ((HALF, HALF, 1.0), (-HALF, -HALF, 1.0), (HALF, -HALF, -1.0), (-HALF, HALF, -1.0))
OCTO = tuple(
    (float(np.cos(angle)), float(np.sin(angle)), (-1.0) ** number)
    for number, angle in enumerate(np.radians(22.5 + 45.0 * np.arange(8)))
)
#: Half of 95 % intervals of the centre of thrust and of the balance of yaw, as flights of 24 s have them.
KNOWN = (0.002, 0.002, 0.012)


def balance(
    place: tuple[tuple[float, ...], ...],
    gives: dict[int, float] | None = None,
    load: tuple[float, float] = (0.0, 0.0),
    yaw: float = 0.0,
    known: tuple[float, ...] = KNOWN,
) -> RotorBalance:
    """Return what rotors are sent that carry a load: a weak one is sent more for the same thrust."""
    each = np.array([1.0 / (gives or {}).get(rotor, 1.0) for rotor in range(len(place))])
    centre = np.array(place).T @ each / each.sum() + np.array([*load, yaw])
    told = (
        Quantity(float(one), "1", (float(one - half), float(one + half)))
        for one, half in zip(centre, known, strict=True)
    )
    forward, right, about = told
    return RotorBalance((forward, right, about), place)  # type: ignore[arg-type]


@pytest.mark.parametrize("place", [QUAD, OCTO])
@pytest.mark.parametrize("rotor", [0, 1, 2, 3])
def test_the_rotor_that_gives_a_fifth_less_is_named_with_its_loss(
    place: tuple[tuple[float, ...], ...], rotor: int
) -> None:
    found = weakened(balance(place), balance(place, {rotor: 0.8}))
    assert found is not None
    assert found[0] == rotor
    assert found[1].value == pytest.approx(0.2, abs=0.005)


def test_a_rotor_that_was_weak_before_is_no_change() -> None:
    assert weakened(balance(QUAD, {2: 0.8}), balance(QUAD, {2: 0.8})) is None


def test_a_load_that_was_moved_along_an_arm_is_no_weak_rotor() -> None:
    assert weakened(balance(QUAD), balance(QUAD, load=(0.05, 0.05))) is None


def test_yaw_that_is_trimmed_otherwise_is_no_weak_rotor() -> None:
    assert weakened(balance(QUAD), balance(QUAD, yaw=0.05)) is None


def test_yaw_that_moved_against_the_spin_is_no_weak_rotor() -> None:
    assert weakened(balance(QUAD), balance(QUAD, load=(0.04, 0.04), yaw=-0.05)) is None


def test_a_loss_within_what_two_flights_leave_open_is_not_named() -> None:
    assert weakened(balance(QUAD), balance(QUAD, {0: 0.97})) is None


def test_flights_with_other_frames_are_not_compared() -> None:
    assert weakened(balance(OCTO), balance(QUAD, {0: 0.8})) is None


def test_false_alarms_are_rare_where_nothing_changed_and_where_the_load_was_moved() -> None:
    random, alarms = np.random.default_rng(4), {"nothing": 0, "load": 0}
    for _ in range(500):
        for case, size in (("nothing", 0.0), ("load", 0.05)):
            before, after = (
                balance(
                    QUAD,
                    load=tuple(size * random.standard_normal(2) + 0.001 * random.standard_normal(2)),
                    yaw=0.006 * random.standard_normal(),
                )
                for _ in range(2)
            )
            alarms[case] += weakened(before, after) is not None
    assert alarms["nothing"] <= 1
    assert alarms["load"] <= 5


def test_a_manoeuvre_widens_no_balance_and_moves_none() -> None:
    """What turns the vehicle, and what its turning takes, is known from its rates."""
    random = np.random.default_rng(6)
    time_s, middle_s = np.arange(0.0, 24.0, 0.005), 0.125 + 0.25 * np.arange(96)
    rates = np.column_stack([np.sin(time_s * hz + turn) for turn, hz in enumerate((2.0, 3.1, 1.3))])
    series = SimpleNamespace(time_s=time_s, values=rates)
    before, after = (
        np.column_stack([np.interp(middle_s + side, time_s, one) for one in rates.T])
        for side in (-0.125, 0.125)
    )
    change = after - before
    trim = np.array([0.01, -0.02, 0.03])
    noise = 0.002 * random.standard_normal((96, 3))
    flown = trim + 0.5 * change[:, [1, 0, 2]] + noise
    balances = _Balances(middle_s, flown - flown.mean(axis=0) + trim, np.ones(96))
    steady = _without_turns(balances, series)  # type: ignore[arg-type]
    assert np.std(steady, axis=0).max() < 0.003 < np.std(flown, axis=0).min()
    np.testing.assert_allclose(steady.mean(axis=0), trim, atol=1e-12)
