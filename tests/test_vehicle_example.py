"""The complete vehicle file among the examples is read, and names everything that can be said."""

from __future__ import annotations

import re

from quadid_logs import read_vehicle
from quadid_logs.vehicle_file import _KEYS
from tests.conftest import REPOSITORY

EXAMPLE = REPOSITORY / "examples" / "quad.toml"


def test_the_example_is_a_vehicle_file() -> None:
    """With geometry, thrust and what yaw needs."""
    vehicle = read_vehicle(EXAMPLE)
    assert len(vehicle.rotors) == 4
    assert [rotor.spin for rotor in vehicle.rotors] == ["ccw", "ccw", "cw", "cw"]
    assert None not in (vehicle.mass_kg, vehicle.max_thrust_n, vehicle.torque_to_thrust_m)


def test_the_example_explains_every_key() -> None:
    """Those that exclude each other stand there as comments."""
    text = EXAMPLE.read_text(encoding="utf-8")
    assert [key for key in _KEYS if not re.search(rf"^#? ?\[*{key}\b", text, re.MULTILINE)] == []
