"""What is taken where the log does not say: the firmware's own default, or nothing at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.actuation import _saturated_fraction
from quadid_logs.actuation.airframe import Airframe
from quadid_logs.align import clean
from quadid_logs.autopilots import named
from quadid_logs.autopilots.ardupilot.torque import _Vehicle, motor_settings
from tests.align.flights import flight_log, motion, signal

from .test_airframe import find_airframe, log_of
from .test_calibration import FRAME, STAMPS, THRUST, motors
from .test_px4_thrust import COMMAND, MIXED, achieved, rebuilt
from .test_px4_thrust import STAMPS as PX4_STAMPS

LEAST = {"MOT_THST_EXPO": 0.6, "MOT_SPIN_MIN": 0.12}


def test_motor_parameters_that_are_not_logged_have_the_firmwares_defaults() -> None:
    """MOT_SPIN_MAX 0.95, MOT_YAW_HEADROOM 200, and a throttle stick of 1100 to 1900 us."""
    found = motor_settings(LEAST)
    assert found is not None
    assert (found.expo, found.spin_min, found.spin_max, found.yaw_headroom) == (0.6, 0.12, 0.95, 0.2)
    assert (found.pwm_min_us, found.pwm_max_us) == (1100.0, 1900.0)


@pytest.mark.parametrize(
    ("known", "expected"),
    [
        ({"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0}, (1000.0, 2000.0)),
        ({"MOT_PWM_MIN": 0.0, "MOT_PWM_MAX": 0.0, "RC3_MIN": 1050.0, "RC3_MAX": 1850.0}, (1050.0, 1850.0)),
        ({"RCMAP_THROTTLE": 1.0, "RC1_MIN": 1010.0, "RC1_MAX": 1990.0, "RC3_MIN": 1.0}, (1010.0, 1990.0)),
    ],
)
def test_the_range_of_the_pulses_is_that_of_the_motors_or_of_the_throttle_stick(
    known: dict[str, float], expected: tuple[float, float]
) -> None:
    """AP_MotorsMulticopter.cpp, get_pwm_output_min."""
    found = motor_settings(LEAST | known)
    assert found is not None
    assert (found.pwm_min_us, found.pwm_max_us) == expected


def test_without_a_type_a_frame_is_an_x() -> None:
    """FRAME_TYPE 1 is the default."""
    alone, stated = (find_airframe(log_of({"FRAME_CLASS": 1.0} | more)) for more in ({}, {"FRAME_TYPE": 1.0}))
    assert isinstance(alone, Airframe)
    assert isinstance(stated, Airframe)
    assert alone.name == stated.name == "quad x"


@pytest.mark.parametrize(
    ("words", "n_rotors"),
    [("QUAD", 4), ("HEXA", 6), ("Y6", 6), ("OCTA", 8), ("OCTA_QUAD", 8), ("DODECA", 12)],
)
def test_an_old_log_tells_the_number_of_motors_in_words(words: str, n_rotors: int) -> None:
    """FRAME gives the layout only."""
    found = find_airframe(log_of({"FRAME": 1.0}, frame=words.replace("_", "-")))
    assert isinstance(found, Airframe)
    assert found.n_rotors == n_rotors


def vehicle(**values: float) -> _Vehicle:
    """Return a vehicle whose log holds these signals."""
    torque = signal("torque_command", STAMPS, motion(STAMPS))
    others = (signal(name, STAMPS, np.full((STAMPS.size, 1), each)) for name, each in values.items())
    settings = motor_settings(LEAST)
    assert settings is not None
    return _Vehicle(clean(flight_log(torque, *others)), FRAME, settings, None)


def test_without_battery_and_air_a_full_battery_at_sea_level_is_taken() -> None:
    """No compensation, no limit, and no more throttle on average than the pilot's."""
    found = vehicle().supply(STAMPS, None)
    for values in (found.lift_max, found.voltage_ratio, found.gain, found.throttle_limit):
        np.testing.assert_array_equal(values, 1.0)
    np.testing.assert_array_equal(found.throttle_average_max, 0.0)
    np.testing.assert_array_equal(vehicle().air(STAMPS), 1.0)


@pytest.mark.parametrize(("logged", "felt"), [(0.2, 1.0), (0.7, 0.7), (1.4, 1.4), (1.6, 1.0)])
def test_a_density_that_no_air_has_is_not_believed(logged: float, felt: float) -> None:
    """Beyond 0.3 to 1.5 of that at sea level thrust goes with that at sea level."""
    np.testing.assert_allclose(vehicle(air_density_ratio=logged).air(STAMPS), felt)


def test_the_saturated_fraction_is_that_of_flown_rows() -> None:
    """On the ground everything is at its stop."""
    series = motors(THRUST, np.sqrt(THRUST))
    flown = STAMPS > 20.0
    saturated = np.repeat(~flown[:, np.newaxis], 3, axis=1)
    saturated[(STAMPS > 20.0) & (STAMPS < 25.0), 2] = True
    found = _saturated_fraction([replace(series, saturated=saturated, flown=flown)])
    assert found == pytest.approx((0.0, 0.0, 0.25), abs=1e-3)
    assert np.isnan(_saturated_fraction([replace(series, flown=np.zeros_like(flown))])).all()


@pytest.mark.parametrize("factor", [-0.2, 1.3])
def test_a_thrust_model_that_px4_cannot_have_is_a_straight_line(factor: float) -> None:
    """THR_MDL_FAC is 0 to 1."""
    known = {f"PWM_MAIN_FUNC{motor + 1}": 101.0 + motor for motor in range(4)}
    limits = {"PWM_MAIN_MIN": 1050.0, "PWM_MAIN_MAX": 1950.0, "THR_MDL_FAC": factor}
    found = achieved(rebuilt(signal("output_pwm", PX4_STAMPS, 1050.0 + 900.0 * MIXED), **known, **limits))
    np.testing.assert_allclose(found.series.values, COMMAND, atol=1e-9)


def test_upright_rotors_need_not_say_so() -> None:
    """CA_ROTORn_A* points up by default; one that lies on its side is not modelled."""
    known = {"CA_ROTOR_COUNT": 4.0}
    for number, (x, y, spin) in enumerate(((1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1))):
        known |= {
            f"CA_ROTOR{number}_PX": 0.2 * x,
            f"CA_ROTOR{number}_PY": 0.2 * y,
            f"CA_ROTOR{number}_KM": 0.02 * spin,
        }
    assert isinstance(named("px4").find_airframe(log_of(known, "px4")), Airframe)
    assert isinstance(named("px4").find_airframe(log_of(known | {"CA_ROTOR0_AZ": -1.0}, "px4")), Airframe)
    lying = known | {"CA_ROTOR0_AZ": 0.0, "CA_ROTOR0_AX": 1.0}
    assert not isinstance(named("px4").find_airframe(log_of(lying, "px4")), Airframe)
