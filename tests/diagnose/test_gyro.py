"""The check of body rates against attitude: silent where they agree, and loud where not."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.flight import FlightData, GyroCheck
from quadid_logs.data.log import Rows, Signal
from quadid_logs.data.settings import AlignSettings
from quadid_logs.diagnose.gyro_findings import find_in_gyro
from quadid_logs.errors import LogError
from quadid_logs.load import read_log
from quadid_logs.maths.rotations import euler_from_quaternion, quaternion_rate
from quadid_logs.simulator import simulate
from quadid_logs.vocabulary import AXES
from tests.align.flights import align, flight_log, signal
from tests.conftest import corpus_logs
from tests.marks import thorough_but

RATE_HZ = 200.0
#: Its main loop ran at 375 Hz instead of 400 by its own PM messages, so that its attitude turns too little,
#: about every axis by the same factor of 0.92.
SLOW_LOOP = "real/ac34rc2-erlebrain3-quadx-265s.bin"


def broad(t: np.ndarray) -> np.ndarray:
    """Return body rates at 0.2 to 0.6 Hz."""
    return np.stack([0.8 * np.sin(2.9 * t), 0.7 * np.cos(3.7 * t), 0.5 * np.sin(1.3 * t + 1.0)], axis=-1)


def tones(frequency_hz: tuple[float, float, float]) -> Callable[[np.ndarray], np.ndarray]:
    """Return body rates of one tone per axis."""

    def rate_at(t: np.ndarray) -> np.ndarray:
        cycle = 2.0 * np.pi * np.multiply.outer(t, frequency_hz)
        return np.array((0.8, 0.7, 0.5)) * np.sin(cycle + np.array((0.0, 0.5, 1.0)))

    return rate_at


def turning(
    rate_at: Callable[[np.ndarray], np.ndarray] = broad, duration_s: float = 60.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time (n,), body rates (n, 3) and the Euler angles (n, 3) that they lead to."""
    time_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)

    # In plain floats: the file is read by every test process.
    step, rate = 1.0 / RATE_HZ, rate_at(time_s)
    quaternion, q = [], (1.0, 0.0, 0.0, 0.0)
    for now, midway in zip(rate.tolist(), rate_at(time_s + 0.5 * step).tolist(), strict=True):
        quaternion.append(q)
        middle = [of + 0.5 * step * by for of, by in zip(q, quaternion_rate(q, now), strict=True)]
        after = [of + step * by for of, by in zip(q, quaternion_rate(middle, midway), strict=True)]
        length = math.hypot(*after)
        q = tuple(each / length for each in after)
    return time_s, rate, euler_from_quaternion(np.array(quaternion))


TIME_S, RATE, EULER = turning()


def _among(sparse: Signal, every: int) -> Signal:
    """Place the rows of a sparse signal in the file beside those that were logged meanwhile."""
    return dataclasses.replace(sparse, rows=Rows(sparse.time_s, sparse.position * every))


def logged(
    rate: np.ndarray = RATE, euler: np.ndarray = EULER, *, rate_late_s: float = 0.0, every: int = 1
) -> FlightData:
    """Return the aligned log of these rates, with a little noise, and this attitude."""
    noise = np.random.default_rng(1).normal(0.0, 0.01, rate.shape)
    return align(
        flight_log(
            signal("body_rate", TIME_S + rate_late_s, rate + noise),
            _among(signal("attitude", TIME_S[::every], euler[::every]), every),
            signal("torque_command", TIME_S, 0.1 * rate),
            signal("throttle", TIME_S, np.full((TIME_S.size, 1), 0.4)),
        ),
        AlignSettings(),
    )


def found(data: FlightData) -> list[Finding]:
    return list(find_in_gyro(data))


def checked(data: FlightData) -> GyroCheck:
    assert data.gyro_check is not None
    return data.gyro_check


def test_rates_that_integrate_to_the_attitude_raise_no_finding() -> None:
    """The matrix is the identity within its own small intervals."""
    check = checked(logged())
    assert np.abs(check.matrix - np.eye(3)).max() < 0.003
    assert abs(check.lag_s) < 0.001
    assert found(logged()) == []


def test_attitude_at_ten_hertz_is_enough_for_slow_motion() -> None:
    """As ArduPilot logs it, whatever the bitmask."""
    data = logged(every=int(RATE_HZ / 10.0))
    assert np.abs(np.diag(checked(data).matrix) - 1.0).max() < 0.01
    assert found(data) == []


@pytest.mark.parametrize("axis", ["roll", "pitch", "yaw"])
def test_a_flipped_axis_is_an_error_that_names_it(axis: str) -> None:
    """Whichever it is."""
    signs = np.where(np.array(["roll", "pitch", "yaw"]) == axis, -1.0, 1.0)
    (finding,) = found(logged(RATE * signs))
    assert (finding.level, finding.axes) == ("error", (axis,))
    assert finding.title == f"By the logged attitude, the {axis} rate has the wrong sign"


def test_degrees_taken_for_radians_are_an_error_on_every_axis() -> None:
    """Factor 57."""
    findings = found(logged(np.degrees(RATE)))
    assert [(each.level, each.axes[0]) for each in findings] == [
        ("error", "roll"), ("error", "pitch"), ("error", "yaw"),
    ]  # fmt: skip
    assert findings[0].evidence["attitude_over_rate"] == pytest.approx(np.radians(1.0), rel=0.02)


def test_an_attitude_in_degrees_is_told_by_its_pitch() -> None:
    """No Euler pitch exceeds 90 degrees."""
    titles = [each.title for each in found(logged(euler=np.degrees(EULER)))]
    assert any("exceeds 90 degrees" in title for title in titles)


@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_a_scale_that_is_wrong_by_five_percent_is_a_warning(factor: float) -> None:
    """On the axis that it is wrong on."""
    (finding,) = found(logged(RATE * (factor, 1.0, 1.0)))
    assert (finding.level, finding.axes) == ("warning", ("roll",))
    assert finding.evidence["attitude_over_rate"] == pytest.approx(1.0 / factor, rel=0.01)


def test_swapped_axes_are_named() -> None:
    """Roll logged as pitch and pitch as roll."""
    findings = found(logged(RATE[:, [1, 0, 2]]))
    assert [each.title for each in findings] == [
        "By the logged attitude, the roll rate is the rate of pitch",
        "By the logged attitude, the pitch rate is the rate of roll",
    ]
    assert {each.level for each in findings} == {"error"}


def test_the_time_between_the_two_is_measured() -> None:
    """Rates that come 20 ms late, as a gyro filter makes them, are fine; 150 ms are not."""
    filtered = logged(rate_late_s=0.02)
    assert checked(filtered).lag_s == pytest.approx(0.02, abs=0.001)
    assert found(filtered) == []
    (finding,) = found(logged(rate_late_s=0.15))
    assert finding.level == "info"
    assert finding.title == "The body rates come 150 ms after the attitude"


def test_a_turn_of_the_compass_that_no_gyro_saw_changes_nothing() -> None:
    """The estimator resets yaw in flight: one interval of many, and it weighs little."""
    reset = EULER + np.where(TIME_S > 30.2, 1.0, 0.0)[:, np.newaxis] * (0.0, 0.0, 1.0)
    assert found(logged(euler=reset)) == []


@pytest.mark.parametrize("frequency_hz", [(1.5, 0.5, 0.5), (1.02, 1.98, 0.98), (0.7, 1.3, 0.3)])
def test_one_tone_per_axis_is_not_accused(frequency_hz: tuple[float, float, float]) -> None:
    """Sampled once a second such tones keep their phase and look alike: pitch turned 0.885 times as far."""
    _, rate, euler = turning(tones(frequency_hz))
    data = logged(rate, euler, rate_late_s=0.01)
    assert found(data) == []
    assert np.abs(checked(data).matrix - np.eye(3)).max() < 0.01
    assert checked(data).lag_s == pytest.approx(0.01, abs=0.001)


def test_a_scale_that_is_wrong_is_found_where_there_is_one_tone_per_axis() -> None:
    """The check has not become blind to it."""
    _, rate, euler = turning(tones((1.5, 0.5, 0.5)))
    (finding,) = found(logged(rate * (1.0, 1.06, 1.0), euler))
    assert (finding.level, finding.axes) == ("warning", ("pitch",))


def test_a_slow_correction_by_the_estimator_is_no_scale_of_the_gyro() -> None:
    """An estimator that takes speed for tilt overstates slow tilts by 20 % and fast ones not at all."""

    def slow_and_fast(t: np.ndarray) -> np.ndarray:
        return broad(t) * 0.3 + 0.3 * np.sin(2.0 * np.pi * 0.1 * t)[..., np.newaxis] * (1.0, 0.0, 0.0)

    time_s, rate, euler = turning(slow_and_fast)
    slow_tilt = -0.3 * np.cos(2.0 * np.pi * 0.1 * time_s) / (2.0 * np.pi * 0.1)
    corrected = euler + 0.2 * slow_tilt[:, np.newaxis] * (1.0, 0.0, 0.0)
    assert found(logged(rate, corrected)) == []


def test_an_axis_that_only_shook_is_not_judged() -> None:
    """Noise alone biases the scale towards zero; its interval says so."""
    still = RATE * (0.002, 1.0, 1.0)
    data = logged(still)
    assert not [each for each in found(data) if each.axes == ("roll",)]


def test_without_attitude_there_is_no_check() -> None:
    """And nothing is said about it here: QL306 says it."""
    data = logged()
    bare = {name: each for name, each in data.overview.items() if name != "attitude"}
    assert found(dataclasses.replace(data, overview=bare, gyro_check=None)) == []


def test_the_lag_of_the_gyro_filter_is_found_in_a_simulated_flight() -> None:
    """Two poles at 40 Hz delay slow motion by sqrt(2) / (2 pi 40 Hz): 5.6 ms."""
    check = checked(align(simulate("doublets", seed=3, duration_s=30.0).log, AlignSettings()))
    assert check.lag_s == pytest.approx(np.sqrt(2.0) / (2.0 * np.pi * 40.0), abs=0.0005)
    assert np.abs(check.matrix - np.eye(3)).max() < 0.005


@pytest.mark.corpus
def test_the_lag_of_the_gyro_filter_is_found_in_a_flight_of_the_firmware(corpus: Path) -> None:
    """Its INS_GYRO_FILTER is 20 Hz: 11.25 ms."""
    check = checked(align(read_log(corpus / "firmware" / "ac47_quadx_doublets.BIN"), AlignSettings()))
    assert check.lag_s == pytest.approx(0.01125, abs=0.0005)


#: One log of each autopilot and each way to log rates and attitude, and the one that contradicts itself.
OF_EACH_KIND = (
    SLOW_LOOP,
    "firmware/ac47_quadx_doublets.BIN",
    "firmware/bf_quad_sticks.bbl",
    "firmware/px4_quad_multisine.ulg",
    "real/ac33dev-erle-quadx-RATE50Hz-2015-03-31.bin",
    "real/ac413-quadx-goodprop-hover1.bin",
    "real/px4-1.16-quad-v6c-indoor-85s.ulg",
    "real/sdlog2-quad-70s.px4log",
    "real/tailsitter-step-size2-2.csv",
)


@pytest.mark.corpus
@pytest.mark.parametrize(
    "corpus_log",
    thorough_but(OF_EACH_KIND, sorted({*OF_EACH_KIND, *corpus_logs("real", "firmware")})),
    indirect=True,
)
def test_of_all_flown_logs_one_contradicts_itself(corpus_log: Path) -> None:
    """And that one for a reason."""
    try:
        log = read_log(corpus_log)
    except LogError as error:
        pytest.skip(str(error))
    findings = found(align(log, AlignSettings()))
    name = f"{corpus_log.parent.name}/{corpus_log.name}"
    assert [each.axes for each in findings] == (
        [("roll",), ("pitch",), ("yaw",)] if name == SLOW_LOOP else []
    )


@pytest.mark.parametrize("column", [0, 1, 2])
def test_an_angle_that_never_changes_while_the_vehicle_turns_is_a_warning(column: int) -> None:
    """All zero, as from an estimator that never started; nothing was said."""
    euler = EULER.copy()
    euler[:, column] = 0.0
    levels = {each.axes: each.level for each in found(logged(euler=euler)) if "never changes" in each.title}
    assert levels == {(AXES[column],): "warning"}


def test_an_attitude_of_zeros_is_one_warning_for_all_axes() -> None:
    """Not three of one cause."""
    (only,) = found(logged(euler=np.zeros_like(EULER)))
    assert only.axes == AXES


def test_telemetry_too_slow_to_integrate_contradicts_no_attitude() -> None:
    """A telemetry log was told to check how the autopilot sits; the card's log of that flight was not."""
    time_s, rate, euler = turning(tones((1.2, 1.1, 1.3)))
    slow = slice(None, None, int(RATE_HZ / 4.0))
    data = align(
        flight_log(
            signal("body_rate", time_s[slow], rate[slow]),
            signal("attitude", time_s[slow], euler[slow]),
            signal("torque_command", time_s[slow], 0.1 * rate[slow]),
            signal("throttle", time_s[slow], np.full((time_s[slow].size, 1), 0.4)),
        ),
        AlignSettings(),
    )
    assert data.gyro_check is not None
    assert np.abs(np.diag(data.gyro_check.matrix) - 1.0).max() > 0.1
    assert found(data) == []


def spinning(t: np.ndarray) -> np.ndarray:
    """Return slow rates, with a spin of seven turns a second that lasts for four seconds."""
    rate = broad(t)
    rate[:, 2] += 45.0 * ((t > 40.0) & (t < 44.0))
    return rate


def test_a_spin_faster_than_the_attitude_counts_is_no_wrong_sign() -> None:
    """After a motor failed, the yaw of a log at 10 Hz "had the wrong sign"."""
    time_s, rate, euler = turning(spinning)
    slow = slice(None, None, int(RATE_HZ / 10.0))
    data = align(
        flight_log(
            signal("body_rate", time_s, rate),
            _among(signal("attitude", time_s[slow], euler[slow]), int(RATE_HZ / 10.0)),
            signal("torque_command", time_s, 0.1 * rate),
            signal("throttle", time_s, np.full((time_s.size, 1), 0.4)),
        ),
        AlignSettings(),
    )
    assert data.gyro_check is not None
    assert data.gyro_check.matrix[2, 2] < 0.5
    assert found(data) == []
