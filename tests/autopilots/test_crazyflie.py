"""Crazyflie: which controller flew, units, signs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.autopilots.crazyflie.signals import SOURCES
from quadid_logs.autopilots.sources import Source
from quadid_logs.data.log import FlightLog
from quadid_logs.load import read_log
from tests.containers import usd_maker as maker

DEGREE = math.pi / 180.0
FLU = np.diag([1.0, -1.0, -1.0])
YAW_LEFT = np.diag([1.0, 1.0, -1.0])
COUNT = np.eye(3) / 65535.0
I1 = np.eye(1)
#: A motor's duty is its share of the command: roll and pitch by halves (mixer of the firmware).
MOTORS = [[-0.5, 0.5, 0.25], [-0.5, -0.5, -0.25], [0.5, -0.5, 0.25], [0.5, 0.5, -0.25]]
#: Row k is what a one in variable k makes, from the comments on the firmware's log groups.
EXPECTED: dict[tuple[str, ...], np.ndarray] = {
    ("ctrlLee.omegax", "ctrlLee.omegay", "ctrlLee.omegaz"): FLU,
    ("controller.r_roll", "controller.r_pitch", "controller.r_yaw"): YAW_LEFT,
    ("ctrlMel.r_roll", "ctrlMel.r_pitch", "ctrlMel.r_yaw"): YAW_LEFT,
    ("gyro.x", "gyro.y", "gyro.z"): DEGREE * FLU,
    ("stateEstimateZ.rateRoll", "stateEstimateZ.ratePitch", "stateEstimateZ.rateYaw"): 1e-3 * YAW_LEFT,
    ("ctrlLee.omegarx", "ctrlLee.omegary", "ctrlLee.omegarz"): FLU,
    ("controller.rollRate", "controller.pitchRate", "controller.yawRate"): DEGREE * YAW_LEFT,
    ("ctrlLee.rpyx", "ctrlLee.rpyy", "ctrlLee.rpyz"): FLU,
    ("stabilizer.roll", "stabilizer.pitch", "stabilizer.yaw"): DEGREE * YAW_LEFT,
    ("stateEstimate.roll", "stateEstimate.pitch", "stateEstimate.yaw"): DEGREE * YAW_LEFT,
    ("stateEstimate.vx", "stateEstimate.vy", "stateEstimate.vz"): FLU,
    ("stateEstimateZ.vx", "stateEstimateZ.vy", "stateEstimateZ.vz"): 1e-3 * FLU,
    ("ctrlLee.torquex", "ctrlLee.torquey", "ctrlLee.torquez"): FLU,
    ("controller.cmd_roll", "controller.cmd_pitch", "controller.cmd_yaw"): COUNT,
    ("ctrlMel.cmd_roll", "ctrlMel.cmd_pitch", "ctrlMel.cmd_yaw"): COUNT,
    ("ctrlINDI.cmd_roll", "ctrlINDI.cmd_pitch", "ctrlINDI.cmd_yaw"): COUNT,
    ("motor.m1", "motor.m2", "motor.m3", "motor.m4"): np.array(MOTORS) / 65535.0,
    ("ctrlLee.thrustSi",): I1,
    ("ctrlLee.thrustSI",): I1,
    ("controller.cmd_thrust",): I1 / 65535.0,
    ("ctrlMel.cmd_thrust",): I1 / 65535.0,
    ("ctrlINDI.cmd_thrust",): I1 / 65535.0,
    ("stabilizer.thrust",): I1 / 65535.0,
    ("rpm.m1", "rpm.m2", "rpm.m3", "rpm.m4"): math.pi / 30.0 * np.eye(4),
    ("motor.m1_rpm", "motor.m2_rpm", "motor.m3_rpm", "motor.m4_rpm"): math.pi / 30.0 * np.eye(4),
    ("acc.x", "acc.y", "acc.z"): 9.80665 * FLU,
    ("pm.vbat",): I1,
    ("pm.vbatMV",): 1e-3 * I1,
    ("sys.isFlying",): np.array([[0.0]]),
}
#: Bit 1 is armed, bit 4 is flying.
INFO = {"armed": [0.0, 1.0, 0.0, 1.0], "landed": [1.0, 1.0, 0.0, 0.0]}


def written(folder: Path, fields: dict[str, list[float]], letter: str = "f") -> FlightLog:
    """Return a log of these variables, a row every 4 ms."""
    types: dict[int, maker.Type] = {0xFFFF: ("fixedFrequency", [(name, letter) for name in fields])}
    rows = [
        maker.Event(0xFFFF, 4000 * k, values) for k, values in enumerate(zip(*fields.values(), strict=True))
    ]
    (folder / "log00").write_bytes(maker.log(types, rows))
    return read_log(folder / "log00")


@pytest.mark.parametrize("source", SOURCES, ids=lambda one: f"{one.signal}-{one.fields[0]}")
def test_a_variable_of_one_is_one_of_its_unit(source: Source, tmp_path: Path) -> None:  # type: ignore[type-arg]
    """Its value in the canonical unit, in its column, with its sign; a row without expectation fails."""
    if source.fields == ("supervisor.info",):
        log = written(tmp_path, {"supervisor.info": [0, 2, 16, 18]}, "H")
        assert log.signals[source.signal][0].values[:, 0].tolist() == INFO[source.signal]
        return
    if source.fields in (("stateEstimate.qw", "stateEstimate.qx", "stateEstimate.qy", "stateEstimate.qz"),
                         ("stateEstimateZ.quat",)):  # fmt: skip
        return  # the tests of attitudes below
    if source.signal == "reference_rate":
        return  # the test of trajectories below
    n = len(source.fields)
    rows = np.vstack([np.zeros(n), np.eye(n)])
    log = written(tmp_path, dict(zip(source.fields, rows.T.tolist(), strict=True)))
    (found,) = log.signals[source.signal]
    np.testing.assert_allclose(found.values[1:], EXPECTED[source.fields], rtol=1e-12)


def turned(axis: int, angle: float = 0.1) -> list[float]:
    """Return w, x, y, z of a turn about an axis of x forward, y left, z up."""
    return [math.cos(angle / 2.0), *(math.sin(angle / 2.0) * np.eye(3)[axis])]


def packed(quaternion: list[float]) -> int:
    """Compress w, x, y, z as the firmware's description of its 32 bits says: x, y, z, w; largest first."""
    q = [*quaternion[1:], quaternion[0]]
    largest = max(range(4), key=lambda k: abs(q[k]))
    word = largest
    for k in range(4):
        if k != largest:
            value = -q[k] if q[largest] < 0.0 else q[k]
            word = word << 10 | (value < 0.0) << 9 | int(511 * abs(value) / math.sqrt(0.5) + 0.5)
    return word


@pytest.mark.parametrize("axis", range(3))
def test_a_quaternion_turns_right_side_down_nose_up_nose_right(axis: int, tmp_path: Path) -> None:
    """About x forward the right side goes down; about y left and z up the other way round."""
    names = [f"stateEstimate.q{each}" for each in "wxyz"]
    log = written(tmp_path, {name: [value] * 3 for name, value in zip(names, turned(axis), strict=True)})
    expected = 0.1 * np.array([1.0, -1.0, -1.0]) * np.eye(3)[axis]
    np.testing.assert_allclose(log.signals["attitude"][0].values, np.tile(expected, (3, 1)), atol=1e-7)


@pytest.mark.parametrize("angle", [0.1, -0.1, 1.9, 3.0])
@pytest.mark.parametrize("axis", [0, 2])
def test_a_compressed_quaternion_is_the_same_to_its_resolution(
    axis: int, angle: float, tmp_path: Path
) -> None:
    """Whichever component is largest, with both signs."""
    log = written(tmp_path, {"stateEstimateZ.quat": [packed(turned(axis, angle))] * 3}, "I")
    expected = angle * np.array([1.0, -1.0, -1.0]) * np.eye(3)[axis]
    found = log.signals["attitude"][0].values[0]
    # Nine bits of 0.71: half a step is 7e-4, and an angle is two of it and more where w is small.
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * expected), atol=0.02)


@pytest.mark.parametrize(("group", "unit"), [("ctrltarget", 1.0), ("ctrltargetZ", 1e-3)])
def test_a_trajectory_asks_for_the_rates_of_its_jerk_over_gravity(
    group: str, unit: float, tmp_path: Path
) -> None:
    """To the right (y falls) right side down, forward nose down; at 1 Hz the smoothing takes 2 %."""
    time_s = 0.004 * np.arange(1000)
    turn = 2.0 * math.pi
    right, forward = 0.5 * np.sin(turn * time_s), 0.3 * np.cos(turn * time_s)
    log = written(tmp_path, {f"{group}.vx": list(forward / unit), f"{group}.vy": list(-right / unit)})
    (found,) = log.signals["reference_rate"]
    expected = np.column_stack([-(turn**2) * right, turn**2 * forward, np.zeros(1000)]) / 9.80665
    np.testing.assert_allclose(found.values[50:-50], expected[50:-50], atol=0.03 * turn**2 * 0.5 / 9.80665)


def test_where_a_log_pauses_a_trajectory_asks_for_nothing(tmp_path: Path) -> None:
    """A leap of the velocity over a pause is no jerk."""
    velocity = [float(k > 100) for k in range(200)]
    types: dict[int, maker.Type] = {
        0xFFFF: ("fixedFrequency", [("ctrltarget.vx", "f"), ("ctrltarget.vy", "f")])
    }
    rows = [maker.Event(0xFFFF, 4000 * k + 500_000 * (k > 100), (v, v)) for k, v in enumerate(velocity)]
    (tmp_path / "log00").write_bytes(maker.log(types, rows))
    rate = read_log(tmp_path / "log00").signals["reference_rate"][0].values
    np.testing.assert_allclose(rate, 0.0, atol=1e-9)


GROUPS = {
    "Lee": ("ctrlLee.torquex", "ctrlLee.torquey", "ctrlLee.torquez"),
    "PID": ("controller.cmd_roll", "controller.cmd_pitch", "controller.cmd_yaw"),
    "Mellinger": ("ctrlMel.cmd_roll", "ctrlMel.cmd_pitch", "ctrlMel.cmd_yaw"),
    "INDI": ("ctrlINDI.cmd_roll", "ctrlINDI.cmd_pitch", "ctrlINDI.cmd_yaw"),
}


@pytest.mark.parametrize("flown", GROUPS)
def test_the_controller_that_flew_is_the_one_whose_commands_move(flown: str, tmp_path: Path) -> None:
    """All groups are logged; those of the others rest."""
    fields = {
        name: [k * 0.1 if group == flown else 0.0 for k in range(20)]
        for group, names in GROUPS.items()
        for name in names
    }
    log = written(tmp_path, fields)
    assert f"The {flown} controller flew" in log.remarks[0]
    (torque,) = log.signals["torque_command"]
    assert GROUPS[flown][0] in torque.source


@pytest.mark.corpus
def test_flown_signs_fit_each_other(corpus: Path) -> None:
    """The rates are the derivative of the angles, and torque turns the vehicle its own way."""
    log = read_log(corpus / "flown" / "crazyswarm2" / "logs" / "log09")
    rate, angle, torque = (
        log.signals[name][0].values[100:-100] for name in ("body_rate", "attitude", "torque_command")
    )
    total = np.cumsum(rate, axis=0)
    for axis in range(3):
        # Over 60 ms the angle changes by the sum of the rates; the time between rows cancels.
        change = angle[15:, axis] - angle[:-15, axis]
        # Yaw is held, and moves by hundredths of a degree.
        least = 0.98 if axis < 2 else 0.3
        assert np.corrcoef(change, total[15:, axis] - total[:-15, axis])[0, 1] > least
        gained = rate[15:, axis] - rate[:-15, axis]
        assert np.corrcoef(gained, torque[:-15, axis])[0, 1] > 0.2
