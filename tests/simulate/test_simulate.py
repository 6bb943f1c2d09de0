"""Scenarios, logs and truths."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.data.vehicle import Rotor, Vehicle
from quadid_logs.errors import SimulationError
from quadid_logs.maths.rotations import quaternion_from_euler, rotation_matrix
from quadid_logs.simulator import Damage, damage_bytes, simulate
from quadid_logs.simulator.closed_loop import SPIN_MAX, SPIN_MIN
from quadid_logs.simulator.control import throttle_for_thrust


@pytest.fixture(scope="module")
def quad():
    """The good flight, 15 s of it."""
    return simulate("sysid-quad-x", seed=5, duration_s=15.0)


@pytest.fixture(scope="module")
def px4():
    """The same flight with the other autopilot."""
    return simulate("sysid-quad-x", seed=5, duration_s=15.0, autopilot="px4")


@pytest.mark.thorough
@pytest.mark.usefixtures("flown_each_time")
def test_the_same_seed_logs_the_same_flight(quad):
    """Every series of every signal, bit for bit, and the same truth."""
    again = simulate("sysid-quad-x", seed=5, duration_s=15.0)
    for name, signals in quad.log.signals.items():
        for one, other in zip(signals, again.log.signals[name], strict=True):
            assert np.array_equal(one.values, other.values)
            assert np.array_equal(one.time_s, other.time_s)
    assert quad.truth == again.truth


def test_rate_and_duration_are_honoured():
    """A log of 16 s at 250 Hz has rows 4 ms apart and ends after 16 s."""
    log = simulate("sysid-quad-x", duration_s=16.0, rate_hz=250.0).log
    time = log.signals["torque_command"][0].time_s
    assert np.median(np.diff(time)) == pytest.approx(0.004, abs=2e-5)
    assert time[-1] - 31.0 == pytest.approx(16.0, abs=0.01)


@pytest.mark.parametrize(("autopilot", "rate_hz"), [("ardupilot", 10.0), ("px4", 50.0)])
def test_default_logging_has_the_autopilots_rate(autopilot, rate_hz):
    """ArduPilot logs RATE at 10 Hz, PX4 the torque set-point at 50 Hz."""
    log = simulate("default-logging", duration_s=15.0, autopilot=autopilot).log
    time = log.signals["torque_command"][0].time_s
    assert 1.0 / np.median(np.diff(time)) == pytest.approx(rate_hz, rel=1e-3)


def test_pulse_widths_follow_from_command_voltage_and_parameters(quad):
    """The logged PWM is recomputed from RATE.*Out, MOTB and the parameters within half a microsecond."""
    signals, parameters = quad.log.signals, quad.log.parameters
    pwm, ratio = signals["output_pwm"][0], signals["battery_ratio"][0].values[:, 0]
    lift = signals["lift_max"][0].values[:, 0]
    rows = np.searchsorted(signals["torque_command"][0].time_s, pwm.time_s)
    command = signals["torque_command"][0].values[rows] / lift[:, np.newaxis]
    throttle = signals["throttle"][0].values[rows, 0] / lift
    factors = 0.5 * np.array([[-1, 1, 1], [1, -1, 1], [1, 1, -1], [-1, -1, -1]])
    thrust = throttle[:, np.newaxis] + command @ factors.T
    linear = throttle_for_thrust(thrust * lift[:, np.newaxis], parameters["MOT_THST_EXPO"])
    actuator = SPIN_MIN + (SPIN_MAX - SPIN_MIN) * linear / ratio[:, np.newaxis]
    (begin, end) = quad.truth["segments_s"][0]
    in_flight = (pwm.time_s > begin) & (pwm.time_s < end)
    assert np.abs(1000.0 + 1000.0 * actuator - pwm.values)[in_flight].max() < 0.51


def test_px4s_motors_are_mix_times_setpoints(px4):
    """actuator_motors carries thrust fractions of which torque and thrust set-points are linear functions."""
    signals = px4.log.signals
    rows = signals["motor_thrust"][0]
    inputs = np.hstack([signals["torque_command"][0].values, signals["throttle"][0].values])
    (begin, end) = px4.truth["segments_s"][0]
    in_flight = (rows.time_s > begin) & (rows.time_s < end)
    solution, *_ = np.linalg.lstsq(inputs[in_flight], rows.values[in_flight])
    np.testing.assert_allclose(inputs[in_flight] @ solution, rows.values[in_flight], atol=1e-5)
    np.testing.assert_allclose(np.abs(solution[0]), np.sqrt(0.5), atol=1e-3)


def test_the_accelerometer_feels_the_ground_and_the_thrust(quad):
    """At rest -g on z; in flight the mean lift carries the weight."""
    force = quad.log.signals["specific_force"][0]
    on_ground = force.time_s < 31.4
    np.testing.assert_allclose(force.values[on_ground].mean(axis=0), [0.0, 0.0, -9.80665], atol=0.05)
    (begin, end) = quad.truth["segments_s"][0]
    in_flight = (force.time_s > begin) & (force.time_s < end)
    attitude = quad.log.signals["attitude"][0].values[in_flight]
    turned = np.einsum(
        "nij,nj->ni", rotation_matrix(quaternion_from_euler(attitude)), force.values[in_flight]
    )
    assert turned[:, 2].mean() == pytest.approx(-9.80665, abs=0.1)


def test_the_attitude_is_the_integral_of_the_rates(quad):
    """Roll rates and roll angle belong to one motion (small angles)."""
    log = quad.log
    p, roll = log.signals["body_rate"][0].values[:, 0], log.signals["attitude"][0].values[:, 0]
    slope = np.gradient(roll, 0.0025)
    assert np.corrcoef(np.convolve(slope, np.ones(5) / 5, "same"), p)[0, 1] > 0.97


def test_signals_of_one_message_have_the_same_rows(quad):
    """RATE's are one object, ANG has its own; positions rise with time."""
    signals = quad.log.signals
    rows = signals["body_rate"][0].rows
    assert rows is signals["torque_command"][0].rows
    assert rows is not signals["attitude"][0].rows
    assert np.all(np.diff(rows.position) > 0)


def test_a_clock_that_is_set_back_leaves_the_rows_in_order():
    """Times fall by 20 s once; positions go on rising."""
    log = simulate("clock-jump", duration_s=15.0).log
    rate = log.signals["body_rate"][0]
    falls = np.flatnonzero(np.diff(rate.time_s) < 0.0)
    assert falls.size == 1
    assert np.diff(rate.time_s)[falls[0]] == pytest.approx(-20.0, abs=0.01)
    assert np.all(np.diff(rate.position) > 0)


def test_two_flights_arm_twice():
    """The log has two take-offs, and the truth two segments."""
    simulation = simulate("two-flights", duration_s=30.0)
    armed = simulation.log.signals["armed"][0].values[:, 0]
    assert np.count_nonzero(np.diff(armed) > 0) == 2
    assert len(simulation.truth["segments_s"]) == 2


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_late_log_finds_the_vehicle_armed(autopilot):
    """A log that begins in flight begins with the motors armed and off the ground."""
    log = simulate("dropouts", duration_s=15.0, autopilot=autopilot).log
    assert log.signals["armed"][0].values[:, 0].tolist() == [1.0, 0.0]
    assert log.signals["landed"][0].values[:, 0].tolist() == [0.0, 1.0]


def test_dropped_rows_are_counted():
    """What is missing in the log is what `n_dropped` says."""
    log = simulate("dropouts", duration_s=15.0).log
    times = log.signals["body_rate"][0].time_s
    assert log.n_dropped > 0
    assert np.diff(times).max() > 0.008
    expected = (15.0 - 4.0) * 400.0
    assert 0.9 * expected < times.size < expected


@pytest.mark.thorough
def test_the_chirp_is_logged_while_it_runs():
    """SIDD exists during the manoeuvre only and is contained in the torque command."""
    simulation = simulate("single-axis", duration_s=30.0)
    chirp = simulation.log.signals["sysid_chirp"][0]
    (begin, end) = simulation.truth["segments_s"][0]
    # A row's chirp enters the command of the next loop, as in the firmware.
    assert chirp.time_s[0] == pytest.approx(begin - 1.0 / 400.0, abs=1e-3)
    assert chirp.time_s[-1] == pytest.approx(end - 1.0 / 400.0, abs=4e-3)
    command = simulation.log.signals["torque_command"][0]
    rows = np.searchsorted(command.time_s, chirp.time_s)
    # Towards its end the chirp is too fast for the controller to work against it.
    late = slice(-2000, None)
    assert np.corrcoef(command.values[rows[late], 0], chirp.values[late, 0])[0, 1] > 0.7
    assert {mode.name for mode in simulation.log.modes} == {"ALT_HOLD", "SYSTEMID", "LAND"}


def test_a_vehicle_file_replaces_the_vehicle():
    """Mass, arms and inertia that are given are flown, and told as truth."""
    inertia = np.diag([0.02, 0.021, 0.035])
    vehicle = Vehicle(name="mine", mass_kg=1.8, arm_length_m=0.25, inertia_kg_m2=inertia)
    truth = simulate("sysid-quad-x", duration_s=15.0, vehicle=vehicle).truth["vehicle"]
    assert truth["mass_kg"] == 1.8
    assert truth["arm_length_m"] == pytest.approx(0.25)
    assert truth["inertia_kg_m2"] == inertia.tolist()


@pytest.mark.parametrize(
    "vehicle",
    [Vehicle(mass_kg=30.0), Vehicle(rotors=(Rotor(position_m=(0.1, 0.1, 0.0), spin="cw"),))],
)
def test_a_vehicle_that_cannot_fly_is_refused(vehicle):
    """Too heavy for its rotors, or a rotor too few."""
    with pytest.raises(SimulationError):
        simulate("sysid-quad-x", vehicle=vehicle)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("sysid-quad", {}, "sysid-quad-x"),
        ("hover", {"duration_s": 3.0}, "cannot be flown"),
        ("hover", {"duration_s": float("nan")}, "cannot be flown"),
        ("hover", {"rate_hz": 1e6}, "cannot be logged"),
        ("hover", {"autopilot": "clearflight"}, "clearflight"),
    ],
)
def test_what_cannot_be_simulated_is_refused(name, options, words):
    """A wrong name, length, rate or autopilot gets one clear sentence."""
    with pytest.raises(SimulationError, match=words):
        simulate(name, **options)


def test_damage_hits_where_it_says():
    """Noise, zeros, a missing block and a cut, each in its place."""
    content = bytes(range(1, 101))
    damages = (
        Damage(kind="zeros", at=0.1, n_bytes=5),
        Damage(kind="noise", at=0.3, n_bytes=4),
        Damage(kind="missing", at=0.5, n_bytes=10),
        Damage(kind="cut", at=0.9),
    )
    damaged = damage_bytes(content, damages, seed=1)
    assert damaged[10:15] == bytes(5)
    assert damaged[30:34] != content[30:34]
    assert damaged[34:50] == content[34:50]
    assert damaged[50:] == content[60:90]
    assert damaged == damage_bytes(content, damages, seed=1)


def test_the_accelerometer_turns_with_the_vehicle(quad):
    """In body axes rotor thrust is along z: sideways there is drag alone, however far it tilts."""
    force = quad.log.signals["specific_force"][0]
    (begin, end) = quad.truth["segments_s"][0]
    in_flight = (force.time_s > begin) & (force.time_s < end)
    sideways = np.abs(force.values[in_flight, :2]).max()
    tilt = np.abs(quad.log.signals["attitude"][0].values[:, :2]).max()
    assert sideways < 0.1 * 9.80665 * np.sin(tilt)


def test_the_accelerometer_noise_has_its_density(quad):
    """At rest on the ground: white up to half the control rate."""
    force = quad.log.signals["specific_force"][0]
    at_rest = force.values[force.time_s < 32.4]
    np.testing.assert_allclose(at_rest.std(axis=0), 2.0e-3 * np.sqrt(200.0), rtol=0.15)


def test_the_true_delay_is_half_a_period_and_the_gyro_filter(quad):
    """sqrt(2) / (2 pi f_c) to a per cent: the digital filter's own differs a little."""
    delay_s = 0.5 / 400.0 + np.sqrt(2.0) / (2.0 * np.pi * 40.0)
    assert quad.truth["actuator"]["delay_s"] == pytest.approx(delay_s, rel=0.05)
    assert quad.truth["actuator"]["delay_parts_s"]["zero_order_hold"] == pytest.approx(0.5 / 400.0)


def test_the_true_models_say_what_euler_s_equation_says():
    """A and B of two structures against J^-1 (u - d w - w x J w) at random rates and commands."""
    truth = simulate("products-of-inertia", seed=5, duration_s=15.0).truth
    J, damping = np.array(truth["vehicle"]["inertia_kg_m2"]), np.array(truth["vehicle"]["rate_damping_n_m_s"])
    gain = np.array(truth["torque_n_m_per_command"])
    model = truth["models"]["rigid-body"]
    A, B = np.array(model["A"]), np.array(model["B"])
    for w, command in np.random.default_rng(2).standard_normal((5, 2, 3)):
        expected = np.linalg.solve(J, gain @ command - damping * w - np.cross(w, J @ w))
        p, q, r = w
        products = {"pp": p * p, "qq": q * q, "rr": r * r, "qr": q * r, "pr": p * r, "pq": p * q}
        columns = products | {"p": p, "q": q, "r": r}
        found = A @ [columns[name] for name in model["regressors"]] + B @ command
        np.testing.assert_allclose(found, expected, rtol=1e-9)
    np.testing.assert_allclose(np.array(model["inertia_over_torque_command"]) @ B, np.eye(3), atol=1e-9)


def test_the_six_term_truth_is_that_of_a_vehicle_without_products():
    """Each of qr, pr, pq on its own axis."""
    truth = simulate("hover", seed=5, duration_s=15.0).truth
    xx, yy, zz = np.diagonal(truth["vehicle"]["inertia_kg_m2"])
    model = truth["models"]["quadrotor-6"]
    assert model["regressors"] == ["qr", "pr", "pq"]
    np.testing.assert_allclose(
        model["A"], np.diag([(yy - zz) / xx, (zz - xx) / yy, (xx - yy) / zz]), atol=1e-12
    )


@pytest.mark.thorough
def test_unallocated_torque_is_what_was_commanded_and_not_achieved():
    """On a vehicle short of thrust: positive where a positive command was cut."""
    log = simulate("saturation", seed=2, duration_s=20.0, autopilot="px4").log
    missing, command = log.signals["unallocated_torque"][0], log.signals["torque_command"][0]
    at = np.searchsorted(command.time_s, missing.time_s + 1e-3) - 1
    cut = np.abs(missing.values) > 0.02
    assert cut.any()
    assert (np.sign(missing.values[cut]) == np.sign(command.values[at][cut])).mean() > 0.95
