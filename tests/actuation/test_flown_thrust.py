"""A tilted, accelerating flight with a sagging battery in thin air, integrated here from the textbook.

Nothing of the package's mixer, thrust curve or calibration is used to make the logs, so that an error in
one of them cannot cancel itself. Formulas: thrust (1 - e) y + e y^2 of the voltage-effective throttle y;
commands raised by one over lift and density; f = R^T (a - g); L = sum -y F, M = sum x F, N = sum s k F.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest

from quadid_logs.actuation import reconstruct
from quadid_logs.align import Prepared, clean, cut
from quadid_logs.autopilots import named
from quadid_logs.autopilots.ardupilot.torque import _misfit
from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.data.settings import AlignSettings
from quadid_logs.data.torque import DensityLaw, MixerCheck
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.load import prepare

GRAVITY = 9.80665
MASS_KG, ARM_M, RATIO_M, FULL_N, DRAG_N_S_M = 1.7, 0.28, 0.017, 10.0, 0.35
EXPO, SPIN_MIN, SPIN_MAX = 0.55, 0.12, 0.95
RATE_HZ, FLIGHT_S = 200.0, 60.0
#: Quad X: front right and rear left counter-clockwise, front left and rear right clockwise.
X = ARM_M / math.sqrt(2.0) * np.array([1.0, -1.0, 1.0, -1.0])
Y = ARM_M / math.sqrt(2.0) * np.array([1.0, -1.0, -1.0, 1.0])
SPIN = np.array([1.0, 1.0, -1.0, -1.0])
VEHICLE = Vehicle(mass_kg=MASS_KG, arm_length_m=ARM_M, torque_to_thrust_m=RATIO_M)
PARAMETERS: Mapping[str, float] = {
    "FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0, "MOT_THST_EXPO": EXPO, "MOT_SPIN_MIN": SPIN_MIN,
    "MOT_SPIN_MAX": SPIN_MAX, "MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0, "MOT_YAW_HEADROOM": 200.0,
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Flight:
    """What truly happened; one row per sample."""

    time_s: np.ndarray
    command: np.ndarray
    throttle: np.ndarray
    volt: np.ndarray
    density: np.ndarray
    thrust_n: np.ndarray
    euler: np.ndarray
    specific_force: np.ndarray

    @property
    def torque_n_m(self) -> np.ndarray:
        """L, M, N of the rotors at their places."""
        return np.column_stack([-self.thrust_n @ Y, self.thrust_n @ X, RATIO_M * (self.thrust_n @ SPIN)])


def commands(time_s: np.ndarray) -> np.ndarray:
    """Return roll, pitch and yaw commands: several tones each, none shared."""
    tones = ((0.7, 1.9, 3.1), (0.9, 2.3, 3.7), (0.5, 1.3, 2.9))
    return 0.04 * np.column_stack(
        [sum(np.sin(2.0 * np.pi * tone * time_s + tone) for tone in axis) for axis in tones]
    )


def specific_force(time_s: np.ndarray, thrust_n: np.ndarray, euler: np.ndarray) -> np.ndarray:
    """Integrate the velocity, which the air brakes; return what an accelerometer feels, in body axes."""
    velocity = np.zeros(3)
    felt = np.empty((time_s.size, 3))
    for row, (phi, theta) in enumerate(euler[:, :2]):
        c, s, ct, st = math.cos(phi), math.sin(phi), math.cos(theta), math.sin(theta)
        body_to_ned = np.array([[ct, s * st, c * st], [0.0, c, -s], [-st, s * ct, c * ct]])
        push = body_to_ned @ [0.0, 0.0, -thrust_n[row].sum()] - DRAG_N_S_M * velocity
        felt[row] = body_to_ned.T @ push / MASS_KG
        velocity = velocity + (push / MASS_KG + [0.0, 0.0, GRAVITY]) / RATE_HZ
    return felt


def flight() -> Flight:
    """Fly forwards nose down, swaying, while the vehicle heaves once every two seconds."""
    time_s = np.arange(0.0, FLIGHT_S, 1.0 / RATE_HZ)
    zero = np.zeros(time_s.size)
    euler = np.column_stack([0.2 + 0.08 * np.sin(1.1 * time_s), -0.25 + 0.06 * np.sin(0.8 * time_s), zero])
    upright = np.cos(euler[:, 0]) * np.cos(euler[:, 1])
    total_n = MASS_KG * (GRAVITY + 0.9 * np.sin(np.pi * time_s)) / upright
    command = commands(time_s)
    # Each motor's part of roll, pitch and yaw is a half; what battery and air take, the autopilot gives back.
    signs = 0.5 * np.column_stack([-np.sign(Y), np.sign(X), SPIN])
    throttle = total_n / (4.0 * FULL_N)
    return Flight(
        time_s=time_s,
        command=command,
        throttle=throttle,
        volt=16.4 - 2.6 * time_s / FLIGHT_S + 0.2 * np.sin(0.4 * time_s),
        density=0.86 - 0.03 * time_s / FLIGHT_S,
        thrust_n=FULL_N * (throttle[:, None] + command @ signs.T),
        euler=euler,
        specific_force=specific_force(time_s, FULL_N * (throttle[:, None] + command @ signs.T), euler),
    )


TRUE = flight()


def signals(
    named: Mapping[str, np.ndarray], *, every: int = 1, source: str, late: int = 0
) -> dict[str, tuple[Signal, ...]]:
    """Return signals of one message, written every so many samples and that many rows late."""
    row = np.arange(0, TRUE.time_s.size, every)
    rows = Rows(30.0 + TRUE.time_s[row], 100 * (row + late) + len(source))
    return {
        name: (
            Signal(
                name=name, rows=rows, values=values.reshape(len(values), -1)[row], source=f"{source}.{name}"
            ),
        )
        for name, values in named.items()
    }


def log(
    autopilot: str, parameters: Mapping[str, float], *parts: Mapping[str, tuple[Signal, ...]]
) -> FlightLog:
    """Return the log of these messages and of the sensors."""
    imu = signals({"specific_force": TRUE.specific_force}, source="IMU")
    attitude = signals({"attitude": TRUE.euler}, source="ATT", every=8)
    battery = signals({"battery_voltage": TRUE.volt}, source="BAT", every=20)
    found: dict[str, tuple[Signal, ...]] = {}
    for part in (imu, attitude, battery, *parts):
        found |= part
    return FlightLog(
        path="made",
        format="dataflash",
        autopilot=autopilot,
        n_bytes=100 * TRUE.time_s.size,
        vehicle_type="multirotor",
        signals=found,
        parameters=dict(parameters),
    )


def ardupilot(*, late: int = 0, rotor_speed: bool = False, density: bool = True) -> FlightLog:
    """Return what ArduPilot logs: commands, outputs, and what it knows of battery and, from 4.0 on, air."""
    ratio = TRUE.volt / 16.8
    effective = (-(1.0 - EXPO) + np.sqrt((1.0 - EXPO) ** 2 + 4.0 * EXPO * available())) / (2.0 * EXPO)
    actuator = effective / ratio[:, None]
    pulse = np.floor(1000.0 + 1000.0 * (SPIN_MIN + (SPIN_MAX - SPIN_MIN) * actuator))
    speed = np.sqrt(TRUE.thrust_n / 1.1e-5) * (1.0 + 0.01 * np.random.default_rng(5).standard_normal((1, 4)))
    speed = speed + 8.0 * np.random.default_rng(6).standard_normal(speed.shape)
    parts = [
        signals({"torque_command": TRUE.command, "throttle": TRUE.throttle}, source="RATE"),
        signals({"body_rate": np.gradient(TRUE.euler, TRUE.time_s, axis=0)}, source="GYR"),
        signals({"output_pwm": pulse}, source="RCOU", every=20),
        signals(
            {
                "battery_ratio": ratio,
                "lift_max": (1.0 - EXPO) * ratio + EXPO * ratio**2,
                "throttle_average_max": np.full(ratio.shape, 0.6),
            },
            source="MOTB",
            every=20,
            late=late,
        ),
    ]
    if density:
        parts.append(signals({"air_density_ratio": TRUE.density}, source="BARO", every=20))
    if rotor_speed:
        parts.append(signals({"rotor_speed": speed}, source="ESC", every=4))
    return log("ardupilot", PARAMETERS, *parts)


def available() -> np.ndarray:
    """Return thrust over that at full command, full battery and sea level, per motor."""
    return TRUE.thrust_n / FULL_N / TRUE.density[:, None]


def px4() -> FlightLog:
    """Return what PX4 logs where nothing makes up for the battery: the thrust that was meant for a motor."""
    meant = TRUE.thrust_n / FULL_N * (15.2 / TRUE.volt[:, None]) ** 2
    parameters = {"CA_ROTOR_COUNT": 4.0}
    for number in range(4):
        parameters |= {
            f"CA_ROTOR{number}_PX": float(np.sign(X[number])),
            f"CA_ROTOR{number}_PY": float(np.sign(Y[number])),
            f"CA_ROTOR{number}_KM": 0.05 * float(SPIN[number]),
        }
    return log(
        "px4",
        parameters,
        signals({"motor_thrust": meant}, source="actuator_motors"),
        signals(
            {"body_rate": np.gradient(TRUE.euler, TRUE.time_s, axis=0)}, source="vehicle_angular_velocity"
        ),
        signals({"throttle": meant.mean(axis=1)}, source="vehicle_thrust_setpoint"),
    )


def calibrated(flown: FlightLog, vehicle: Vehicle = VEHICLE) -> Prepared:
    """Return the log with its torque."""
    return prepare(flown, vehicle)


def error_of(found: Prepared) -> np.ndarray:
    """Return the largest error of L, M, N over their largest values, early and late in the flight (2, 3)."""
    assert found.torque is not None
    assert found.torque.series.name == "torque_n_m"
    np.testing.assert_allclose(found.torque.series.time_s, 30.0 + TRUE.time_s)
    size = np.abs(TRUE.torque_n_m).max(axis=0)
    wrong = np.abs(found.torque.series.values - TRUE.torque_n_m) / size
    return np.array([wrong[400:2000].max(axis=0), wrong[-2000:-400].max(axis=0)])


def test_weight_and_arm_give_the_thrust_of_a_rotor_in_air_of_sea_level() -> None:
    """From the accelerometer of a tilted vehicle that the wind brakes: not what thin air leaves."""
    model = calibrated(ardupilot()).log.torque
    assert model is not None
    assert model.calibration.max_thrust_n == pytest.approx(FULL_N, rel=2e-3)


def test_torque_of_a_compensating_autopilot_is_that_of_the_rotors_at_their_places() -> None:
    """Early with a full battery and late with an empty one, to half a per cent of the largest torque."""
    assert error_of(calibrated(ardupilot())).max() < 5e-3


def test_torque_follows_the_battery_where_nothing_makes_up_for_it() -> None:
    """The voltage falls by a sixth, the thrust per command by a third."""
    assert error_of(calibrated(px4())).max() < 1.5e-2


def test_the_thrust_beside_the_torque_is_that_of_the_rotors() -> None:
    """In newtons, one column per motor."""
    torque = calibrated(ardupilot()).torque
    assert torque is not None
    assert torque.rotor_thrust is not None
    np.testing.assert_allclose(torque.rotor_thrust[400:-400], TRUE.thrust_n[400:-400], rtol=5e-3)


def test_torque_that_is_calibrated_about_two_axes_only_stays_a_command() -> None:
    """Newton metres about roll and pitch beside a command about yaw would be no torque at all."""
    found = calibrated(ardupilot(), Vehicle(mass_kg=MASS_KG, arm_length_m=ARM_M))
    assert found.torque is not None
    assert found.torque.series.name == "torque_command"


def test_segments_hold_the_thrust_of_each_rotor_in_its_own_column() -> None:
    """Resampled like the torque: here every sample is a grid point."""
    (segment,) = cut(calibrated(ardupilot()), AlignSettings()).segments
    assert segment.rotor_thrust is not None
    row = np.rint((segment.time_s - 30.0) * RATE_HZ).astype(int)
    np.testing.assert_allclose(segment.rotor_thrust, TRUE.thrust_n[row], rtol=1e-2)


@pytest.mark.parametrize("flown", [ardupilot(rotor_speed=True, density=False), px4()])
def test_the_thrust_beside_every_torque_makes_it(flown: FlightLog) -> None:
    """Mixed, from outputs, from rotor speeds and as commanded; on the scale of the command and in N m."""
    sources = reconstruct(clean(flown), named(flown.autopilot), VEHICLE).sources
    assert {one.series.name for one in sources} == {"torque_command", "torque_n_m"}
    for one in sources:
        assert one.rotor_thrust is not None
        assert one.torque_per_thrust is not None
        made = one.rotor_thrust @ one.torque_per_thrust.T
        np.testing.assert_allclose(made, one.series.values, atol=1e-9, err_msg=one.series.source)


def test_the_thrust_beside_a_command_is_free_of_what_battery_and_air_made_of_it() -> None:
    """Commands mean the same at every voltage, so the thrust on their scale does."""
    torque = prepare(ardupilot()).torque
    assert torque is not None
    assert torque.rotor_thrust is not None
    np.testing.assert_allclose(torque.rotor_thrust, TRUE.thrust_n / FULL_N, rtol=2e-3)


def test_rotor_speeds_come_on_the_scale_of_the_command() -> None:
    """Thin air, of which this log tells nothing, is made up for; commands mean the same all the same."""
    found = prepare(ardupilot(rotor_speed=True, density=False))
    measured = next(one for one in found.candidates["torque_command"] if one.source.startswith("ESC"))
    rows = slice(100, -100)
    commanded = TRUE.command[::4][rows]
    slope = [
        float(commanded[:, axis] @ measured.values[rows, axis] / (commanded[:, axis] @ commanded[:, axis]))
        for axis in range(3)
    ]
    np.testing.assert_allclose(slope, 1.0, atol=0.03)


def test_a_message_written_late_counts_at_its_time() -> None:
    """MOTB comes 0.3 s late into the file, but says when it was true."""
    on_time, late = (calibrated(ardupilot(late=late)) for late in (0, 60))
    assert on_time.torque is not None
    assert late.torque is not None
    np.testing.assert_array_equal(late.torque.series.values, on_time.torque.series.values)


def test_the_uncertainty_is_that_of_scale_ruler_accelerometer_and_propeller() -> None:
    """One per cent each of mass, accelerometer and arm; for yaw five of the ratio, not the arm."""
    model = calibrated(ardupilot()).log.torque
    assert model is not None
    expected = (math.sqrt(3.0) * 0.01, math.sqrt(3.0) * 0.01, math.hypot(0.01, 0.01, 0.05))
    np.testing.assert_allclose(model.calibration.relative_sigma, expected, rtol=1e-2)


def test_scatter_that_the_battery_explains_is_no_uncertainty() -> None:
    """The thrust falls by a third; with the voltage squared taken out, every block balances alike."""
    model = calibrated(px4()).log.torque
    assert model is not None
    assert model.calibration.relative_sigma[0] == pytest.approx(math.sqrt(3.0) * 0.01, rel=1e-2)


def test_the_uncertainty_of_a_thrust_stand_is_its_own() -> None:
    """Five per cent of the stand, one of the arm, five of the ratio."""
    given = Vehicle(max_thrust_n=FULL_N, arm_length_m=ARM_M, torque_to_thrust_m=RATIO_M)
    model = calibrated(ardupilot(), given).log.torque
    assert model is not None
    expected = (math.hypot(0.05, 0.01), math.hypot(0.05, 0.01), math.hypot(0.05, 0.05))
    np.testing.assert_allclose(model.calibration.relative_sigma, expected)


def test_what_scatters_from_block_to_block_is_in_the_uncertainty_over_the_root_of_their_number() -> None:
    """An accelerometer that is wrong by a tenth, otherwise in every block of two seconds."""
    flown = ardupilot()
    whole = flown.candidates("specific_force")[0]
    block = np.arange(TRUE.time_s.size) // 400
    wrong = 1.0 + 0.1 * np.random.default_rng(2).standard_normal(block[-1] + 1)
    felt = Signal(
        name="specific_force", rows=whole.rows, values=whole.values * wrong[block][:, None], source="IMU"
    )
    model = calibrated(replace(flown, signals={**flown.signals, "specific_force": (felt,)}))
    calibration = model.log.torque
    assert calibration is not None
    # Take-off and landing, a second each, cut into the first and the last block.
    inside = wrong[1:-1]
    scatter = float(np.std(inside) / np.mean(inside)) / math.sqrt(len(inside))
    expected = math.hypot(scatter, 0.01, 0.01, 0.01)
    assert calibration.calibration.relative_sigma[0] == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(("density", "law"), [(True, DensityLaw.LOGGED), (False, DensityLaw.FITTED)])
def test_a_gain_is_fitted_only_where_no_logged_density_explains_the_outputs(
    density: bool, law: DensityLaw
) -> None:
    """A fit explains anything a little better: what the log says comes first."""
    model = prepare(ardupilot(density=density)).log.torque
    assert model is not None
    assert model.check is not None
    assert model.check.law is law


def test_what_is_refused_as_a_calibration_is_told_apart_from_other_remarks() -> None:
    """Arms of 1 m and the default thrust are a finding, whatever the words."""
    model = prepare(px4()).log.torque
    assert model is not None
    (refused,) = model.refused
    assert refused in model.remarks


def test_a_thrust_curve_is_asked_for_the_motor_command() -> None:
    """From 0 at MOT_SPIN_MIN to 1 at MOT_SPIN_MAX, whatever thrust the autopilot believes in."""
    curve = np.array([[0.0, 0.0], [0.4, 2.0], [1.0, 11.0]])
    given = Vehicle(thrust_curve=curve, arm_length_m=ARM_M, torque_to_thrust_m=RATIO_M)
    torque = calibrated(ardupilot(), given).torque
    assert torque is not None
    assert torque.rotor_thrust is not None
    effective = (-(1.0 - EXPO) + np.sqrt((1.0 - EXPO) ** 2 + 4.0 * EXPO * available())) / (2.0 * EXPO)
    command = effective / (TRUE.volt / 16.8)[:, None]
    rows = slice(400, -400)
    np.testing.assert_allclose(
        torque.rotor_thrust[rows], np.interp(command, curve[:, 0], curve[:, 1])[rows], rtol=5e-3
    )


def test_torque_in_newton_metres_that_is_slower_than_the_command_is_not_used() -> None:
    """Without the loop's throttle, outputs at 10 Hz alone tell of thrust: units are not worth samples."""
    flown = ardupilot()
    without = replace(
        flown, signals={name: each for name, each in flown.signals.items() if name != "throttle"}
    )
    sources = reconstruct(clean(without), named("ardupilot"), VEHICLE).sources
    assert {one.series.name for one in sources} == {"torque_command"}


def test_a_density_that_the_log_holds_is_preferred_to_a_fitted_gain_that_fits_a_little_better() -> None:
    """By less than the microsecond that chance makes; by more it is believed."""

    def check(law: DensityLaw, typical_us: float) -> MixerCheck:
        return MixerCheck(
            n_samples=100, mean_us=0.0, std_us=1.0, largest_us=2.0, typical_us=typical_us, density="", law=law
        )

    logged = check(DensityLaw.LOGGED, 1.2)
    assert _misfit(logged) < _misfit(check(DensityLaw.FITTED, 0.4))
    assert _misfit(logged) > _misfit(check(DensityLaw.FITTED, 0.1))
