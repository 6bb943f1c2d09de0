"""Structural effects: each does what its field says, in the flight, in the log and in the truth."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from quadid_logs.maths.rotations import quaternion_from_euler
from quadid_logs.simulator import fly
from quadid_logs.simulator.airframes import quad_x
from quadid_logs.simulator.closed_loop import _body, torque_gain
from quadid_logs.simulator.effects import (
    FIELDS,
    Actuation,
    Effects,
    FlexibleMode,
    Surroundings,
    disturbance,
    with_outliers,
)
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.plant import advance, at_rest
from quadid_logs.simulator.truth import actuator_truth, flight_truth, torque_per_command
from tests.marks import thorough
from tests.simulate.test_closed_loop import SILENT, body_of, manoeuvre, setup_of

ALL = Effects(
    disturbance_rad_s2=(1.0, 1.2, 0.4),
    tilt_stiffness_1_s2=4.0,
    sling_load_fraction=0.1,
    dead_zone=0.01,
    rotor_dead_zone=0.005,
    torque_limit=(0.2, 0.25, 0.4),
    gain_swing=0.2,
    spin_down_ratio=2.0,
    firmware_expo=0.3,
    thrust_linear=0.3,
    sag_compensation=0.8,
    flexible_mode_hz=7.0,
    torque_late_s=0.01,
    outlier_fraction=0.002,
    setpoints_logged=False,
)
PERIOD_S = 0.0025
LEVEL = (1.0, 0.0, 0.0, 0.0)
STILL = (0.0, 0.0, 0.0)


def surroundings(effects):
    """What acts on a vehicle of 2 kg with a moment of inertia of 0.02 and 0.03 kg m^2."""
    return Surroundings(effects, (0.02, 0.03, 0.04), 2.0, PERIOD_S)


def attitude(roll, pitch):
    """Return the quaternion of a tilt as floats."""
    return tuple(quaternion_from_euler(np.array([[roll, pitch, 0.0]]))[0].tolist())


def band_rms(values, low_hz, high_hz):
    """Root mean square of the part of a series between two frequencies."""
    spectrum = np.fft.rfft(values, axis=0)
    frequency = np.fft.rfftfreq(values.shape[0], PERIOD_S)
    spectrum[(frequency < low_hz) | (frequency > high_hz)] = 0.0
    return np.fft.irfft(spectrum, values.shape[0], axis=0).std(axis=0)


def test_disturbances_have_the_stated_size_between_0_3_and_5_hz():
    """As an angular acceleration, whatever the inertia."""
    inertia = np.array([[0.02, 0.001, 0.0], [0.001, 0.03, 0.0], [0.0, 0.0, 0.04]])
    effects = Effects(disturbance_rad_s2=(1.3, 1.0, 0.4))
    torque = disturbance(effects, inertia, 400_000, PERIOD_S, np.random.default_rng(0))
    acceleration = np.linalg.solve(inertia, torque.T).T
    np.testing.assert_allclose(band_rms(acceleration, 0.3, 5.0), [1.3, 1.0, 0.4], rtol=0.03)


@pytest.mark.thorough
def test_slow_disturbances_are_the_largest():
    """By the power 0.4 of the frequency; from some tens of hertz faster, without an edge."""
    torque = disturbance(ALL, np.eye(3), 400_000, PERIOD_S, np.random.default_rng(1))
    slow, fast = (band_rms(torque, f, 2.0 * f) / math.sqrt(f) for f in (0.1, 5.0))
    np.testing.assert_allclose(slow / fast, 50.0**0.4, rtol=0.15)
    density = [band_rms(torque, f, 1.1 * f).mean() / math.sqrt(f) for f in np.geomspace(10.0, 150.0, 16)]
    steps = np.diff(np.log(density)) / np.log(15.0) * 15.0
    assert -2.9 < steps[-1] < -1.9
    assert (np.abs(np.diff(steps)) < 1.0).all()


@pytest.mark.thorough
def test_disturbances_turn_the_vehicle_beside_its_torque():
    """What the recorded torque leaves of the recorded rate is the disturbance."""
    frame = dataclasses.replace(quad_x(), drag_n_s_m=0.0, drag_area_m2=0.0)
    effects = Effects(disturbance_rad_s2=(1.3, 1.0, 0.4))
    record = fly(
        setup_of("hover", duration_s=20.0, rate_hz=400.0, airframe=frame, noise=SILENT, effects=effects)
    )
    rate, torque = record.channels["rate"], record.channels["torque"]
    gyroscopic = np.cross(rate, rate @ frame.inertia_kg_m2)
    known = np.linalg.solve(frame.inertia_kg_m2, (torque - frame.rate_damping_n_m_s * rate - gyroscopic).T).T
    left = np.gradient(rate, PERIOD_S, axis=0) - known
    np.testing.assert_allclose(band_rms(left[manoeuvre(record)], 0.3, 5.0), [1.3, 1.0, 0.4], rtol=0.3)


@pytest.mark.parametrize("stiffness", [9.0, -4.0])
def test_a_tilt_is_driven_away_or_back(stiffness):
    """By the stiffness times the angle and the moment of inertia: roll to the right turns further right."""
    acted = surroundings(Effects(tilt_stiffness_1_s2=stiffness)).act(attitude(0.02, -0.03), STILL, STILL)
    expected = stiffness * np.array([0.02 * 0.02, -0.03 * 0.03, 0.0])
    np.testing.assert_allclose(acted.torque, expected, rtol=1e-3, atol=1e-12)


def test_a_hanging_load_pulls_down_through_its_hook():
    """Level: nothing but its weight. Tilted: below the centre of mass, it turns the vehicle back."""
    load = Effects(sling_load_fraction=0.1, sling_hook_m=0.05)
    weight = 0.1 * 2.0 * 9.80665
    level = surroundings(load).act(LEVEL, STILL, STILL)
    np.testing.assert_allclose(level.force, [0.0, 0.0, weight], atol=1e-12)
    np.testing.assert_allclose(level.torque, 0.0, atol=1e-12)
    tilted = surroundings(load).act(attitude(0.1, 0.0), STILL, STILL)
    assert tilted.torque[0] == pytest.approx(-0.05 * weight * math.sin(0.1), rel=0.1)


def test_a_load_swings_with_the_period_of_its_string():
    """Of 2 pi sqrt(l / g), when the vehicle that it hangs on was pushed once."""
    hanging = surroundings(Effects(sling_load_fraction=0.1, sling_length_m=1.5))
    north = [hanging.act(LEVEL, (1.0 if k < 100 else 0.0, 0.0, 0.0), STILL).force[0] for k in range(8000)]
    crossings = np.flatnonzero(np.diff(np.signbit(north[200:])))
    assert 2.0 * np.diff(crossings).mean() * PERIOD_S == pytest.approx(
        2.0 * math.pi * math.sqrt(1.5 / 9.80665), rel=0.01
    )


def test_a_load_carried_along_pulls_back():
    """A vehicle that speeds up to the north is held back to the south."""
    hanging = surroundings(Effects(sling_load_fraction=0.1))
    forces = [hanging.act(LEVEL, (1.0, 0.0, 0.0), STILL).force[0] for _ in range(200)]
    assert forces[-1] < 0.0


def test_a_force_from_outside_accelerates_the_vehicle():
    """By its size over the mass, in NED."""
    frame = dataclasses.replace(quad_x(), drag_n_s_m=0.0, drag_area_m2=0.0)
    state = at_rest(4)._replace(height=100.0)
    outside = surroundings(Effects()).act(LEVEL, STILL, STILL)._replace(force=(3.0, -1.5, 0.75))
    moved = advance(state, (0.0,) * 4, STILL, body_of(frame, PERIOD_S), outside)
    np.testing.assert_allclose(moved.acceleration, [3.0 / 1.5, -1.0, 9.80665 + 0.5], atol=1e-9)


@pytest.mark.parametrize(("command", "given"), [(0.005, 0.0), (-0.03, -0.01), (0.5, 0.48)])
def test_a_dead_zone_is_taken_off_every_command(command, given):
    """On both sides, and nothing is left of a command that is smaller."""
    error = Actuation(Effects(dead_zone=0.02)).error((command, 0.0, 0.0), 0.0)
    np.testing.assert_allclose(command + error[0], given, atol=1e-12)


def test_a_rotor_follows_only_what_differs_enough_from_the_mean():
    """The mean is followed at once."""
    actuation = Actuation(Effects(rotor_dead_zone=0.02))
    followed = actuation.followed((0.51, 0.49, 0.55, 0.45))
    np.testing.assert_allclose(followed, [0.5, 0.5, 0.53, 0.47], atol=1e-12)


def test_each_axis_has_its_own_hidden_limit():
    """A command within it is followed."""
    limited = Actuation(Effects(torque_limit=(0.1, 0.2, 0.3)))
    error = limited.error((0.25, -0.25, 0.25), 0.0)
    np.testing.assert_allclose(error, [-0.15, 0.05, 0.0], atol=1e-12)


def test_a_gain_alternates_by_half_periods():
    """Up first, then down."""
    swinging = Actuation(Effects(gain_swing=0.2, gain_period_s=4.0))
    errors = [swinging.error((0.1, 0.0, 0.0), time_s)[0] for time_s in (0.5, 1.9, 2.1, 3.9, 4.1)]
    np.testing.assert_allclose(errors, [0.02, 0.02, -0.02, -0.02, 0.02], atol=1e-12)


@pytest.mark.parametrize("autopilot", ["ardupilot", thorough("px4")])
def test_rotors_get_the_mistaken_torque_and_the_log_the_commanded_one(autopilot):
    """With a gain that is 10 % up all the time, the torque is 1.1 times what the log takes for achieved."""
    swing = Effects(gain_swing=0.1, gain_period_s=1e6)
    still = dataclasses.replace(quad_x(), lag_up_s=1e-6, lag_down_s=1e-6)
    record = fly(setup_of("sysid-quad-x", airframe=still, autopilot=autopilot, effects=swing))
    rows = np.flatnonzero(manoeuvre(record))
    achieved = record.channels["achieved"][rows] @ torque_gain(still, autopilot).T
    if autopilot == "px4":
        achieved = record.channels["achieved"][rows] @ torque_per_command(record).T
    slope = np.sum(achieved * record.channels["torque"][rows + 1], axis=0) / np.sum(achieved**2, axis=0)
    np.testing.assert_allclose(slope, 1.1, rtol=0.02)


def test_rotors_that_slow_down_slowly_are_those_of_an_airframe_that_does():
    """The ratio multiplies the airframe's time constant down, in the plant and in the truth."""
    slow = setup_of("slow-motors", effects=Effects(spin_down_ratio=2.0))
    frame = dataclasses.replace(slow.airframe, lag_down_s=2.0 * slow.airframe.lag_down_s)
    same = setup_of("slow-motors", airframe=frame)
    assert _body(slow).decay_down == _body(same).decay_down
    assert actuator_truth(slow) == actuator_truth(same)
    assert actuator_truth(slow)["lag_down_s"] == pytest.approx(0.14)


@pytest.mark.parametrize("autopilot", ["ardupilot", thorough("px4")])
def test_with_another_expo_in_the_firmware_the_true_gain_is_still_the_linearised_simulator(autopilot):
    """Small commands, rotors without lag: torque against command is the stated truth."""
    setup = setup_of("sysid-quad-x", autopilot=autopilot, duration_s=30.0, effects=Effects(firmware_expo=0.2))
    reference = dataclasses.replace(setup.reference, rate_rad_s=0.2 * setup.reference.rate_rad_s)
    still = dataclasses.replace(setup.airframe, lag_up_s=1e-6, lag_down_s=1e-6)
    record = fly(dataclasses.replace(setup, reference=reference, airframe=still))
    rows = np.flatnonzero(manoeuvre(record))
    columns = np.hstack([record.channels["command"][rows], np.ones((rows.size, 1))])
    gain = np.linalg.lstsq(columns, record.channels["torque"][rows + 1])[0][:3].T
    np.testing.assert_allclose(np.diag(gain), np.diag(torque_per_command(record)), rtol=3e-3)


@pytest.mark.parametrize(("autopilot", "name"), [("ardupilot", "MOT_THST_EXPO"), ("px4", "THR_MDL_FAC")])
def test_a_firmware_with_another_expo_says_so_in_its_parameters(autopilot, name):
    """What the log holds is what the firmware is set to, not what the propellers have."""
    record = fly(setup_of("hover", autopilot=autopilot, effects=Effects(firmware_expo=0.2)))
    assert log_flights((record,), Logging()).parameters[name] == pytest.approx(0.2)


def test_a_firmware_with_another_expo_hovers_where_its_parameter_says():
    """The throttle in the units of the firmware's own curve; the voltage is compensated by it."""
    record = fly(setup_of("hover", noise=SILENT, effects=Effects(firmware_expo=0.2)))
    named = log_flights((record,), Logging()).parameters["MOT_THST_HOVER"]
    flown = record.channels["throttle"][manoeuvre(record)].mean()
    assert flown == pytest.approx(named, rel=0.01)
    assert abs(named - record.setup.airframe.hover_throttle) > 0.03


@pytest.mark.parametrize(("frequency_hz", "gain"), [(3.0, 0.2), (6.0, -0.1), (20.0, 0.3)])
def test_the_gyro_sees_the_body_s_rate_and_a_part_of_the_mode_s(frequency_hz, gain):
    """The frequency response of 1 - g s^2 / (s^2 + 2 z w s + w^2)."""
    mode = FlexibleMode(
        Effects(flexible_mode_hz=6.0, flexible_mode_damping=0.15, flexible_mode_gain=gain), 4000.0
    )
    time_s = np.arange(24_000) / 4000.0
    wave = np.exp(2j * np.pi * frequency_hz * time_s)
    seen = np.array([mode.seen((value.real, value.imag, 0.0))[:2] for value in wave])
    s, w = 2j * math.pi * frequency_hz, 2.0 * math.pi * 6.0
    expected = 1.0 - gain * s**2 / (s**2 + 0.3 * w * s + w**2)
    np.testing.assert_allclose((seen @ [1.0, 1j])[-1] / wave[-1], expected, rtol=5e-3)


@pytest.mark.thorough
def test_late_torque_is_that_of_so_much_earlier():
    """The rates of the same message are not late."""
    setup = setup_of("sysid-quad-x", rate_hz=400.0)
    prompt, late = (
        log_flights((fly(dataclasses.replace(setup, effects=effects)),), Logging())
        for effects in (Effects(), Effects(torque_late_s=0.02))
    )
    torque, delayed = (log.signals["torque_command"][0].values for log in (prompt, late))
    np.testing.assert_array_equal(delayed[8:], torque[:-8])
    np.testing.assert_array_equal(late.signals["body_rate"][0].values, prompt.signals["body_rate"][0].values)


def test_so_many_samples_are_absurd_and_no_other_changes():
    """By three times the spread of the series at least."""
    values = np.random.default_rng(0).standard_normal((100_000, 3))
    struck = with_outliers(values, 0.003, np.random.default_rng(1)) - values
    assert np.count_nonzero(struck.any(axis=1)) == pytest.approx(300, abs=50)
    assert np.count_nonzero(struck, axis=1).max() == 1
    assert np.abs(struck[struck != 0.0]).min() > 2.9


@pytest.mark.thorough
def test_a_log_without_setpoints_has_everything_else():
    """What is missing are the rate set-points alone."""
    whole, without = (
        log_flights((fly(setup_of("hover", autopilot="px4", effects=effects)),), Logging())
        for effects in (Effects(), Effects(setpoints_logged=False))
    )
    assert set(whole.signals) - set(without.signals) == {"body_rate_setpoint"}


def test_the_truth_names_the_effects_that_are_present():
    """With their values, ready for JSON; of a flight without effects, none."""
    every = dataclasses.replace(ALL, motor_fault=1, bent_propeller=2, mass_offset=(0.01, 0.0), desync_rotor=3)
    record = fly(setup_of("sysid-quad-x", effects=every))
    truth = flight_truth((record,), scenario="all", boot_s=0.0)
    assert set(json.loads(json.dumps(truth, allow_nan=False))["effects"]) == set(FIELDS)
    assert truth["effects"]["dead zone"] == {"dead_zone": 0.01}
    assert Effects().named() == {}


def test_every_field_belongs_to_one_effect():
    """None is declared and never named in a truth."""
    listed = [field for fields in FIELDS.values() for field in fields]
    assert sorted(listed) == sorted(field.name for field in dataclasses.fields(Effects))


def test_a_bent_propeller_shakes_the_gyro_more_than_the_others_and_at_its_own_speed():
    """One model of imbalance: every rotor has its line, and the bent one adds to its own."""
    from quadid_logs.simulator.faults import RotorVibration

    speeds = tuple(2.0 * np.pi * hz for hz in (60.0, 70.0, 80.0, 90.0))
    vibration = RotorVibration(Effects(bent_propeller=2), 0.1, 4, 1000.0)
    roll = np.array([vibration.rates(speeds)[0] for _ in range(1000)])
    lines = 2.0 * np.abs(np.fft.rfft(roll))[[60, 70, 80, 90]] / 1000.0
    alike = 0.1 * np.sqrt(0.5)
    # Nearly all of it at these speeds, which slow rotors do not have.
    np.testing.assert_allclose(lines, [alike, alike + 0.3, alike, alike], rtol=0.08)
