"""Faults of rotors are named from whole simulated flights, and none in a flight without."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.data.health import Health
from quadid_logs.data.settings import AlignSettings
from quadid_logs.health import health_of
from quadid_logs.health.rotors import _axes_change
from quadid_logs.load import prepare
from quadid_logs.maths.self_normalised import Change, Difference
from quadid_logs.simulator import fly, plan_flights
from quadid_logs.simulator.effects import Effects
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.scenarios import SCENARIOS
from tests.marks import thorough

#: Betaflight counts rear right, front right, rear left, front left; the others front right, rear left, front
#: left, rear right.
PLACES = {
    "ardupilot": ("front right", "back left", "front left", "back right"),
    "px4": ("front right", "back left", "front left", "back right"),
    "betaflight": ("back right", "front right", "back left", "front left"),
}


def flown(
    scenario: str, autopilot: str = "ardupilot", seed: int = 1, duration_s: float = 35.0, **changes: object
) -> Health:
    """Fly and look at it; ``changes`` replace effects of the scenario."""
    found = SCENARIOS[scenario]
    found = dataclasses.replace(found, effects=dataclasses.replace(found.effects, **changes))  # type: ignore[arg-type]
    setups = plan_flights(found, seed=seed, duration_s=duration_s, rate_hz=400.0, autopilot=autopilot)
    prepared = prepare(log_flights(tuple(fly(setup) for setup in setups), Logging()))
    return health_of(prepared, cut(prepared, AlignSettings()))


def only_fault(health: Health) -> tuple[str, int, float]:
    """Return code, rotor and size of the one fault that is found."""
    assert health.rotors is not None
    (fault,) = health.rotors.faults
    return fault.code, fault.rotor, fault.size.value


@pytest.mark.parametrize("autopilot", [thorough("ardupilot"), "px4", thorough("betaflight")])
def test_a_motor_that_loses_a_fifth_of_its_thrust_in_flight_is_named(autopilot: str) -> None:
    """Motor 3 of the simulator is the front left one, whatever its number in the log."""
    health = flown("motor-step", autopilot, duration_s=75.0)
    code, rotor, lost = only_fault(health)
    assert (code, PLACES[autopilot][rotor]) == ("QL431", "front left")
    assert lost == pytest.approx(0.2, abs=0.04)
    assert health.rotors is not None
    assert health.rotors.level == "high"
    # Each of four rotors makes a quarter of every torque.
    assert [one.value for one in health.rotors.axes_change] == pytest.approx([0.95] * 3, abs=0.01)


@pytest.mark.thorough
def test_a_motor_that_is_weak_from_the_beginning_is_named() -> None:
    """A load moves the balance of roll and pitch, a motor that of yaw too."""
    code, rotor, lost = only_fault(flown("weak-motor", duration_s=75.0))
    assert (code, rotor) == ("QL430", 1)
    assert lost == pytest.approx(0.2, abs=0.04)


@pytest.mark.thorough
def test_a_centre_of_mass_off_the_middle_is_no_weak_motor() -> None:
    """3 % of the arm forward."""
    health = flown("mass-off-centre")
    code, rotor, size = only_fault(health)
    assert (code, rotor) == ("QL434", -1)
    assert size == pytest.approx(0.03, abs=0.005)
    assert health.rotors is not None
    assert health.rotors.level == "fact"


@pytest.mark.thorough
def test_a_bent_propeller_is_named_by_its_rotor() -> None:
    """The part of the gyro that turns with one rotor is larger than that of all others together."""
    code, rotor, size = only_fault(flown("bent-propeller", "px4"))
    assert (code, rotor) == ("QL432", 3)
    assert size > 0.0


@pytest.mark.thorough
@pytest.mark.parametrize("autopilot", [thorough("ardupilot"), "betaflight"])
def test_a_desync_of_80_ms_is_named_with_its_time(autopilot: str) -> None:
    """Motor 2 of the simulator is the rear left one; the manoeuvre begins 5.5 s after the simulation."""
    health = flown("desync", autopilot)
    code, rotor, _ = only_fault(health)
    assert (code, PLACES[autopilot][rotor]) == ("QL433", "back left")
    assert health.rotors is not None
    middle_s = 31.0 + 5.5 + 0.5 * (35.0 - 1.5 - 5.0 - 5.5)
    assert health.rotors.faults[0].time_s == pytest.approx(middle_s, abs=0.2)


@pytest.mark.thorough
def test_an_accelerometer_at_the_end_of_its_range_is_found_without_a_counter() -> None:
    """The propeller that shakes it is found beside it."""
    health = flown("clipping")
    assert health.vibration is not None
    assert health.vibration.findings == ("QL435",)
    assert only_fault(health)[:2] == ("QL432", 3)


@pytest.mark.parametrize("scenario", ["rough-air", thorough("no-setpoints"), thorough("wind")])
def test_a_flight_without_a_fault_shows_none(scenario: str) -> None:
    """Multisines and sticks in rough air, and wind of 8 m/s."""
    health = flown(scenario, "px4", seed=4)
    assert health.rotors is not None
    assert health.rotors.faults == ()
    assert health.rotors.axes_change == ()
    assert len(health.rotors.searched) == 5
    assert all(
        change is None or change.ci95[0] <= 1.0 <= change.ci95[1]  # type: ignore[index]
        for change in health.rotors.change
    )


@pytest.mark.thorough
def test_rotors_that_move_independently_tell_what_each_gives() -> None:
    """Motor 2 gives 80 % of what the others give: 0.84 of the mean of all."""
    weak = Effects(disturbance_rad_s2=(1.3, 1.3, 0.43), motor_fault=2, motor_fault_at=0.0)
    health = flown("rough-air", motor_fault=2, motor_fault_at=0.0)
    assert weak.named()["motor fault"]["motor_effectiveness"] == 0.8
    assert health.rotors is not None
    known = health.rotors.effectiveness[1]
    assert known is not None
    assert known.ci95 is not None
    # One flight in twenty lies outside by chance, one in three hundred by half as much again.
    assert abs(known.value - 0.8 / 0.95) <= 1.5 * 0.5 * (known.ci95[1] - known.ci95[0])
    others = [one for place, one in enumerate(health.rotors.effectiveness) if place != 1 and one is not None]
    assert all(one.value > known.value for one in others)


def test_a_fault_leaves_its_truth() -> None:
    """Of the kind, the rotor and the time."""
    assert SCENARIOS["desync"].effects.named()["desync"] == {
        "desync_rotor": 2,
        "desync_s": 0.08,
        "desync_at": 0.5,
    }
    assert np.isclose(SCENARIOS["mass-off-centre"].effects.mass_offset[0], 0.03)


def test_a_rotor_counts_for_an_axis_by_its_arm_squared() -> None:
    """A hexacopter: the rotor on the right has a third of roll's torque (sin^2 over 3), none of pitch's."""
    angle = np.radians([90.0, -90.0, -30.0, 150.0, 30.0, -150.0])
    place = np.column_stack([np.cos(angle), np.sin(angle), [-1.0, 1.0, -1.0, 1.0, 1.0, -1.0]])
    given = np.array([0.7, 1.0, 1.0, 1.0, 1.0, 1.0])
    # What keeps the vehicle level: the weak one is sent more.
    sent = 1.0 / given
    moved = float(sent[0] / sent.sum() - 1.0 / 6.0) * 6.0 / 5.0
    change = Change(slice(0, 50), slice(50, 100), Difference(moved, 0.0), p_value=1e-4, detectable=0.01)
    roll, pitch, yaw = _axes_change([change, *[None] * 5], place, [0])
    assert roll.value == pytest.approx(1.0 - 0.3 / 3.0, abs=1e-3)
    assert pitch.value == pytest.approx(1.0, abs=1e-3)
    assert yaw.value == pytest.approx(1.0 - 0.3 / 6.0, abs=1e-3)
