"""Several short flights of one vehicle are one data set."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from quadid_logs import Vehicle, analyze, analyze_pooled
from quadid_logs.data.result import Result
from quadid_logs.simulator import Simulation, simulate


def short(seed: int, vehicle: Vehicle | None = None) -> Simulation:
    """Return a log of 15 s of which 9 s are flown."""
    return simulate(
        "sysid-quad-x", seed=seed, duration_s=15.0, rate_hz=250.0, autopilot="crazyflie", vehicle=vehicle
    )


@pytest.fixture(scope="module")
def flights() -> list[Simulation]:
    return [short(seed) for seed in range(20, 25)]


@pytest.fixture(scope="module")
def pooled(flights: list[Simulation]) -> Result:
    return analyze_pooled(flights)


@pytest.mark.thorough
def test_one_flight_is_too_short_and_five_are_enough(flights: list[Simulation], pooled: Result) -> None:
    """No flight needs a minute of its own."""
    alone = analyze(flights[0])
    assert set(alone.verdict.values()) == {"refused"}
    assert "QL402" in {one.code for one in alone.diagnosis.findings}
    assert pooled.data.used_s < 50.0
    assert "QL402" not in {one.code for one in pooled.diagnosis.findings}
    assert pooled.verdict["roll"] != "refused"
    assert pooled.verdict["pitch"] != "refused"


@pytest.mark.thorough
def test_the_interval_of_the_pool_holds_the_truth(flights: list[Simulation], pooled: Result) -> None:
    """Roll and pitch, as simulated."""
    model = pooled.identification.recommended
    assert model is not None
    truth = flights[0].truth
    gain = np.linalg.solve(truth["vehicle"]["inertia_kg_m2"], truth["torque_n_m_per_command"])
    for axis, name in enumerate((("p_dot", "L"), ("q_dot", "M"))):
        low, high = model.entries[name].ci95
        assert low <= gain[axis, axis] <= high
        assert high - low < 0.2 * gain[axis, axis]


@pytest.mark.thorough
def test_flights_of_one_vehicle_are_not_told_apart(pooled: Result) -> None:
    """They differ by chance, and the finding that names the logs says by how much."""
    found = {one.code: one for one in pooled.diagnosis.findings}
    assert "QL529" not in found
    between = found["QL107"].evidence["between_flights"]
    assert isinstance(between, dict)
    assert between["roll"]["flights"] == 5
    assert between["roll"]["p_value"] > 1e-3


@pytest.mark.thorough
def test_a_flight_of_another_vehicle_is_found_and_widens_the_interval(
    flights: list[Simulation], pooled: Result
) -> None:
    """Half of the inertia more in two of five: the interval reaches over what they differ by."""
    heavier = Vehicle(inertia_kg_m2=1.5 * np.diag([0.0145, 0.0162, 0.0265]))
    mixed = analyze_pooled([*flights[:3], short(30, heavier), short(31, heavier)])
    assert "QL529" in {one.code for one in mixed.diagnosis.findings}
    one, other = (each.identification.recommended for each in (pooled, mixed))
    assert one is not None
    assert other is not None
    widths = [np.diff(each.entries[("p_dot", "L")].ci95)[0] for each in (one, other)]
    assert widths[1] > 3.0 * widths[0]
    gain = other.entries[("p_dot", "L")]
    assert gain.value - gain.ci95[0] > 0.5 * (gain.ci95[1] - gain.value)


@pytest.mark.thorough
def test_a_flight_that_is_given_twice_counts_once(flights: list[Simulation], pooled: Result) -> None:
    """Under another name it is still the same rates and torque: the interval is that of the five."""
    again = analyze_pooled([*flights, flights[0]])
    assert [bool(each.same_as) for each in again.pooled] == [False] * 5 + [True]
    assert "another log" in {one.code: one for one in again.diagnosis.findings}["QL107"].title
    ends = [each.identification.recommended.entries[("p_dot", "L")].ci95 for each in (pooled, again)]  # type: ignore[union-attr]
    assert ends[0] == ends[1]


@pytest.mark.thorough
@pytest.mark.corpus
def test_five_flown_flights_of_ten_seconds_give_roll(corpus: Path) -> None:
    """It agrees with the response by the trajectory over 103 flights [rad/s^2 per N m], both uncertain."""
    folder = corpus / "flown" / "crazyswarm2" / "logs"
    result = analyze_pooled([folder / f"log{number}" for number in ("09", "11", "13", "15", "17")])
    assert result.verdict["roll"] != "refused"
    model = result.identification.recommended
    assert model is not None
    assert model.actuator is not None
    low, high = model.entries[("p_dot", "L")].ci95
    for frequency_hz, response, uncertain in (
        (2.0, 36_500.0, 3700.0),
        (3.9, 30_000.0, 3200.0),
        (4.4, 29_100.0, 2200.0),
        (6.3, 21_400.0, 3100.0),
    ):
        behind_lag = np.hypot(1.0, 2.0 * np.pi * frequency_hz * model.actuator.lag_s)
        middle, half_width = 0.5 * (low + high) / behind_lag, 0.5 * (high - low) / behind_lag
        assert abs(middle - response) < np.hypot(half_width, uncertain)
