"""What is told of an axis where the flights of a log differ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.data.health import Quantity, RotorFault, Rotors
from quadid_logs.data.model import Model, Posterior, StructuralCheck
from quadid_logs.diagnose.structural_findings import find_in_rotors
from quadid_logs.identify.two_vehicles import with_flights_beside, with_lost_thrust
from quadid_logs.vocabulary import ON_AXIS
from tests.synthetic_results import usable_result


def told(gain: list[list[float]], half_width: float) -> tuple[Model, Model]:
    """Return a model of flights with those effectivenesses over that of all, as it was and as it is told."""
    flights = np.array(gain).reshape(-1, 3)
    check = StructuralCheck(
        effects=(),
        timing=None,
        flight_gain=flights,
        flight_half_width=np.full(flights.shape, half_width),
        persistence=np.zeros(3),
        spread=np.zeros(3),
        feedback=np.zeros(3),
    )
    model = usable_result().identification.recommended
    assert model is not None
    known = Posterior(mean=np.zeros((3, 5)), covariance=np.zeros((3, 5, 5)), lag_or_delay_s=0.0)
    model = replace(model, structural=check, posterior=known)
    return model, with_flights_beside(model)


def roll(model: Model) -> np.ndarray:
    entry = model.entries[ON_AXIS["roll"]]
    return np.array(entry.ci95) / entry.value


def test_two_packs_that_differ_are_both_inside() -> None:
    """8 % apart, each known to 1 %, and beyond each what is uncertain about all flights."""
    before, after = told([[0.96, 0.96, 0.96], [1.04, 1.04, 1.04]], 0.01)
    assert roll(after)[0] < 0.96 - (1.0 - roll(before)[0])
    assert roll(after)[1] > 1.04 + (roll(before)[1] - 1.0)


def test_flights_that_are_alike_leave_the_interval_as_it_is() -> None:
    """They differ by less than each is known to."""
    before, after = told([[0.995, 1.0, 1.0], [1.005, 1.0, 1.0]], 0.02)
    assert roll(after) == pytest.approx(roll(before))


def test_an_axis_that_hardly_shows_it_differs_with_the_others() -> None:
    """Battery and load change all axes: what pitch and yaw show holds for roll."""
    before, after = told([[0.985, 0.96, 0.96], [1.015, 1.04, 1.04]], 0.025)
    assert roll(after)[0] < roll(before)[0]
    assert roll(after)[1] > roll(before)[1]


def test_one_flight_is_left_alone() -> None:
    """There is nothing to differ from."""
    before, after = told([], 0.01)
    assert after is before


def test_of_many_short_flights_each_is_too_little_known_to_be_held() -> None:
    """The mean of five is told, with what lies between them."""
    flights = [[1.0 + offset] * 3 for offset in (-0.3, -0.1, 0.0, 0.1, 0.3)]
    before, after = told(flights, 0.05)
    assert after is before


def test_an_axis_that_no_flight_shows_stays_as_it_is() -> None:
    """Roll and pitch differ; of yaw nothing is known."""
    nan = float("nan")
    before, after = told([[0.96, 0.96, nan], [1.04, 1.04, nan]], 0.01)
    assert after.entries[ON_AXIS["yaw"]].ci95 == pytest.approx(before.entries[ON_AXIS["yaw"]].ci95)
    assert roll(after)[1] > roll(before)[1]


def test_what_margins_are_drawn_from_holds_both_flights() -> None:
    """The standard deviation grows with the interval."""
    before, after = told([[0.96, 0.96, 0.96], [1.04, 1.04, 1.04]], 0.01)
    assert before.posterior is not None
    assert after.posterior is not None
    added = after.posterior.covariance[0, 0, 0] - before.posterior.covariance[0, 0, 0]
    value = after.entries[ON_AXIS["roll"]].value
    farthest = (np.abs(roll(after) - 1.0).max(), np.abs(roll(before) - 1.0).max())
    assert added == pytest.approx((farthest[0] ** 2 - farthest[1] ** 2) * (value / 1.96) ** 2, rel=1e-3)


def test_a_motor_that_lost_thrust_widens_each_axis_by_what_it_turned() -> None:
    """Roll gave 5 % less afterwards: each end of the interval may be of either vehicle."""
    result = usable_result()
    change = tuple(Quantity(value, "1") for value in (0.95, 0.9, 1.0))
    rotors = rotors_of(axes_change=change)
    before = result.identification.recommended
    after = with_lost_thrust(result.identification, rotors).recommended
    assert before is not None
    assert after is not None
    (low, high), (lower, higher) = roll(before), roll(after)
    assert (lower, higher) == pytest.approx((0.95 * low, high / 0.95))
    assert after.entries[ON_AXIS["yaw"]].ci95 == before.entries[ON_AXIS["yaw"]].ci95


def test_rotors_whose_balance_stayed_leave_the_model_alone() -> None:
    """Nothing moved."""
    result = usable_result()
    assert with_lost_thrust(result.identification, rotors_of(axes_change=())) is result.identification
    assert with_lost_thrust(result.identification, None) is result.identification


@pytest.mark.parametrize(("named", "level"), [(True, "warning"), (False, "info")])
def test_a_balance_that_moved_is_said_and_surer_where_yaw_says_so(named: bool, level: str) -> None:
    """A load that slips moves the balance, too, and changes no effectiveness: doubt is in the interval."""
    change = tuple(Quantity(0.95, "1") for _ in range(3))
    lost = RotorFault(
        code="QL431", rotor=1, time_s=12.0, size=Quantity(0.2, "1"), p_value=1e-4, sentence="Lost."
    )
    rotors = rotors_of(axes_change=change, faults=(lost,) if named else ())
    (found,) = find_in_rotors(usable_result().identification, rotors)
    assert (found.code, found.level) == ("QL536", level)


def rotors_of(axes_change: tuple[Quantity, ...], faults: tuple[RotorFault, ...] = ()) -> Rotors:
    """Return what a flight tells of four rotors."""
    return Rotors(
        sentence="",
        level="fact",
        names=("1", "2", "3", "4"),
        effectiveness=(None,) * 4,
        change=(None,) * 4,
        mass_offset=None,
        thrust_change=None,
        shaking=(None,) * 4,
        faults=faults,
        findings=(),
        searched=(),
        axes_change=axes_change,
    )
