"""Thrust from what PX4 logs, each formula against numbers worked out here; sources as in `px4/torque.py`."""

from __future__ import annotations

import math

import numpy as np
import pytest

from quadid_logs.actuation import Torques, reconstruct
from quadid_logs.align import clean
from quadid_logs.align.series import TorqueSeries
from quadid_logs.autopilots import named
from quadid_logs.autopilots.px4.torque import output_of_thrust
from quadid_logs.data.log import Signal
from tests.align.flights import flight_log, motion, signal

STAMPS = np.arange(10.0, 40.0, 0.01)
#: Quad X in PX4's order: front right and rear left turn counter-clockwise.
X, Y, SPIN = (
    np.array([1.0, -1.0, 1.0, -1.0]),
    np.array([1.0, -1.0, -1.0, 1.0]),
    np.array([1.0, 1.0, -1.0, -1.0]),
)
COMMAND = 0.1 * motion(STAMPS)
THROTTLE = np.full((STAMPS.size, 1), 0.45)
#: Motor command per roll, pitch and yaw as PX4 scales them for a quad X.
MIX = np.array([-Y / math.sqrt(2.0), X / math.sqrt(2.0), SPIN])
MIXED = THROTTLE + COMMAND @ MIX


def parameters(**others: float) -> dict[str, float]:
    found = {"CA_ROTOR_COUNT": 4.0}
    for number in range(4):
        found |= {
            f"CA_ROTOR{number}_PX": float(X[number]),
            f"CA_ROTOR{number}_PY": float(Y[number]),
            f"CA_ROTOR{number}_KM": 0.05 * float(SPIN[number]),
        }
    return found | others


def rebuilt(*signals: Signal, **known: float) -> Torques:
    throttle = (
        () if any(each.name == "throttle" for each in signals) else (signal("throttle", STAMPS, THROTTLE),)
    )
    log = flight_log(*signals, *throttle, autopilot="px4", format="ulog", parameters=parameters(**known))
    return reconstruct(clean(log), named("px4"))


def achieved(found: Torques) -> TorqueSeries:
    """Return the command that was rebuilt from what the motors did."""
    return next(one for one in found.sources if one.series.name == "torque_command" and one.series.achieved)


def marks(one: TorqueSeries) -> np.ndarray:
    assert one.saturated is not None
    return one.saturated.values > 0.5


@pytest.mark.parametrize("factor", [0.0, 0.3, 1.0])
def test_the_output_gives_the_thrust_of_the_model(factor: float) -> None:
    """THR_MDL_FAC: thrust = f x^2 + (1 - f) x."""
    thrust = np.linspace(0.0, 1.0, 21)
    output = output_of_thrust(thrust, factor)
    np.testing.assert_allclose(factor * output**2 + (1.0 - factor) * output, thrust, atol=1e-12)
    assert (np.diff(output, prepend=-1e-9) > 0.0).all()


def test_outputs_give_the_command_back_through_the_thrust_model() -> None:
    """Pulse widths of 1100 to 1900 us, f = 0.4, motors on outputs 2, 4, 1 and 3."""
    factor, channels = 0.4, [2, 4, 1, 3]
    output = (-(1.0 - factor) + np.sqrt((1.0 - factor) ** 2 + 4.0 * factor * MIXED)) / (2.0 * factor)
    pulse = np.zeros((STAMPS.size, 4))
    pulse[:, [channel - 1 for channel in channels]] = 1100.0 + 800.0 * output
    known = {f"PWM_MAIN_FUNC{channel}": 101.0 + motor for motor, channel in enumerate(channels)}
    limits = {
        f"PWM_MAIN_{end}{channel}": value
        for channel in channels
        for end, value in (("MIN", 1100.0), ("MAX", 1900.0))
    }
    # The limits of the port and those of old are others: the channel's own win.
    common = {"PWM_MAIN_MIN": 1000.0, "PWM_MAIN_MAX": 2000.0, "PWM_MIN": 900.0, "PWM_MAX": 2100.0}
    found = achieved(
        rebuilt(signal("output_pwm", STAMPS, pulse), THR_MDL_FAC=factor, **known, **limits, **common)
    )
    np.testing.assert_allclose(found.series.values, COMMAND, atol=1e-9)


def test_the_limits_of_the_port_serve_where_a_channel_has_none() -> None:
    """PWM_MAIN_MIN and MAX ahead of PWM_MIN and MAX."""
    pulse = 1050.0 + 900.0 * MIXED
    known = {f"PWM_MAIN_FUNC{motor + 1}": 101.0 + motor for motor in range(4)}
    common = {"PWM_MAIN_MIN": 1050.0, "PWM_MAIN_MAX": 1950.0, "PWM_MIN": 900.0, "PWM_MAX": 2100.0}
    found = achieved(rebuilt(signal("output_pwm", STAMPS, pulse), **known, **common))
    np.testing.assert_allclose(found.series.values, COMMAND, atol=1e-9)


def test_the_axes_that_got_less_than_the_set_point_of_the_sample_are_marked() -> None:
    """Between 20 and 25 s the motors give half of the yaw that was set, and all of roll and pitch."""
    given = COMMAND.copy()
    given[(STAMPS > 20.0) & (STAMPS < 25.0), 2] *= 0.5
    thrust = THROTTLE + given @ MIX
    found = achieved(
        rebuilt(signal("motor_thrust", STAMPS, thrust), signal("torque_command", STAMPS, COMMAND))
    )
    np.testing.assert_allclose(found.series.values, given, atol=1e-9)
    missed = np.abs(given - COMMAND) > 2e-3
    np.testing.assert_array_equal(marks(found)[missed.any(axis=1)], missed[missed.any(axis=1)])
    assert not marks(found)[:, :2].any()


def test_without_a_set_point_a_motor_at_its_stop_marks_all_axes() -> None:
    """What was wanted is not known."""
    thrust = MIXED.copy()
    thrust[100:102, 2], thrust[200:202, 0] = 0.0, 1.0
    found = achieved(rebuilt(signal("motor_thrust", STAMPS, thrust)))
    np.testing.assert_array_equal(np.flatnonzero(marks(found).all(axis=1)), [100, 101, 200, 201])
    np.testing.assert_array_equal(np.flatnonzero(marks(found).any(axis=1)), [100, 101, 200, 201])


def test_torque_that_the_allocation_could_not_give_is_marked_on_its_axis() -> None:
    """control_allocator_status, in a log without what the motors gave."""
    missing = np.zeros((STAMPS.size, 3))
    missing[(STAMPS > 20.0) & (STAMPS < 25.0), 1] = -0.02
    found = rebuilt(signal("torque_command", STAMPS, COMMAND), signal("unallocated_torque", STAMPS, missing))
    command = next(one for one in found.sources if one.series.name == "torque_command")
    inside = (STAMPS > 20.02) & (STAMPS < 24.98)
    outside = (STAMPS < 19.98) | (STAMPS > 25.02)
    assert marks(command)[inside, 1].all()
    assert not marks(command)[outside].any()
    assert not marks(command)[:, [0, 2]].any()


def test_thrust_beside_the_command_is_what_each_motor_gives_for_it() -> None:
    """No command is near a limit."""
    found = rebuilt(signal("torque_command", STAMPS, COMMAND))
    command = next(one for one in found.sources if one.series.name == "torque_command")
    assert command.rotor_thrust is not None
    np.testing.assert_allclose(command.rotor_thrust, MIXED, atol=1e-9)


def test_motors_beyond_those_of_the_frame_are_left_out() -> None:
    """actuator_motors may show more; fewer than the frame has tell nothing."""
    more = np.column_stack([MIXED, np.full((STAMPS.size, 2), 0.9)])
    found = achieved(rebuilt(signal("motor_thrust", STAMPS, more)))
    np.testing.assert_allclose(found.series.values, COMMAND, atol=1e-9)
    fewer = rebuilt(signal("motor_thrust", STAMPS, MIXED[:, :3]), signal("torque_command", STAMPS, COMMAND))
    assert not any(one.series.achieved for one in fewer.sources)
