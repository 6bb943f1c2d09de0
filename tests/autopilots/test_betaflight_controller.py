"""Betaflight's rate loop: gains and filters of the header, replay on the log's rows, margins."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from quadid_logs.autopilots import named
from quadid_logs.autopilots.betaflight.controller import controllers
from quadid_logs.autopilots.betaflight.filters import GYRO_LOW_PASSES, cutoff_hz, loop_filters
from quadid_logs.autopilots.betaflight.law import (
    angle_gain_per_s,
    attenuation,
    d_filter,
    p_filter,
    rate_gains,
    throttle_stick,
)
from quadid_logs.autopilots.betaflight.log import read
from quadid_logs.autopilots.betaflight.replay import d_parts, replay_inputs
from quadid_logs.autopilots.betaflight.sticks import sticks_of
from quadid_logs.autopilots.betaflight.terms import WholeTerms
from quadid_logs.control.loop import close, integrators
from quadid_logs.control.margins import grid_hz, margins_of
from quadid_logs.control.replay import replay
from quadid_logs.data.closed_loop import Margins, Plant
from quadid_logs.data.controller import RemarkKind, Replay, ReplayReason
from quadid_logs.data.log import ControllerTerms, FlightLog, ModeChange, Rows, Signal
from quadid_logs.report.loop_json import closed_loop_dict
from quadid_logs.report.loop_view import loop_view
from quadid_logs.vocabulary import AXES
from tests.analyses import Analyzed
from tests.marks import thorough

STICKS, CHIRP, HOVER = (f"bf_quad_{name}.bbl" for name in ("sticks", "chirp", "hover"))
PID = {"p_roll": 45.0, "i_roll": 80.0, "d_roll": 30.0}
YAW = {"p_yaw": 45.0, "i_yaw": 80.0, "d_yaw": 0.0}
PER_RADIAN = math.degrees(1.0) * 1e-3


@cache
def logged(path: Path) -> FlightLog:
    """Read a log of the corpus once."""
    return read(path)


def replayed(log: FlightLog, **changes: float) -> dict[str, Replay]:
    """Replay a log with other settings than those of its header."""
    other = replace(log, parameters={**log.parameters, **changes})
    found = controllers(other, other.parameters)
    return replay(found, replay_inputs(other, found, ()))


def test_p_of_the_header_is_per_degree_and_thousandth() -> None:
    """PTERM_SCALE 0.032029."""
    assert rate_gains(PID, "roll").proportional == pytest.approx(0.032029 * 45 * PER_RADIAN)


def test_yaws_integral_is_two_and_a_half_times_its_scale() -> None:
    """As ``pid_init.c`` has it, and as the firmware's logs show."""
    assert rate_gains(YAW, "yaw").integral == pytest.approx(2.5 * 0.244381 * 80 * PER_RADIAN)


def test_d_lies_between_the_header_and_d_max() -> None:
    """Since 4.6 the header's D is the lower one."""
    found = rate_gains(PID | {"d_max_roll": 40.0}, "roll")
    assert (found.derivative, found.most_derivative) == pytest.approx(
        (0.000529 * 30 * PER_RADIAN, 0.000529 * 40 * PER_RADIAN)
    )


def test_d_lies_between_d_min_and_the_header() -> None:
    """Until then it was the higher one."""
    found = rate_gains(PID | {"d_min_roll": 20.0}, "roll")
    assert (found.derivative, found.most_derivative) == pytest.approx(
        (0.000529 * 20 * PER_RADIAN, 0.000529 * 30 * PER_RADIAN)
    )


def test_d_fades_from_the_breakpoint_to_full_throttle() -> None:
    """By 65 % at full throttle, by half of that half-way."""
    settings = {"tpa_rate": 65.0, "tpa_breakpoint": 1350.0}
    np.testing.assert_allclose(
        attenuation(settings, np.array([0.2, 0.35, 0.675, 1.0])), [1.0, 1.0, 0.675, 0.35]
    )


@pytest.mark.parametrize(("cut", "of_three"), [(True, -3.5e-3), (False, -3e-3)], ids=["4.3", "4.4"])
def test_whole_terms_stand_for_the_middle_of_what_became_them(cut: bool, of_three: float) -> None:
    """Before 4.4 the firmware cut towards zero: 3 stood for 3 to 4, and 0 for -1 to 1."""
    terms = WholeTerms({"P": (np.array([3, 0, -3], np.int16),)}, -1.0, cut=cut)
    np.testing.assert_allclose(terms["P"], [of_three, 0.0, -of_three])


def test_a_dynamic_low_pass_moves_with_the_throttle() -> None:
    """From its lowest cut-off to its highest, faster at first by the expo."""
    settings = {"gyro_lpf1_dyn_hz[0]": 250.0, "gyro_lpf1_dyn_hz[1]": 500.0, "gyro_lpf1_dyn_expo": 5.0}
    found = [cutoff_hz(settings, GYRO_LOW_PASSES[0], throttle) for throttle in (0.0, 0.5, 1.0)]
    assert found == pytest.approx([250.0, 250.0 + 250.0 * (0.5 + 0.125), 500.0])


@pytest.mark.parametrize(("throttle", "expected"), [(0.1, 200.0), (0.5, 275.0), (1.0, 400.0)])
def test_before_4_3_the_gyros_dynamic_low_pass_rose_by_another_curve(
    throttle: float, expected: float
) -> None:
    """1.5 t (1 - t^2 / 3) times the higher end, and never below the lower one."""
    settings = {"gyro_lowpass_dyn_hz[0]": 200.0, "gyro_lowpass_dyn_hz[1]": 400.0}
    found = next(hz for names in GYRO_LOW_PASSES if (hz := cutoff_hz(settings, names, throttle)) > 0.0)
    assert found == pytest.approx(expected)


def test_a_header_without_the_bend_of_a_dynamic_low_pass_has_that_of_its_firmware() -> None:
    """4.3 and 4.4 do not log it; it is 5 in tenths unless it was changed."""
    settings = {"gyro_lpf1_dyn_hz[0]": 250.0, "gyro_lpf1_dyn_hz[1]": 500.0}
    assert cutoff_hz(settings, GYRO_LOW_PASSES[0], 0.3) == pytest.approx(250.0 + 250.0 * (0.3 + 0.105))


def test_notches_on_rotors_that_nobody_logged_are_named(corpus: Path) -> None:
    """Betaflight 4.2 has the RPM filter and logs no speeds."""
    log = logged(corpus / "blackbox" / "bf42-btfl002.bbl")
    (remark,) = (
        one for one in controllers(log, log.parameters).remarks if one.kind is RemarkKind.NOTCH_UNKNOWN
    )
    assert remark.values["gyro_rpm_notch_harmonics"] == 3.0


def test_notches_on_the_rotors_fade_out_above_their_lowest_frequency() -> None:
    """Half-way through the fade range half of the notch is left."""
    settings = {
        "rpm_filter_q": 500.0,
        "rpm_filter_min_hz": 100.0,
        "rpm_filter_harmonics": 1.0,
        "rpm_filter_fade_range_hz": 50.0,
    }
    (found,) = loop_filters(settings, (125.0,), 0.3, (125e-6, 250e-6))
    assert abs(found.response(np.array([125.0]))[0]) == pytest.approx(0.5, abs=1e-6)


def test_d_acts_on_the_slope_behind_two_low_passes() -> None:
    """At 100 Hz, where both take phase and gain away."""
    settings = {"dterm_lpf1_static_hz": 75.0, "dterm_lpf2_static_hz": 150.0}
    s = 2j * math.pi * 100.0
    expected = s / (1.0 + s / (2 * math.pi * 75.0)) / (1.0 + s / (2 * math.pi * 150.0))
    found = d_filter(settings, 0.0, 1e-6).response(np.array([100.0]))[0]
    assert found == pytest.approx(expected, rel=2e-3)


def test_only_yaws_p_is_low_passed() -> None:
    """At 100 Hz."""
    for axis, gain in (("roll", 1.0), ("yaw", math.sqrt(0.5))):
        found = p_filter({"yaw_lowpass_hz": 100.0}, axis, 1e-6).response(np.array([100.0]))[0]
        assert abs(found) == pytest.approx(gain, rel=1e-3)


@pytest.mark.parametrize("name", [STICKS, thorough(CHIRP)])
def test_the_firmwares_own_terms_are_replayed(corpus: Path, name: str) -> None:
    """P and D of roll and pitch, P of yaw, within what rounding leaves."""
    found = replayed(logged(corpus / "firmware" / name))
    assert {axis: one.agrees for axis, one in found.items()} == dict.fromkeys(AXES, True)
    assert all((one.relative_rms["P"] or 1.0) < 0.08 for one in found.values())
    assert all((found[axis].relative_rms["D"] or 1.0) < 0.12 for axis in ("roll", "pitch"))


def test_what_is_not_replayed_is_told(corpus: Path) -> None:
    """Nothing is claimed of I and feed-forward."""
    found = replayed(logged(corpus / "firmware" / STICKS))["roll"]
    assert found.as_logged == ("I", "FF")
    assert found.relative_rms["I"] is None


@pytest.mark.parametrize(
    ("axis", "name", "value"), [("roll", "p_roll", 54.0), thorough("pitch", "p_pitch", 41.0)]
)
def test_a_gain_that_did_not_fly_is_named(corpus: Path, axis: str, name: str, value: float) -> None:
    """Of the header's P a fifth too high or an eighth too low."""
    log = logged(corpus / "firmware" / STICKS)
    found = replayed(log, **{name: value})[axis]
    assert (found.reason, found.parameter) == (ReplayReason.GAIN_DIFFERS, name)
    assert found.numbers["flown"] == pytest.approx(log.parameters[name], rel=0.03)


@pytest.mark.thorough
def test_a_hover_of_a_few_units_tells_nothing_of_the_controller(corpus: Path) -> None:
    """Its terms are mostly rounding."""
    found = replayed(logged(corpus / "firmware" / HOVER))
    assert {one.reason for one in found.values()} == {ReplayReason.ROUNDED}


def test_p_alone_is_held_against_a_log_whose_rounding_hides_d(corpus: Path) -> None:
    """A calm flight in whole degrees per second; what no cause explains is not said to be another gain."""
    log = logged(corpus / "blackbox" / "bf2025-eRPM-btfl027.bbl")
    inputs = replay_inputs(log, controllers(log, log.parameters), [(73.8, 110.8)])
    assert inputs["roll"].coarse
    found = replay(controllers(log, log.parameters), inputs)
    assert found["roll"].agrees
    assert {one.reason for one in found.values()} == {None, ReplayReason.ROUNDED}


def whole(values: np.ndarray, unit: float) -> np.ndarray:
    """Round to whole units."""
    return np.asarray(unit * np.rint(values / unit))


STEP_S, N_ROWS = 5e-4, 12_000
#: Of `flown`: gains, and two low-passes of D that stay.
FLOWN = {
    "p_roll": 60.0,
    "i_roll": 0.0,
    "d_roll": 43.0,
    "looptime": 1e6 * STEP_S,
    "dterm_lpf2_static_hz": 210.0,
}
STAYS = FLOWN | {"dterm_lpf1_static_hz": 105.0}
AIRMODE = {"features": float(1 << 22)}


def flown(
    seed: int,
    rms_deg_s: float,
    settings: dict[str, float],
    throttle: np.ndarray | float = 0.3,
    slope: Callable[[np.ndarray], np.ndarray] | None = None,
) -> FlightLog:
    """Fly roll with P and D, and log rates in degrees per second, or tenths of it, and whole thousandths."""
    random = np.random.default_rng(seed)
    slow = signal.butter(2, 15.0, fs=1.0 / STEP_S)
    rate, error = (signal.lfilter(*slow, random.normal(size=N_ROWS)) for _ in range(2))
    rate, error = (
        math.radians(rms_deg_s) * rate / rate.std(),
        math.radians(0.3 * rms_deg_s) * error / error.std(),
    )
    gains, used = rate_gains(settings, "roll"), d_filter(settings, 0.3, STEP_S)
    turning = signal.lfilter(used.numerator, used.denominator, rate) if slope is None else slope(rate)
    terms = {"P": gains.proportional * error, "D": -gains.derivative * turning}
    unit = math.radians(0.1 if settings.get("blackbox_high_resolution") else 1.0)
    nothing, rows = np.zeros(N_ROWS), Rows(STEP_S * np.arange(N_ROWS), np.arange(N_ROWS))
    signals = {
        "body_rate": np.column_stack([whole(rate, unit), nothing, nothing]),
        "body_rate_setpoint": np.column_stack([whole(rate + error, unit), nothing, nothing]),
        "throttle": np.full((N_ROWS, 1), 1.0) * np.reshape(throttle, (-1, 1)),
    }
    return FlightLog(
        path="",
        format="blackbox",
        autopilot="betaflight",
        firmware="Betaflight 4.5.2",
        n_bytes=0,
        parameters=settings,
        signals={
            name: (Signal(name=name, source="main", reason="", rows=rows, values=values),)
            for name, values in signals.items()
        },
        controller_terms=(
            ControllerTerms(
                axis="roll",
                rows=rows,
                values={name: whole(values, 1e-3) for name, values in terms.items()},
            ),
        ),
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_rate_rounded_for_p_and_d_at_once_is_no_other_controller(seed: int) -> None:
    """Behind D's low-passes both answer a rounded rate in phase; their sum is off by more than each alone."""
    found = replayed(flown(seed, 8.0, STAYS))["roll"]
    assert found.agrees
    assert found.relative_rms["D"] is not None


@pytest.mark.parametrize("gain_off", [1.0, 1.3])
def test_vibration_faster_than_the_rows_behind_yaws_low_pass_is_no_other_controller(gain_off: float) -> None:
    """One frame in eight loops; a gain that is off by a third still shows."""
    loop_s, every, n_loops = 125e-6, 8, 64_000
    random = np.random.default_rng(0)
    rate = signal.lfilter(*signal.butter(2, 15.0, fs=1.0 / loop_s), random.normal(size=n_loops))
    shaken = signal.lfilter(
        *signal.butter(2, (300.0, 480.0), "bandpass", fs=1.0 / loop_s), random.normal(size=n_loops)
    )
    rate = math.radians(20.0) * rate / rate.std() + math.radians(20.0) * shaken / shaken.std()
    settings = {**YAW, "looptime": 1e6 * loop_s, "pid_process_denom": 1.0, "yaw_lowpass_hz": 100.0}
    part = loop_s / (loop_s + 1.0 / (2.0 * math.pi * 100.0))
    passed = signal.lfilter([part], [1.0, part - 1.0], -rate)[::every]
    rows = Rows(every * loop_s * np.arange(passed.size), np.arange(passed.size))
    values = {
        "body_rate": whole(rate[::every], math.radians(1.0)),
        "body_rate_setpoint": np.zeros(passed.size),
        "throttle": np.full(passed.size, 0.3),
    }
    log = replace(
        flown(0, 8.0, STAYS),
        parameters=settings,
        signals={
            name: (
                Signal(
                    name=name,
                    source="main",
                    reason="",
                    rows=rows,
                    values=each[:, None] * ([1.0] if name == "throttle" else [0.0, 0.0, 1.0]),
                ),
            )
            for name, each in values.items()
        },
        controller_terms=(
            ControllerTerms(
                axis="yaw",
                rows=rows,
                values={"P": whole(gain_off * rate_gains(settings, "yaw").proportional * passed, 1e-3)},
            ),
        ),
    )
    assert replayed(log)["yaw"].agrees == (gain_off == 1.0)


def yaw_log(
    settings: dict[str, float],
    *,
    rate: np.ndarray,
    set_point: np.ndarray,
    p: np.ndarray,
    step_s: float,
    firmware: str = "Betaflight 4.5.2",
    source: str = "main",
) -> FlightLog:
    """Return a log of yaw with P alone: rates in whole degrees per second, P in whole thousandths."""
    rows = Rows(step_s * np.arange(rate.size), np.arange(rate.size))
    values = {
        "body_rate": np.outer(whole(rate, math.radians(1.0)), [0.0, 0.0, 1.0]),
        "body_rate_setpoint": np.outer(set_point, [0.0, 0.0, 1.0]),
        "throttle": np.full((rate.size, 1), 0.3),
    }
    return replace(
        flown(0, 8.0, STAYS),
        firmware=firmware,
        parameters=settings,
        signals={
            name: (Signal(name=name, source=source, reason="", rows=rows, values=each),)
            for name, each in values.items()
        },
        controller_terms=(ControllerTerms(axis="yaw", rows=rows, values={"P": whole(p, 1e-3)}),),
    )


def calm(seed: int, gain_off: float = 1.0) -> Replay:
    """Replay five seconds in which yaw hardly moves, and its set-point stands for half a second at a time."""
    random = np.random.default_rng(seed)
    step_s, n_rows = 1e-3, 5_000
    settings = {**YAW, "looptime": 1e6 * step_s, "pid_process_denom": 1.0}
    rate = signal.lfilter(*signal.butter(2, 3.0, fs=1.0 / step_s), random.normal(size=n_rows))
    rate = math.radians(3.0) * rate / rate.std()
    set_point = np.repeat(random.normal(scale=math.radians(3.0), size=n_rows // 500), 500)
    p = gain_off * rate_gains(settings, "yaw").proportional * (set_point - rate)
    log = yaw_log(settings, rate=rate, set_point=whole(set_point, math.radians(1.0)), p=p, step_s=step_s)
    return replayed(log)["yaw"]


@pytest.mark.thorough
def test_what_chance_makes_of_rounding_in_a_calm_flight_is_no_other_controller() -> None:
    """In 200 flights whose controller is right; a set-point that stands is rounded once."""
    found = [calm(seed) for seed in range(200)]
    assert sum(one.agrees for one in found) > 100
    assert sum(not one.agrees and one.reason is not ReplayReason.ROUNDED for one in found) <= 2


def test_a_gain_that_is_off_by_half_shows_in_a_calm_flight() -> None:
    """Where rounding does not hide it."""
    found = [calm(seed, 1.5) for seed in range(40)]
    told = [one for one in found if one.reason is not ReplayReason.ROUNDED]
    assert len(told) > 20
    assert not any(one.agrees for one in told)


@pytest.mark.parametrize("gain_off", [1.0, 1.3])
def test_a_set_point_of_limited_slope_is_known_to_a_row(gain_off: float) -> None:
    """The firmware steps loop by loop, from the loop in which the stick moved; a row is eight of them."""
    random = np.random.default_rng(3)
    loop_s, every, n_steps, slope = 125e-6, 8, 300, 10_000.0
    settings = {
        **YAW, "looptime": 1e6 * loop_s, "pid_process_denom": 1.0, "acc_limit_yaw": 100.0,
        **{f"{name}[{axis}]": 0.0 for axis in range(3) for name in ("rc_expo", "rates")},
        **{f"rc_rates[{axis}]": 200.0 for axis in range(3)},
    }  # fmt: skip
    # The stick moves every 16 ms, at any loop between two rows.
    when = 16 * every * np.arange(1, n_steps + 1) + random.integers(0, every, n_steps)
    n_loops = 16 * every * (n_steps + 2)
    stick = np.rint(np.clip(np.cumsum(random.normal(scale=60.0, size=n_steps)), -450.0, 450.0))
    command = np.concatenate([[0.0], stick])[np.searchsorted(when, np.arange(n_loops), side="right")]
    asked = command * 400.0 / 500.0
    set_point, now = np.empty(n_loops), 0.0
    for loop, wanted in enumerate(asked.tolist()):
        now = min(max(wanted, now - slope * loop_s), now + slope * loop_s)
        set_point[loop] = math.radians(now)
    rate = signal.lfilter(*signal.butter(2, 25.0, fs=1.0 / loop_s), set_point)
    p = gain_off * rate_gains(settings, "yaw").proportional * (set_point - rate)
    time_s = every * loop_s * np.arange(n_loops // every)
    sticks = sticks_of(settings, (3, 4))
    assert sticks is not None
    of_sticks = sticks.set_points(np.outer(command[::every], [0.0, 0.0, 1.0]), time_s)[:, 2]
    log = yaw_log(
        settings, rate=rate[::every], set_point=np.radians(of_sticks), p=p[::every], step_s=every * loop_s,
        firmware="Betaflight 3.4.0", source="main.rcCommand",
    )  # fmt: skip
    assert replayed(log)["yaw"].agrees == (gain_off == 1.0)


def test_a_low_pass_that_moves_with_the_throttle_is_replayed_as_it_moves() -> None:
    """From 70 to 170 Hz, as the throttle goes up and down; at its mean it is off by a tenth of D."""
    throttle = 0.5 - 0.4 * np.cos(2.0 * np.pi * 0.5 * STEP_S * np.arange(N_ROWS))
    settings = FLOWN | {
        "dterm_lpf1_dyn_hz[0]": 70.0,
        "dterm_lpf1_dyn_hz[1]": 170.0,
        "dterm_lpf1_dyn_expo": 5.0,
    }
    settings |= {"blackbox_high_resolution": 1.0}

    def slope(rate: np.ndarray) -> np.ndarray:
        """Filter as ``pt1FilterApply`` does, with a gain that moves."""
        cut_off = 70.0 + 100.0 * throttle * (1.0 + 0.5 * (1.0 - throttle))
        made, state = np.zeros_like(rate), np.zeros(2)
        for row, change in enumerate(np.diff(rate, prepend=0.0) / STEP_S):
            for number, hz in enumerate((cut_off[row], 210.0)):
                gain = STEP_S / (STEP_S + 1.0 / (2.0 * np.pi * hz))
                state[number] += gain * ((change if number == 0 else state[0]) - state[number])
            made[row] = state[1]
        return made

    found = replayed(flown(0, 100.0, settings, throttle, slope))["roll"]
    assert (found.relative_rms["D"] or 1.0) < 0.03


@pytest.mark.parametrize(("settings", "reason"), [(AIRMODE, None), ({"features": 0.0}, ReplayReason.NO_ROWS)])
def test_a_flight_of_flips_is_replayed_in_airmode(settings: dict, reason: ReplayReason | None) -> None:
    """Its throttle is never up for four seconds; without airmode the PID does not work in between."""
    throttle = np.where(STEP_S * np.arange(N_ROWS) % 2.0 < 1.0, 0.5, 0.0)
    found = replayed(flown(0, 100.0, STAYS | settings, throttle))["roll"]
    assert (found.agrees, found.reason) == (reason is None, reason)


def test_before_4_3_d_fades_by_the_stick_not_by_the_throttle_that_it_makes() -> None:
    """``thr_mid`` 55 and ``thr_expo`` 50 make 713.6 of 800."""
    settings = {"thr_mid": 55.0, "thr_expo": 50.0}
    stick = [
        float(throttle_stick(settings, np.array([0.7136]), version)[0]) for version in ((4, 2), (4, 3), None)
    ]
    assert stick == pytest.approx([0.8, 0.7136, 0.7136], abs=1e-3)


@pytest.mark.parametrize(("version", "expected"), [((4, 2), 0.65), ((4, 3), 0.801)])
def test_d_fades_with_the_stick_where_the_version_has_it_so(
    version: tuple[int, int], expected: float
) -> None:
    """By 70 % of full throttle above 60 %, at 80 % of stick, which make 71.36 % of throttle."""
    settings = {"thr_mid": 55.0, "thr_expo": 50.0, "tpa_rate": 70.0, "tpa_breakpoint": 1600.0}
    assert float(attenuation(settings, 0.7136, version)) == pytest.approx(expected, abs=0.01)


def test_a_straight_throttle_is_that_of_the_stick() -> None:
    """As it is by default."""
    throttle = np.linspace(0.0, 1.0, 7)
    np.testing.assert_allclose(throttle_stick({}, throttle, (4, 2)), throttle, atol=1e-12)


def test_the_mean_d_lies_between_its_ends(corpus: Path) -> None:
    """On quick sticks a little above the lower one, in a flown log close to the higher one."""
    quick = d_parts(logged(corpus / "firmware" / STICKS))["roll"]
    flown = d_parts(logged(corpus / "blackbox" / "bf2025-eRPM-btfl027.bbl"))["roll"]
    assert 0.1 < quick < 0.3
    assert 0.8 < flown <= 1.0


def with_d(log: FlightLog, of_lower: Callable[[np.ndarray], np.ndarray]) -> Replay:
    """Replay roll with D-max twice D, where D flew as this makes of the lower gain's."""
    settings = {**log.parameters, "d_max_roll": 2.0 * log.parameters["d_roll"]}
    log = replace(log, parameters=settings)
    found = controllers(log, settings)
    given = replay_inputs(log, found, ())["roll"]
    lower = given.law(given.rows, {**settings, "d_max_roll": 0.0}).values["D"]
    proportional, flown = given.rows.logged["P"], of_lower(lower)
    rows = replace(
        given.rows,
        logged={"P": proportional, "D": flown},
        output=proportional + flown + given.rows.added,
    )
    return replay(found, {"roll": replace(given, rows=rows)})["roll"]


def test_a_d_that_rises_in_the_quickest_motion_is_no_other_gain(corpus: Path) -> None:
    """D-min does that: the mean of a flight, held against each row, called it a gain that did not fly."""

    def raised(lower: np.ndarray) -> np.ndarray:
        return np.where(np.abs(lower) > np.quantile(np.abs(lower), 0.9), 2.0, 1.0) * lower

    assert with_d(logged(corpus / "firmware" / STICKS), raised).agrees


@pytest.mark.thorough
def test_a_d_beyond_both_of_its_gains_did_not_fly_with_them(corpus: Path) -> None:
    """Half as much again as the higher one."""
    found = with_d(logged(corpus / "firmware" / STICKS), lambda lower: 3.0 * lower)
    assert (found.reason, found.parameter) == (ReplayReason.GAIN_DIFFERS, "d_roll")


def test_d_of_a_slow_log_is_taken_as_logged(corpus: Path) -> None:
    """500 Hz alias what D amplifies."""
    found = replayed(logged(corpus / "blackbox" / "bf42-btfl002.bbl"))["roll"]
    assert found.agrees
    assert found.as_logged == ("I", "D", "FF")


def test_a_dynamic_notch_that_nobody_measured_is_named(corpus: Path) -> None:
    """Without the unfiltered gyro nothing tells its delay."""
    log = logged(corpus / "blackbox" / "bf42-btfl002.bbl")
    kinds = {one.kind for one in controllers(log, log.parameters).remarks}
    assert RemarkKind.NOTCH_UNKNOWN in kinds


def test_a_header_without_gains_closes_no_loop(corpus: Path) -> None:
    """The missing ones are named."""
    log = logged(corpus / "firmware" / STICKS)
    found = controllers(log, {name: one for name, one in log.parameters.items() if not name.startswith("p_")})
    assert not found.axes
    assert "p_roll" in found.remarks[-3].values


def test_a_gain_below_zero_is_none(corpus: Path) -> None:
    """Of a damaged header; the other axes are not concerned."""
    log = logged(corpus / "firmware" / STICKS)
    assert set(controllers(log, {**log.parameters, "d_pitch": -1e9}).axes) == {"roll", "yaw"}


@pytest.mark.parametrize(
    ("modes", "version", "per_s"),
    [
        (("Angle",), (3, 1), 5.0),
        (("Angle",), (2025, 12), 5.0),
        (("Horizon",), (4, 4), 7.5),
        (("Horizon",), (4, 5), 3.75),
        (("Angle", "Horizon"), (4, 3), 7.5),
        (("Angle", "Horizon"), (4, 5), 5.0),
    ],
)
def test_levelling_is_tenths_of_a_rate_per_angle(
    modes: tuple[str, ...], version: tuple[int, int], per_s: float
) -> None:
    """Before 4.5 horizon mode has a gain of its own, since then hundredths of that of angle mode."""
    header = {"levelPID[0]": 50.0, "levelPID[1]": 75.0}
    assert angle_gain_per_s(header, modes, version) == pytest.approx(per_s)


def test_horizon_mode_never_levels_by_more_than_angle_mode() -> None:
    """Since 4.5: ``MIN(I / 100, 1)``."""
    header = {"levelPID[0]": 50.0, "levelPID[1]": 180.0}
    assert angle_gain_per_s(header, ("Horizon",), (2025, 12)) == pytest.approx(5.0)


def in_mode(log: FlightLog, name: str) -> FlightLog:
    """Return a log that says that it flew in a mode."""
    return replace(log, modes=(ModeChange(time_s=0.0, position=0, name=name),))


def test_an_angle_loop_flies_around_roll_and_pitch_alone(corpus: Path) -> None:
    """Yaw stays a rate in every mode, and acro mode has none."""
    log = logged(corpus / "firmware" / STICKS)
    flown_in = {name: controllers(in_mode(log, name), log.parameters).axes for name in ("Acro", "Angle")}
    assert {axis: one.angle_gain_per_s for axis, one in flown_in["Angle"].items()} == {
        "roll": 5.0,
        "pitch": 5.0,
        "yaw": None,
    }
    assert all(one.angle_gain_per_s is None for one in flown_in["Acro"].values())


def test_the_angle_loop_adds_its_gain_over_s_to_what_the_rate_error_makes(corpus: Path) -> None:
    """P and I act on the set-point that it makes, D does not; what it adds is as late as the attitude."""
    log = in_mode(logged(corpus / "firmware" / STICKS), "Angle")
    roll = controllers(log, log.parameters).axes["roll"]
    frequency_hz = np.array([1.0, 3.0])
    plant = true_plant(corpus, STICKS, "roll")
    found = close(roll, plant, frequency_hz)
    assert found.full is not None
    s = 2j * np.pi * frequency_hz
    body = plant.response(frequency_hz, roll.period_s)[0]
    by_angle = (found.full - found.rate)[0] / (body * roll.error.response(frequency_hz))
    np.testing.assert_allclose(np.abs(by_angle), np.abs(5.0 / s), rtol=1e-3)
    late_s = -(np.angle(by_angle * s / 5.0)) / (2.0 * np.pi * frequency_hz)
    np.testing.assert_allclose(late_s, 0.005 + 3.0 * 0.5098 / (2.0 * np.pi * 50.0), atol=3e-4)


def test_the_autopilot_hands_on_controller_and_rows(corpus: Path) -> None:
    """Through the folder's way in."""
    log, autopilot = logged(corpus / "firmware" / STICKS), named("betaflight")
    found = autopilot.controllers(log, log.parameters)
    assert found is not None
    assert set(autopilot.replay_inputs(log, found, ())) == set(AXES)


def true_plant(corpus: Path, name: str, axis: str) -> Plant:
    """Return the simulated vehicle's axis over the flight; yaw with its rotors' reaction to small changes.

    Least squares over the flight weighs the fastest and largest changes most, which no crossover is made of.
    """
    truth = json.loads((corpus / "firmware" / name).with_suffix(".truth.json").read_text())
    model, number = truth["linear_model"], AXES.index(axis)
    B = model["B_roll_pitch_yaw_ls_flight"][number]
    damping = -model["D_per_s_FRD"][number][number]
    lag_s = truth["vehicle"]["motor_lag_s"][0]
    numbers = (B, damping, lag_s, truth["delays"]["gyro_sample_to_thrust_command_s"])
    lead_s = model["E_yaw_mean"] / B if axis == "yaw" else 0.0
    return Plant(*(np.array([value]) for value in numbers), lead_s=lead_s)


def true_margins(corpus: Path, name: str, axis: str, **changes: float) -> Margins:
    log = logged(corpus / "firmware" / name)
    log = replace(log, parameters={**log.parameters, **changes})
    controller = controllers(log, log.parameters).axes[axis]
    frequency_hz = grid_hz(controller.period_s)
    loop = close(controller, true_plant(corpus, name, axis), frequency_hz)
    return margins_of(frequency_hz, loop.rate, integrators(controller), np.array([False]), 1e9)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("name", [STICKS, thorough(CHIRP)])
def test_the_true_vehicles_margins_are_inside_the_intervals(
    corpus: Path, analyzed: Analyzed, name: str, axis: str
) -> None:
    """Phase, gain and crossover of the rate loop."""
    result = analyzed(corpus / "firmware" / name)
    assert result.closed_loop is not None
    margins, true = result.closed_loop.axes[axis].margins, true_margins(corpus, name, axis)
    assert margins is not None
    for figure in ("phase_margin_deg", "gain_margin_db", "crossover_hz"):
        low, high = getattr(margins.rate, figure).ci95
        slack = 2e-3 * getattr(true, figure).value
        assert low - slack <= getattr(true, figure).value <= high + slack


@pytest.mark.thorough
@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("name", [STICKS, CHIRP])
def test_a_cutoff_of_d_that_the_replay_does_not_see_hardly_changes_the_phase_margin(
    corpus: Path, name: str, factor: float
) -> None:
    """At half or twice its value, which D-max hides: by 0.3 degrees at most."""
    cutoff_hz = factor * logged(corpus / "firmware" / name).parameters["dterm_lpf2_static_hz"]
    found = true_margins(corpus, name, "roll", dterm_lpf2_static_hz=cutoff_hz)
    true = true_margins(corpus, name, "roll")
    assert abs(found.phase_margin_deg.value - true.phase_margin_deg.value) < 0.3


def swept(corpus: Path, axis: str, start_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what the chirp shows of the rate over the set-point, by frequency, and the model of it."""
    log = logged(corpus / "firmware" / CHIRP)
    setpoint, rate = (log.candidates(name)[0] for name in ("body_rate_setpoint", "body_rate"))
    rows = (rate.time_s > start_s) & (rate.time_s < start_s + 20.6)
    x, y = (one.values[rows, AXES.index(axis)].astype(float) for one in (setpoint, rate))
    frequency_hz, cross = signal.csd(x, y, 1000.0, nperseg=4096)
    found = cross / signal.welch(x, 1000.0, nperseg=4096)[1]
    known = (frequency_hz > 1.5) & (frequency_hz < 31.0)
    controller = controllers(log, log.parameters).axes[axis]
    loop = close(controller, true_plant(corpus, CHIRP, axis), frequency_hz[known])
    return frequency_hz[known], found[known], loop.target_to_rate[0]


def test_yaws_broken_loop_is_what_the_chirp_shows(corpus: Path) -> None:
    """Without D it is T / (1 - T) of the set-point's response T; yaw's integral knows no relax."""
    _, measured, modelled = swept(corpus, "yaw", 57.8)
    broken, expected = (one / (1.0 - one) for one in (measured, modelled))
    np.testing.assert_allclose(np.abs(broken / expected), 1.0, atol=0.08)
    np.testing.assert_allclose(np.degrees(np.angle(broken / expected)), 0.0, atol=5.0)


@pytest.mark.parametrize(("axis", "start_s"), [("roll", 11.8), ("pitch", 34.8)])
def test_above_the_integrals_band_the_closed_loop_is_what_the_chirp_shows(
    corpus: Path, axis: str, start_s: float
) -> None:
    """Below it relax holds the integral back as the set-point moves; beyond 28 Hz rounding hides all."""
    frequency_hz, measured, modelled = swept(corpus, axis, start_s)
    high = (frequency_hz > 15.0) & (frequency_hz < 28.0)
    np.testing.assert_allclose(np.abs(measured / modelled)[high], 1.0, atol=0.1)
    np.testing.assert_allclose(np.degrees(np.angle(measured / modelled)[high]), 0.0, atol=7.0)


def test_the_gain_per_unit_of_the_pid_sum_is_that_of_the_true_vehicle(
    corpus: Path, analyzed: Analyzed
) -> None:
    """B in deg/s^2 per thousandth, as an ADRC would be told it."""
    loop = analyzed(corpus / "firmware" / STICKS).closed_loop
    assert loop is not None
    told = closed_loop_dict(loop, {})["axes"]["roll"]["control_gain"]["deg_s2_per_own_unit"]
    true = true_plant(corpus, STICKS, "roll").effectiveness[0] * PER_RADIAN
    assert told["unit"] == "unit of the PID sum"
    assert told["ci95"][0] < true < told["ci95"][1]


def test_no_prediction_is_announced_where_none_is_made(corpus: Path, analyzed: Analyzed) -> None:
    """Moving sticks hold the integral back."""
    view = loop_view(analyzed(corpus / "firmware" / STICKS))
    assert "predict" not in view.intro
    assert "b0" in view.sentences[-1]
