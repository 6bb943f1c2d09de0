"""What holds a vehicle gives it gravity to feel; the air does not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from quadid_logs.data.flight import FlightData
from quadid_logs.data.settings import AlignSettings

from .flights import align, flight_log, motion, signal

G = 9.80665
STEP_S = 0.01
TIME_S = np.arange(0.0, 40.0, STEP_S)


def tilts(seed: int = 1) -> np.ndarray:
    """Roll and pitch of a few degrees with power up to 3 Hz, shape (n, 2) [rad]."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((TIME_S.size, 2))
    slow = lfilter([0.06], [1.0, -0.94], lfilter([0.06], [1.0, -0.94], white, axis=0), axis=0)
    return np.asarray(slow * np.radians(3.0) / slow.std())


def felt_in_the_air(tilt: np.ndarray, drag_1_s: float) -> np.ndarray:
    """Drag alone: the speed is what the tilted thrust gave, and decays; forward for nose down."""
    pushed = G * tilt * [1.0, -1.0]
    speed = lfilter([STEP_S], [1.0, -(1.0 - drag_1_s * STEP_S)], pushed, axis=0)
    return np.asarray(-drag_1_s * speed)


def felt_on_a_rig(tilt: np.ndarray) -> np.ndarray:
    """Along y by roll, along x by pitch."""
    return np.asarray(G * np.sin(tilt) * [-1.0, 1.0])


def flown(tilt: np.ndarray, felt: np.ndarray, *, offset_m: float = 0.0, **more: np.ndarray) -> FlightData:
    """A log whose accelerometer is that far from the axis and feels this along y and x."""
    rate = np.gradient(tilt, STEP_S, axis=0)
    noise = 0.05 * np.random.default_rng(7).standard_normal((TIME_S.size, 3))
    lateral = felt + offset_m * np.gradient(rate, STEP_S, axis=0)
    force = np.column_stack([lateral[:, 1], lateral[:, 0], np.full(TIME_S.size, -G)]) + noise
    yaw = np.zeros((TIME_S.size, 1))
    log = flight_log(
        signal("body_rate", TIME_S, np.column_stack([rate, yaw])),
        signal("torque_command", TIME_S, np.column_stack([0.1 * tilt, yaw])),
        signal("throttle", TIME_S, np.full((TIME_S.size, 1), 0.4)),
        signal("specific_force", TIME_S, force),
        *(signal(name, TIME_S, values[:, np.newaxis]) for name, values in more.items()),
    )
    return align(log, AlignSettings())


def test_a_vehicle_on_a_rig_has_not_flown() -> None:
    """Its model would be the rig's: "flexible mode", "nothing is missing in the log" were said of one."""
    found = flown(tilts(), felt_on_a_rig(tilts()), offset_m=-0.06)
    assert found.flights == ()
    assert "held" in found.on_ground_reason


def test_a_vehicle_on_a_rig_has_not_flown_whatever_its_land_detector_says() -> None:
    """It listens to motors and to the barometer."""
    on = np.ones(TIME_S.size)
    found = flown(tilts(), felt_on_a_rig(tilts()), armed=on, landed=0.0 * on)
    assert found.flights == ()


def test_a_vehicle_that_a_rig_lets_turn_about_roll_alone_has_not_flown() -> None:
    """Half of the readings show nothing but noise."""
    tilt = tilts() * [1.0, 0.0]
    assert flown(tilt, felt_on_a_rig(tilt)).flights == ()


@pytest.mark.parametrize("drag_1_s", [0.2, 0.5, 2.5], ids=["large", "small", "nano in a frame"])
@pytest.mark.parametrize("offset_m", [0.0, 0.1])
def test_a_vehicle_in_the_air_has_flown(drag_1_s: float, offset_m: float) -> None:
    """Wherever its accelerometer is, and however strongly the air slows it down."""
    found = flown(tilts(), felt_in_the_air(tilts(), drag_1_s), offset_m=offset_m)
    assert len(found.flights) == 1


def test_a_tilt_that_explains_half_of_what_is_felt_is_no_proof_of_a_rig() -> None:
    """The other half is as strong, and nobody knows what it is."""
    felt = felt_on_a_rig(tilts()) + felt_on_a_rig(tilts(seed=2))
    assert len(flown(tilts(), felt).flights) == 1


def test_a_flight_that_swings_at_one_frequency_is_not_taken_for_a_rig() -> None:
    """An accelerometer at the pendulum's length from the axis reads just what a held one would."""
    frequency_hz = 1.5
    swing = np.radians(5.0) * np.sin(2.0 * np.pi * frequency_hz * TIME_S)
    tilt = np.column_stack([swing, 0.0 * swing])
    found = flown(tilt, felt_in_the_air(tilt, 0.3), offset_m=G / (2.0 * np.pi * frequency_hz) ** 2)
    assert len(found.flights) == 1


def hovered(throttle: np.ndarray, down: np.ndarray, axis: int = 2) -> FlightData:
    """A log of the stick and of the accelerometer along one body axis, with the vibration of rotors."""
    noise = 0.3 * np.random.default_rng(3).standard_normal((TIME_S.size, 3))
    log = flight_log(
        signal("body_rate", TIME_S, np.radians(2.0) * motion(TIME_S)),
        signal("torque_command", TIME_S, 0.1 * motion(TIME_S)),
        signal("throttle", TIME_S, throttle[:, np.newaxis]),
        signal("specific_force", TIME_S, noise + np.outer(down, np.eye(3)[axis])),
        signal("armed", TIME_S, np.ones((TIME_S.size, 1))),
        signal("landed", TIME_S, np.zeros((TIME_S.size, 1))),
    )
    return align(log, AlignSettings())


def test_a_vehicle_whose_throttle_moves_and_that_feels_one_g_stayed_on_the_ground() -> None:
    """An autopilot called it flying from the first stick on, and motor 3 "61 % weaker than the others"."""
    ramp = np.linspace(0.08, 0.16, TIME_S.size)
    found = hovered(ramp, np.full(TIME_S.size, -G))
    assert found.flights == ()
    assert "ground" in found.on_ground_reason


def test_a_still_hover_flies() -> None:
    """Indoors nothing moves but the throttle, as the battery empties."""
    sagging = np.linspace(0.40, 0.57, TIME_S.size)
    assert len(hovered(sagging, np.full(TIME_S.size, -G)).flights) == 1


@pytest.mark.parametrize("axis", [2, 0], ids=["multirotor", "tail-sitter"])
def test_a_vehicle_that_climbs_and_descends_flies(axis: int) -> None:
    """A throttle that moves by a half, and the acceleration with it until the air has the speed."""
    stick = 0.4 * (1.0 + 0.3 * np.sin(2.0 * np.pi * TIME_S / 8.0))
    gained = lfilter([STEP_S], [1.0, -(1.0 - 0.5 * STEP_S)], G * (stick / 0.4 - 1.0))
    felt = -G * (stick / 0.4) + 0.5 * gained
    assert len(hovered(stick, felt, axis).flights) == 1
