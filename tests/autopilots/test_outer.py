"""Input shapers, attitude, velocity and position controllers: laws of firmware, on parameters and logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.autopilots import named
from quadid_logs.autopilots.ardupilot.outer import acceleration_limit, shape_angle, square_root
from quadid_logs.control.outer_loops import attitude_replays, cascade_replay
from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.data.outer_loops import Shown
from quadid_logs.load import read_log
from tests.marks import thorough

HORIZONTAL = {"P": 2.0, "I": 1.0, "D": 0.25, "FLTE": 5.0, "FLTD": 4.0}


@pytest.mark.parametrize(
    ("position", "velocity"), [("PSC_POSXY_P", "PSC_VELXY"), ("PSC_NE_POS_P", "PSC_NE_VEL")]
)
def test_the_velocity_gains_are_read_by_the_names_of_each_version(position: str, velocity: str) -> None:
    """They were renamed in ArduCopter 4.7."""
    parameters = {position: 1.1, **{f"{velocity}_{name}": value for name, value in HORIZONTAL.items()}}
    found = named("ardupilot").outer_controllers(parameters)
    assert found is not None
    assert found.horizontal is not None
    assert found.horizontal.position_per_s == 1.1
    assert found.horizontal.proportional_per_s == 2.0
    assert (found.horizontal.error_hz, found.horizontal.derivative_hz) == (5.0, 4.0)


@pytest.mark.parametrize("parameters", [{"ATC_ACCEL_R_MAX": 110000.0}, {"ATC_ACC_R_MAX": 1100.0}])
def test_the_acceleration_limit_is_in_hundredths_of_a_degree_until_it_was_renamed(
    parameters: Mapping[str, float],
) -> None:
    assert acceleration_limit(parameters, 0) == pytest.approx(np.radians(1100.0))


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, 0.0])
def test_a_velocity_gain_that_is_none_leaves_no_controller(autopilot: str, value: float) -> None:
    parameters = {"PSC_POSXY_P": 1.0, **{f"PSC_VELXY_{name}": each for name, each in HORIZONTAL.items()}}
    parameters |= {"MPC_XY_P": 1.0, **{f"MPC_XY_VEL_{name}_ACC": 1.0 for name in "PID"}}
    parameters |= {"PSC_VELXY_P": value, "MPC_XY_VEL_P_ACC": value}
    found = named(autopilot).outer_controllers(parameters)
    assert found is not None
    assert found.horizontal is None


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_a_damaged_shaper_is_none_or_finite(value: float) -> None:
    found = named("ardupilot").outer_controllers({"ATC_INPUT_TC": value, "ATC_RATE_FF_ENAB": 1.0})
    assert found is not None
    assert all(0.0 < lag < np.inf for lag in found.attitude.lags_s)


def test_small_errors_are_taken_away_in_proportion_and_large_ones_at_the_limit() -> None:
    """Behind a / p^2 the rate falls so that the deceleration is the limit: w^2 = 2 a (e - a / (2 p^2))."""
    p, a = 4.0, 8.0
    error = np.array([0.1, -0.1, 2.0])
    wanted = np.array([0.4, -0.4, np.sqrt(2.0 * a * (2.0 - 0.25))])
    assert square_root(error, p, a, np.full(3, 1e-3)) == pytest.approx(wanted)


def test_no_more_than_the_error_is_taken_away_in_one_step() -> None:
    assert square_root(np.array([0.1]), 1000.0, 0.0, np.array([0.01])) == pytest.approx([10.0])


def test_the_shaped_angle_lags_a_small_step_by_the_time_constant() -> None:
    shaped = shape_angle(np.full(200, 0.01), 0.2, 0.0, 0.0)
    assert shaped[20] == pytest.approx(0.01 * (1.0 - np.exp(-1.0)), rel=0.05)


def test_the_shaped_angle_of_a_large_step_accelerates_and_brakes_at_the_limit() -> None:
    """Angle d in the time 2 sqrt(d / a) at least."""
    limit, step = 5.0, 1.0
    shaped = shape_angle(np.full(400, step), 0.05, limit, 0.0)
    acceleration = np.diff(shaped, 2) * 100.0**2
    assert np.abs(acceleration).max() <= 1.05 * limit
    arrived_s = 0.01 * int(np.argmax(shaped > 0.95 * step))
    assert 0.8 < arrived_s / (2.0 * np.sqrt(step / limit)) < 1.1


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("firmware/ac47_quadx_multisine.BIN", 1e-3),
        ("real/px4-1.16-quad-v6c-indoor-85s.ulg", 1e-5),
        thorough("firmware/ac47_quadx_doublets.BIN", 5e-3),
        thorough("firmware/ac47_rate_thread.BIN", 0.04),
        thorough("real/px4-1.14-octocoax-cubeorange-75s.ulg", 1e-5),
        thorough("real/px4-1.15-quad-hover-80s.ulg", 1e-5),
    ],
)
def test_the_attitude_law_makes_the_rates_that_the_firmware_logged(
    corpus: Path, name: str, most: float
) -> None:
    log = read_log(corpus / name)
    autopilot = named(log.autopilot)
    rows, controllers = (
        autopilot.attitude_rows(log, log.parameters, []),
        autopilot.outer_controllers(log.parameters),
    )
    assert rows is not None
    assert controllers is not None
    replays = attitude_replays(rows, controllers.attitude)
    assert {replay.shown for replay in replays.values()} == {Shown.AGREES}
    assert max(replay.relative_rms for replay in replays.values()) < most


def test_the_attitude_law_of_a_firmware_with_a_reference_model_is_that_of_the_model(corpus: Path) -> None:
    """PX4 1.18 holds the attitude against a model that follows the set-point (MC_REF_W_N): else 20 % off."""
    log = read_log(corpus / "firmware" / "px4_sih_hex_esc.ulg")
    autopilot = named("px4")
    rows, controllers = (
        autopilot.attitude_rows(log, log.parameters, []),
        autopilot.outer_controllers(log.parameters),
    )
    assert rows is not None
    assert controllers is not None
    assert rows.lags_s == (0.02, 0.02)
    replays = attitude_replays(rows, controllers.attitude)
    # Of yaw it leaves a sixth: that is no other gain.
    shown = {"roll": Shown.AGREES, "pitch": Shown.AGREES, "yaw": Shown.NOT_SHOWN}
    assert {axis: replay.shown for axis, replay in replays.items()} == shown
    assert all(replays[axis].relative_rms < 0.05 for axis in ("roll", "pitch"))


@pytest.mark.parametrize(
    "name",
    [
        "firmware/ac47_two_flights.BIN",
        "real/ac413-quadx-goodprop-hover1.bin",
        thorough("real/ac364-quadx-RATE1Hz-700s.bin"),
        thorough("real/ac41-quadplus-mission-113s.bin"),
    ],
)
def test_the_shaped_angle_is_nearer_to_the_logged_target_than_the_wanted_one(corpus: Path, name: str) -> None:
    log = read_log(corpus / name)
    rows = named("ardupilot").shaper_rows(log, log.parameters, [])
    assert rows is not None
    shaped, wanted = (np.std(each - rows.logged) for each in (rows.shaped, rows.wanted))
    # Rows of 10 Hz leave out some of what a shaper of 0.15 s lets through.
    assert shaped < 0.7 * wanted


@pytest.mark.parametrize(
    "name",
    [
        "real/ac413-quadx-goodprop-hover1.bin",
        "damaged/px4-1.17-x500-v6xrt-outdoor-89s-corrupt.ulg",
        thorough("real/ac413-quadx-25mmcut-hover2.bin"),
        thorough("firmware/ac47_quadx_multisine.BIN"),
    ],
)
def test_flown_position_and_velocity_gains_are_those_of_the_parameters(corpus: Path, name: str) -> None:
    log = read_log(corpus / name)
    controllers = named(log.autopilot).outer_controllers(log.parameters)
    assert controllers is not None
    assert controllers.horizontal is not None
    assert {"north", "east"} <= {rows.direction for rows in log.position_control}
    for rows in log.position_control:
        law = controllers.vertical if rows.direction == "down" else controllers.horizontal
        assert law is not None
        found = cascade_replay(rows, law, [])
        assert found is not None
        assert found.position is not None
        assert found.position.value == pytest.approx(1.0, abs=3e-3)
        assert found.shown is Shown.AGREES


def test_centimetres_of_old_firmware_are_metres(corpus: Path) -> None:
    """ArduCopter 3.6 stated its unit in the log; the vehicle stayed within a kilometre."""
    log = read_log(corpus / "real" / "ac364-quadx-RATE1Hz-700s.bin")
    north = log.position_control[0].values
    assert float(np.std(north["velocity"])) < 10.0
    assert float(np.ptp(north["position"])) < 1000.0


def of_angles(wanted_rad: tuple[float, float, float], n_rows: int = 60) -> FlightLog:
    """Return a log of a level vehicle whose attitude is wanted to be another one."""
    rows = Rows(0.004 * np.arange(n_rows), np.arange(n_rows))
    signals = {
        name: (Signal(name=name, rows=rows, values=np.tile(values, (n_rows, 1)), source=name),)
        for name, values in (
            ("attitude", (0.0, 0.0, 0.0)),
            ("attitude_setpoint", wanted_rad),
            ("body_rate_setpoint", (0.1, 0.1, 0.1)),
        )
    }
    return FlightLog(path="", format="ulog", autopilot="px4", n_bytes=0, signals=signals)


@pytest.mark.parametrize("weight", [1.0, 0.4])
def test_the_weight_of_the_heading_leaves_the_yaw_gain_as_it_is(weight: float) -> None:
    """AttitudeControl divides the gain by the weight."""
    parameters = {"MC_ROLL_P": 6.5, "MC_PITCH_P": 6.0, "MC_YAW_P": 2.8, "MC_YAW_WEIGHT": weight}
    rows = named("px4").attitude_rows(of_angles((0.002, -0.003, 0.004)), parameters, [])
    assert rows is not None
    assert rows.from_error[0] == pytest.approx([6.5 * 0.002, -6.0 * 0.003, 2.8 * 0.004], rel=0.02)


@pytest.mark.parametrize("worst", [np.nan, np.inf, 1e300])
@pytest.mark.parametrize("name", ["attitude", "attitude_setpoint", "body_rate_setpoint"])
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_damaged_angles_and_rates_are_left_out(autopilot: str, name: str, worst: float) -> None:
    parameters = {f"MC_{axis}_P": 2.0 for axis in ("ROLL", "PITCH", "YAW")}
    parameters |= {f"ATC_ANG_{axis}_P": 2.0 for axis in ("RLL", "PIT", "YAW")} | {"SCHED_LOOP_RATE": 250.0}
    log = of_angles((0.01, 0.02, 0.03), 3000)
    (good,) = log.signals[name]
    values = good.values.copy()
    values[::1500] = worst
    bad = replace(log, signals={**log.signals, name: (replace(good, values=values),)})
    rows = named(autopilot).attitude_rows(bad, parameters, [])
    assert rows is not None
    for each in (rows.from_error, rows.forward, rows.logged):
        assert np.isfinite(each).all()
