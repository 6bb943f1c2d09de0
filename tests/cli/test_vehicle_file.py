"""The vehicle file: what it may hold, and what is refused with a hint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from quadid_logs.errors import VehicleFileError
from quadid_logs.vehicle_file import read_vehicle

FULL = """
name = "test quad"
mass_kg = 1.25
max_thrust_n = 9.5
torque_to_thrust_m = 0.016
inertia_kg_m2 = [0.008, 0.009, 0.015]

[[rotor]]
position_m = [0.1, 0.1, 0]
spin = "ccw"

[[rotor]]
position_m = [-0.1, -0.1, -0.02]
spin = "cw"
"""


def write(tmp_path: Path, text: str) -> Path:
    """Write a vehicle file."""
    path = tmp_path / "vehicle.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_every_key_is_read(tmp_path: Path) -> None:
    """Each value arrives under its name."""
    vehicle = read_vehicle(write(tmp_path, FULL))
    assert (vehicle.name, vehicle.mass_kg, vehicle.max_thrust_n) == ("test quad", 1.25, 9.5)
    assert vehicle.torque_to_thrust_m == 0.016
    assert [rotor.spin for rotor in vehicle.rotors] == ["ccw", "cw"]
    assert vehicle.rotors[1].position_m == (-0.1, -0.1, -0.02)
    assert vehicle.inertia_kg_m2 is not None
    np.testing.assert_array_equal(vehicle.inertia_kg_m2, np.diag([0.008, 0.009, 0.015]))


def test_mass_and_arm_alone_are_enough(tmp_path: Path) -> None:
    """Nothing but what is given is known."""
    vehicle = read_vehicle(write(tmp_path, "mass_kg = 2\narm_length_m = 0.2\n"))
    assert (vehicle.mass_kg, vehicle.arm_length_m, vehicle.rotors, vehicle.max_thrust_n) == (
        2.0,
        0.2,
        (),
        None,
    )


def test_a_thrust_curve_is_read(tmp_path: Path) -> None:
    """Pairs of command and thrust."""
    vehicle = read_vehicle(write(tmp_path, "thrust_curve = [[0, 0], [0.5, 2.0], [1.0, 6.0]]"))
    assert vehicle.thrust_curve is not None
    np.testing.assert_array_equal(vehicle.thrust_curve, [[0.0, 0.0], [0.5, 2.0], [1.0, 6.0]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mas_kg = 1", "Did you mean mass_kg"),
        ("colour = 'red'", "Known keys"),
        ("mass_kg = -1", "above 0"),
        ("mass_kg = 0", "above 0"),
        ("mass_kg = nan", "above 0"),
        ("mass_kg = inf", "above 0"),
        ("mass_kg = 680", "kg, not g"),
        ("arm_length_m = 225", "m, not mm"),
        ("max_thrust_n = 1e308", "N for one rotor"),
        ("torque_to_thrust_m = 16", "N m of torque per N"),
        ("mass_kg = '1 kg'", "must be a number"),
        ("mass_kg = true", "must be a number"),
        ("name = 3", "name must be text"),
        ("rotor = 3", "list of tables"),
        ("[[rotor]]\nposition_m = [0, 0, 0]", "lacks spin"),
        ("[[rotor]]\nposition_m = [0, 0]\nspin = 'cw'", "position_m"),
        ("[[rotor]]\nposition_m = [0, 0, 0]\nspin = 'left'", "seen from above"),
        ("[[rotor]]\nposition_m = [0, 0, 0]\nspin = 'cw'\nspun = 1", "Did you mean spin"),
        ("thrust_curve = [[0, 0], [0.5, 2], [0.4, 3]]", "rise"),
        ("thrust_curve = [0, 1]", "wrong shape"),
        ("inertia_kg_m2 = [1, 2]", "wrong shape"),
        ("inertia_kg_m2 = [1, 2, -3]", "positive definite"),
        ("inertia_kg_m2 = [[1, 2, 0], [0, 1, 0], [0, 0, 1]]", "symmetric"),
        ("inertia_kg_m2 = ['a', 'b', 'c']", "numbers only"),
        ("mass_kg = ", "not valid TOML"),
        ("max_thrust_n = 1\nthrust_curve = [[0, 0], [1, 1]]", "same thing"),
        ("arm_length_m = 1\n[[rotor]]\nposition_m = [0, 0, 0]\nspin = 'cw'", "same thing"),
    ],
)
def test_a_mistake_is_named_with_what_to_do(text: str, words: str, tmp_path: Path) -> None:
    """One error that says which key and what is expected."""
    with pytest.raises(VehicleFileError, match=words):
        read_vehicle(write(tmp_path, text))


def test_a_missing_file_and_a_log_in_its_place_are_clear_errors(tmp_path: Path) -> None:
    """Neither a system error nor a decoding error comes through."""
    with pytest.raises(VehicleFileError, match="Cannot read"):
        read_vehicle(tmp_path / "none.toml")
    with pytest.raises(VehicleFileError, match="Cannot read"):
        read_vehicle(tmp_path)
    (tmp_path / "log.bin").write_bytes(b"\xa3\x95\xff\x00" * 100)
    with pytest.raises(VehicleFileError, match="not valid TOML"):
        read_vehicle(tmp_path / "log.bin")


def test_deeply_nested_toml_is_refused(tmp_path: Path) -> None:
    """No recursion error comes through."""
    with pytest.raises(VehicleFileError):
        read_vehicle(write(tmp_path, "mass_kg = " + "[" * 20_000))


@pytest.mark.parametrize("digits", [400, 4000, 5000])
def test_a_number_of_thousands_of_digits_is_refused(digits: int, tmp_path: Path) -> None:
    """It overflowed, which was called a bug of ours."""
    with pytest.raises(VehicleFileError, match=r"vehicle\.toml"):
        read_vehicle(write(tmp_path, f"mass_kg = {'9' * digits}"))
