"""The closed loop: plant, autopilot, sensors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.autopilots.ardupilot.frames import frame_geometry, known_frames
from quadid_logs.maths.frames import torque_matrix
from quadid_logs.maths.rotational_dynamics import inertia_terms
from quadid_logs.simulator import SCENARIOS, fly, plan_flights
from quadid_logs.simulator.airframes import SimulatedAirframe, layout, quad_x
from quadid_logs.simulator.closed_loop import Noise, mixer_factors, torque_gain
from quadid_logs.simulator.control import (
    Mixer,
    butterworth,
    filter_rates,
    mix,
    throttle_for_thrust,
    thrust_of_throttle,
)
from quadid_logs.simulator.plant import Body, advance, at_rest
from quadid_logs.simulator.truth import torque_per_command
from quadid_logs.simulator.wind import Wind, dryden_wind
from tests.marks import thorough, thorough_but

TAILS = ((1, 4), (1, 5))
#: Just fast enough for a loop of its own at that rate: a flight takes its time for every step.
SLOW_HZ = 270.0
SILENT = Noise(gyro_rad_s_per_rthz=0.0, gyro_bias_rad_s=(0.0, 0.0, 0.0), gyro_resolution_rad_s=1e-12)


def setup_of(name, *, seed=1, duration_s=15.0, **changes):
    """Plan a flight of a named scenario, as short and as slow as there is one."""
    (setup,) = plan_flights(
        SCENARIOS[name],
        seed=seed,
        duration_s=duration_s,
        rate_hz=changes.pop("rate_hz", SLOW_HZ),
        autopilot=changes.pop("autopilot", "ardupilot"),
    )
    return dataclasses.replace(setup, **changes)


def manoeuvre(record):
    """Rows of the manoeuvre."""
    schedule = record.setup.schedule
    return (record.time_s >= schedule.manoeuvre_s + 0.5) & (record.time_s < schedule.land_s - 0.5)


def body_of(airframe, step_s):
    """Build the plant's constants by hand."""
    decay = [float(np.exp(-part * step_s / airframe.lag_up_s)) for part in (0.5, 1.0)]
    return Body(
        step_s=step_s,
        mass=airframe.mass_kg,
        inertia=inertia_terms(airframe.inertia_kg_m2),
        damping=tuple(airframe.rate_damping_n_m_s),
        thrust_per_speed2=tuple(airframe.rotor_thrust_n / airframe.rotor_speed_max_rad_s**2),
        arms=tuple(map(tuple, airframe.torque_per_thrust.T.tolist())),
        decay_up=tuple(decay),
        decay_down=tuple(decay),
        drag=0.0,
        drag_area=0.0,
        drag_height=0.0,
    )


def test_a_rotor_answers_a_step_as_a_first_order_lag():
    """After one time constant 63.2 % of the speed step is made, whatever the control period."""
    airframe = quad_x()
    for step_s in (0.0025, 0.006):
        body, state = body_of(airframe, step_s), at_rest(4)
        speeds = []
        for _ in range(60):
            state = advance(state, (500.0,) * 4, (0.0, 0.0, 0.0), body)
            speeds.append(state.speeds[0])
        time = step_s * np.arange(1, 61)
        np.testing.assert_allclose(speeds, 500.0 * -np.expm1(-time / airframe.lag_up_s), rtol=1e-12)


def test_thrust_and_drag_torque_go_with_the_square_of_the_speed():
    """Twice the speed, four times the thrust and yaw torque."""
    airframe, rows = quad_x(), []
    for speed in (200.0, 400.0):
        state = at_rest(4)._replace(speeds=(speed, speed, 0.0, 0.0))
        end = advance(state, (speed, speed, 0.0, 0.0), (0.0, 0.0, 0.0), body_of(airframe, 0.0025))
        rows.append((end.wrench.thrust, end.wrench.torque[2]))
    assert rows[1][0] == pytest.approx(4.0 * rows[0][0])
    assert rows[1][1] == pytest.approx(4.0 * rows[0][1])
    assert rows[0][1] == pytest.approx(airframe.torque_to_thrust_m * rows[0][0])


def test_a_vehicle_without_lift_stays_on_the_ground():
    """Gravity does not pull it into the ground."""
    state = at_rest(4)
    for _ in range(100):
        state = advance(state, (100.0,) * 4, (0.0, 0.0, 0.0), body_of(quad_x(), 0.0025))
    assert state.height == 0.0
    assert state.velocity == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("key", [key for key in known_frames() if key not in TAILS])
def test_the_mixer_achieves_what_fits(key):
    """A moderate command on any frame comes out of the motors as it went in."""
    frame = frame_geometry(*key)
    columns = [tuple(column) for column in frame.mixer.T.tolist()]
    mixer = Mixer(*columns, (1.0,) * frame.n_rotors, hover=0.45)
    command = (0.06, -0.05, 0.04)
    mixed = mix(command, 0.45, mixer)
    assert mixed.limited == 0.0
    thrust = np.array(mixed.thrust)
    np.testing.assert_allclose(thrust - thrust.mean(), frame.mixer @ command - (frame.mixer @ command).mean())
    assert thrust.mean() - (frame.mixer @ command).mean() == pytest.approx(0.45)


@pytest.mark.parametrize("command", [(0.0, 0.0, 1.5), (1.0, 1.0, 0.0), (0.9, -0.8, 0.9)])
def test_the_mixer_keeps_every_motor_in_range_and_says_so(command):
    """Too much yaw is clipped, too much of all is scaled; no motor leaves 0 to 1."""
    columns = [tuple(column) for column in frame_geometry(1, 1).mixer.T.tolist()]
    mixed = mix(command, 0.45, Mixer(*columns, (1.0,) * 4, hover=0.45))
    assert mixed.limited == 1.0
    assert min(mixed.thrust) >= 0.0
    assert max(mixed.thrust) <= 1.0
    achieved = np.linalg.lstsq(frame_geometry(1, 1).mixer, np.array(mixed.thrust) - np.mean(mixed.thrust))[0]
    np.testing.assert_allclose(achieved, mixed.torque, atol=1e-12)


@pytest.mark.parametrize("expo", [0.05, 0.5, 1.0])
def test_the_thrust_curve_and_its_inverse_cancel(expo):
    """Throttle for a thrust gives that thrust."""
    thrust = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(
        thrust_of_throttle(throttle_for_thrust(thrust, expo), expo), thrust, atol=1e-14
    )


def test_a_cut_off_beyond_what_the_gyro_shows_is_two_fifths_of_its_rate():
    """Above half of it, the filter itself would be unstable."""
    assert butterworth(256.0, 400.0) == butterworth(160.0, 400.0)


def test_the_gyro_filter_is_scipys_butterworth():
    """The autopilots' biquad is a bilinear second-order Butterworth with a pre-warped cut-off."""
    from scipy.signal import butter, lfilter

    samples = np.random.default_rng(0).standard_normal((200, 3))
    memory, filtered = ((0.0,) * 3, (0.0,) * 3), []
    for sample in samples.tolist():
        rate, memory = filter_rates(tuple(sample), memory, butterworth(40.0, 400.0))
        filtered.append(rate)
    np.testing.assert_allclose(filtered, lfilter(*butter(2, 40.0, fs=400.0), samples, axis=0), atol=1e-12)


@pytest.mark.parametrize(
    "key",
    thorough_but(
        # A quadrotor, and a frame whose yaw rolls it.
        [(1, 0), (5, 10)],
        [(1, 0), (1, 2), (1, 3), (1, 19), (2, 0), (3, 2), (4, 1), (5, 0), (5, 10), (12, 1), (14, 0)],
    ),
)
def test_frames_of_every_class_hover(key):
    """The loops are stable on frames of every class: a doublet flight ends level and at its height."""
    n = frame_geometry(*key).n_rotors
    airframe = SimulatedAirframe(
        name="any",
        mass_kg=0.4 * n,
        inertia_kg_m2=np.diag([0.004, 0.0045, 0.007]) * n,
        max_thrust_n=9.0,
        torque_to_thrust_m=0.016,
        **layout(*key, 0.25),
    )
    setup = setup_of("doublets", duration_s=16.0, airframe=airframe)
    # Small, because a Y4's yaw rolls it as well.
    reference = dataclasses.replace(setup.reference, rate_rad_s=0.3 * setup.reference.rate_rad_s)
    record = fly(dataclasses.replace(setup, reference=reference))
    rows = manoeuvre(record)
    assert np.abs(record.channels["rate"]).max() < 4.0
    assert np.abs(record.channels["height"][rows, 0] - record.setup.schedule.height_m).max() < 1.5
    landing = np.flatnonzero(record.time_s < record.setup.schedule.land_s)[-1]
    assert np.abs(record.channels["attitude"][landing, 1:3]).max() < 0.2


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_hover_without_noise_stands_still(autopilot):
    """No excitation and no noise: nothing moves."""
    record = fly(setup_of("hover", noise=SILENT, autopilot=autopilot))
    assert np.abs(record.channels["rate"][manoeuvre(record)]).max() < 1e-6


@pytest.mark.usefixtures("flown_each_time")
def test_the_same_seed_flies_the_same_flight():
    """Bit for bit; another seed does not."""
    first, again, other = (fly(setup_of("wind", seed=seed)).channels for seed in (3, 3, 4))
    assert all(np.array_equal(first[name], again[name]) for name in first)
    assert not np.array_equal(first["gyro"], other["gyro"])


def test_newton_and_euler_hold_for_what_is_recorded():
    """The recorded torque explains the recorded rates' derivative by eq. (8) with damping."""
    calm = dataclasses.replace(quad_x(), drag_n_s_m=0.0, drag_area_m2=0.0)
    record = fly(setup_of("sysid-quad-x", rate_hz=400.0, airframe=calm, noise=SILENT))
    rate, torque = record.channels["rate"], record.channels["torque"]
    J, damping = calm.inertia_kg_m2, calm.rate_damping_n_m_s
    rows = manoeuvre(record)
    step_s = 1.0 / record.setup.loop_hz
    explained = np.linalg.solve(J, (torque - damping * rate - np.cross(rate, rate @ J)).T).T
    # Simpson's rule over two periods; the rotors' response has a kink at every period's beginning.
    gained = rate[2:] - rate[:-2]
    integral = step_s / 3.0 * (explained[:-2] + 4.0 * explained[1:-1] + explained[2:])
    np.testing.assert_allclose(gained[rows[1:-1]], integral[rows[1:-1]], atol=3e-4)


@pytest.mark.parametrize(
    ("name", "autopilot"),
    [
        ("products-of-inertia", "ardupilot"),
        ("hexa-x", "px4"),
        thorough("octa-coax", "ardupilot"),
        thorough("sysid-quad-x", "ardupilot"),
        thorough("sysid-quad-x", "px4"),
        thorough("products-of-inertia", "px4"),
        thorough("hexa-x", "ardupilot"),
        thorough("octa-coax", "px4"),
    ],
)
def test_the_true_gain_is_the_linearised_simulator(name, autopilot):
    """Torque that the rotors would make at rest, regressed on small commands, is the stated truth."""
    gentle = setup_of(name, autopilot=autopilot, duration_s=30.0)
    reference = dataclasses.replace(gentle.reference, rate_rad_s=0.3 * gentle.reference.rate_rad_s)
    still = dataclasses.replace(gentle.airframe, lag_up_s=1e-6, lag_down_s=1e-6)
    record = fly(dataclasses.replace(gentle, reference=reference, airframe=still))
    rows = np.flatnonzero(manoeuvre(record))
    command = record.channels["command"][rows]
    # Without lag the torque at the end of a period is that of the period's command.
    torque = record.channels["torque"][rows + 1]
    bias = np.ones((rows.size, 1))
    gain = np.linalg.lstsq(np.hstack([command, bias]), torque)[0][:3].T
    expected = torque_per_command(record)
    largest = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(gain / largest, expected / largest, atol=3e-3)


def test_ardupilots_gain_does_not_depend_on_the_battery():
    """Its compensation cancels the voltage: the true gain is that of a full battery."""
    record = fly(setup_of("sysid-quad-x"))
    np.testing.assert_allclose(
        torque_per_command(record), torque_gain(record.setup.airframe, "ardupilot"), rtol=2e-3, atol=1e-9
    )


def test_px4s_factors_are_the_allocations_of_its_geometry():
    """A quadrotor X has 1/sqrt(2) on roll and pitch and 1 on yaw."""
    factors = mixer_factors(quad_x(), "px4")
    np.testing.assert_allclose(np.abs(factors), np.tile([np.sqrt(0.5), np.sqrt(0.5), 1.0, 1.0], (4, 1)))
    gain = torque_matrix(quad_x().position_m, quad_x().spin, 0.016) @ factors[:, :3]
    assert np.all(np.diagonal(gain) > 0.0)


def test_slow_motors_are_slower_down_than_up():
    """A longer time constant down than up lowers the speed more slowly than it raises it."""
    record = fly(
        setup_of("slow-motors", airframe=dataclasses.replace(quad_x(), lag_up_s=0.02, lag_down_s=0.2))
    )
    change = np.diff(record.channels["rotor_speed"][manoeuvre(record), 0])
    assert np.percentile(change, 99.0) > -1.3 * np.percentile(change, 1.0)


@pytest.mark.thorough
def test_turbulence_has_drydens_intensity():
    """Standard deviations of a long series match MIL-F-8785C at 20 ft within the sampling error."""
    wind = Wind(speed_m_s=8.0, heading_rad=0.0, height_m=6.096)
    gusts = dryden_wind(wind, 2_000_000, 0.05, np.random.default_rng(0))
    shape = 0.177 + 0.000823 * 20.0
    along = 0.1 * 8.0 / shape**0.4
    np.testing.assert_allclose(gusts.std(axis=0), [along, along, 0.8], rtol=0.03)
    np.testing.assert_allclose(gusts.mean(axis=0), [8.0, 0.0, 0.0], atol=0.1)


def test_a_gyro_scale_error_multiplies_what_the_gyro_shows():
    """Of each axis by its own factor; the true rate is what flew."""
    setup = setup_of("sysid-quad-x", noise=dataclasses.replace(SILENT, gyro_scale=(0.01, -0.02, 0.0)))
    channels = fly(setup).channels
    np.testing.assert_allclose(channels["gyro"], channels["rate"] * [1.01, 0.98, 1.0], rtol=0.0, atol=1e-9)


def test_a_cross_axis_gyro_shows_a_fraction_of_the_other_rates():
    """p of q and r, q of p and r, r of p and q."""
    cross = (0.01, -0.02, 0.0, 0.03, 0.005, 0.0)
    setup = setup_of("sysid-quad-x", noise=dataclasses.replace(SILENT, gyro_cross=cross))
    channels = fly(setup).channels
    E = np.array([[1.0, 0.01, -0.02], [0.0, 1.0, 0.03], [0.005, 0.0, 1.0]])
    np.testing.assert_allclose(channels["gyro"], channels["rate"] @ E.T, rtol=0.0, atol=1e-9)


def test_drag_grows_with_airspeed_and_its_square_and_attacks_above_the_centre_of_mass():
    """-(d v + rho / 2 A v^2) along the airspeed; blown from ahead, the nose rises."""
    frame = dataclasses.replace(quad_x(), drag_n_s_m=0.3, drag_area_m2=0.02, drag_height_m=0.05)
    body = body_of(frame, 1e-4)._replace(drag=0.3, drag_area=0.02, drag_height=0.05)
    state = at_rest(4)._replace(height=100.0, velocity=(7.0, 0.0, 0.0))
    moved = advance(state, (0.0,) * 4, (3.0, 0.0, 0.0), body)
    drag = 0.3 * 4.0 + 0.5 * 1.225 * 0.02 * 4.0**2
    np.testing.assert_allclose(moved.acceleration, [-drag / frame.mass_kg, 0.0, 9.80665], atol=1e-6)
    pitching = 0.05 * drag / frame.inertia_kg_m2[1, 1] * 1e-4
    np.testing.assert_allclose(moved.rate, [0.0, pitching, 0.0], rtol=1e-3)


def test_the_gyro_noise_has_its_density():
    """White up to half the sampling rate: sigma^2 is the density squared times that."""
    noise = Noise(gyro_rad_s_per_rthz=1e-3, gyro_bias_rad_s=(0.1, -0.2, 0.3), gyro_resolution_rad_s=1e-12)
    record = fly(setup_of("hover", noise=noise))
    error = record.channels["gyro"] - record.channels["rate"]
    highest_hz = 0.5 * record.setup.loop_hz
    np.testing.assert_allclose(error.std(axis=0), 1e-3 * np.sqrt(highest_hz), rtol=0.03)


def test_a_tenth_of_the_gyro_bias_is_left_at_take_off():
    """The autopilot's estimator has found the rest."""
    noise = dataclasses.replace(SILENT, gyro_bias_rad_s=(0.1, -0.2, 0.3))
    record = fly(setup_of("hover", noise=noise))
    error = record.channels["gyro"] - record.channels["rate"]
    np.testing.assert_allclose(error, np.tile([0.01, -0.02, 0.03], (error.shape[0], 1)), atol=1e-9)


def test_the_voltage_falls_with_the_charge_and_with_the_current():
    """Current as thrust to the power 1.5, every tenth of a second."""
    frame = dataclasses.replace(quad_x(), battery=dataclasses.replace(quad_x().battery, sag=30.0))
    record = fly(setup_of("sysid-quad-x", airframe=frame))
    battery, every = frame.battery, round(0.1 * record.setup.loop_hz)
    speed = record.channels["rotor_speed"][::every]
    thrust = np.sum(frame.rotor_thrust_n * (speed / frame.rotor_speed_max_rad_s) ** 2, axis=1)
    current = battery.hover_current_a * (thrust / (frame.mass_kg * 9.80665)) ** 1.5
    charge = np.cumsum(current) * 0.1
    expected = 1.0 - battery.sag * charge / battery.capacity_a_s
    expected -= battery.resistance_ohm * current / battery.full_v
    assert expected.min() < 0.9
    np.testing.assert_allclose(record.channels["voltage"][::every, 0], expected, rtol=1e-9)


def test_the_wind_blows_where_its_heading_points():
    """From the mean of a long series; 0 is north, a quarter turn east."""
    wind = Wind(speed_m_s=5.0, heading_rad=0.4)
    mean = dryden_wind(wind, 400_000, 0.05, np.random.default_rng(1)).mean(axis=0)
    np.testing.assert_allclose(mean, [5.0 * np.cos(0.4), 5.0 * np.sin(0.4), 0.0], atol=0.15)


def test_rotors_that_slow_down_slowly_have_the_longer_time_constant_on_the_way_down():
    """A step up and a step down of one rotor: each its own exponential."""
    airframe = quad_x()
    up, down = (tuple(np.exp(-part * 0.0025 / lag) for part in (0.5, 1.0)) for lag in (0.02, 0.2))
    body = body_of(airframe, 0.0025)._replace(decay_up=up, decay_down=down)
    state = at_rest(4)._replace(speeds=(100.0, 900.0, 500.0, 500.0))
    moved = advance(state, (500.0,) * 4, (0.0, 0.0, 0.0), body)
    expected = (500.0 - 400.0 * up[1], 500.0 + 400.0 * down[1], 500.0, 500.0)
    np.testing.assert_allclose(moved.speeds, expected, rtol=1e-12)
