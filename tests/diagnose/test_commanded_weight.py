"""A commanded thrust is held against the weight where the mass is given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from quadid_logs import Vehicle, analyze
from quadid_logs.data.flight import FlightData, Overview
from quadid_logs.diagnose.torque_findings import find_in_weight
from tests.marks import thorough


def flown(over_weight: float, *, mass_kg: float = 0.035, length_s: float = 8.0) -> FlightData:
    """Return a flight at a tilt of 0.3 rad that climbs and sinks, whose controller commands so much."""
    time_s = np.arange(0.0, length_s, 0.004)
    force = 9.80665 + np.sin(2.0 * np.pi * time_s) + 0.05 * np.random.default_rng(1).normal(size=time_s.size)
    thrust = over_weight * mass_kg * force / np.cos(0.3)
    attitude = np.tile([0.3, 0.0, 1.0], (time_s.size, 1))
    return FlightData(
        sample_period_s=0.004,
        segments=(),
        flights=((0.0, length_s),),
        sources={},
        input=None,
        start_s=0.0,
        duration_s=length_s,
        overview={
            "thrust_n": Overview(
                signal="thrust_n", columns=("thrust_n",), time_s=time_s, stored=thrust[:, np.newaxis]
            ),
            "attitude": Overview(signal="attitude", columns=(), time_s=time_s, stored=attitude),
        },
    )


def test_motors_that_are_not_the_firmwares_make_the_commanded_newton_none() -> None:
    """0.68 N for each newton of weight."""
    (found,) = find_in_weight(flown(0.68), Vehicle(mass_kg=0.035))
    assert found.code == "QL313"
    low, high = found.evidence["ci95"]  # type: ignore[misc]
    assert low < 0.68 < high < 0.75


def test_a_thrust_that_carries_the_weight_is_no_finding() -> None:
    """Within what scale and climbs leave open."""
    assert not list(find_in_weight(flown(1.0), Vehicle(mass_kg=0.035)))


def test_without_a_mass_nothing_is_said() -> None:
    """There is nothing to hold the thrust against."""
    assert not list(find_in_weight(flown(0.68), None))
    assert not list(find_in_weight(flown(0.68), Vehicle()))


@pytest.mark.corpus
@pytest.mark.parametrize(
    ("name", "mass_kg", "between"),
    [
        thorough("log09", 0.0333, (0.65, 0.75)),
        thorough("log81", 0.0375, (0.6, 0.72)),
        ("log201", 0.0419, (0.93, 0.99)),
    ],
)
def test_flown_thrust_over_weight_is_that_of_the_motors(
    name: str, mass_kg: float, between: tuple[float, float], corpus: Path
) -> None:
    """Upgraded motors give more than the firmware assumes, standard ones about that; never an inertia."""
    result = analyze(corpus / "flown" / "crazyswarm2" / "logs" / name, vehicle=Vehicle(mass_kg=mass_kg))
    found = {one.code: one for one in result.diagnosis.findings}["QL313"]
    assert between[0] < float(str(found.evidence["commanded_thrust_over_weight"])) < between[1]
    assert all(model.inertia is None for model in result.identification.models)
