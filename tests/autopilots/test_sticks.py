"""Set-points from the sticks: curves by their closed forms, both ways on logs that hold set-points too."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from quadid_logs.autopilots.betaflight.dialect import common_settings, firmware_of, settings_of
from quadid_logs.autopilots.betaflight.sticks import (
    Sticks,
    sticks_of,
    straight_by_p,
    straight_sticks,
    told_by_p,
)
from quadid_logs.containers.blackbox import BlackboxContent, read_content
from tests.marks import thorough_but

TIME_S = 1e-3 * np.arange(3)


def sticks(
    centre: float, expo: float, full: float, version: tuple[int, ...] = (3, 4, 0), **settings: float
) -> Sticks:
    """Return curves that are the same on all axes."""
    named = {"rc_rates": centre, "rc_expo": expo, "rates": full}
    header = {f"{name}[{axis}]": value for name, value in named.items() for axis in range(3)}
    found = sticks_of(header | settings, version)
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("kind", "rates", "command", "expected"),
    [
        # 200 a unit of rc_rate, over 1 minus the super rate at the end.
        (0, (100, 0, 70), 500.0, 200.0 / 0.3),
        (0, (100, 0, 70), -250.0, -100.0 / 0.65),
        # Above 2 the rate grows 15.54 times as fast.
        (0, (250, 0, 0), 250.0, 0.5 * 200.0 * (2.5 + 14.54 * 0.5)),
        # Expo: x (1 - e) + e x^4, the sign kept.
        (0, (100, 40, 0), -250.0, -200.0 * (0.5 * 0.6 + 0.4 * 0.5**4)),
        (0, (255, 0, 99), 500.0, 1998.0),
        (1, (37, 50, 80), 500.0, 370.0 * 1.8),
        (1, (37, 50, 0), 250.0, 370.0 * 0.5 * (1.0 + 0.5 * (0.25 - 1.0))),
        (2, (100, 0, 70), 500.0, 200.0 / 0.3),
        (2, (100, 30, 70), 250.0, 200.0 * (0.5 * 0.7 + 0.3 * 0.125) / 0.65),
        (3, (7, 0, 67), 500.0, 670.0),
        (3, (7, 50, 67), 250.0, 35.0 + 600.0 * 0.5 * (0.5 * 0.5**5 + 0.5 * 0.5)),
        (4, (100, 0, 67), 500.0, 670.0),
        (4, (100, 0, 67), 250.0, 100.0 / (1.0 - 0.5 * (1.0 - 200.0 / 670.0))),
    ],
)
def test_each_kind_of_rates_is_its_curve(
    kind: int, rates: tuple[float, float, float], command: float, expected: float
) -> None:
    """Betaflight's, RaceFlight's, KISS', actual and quick ones."""
    found = sticks(*rates, version=(4, 3, 0), rates_type=kind).set_points(np.full((3, 3), command), TIME_S)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize(("version", "away"), [((3, 1, 3), 0.5 * 0.6 + 0.4 * 0.5**4), ((3, 1, 4), 0.5)])
def test_until_3_1_3_the_super_rate_acted_on_the_curved_stick(version: tuple[int, ...], away: float) -> None:
    """A change of February 2017, which no header names."""
    curved = 0.5 * 0.6 + 0.4 * 0.5**4
    found = sticks(100, 40, 70, version).set_points(np.full((3, 3), 250.0), TIME_S)
    np.testing.assert_allclose(found, 200.0 * curved / (1.0 - 0.7 * away), rtol=1e-12)


def test_yaw_follows_with_a_limited_slope() -> None:
    """An acc_limit_yaw of 100 is 10 000 deg/s^2: 10 deg/s a millisecond."""
    command = np.zeros((200, 3))
    command[50:] = 500.0
    found = sticks(100, 0, 70, acc_limit_yaw=100.0).set_points(command, 1e-3 * np.arange(200))
    np.testing.assert_allclose(np.diff(found[49:110, 2]), 10.0)
    assert found[-1, 2] == pytest.approx(200.0 / 0.3)
    assert found[50, 0] == pytest.approx(200.0 / 0.3)


@pytest.mark.parametrize(
    ("version", "expected"), [((3, 1, 5), 100.0), ((3, 4, 0), 100.5), ((4, 0, 0), 100.0)]
)
def test_interpolated_sticks_were_cut_to_whole_numbers(version: tuple[int, ...], expected: float) -> None:
    """From 3.2 until 4.0; yaw is not interpolated."""
    found = sticks(100, 0, 0, version, rc_interpolation=2.0).set_points(np.full((3, 3), 100.0), TIME_S)
    np.testing.assert_allclose(found[0, :2], 0.4 * expected)
    assert found[0, 2] == pytest.approx(40.0)


def test_the_dead_band_is_no_part_of_the_range_since_4_2() -> None:
    """What is left of 500 is the whole stick."""
    command = np.full((3, 3), 480.0)
    new, old = (
        sticks(100, 0, 0, version, deadband=20.0).set_points(command, TIME_S)[0]
        for version in ((4, 2, 0), (4, 1, 0))
    )
    np.testing.assert_allclose(new, [200.0, 200.0, 192.0])
    np.testing.assert_allclose(old, 192.0)


@pytest.mark.parametrize(
    "hostile",
    [
        {"rc_rates[0]": math.nan},
        {"rates[2]": -1.0},
        {"rc_expo[1]": 1e9},
        {"rates_type": 7.0},
        {"rates_type": 0.5},
    ],
)
def test_rates_that_no_firmware_holds_make_no_set_points(hostile: dict[str, float]) -> None:
    """A damaged header may hold any number."""
    header = {f"{name}[{axis}]": 50.0 for name in ("rc_rates", "rc_expo", "rates") for axis in range(3)}
    assert sticks_of(header, (3, 4)) is not None
    assert sticks_of(header | hostile, (3, 4)) is None


@pytest.mark.parametrize("missing", ["rc_rates[0]", "rc_expo[1]", "rates[2]"])
def test_a_header_without_rates_makes_no_set_points(missing: str) -> None:
    """None of them has a default that flew for sure."""
    header = {f"{name}[{axis}]": 50.0 for name in ("rc_rates", "rc_expo", "rates") for axis in range(3)}
    assert sticks_of({name: value for name, value in header.items() if name != missing}, (3, 4)) is None


@pytest.mark.parametrize("kind", range(5))
@pytest.mark.parametrize("rates", [(0.0, 0.0, 0.0), (65535.0, 65535.0, 65535.0), (1.0, 255.0, 255.0)])
def test_extreme_rates_give_finite_set_points(kind: int, rates: tuple[float, float, float]) -> None:
    """Within the firmware's own limit."""
    command = np.linspace(-1e6, 1e6, 9)[:, np.newaxis] * np.ones(3)
    found = sticks(*rates, rates_type=kind).set_points(command, 1e-3 * np.arange(9))
    assert np.abs(found).max() <= 1998.0


def test_sticks_behind_their_curve_ask_in_proportion() -> None:
    """As INAV logs them."""
    found = straight_sticks([600.0, 500.0, 200.0])
    assert found is not None
    np.testing.assert_allclose(found.set_points(np.full((3, 3), 250.0), TIME_S)[0], [300.0, 250.0, 100.0])
    assert straight_sticks([600.0, math.nan, 200.0]) is None


@pytest.fixture(scope="module")
def by_p() -> tuple[np.ndarray, np.ndarray]:
    """Sticks and rates of no relation to each other."""
    rng = np.random.default_rng(0)
    return rng.integers(-400, 400, (4000, 3)).astype(float), rng.normal(0.0, 200.0, (4000, 3))


def test_p_tells_what_a_stick_asks_for(by_p: tuple[np.ndarray, np.ndarray]) -> None:
    """Whatever its gain; P of yaw is limited, and rounded like the others."""
    command, rate = by_p
    p = np.rint([1.2, 1.4, 2.0] * ([1.5, 1.6, 0.9] * command - rate))
    p[:, 2] = np.clip(p[:, 2], -400, 400)
    found = straight_by_p(command, rate, p, np.ones(4000, np.bool_))
    np.testing.assert_allclose(found, [1.5, 1.6, 0.9], rtol=2e-3)


def test_p_of_a_mode_that_levels_tells_nothing(by_p: tuple[np.ndarray, np.ndarray]) -> None:
    """There it follows an angle."""
    command, rate = by_p
    angle = np.cumsum(rate, axis=0) * 5e-2
    p = np.rint(1.4 * (1.5 * command - angle - rate))
    assert straight_by_p(command, rate, p, np.ones(4000, np.bool_)) is None


def test_p_that_grows_with_the_rate_tells_nothing(by_p: tuple[np.ndarray, np.ndarray]) -> None:
    """A loop of that sign cannot fly."""
    command, rate = by_p
    assert straight_by_p(command, rate, command + rate, np.ones(4000, np.bool_)) is None


@pytest.mark.parametrize("flown", [0, 1])
def test_p_tells_which_kind_of_rates_flew(flown: int) -> None:
    """RaceFlight's came with 3.3, and no header named the kind before 4.1."""
    rng = np.random.default_rng(1)
    command, rate = rng.integers(-400, 400, (2000, 3)).astype(float), rng.normal(0.0, 100.0, (2000, 3))
    true = sticks(37, 50, 80, (3, 3, 0), rates_type=flown)
    p = np.rint(1.4 * (true.set_points(command, 1e-3 * np.arange(2000)) - rate))
    assert told_by_p(sticks(37, 50, 80, (3, 3, 0)), (3, 3, 0), command, rate, p).kind == flown
    assert told_by_p(sticks(37, 50, 80, (3, 2, 0)), (3, 2, 0), command, rate, p).kind == 0


def log_of(content: BlackboxContent) -> tuple[Sticks, dict[str, float], np.ndarray, np.ndarray, np.ndarray]:
    """Return curves, settings, times, sticks and logged set-points [deg/s]."""
    version = firmware_of(content.header.texts).version
    settings = common_settings(settings_of(content.header.texts), version)
    found, main = sticks_of(settings, version), content.tables["I"]
    assert found is not None
    tenths = 0.1 if settings.get("blackbox_high_resolution") else 1.0
    command, logged = (
        tenths * np.column_stack([main.columns[f"{name}[{axis}]"].astype(float) for axis in range(3)])
        for name in ("rcCommand", "setpoint")
    )
    return found, settings, main.columns["time"].astype(float) * 1e-6, command, logged


def rms(values: np.ndarray) -> np.ndarray:
    """Return the root of the mean square by axis."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


@pytest.mark.parametrize(("name", "number"), [("bf42-btfl002", 0), ("several-logs-in-one-file", 4)])
def test_set_points_of_sticks_are_those_that_4_2_logs(corpus: Path, name: str, number: int) -> None:
    """To the rounding of whole degrees per second, which alone is 0.29 of them."""
    found, _, time_s, command, logged = log_of(read_content(corpus / f"blackbox/{name}.bbl", number=number))
    off = rms(found.set_points(command, time_s) - logged)
    assert (np.sqrt(np.maximum(off**2 - 1.0 / 12.0, 0.0)) < 0.01 * rms(logged)).all()


@pytest.mark.parametrize("name", ["firmware/bf_quad_sticks", "blackbox/bf431-freestyle"])
def test_since_4_3_the_logged_set_points_are_those_of_sticks_smoothed(corpus: Path, name: str) -> None:
    """Three poles at the header's cut-off, and a time of some loops that all rows have in common."""
    found, settings, time_s, command, logged = log_of(read_content(corpus / f"{name}.bbl"))
    period_s, n_loops = float(np.median(np.diff(time_s))), 8
    smooth = np.repeat(found.set_points(command, time_s), n_loops, axis=0)
    cutoff_hz = settings["rc_smoothing_active_cutoffs_ff_sp_thr[1]"] * 1.961459177
    step = 2.0 * math.pi * cutoff_hz * period_s / n_loops
    for _ in range(3):
        smooth = lfilter([step / (1.0 + step)], [1.0, -1.0 / (1.0 + step)], smooth, axis=0)
    middle = slice(1000, len(logged) - 1000)
    rows = n_loops * np.arange(len(logged))[middle]
    off = [rms(smooth[rows + late] - logged[middle]) / rms(logged[middle]) for late in range(33)]
    assert (np.min(off, axis=0) < 0.01).all()


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    "name",
    thorough_but(
        ["log14"],
        ["hiro-highP-lowD", "hiro-lowP-lowD", "log14", "log17", "log21", "log26", "log29", "log36"],
    ),
)
def test_p_of_old_logs_weighs_set_points_as_it_weighs_the_gyro(corpus: Path, name: str, axis: int) -> None:
    """So both are in one unit: P is a gain times their difference, and the gain is the header's."""
    content = read_content(corpus / f"blackbox/bf3-{name}.bfl")
    main, version = content.tables["I"], firmware_of(content.header.texts).version
    settings = common_settings(settings_of(content.header.texts), version)
    found = sticks_of(settings, version)
    assert found is not None
    time_s = main.columns["time"].astype(float) * 1e-6
    stick = np.column_stack([main.columns[f"rcCommand[{k}]"].astype(float) for k in range(3)])
    wanted = found.set_points(stick, time_s)[:, axis]
    gyro, p = (main.columns[f"{name}[{axis}]"].astype(float) for name in ("gyroADC", "axisP"))
    flown = (main.columns["rcCommand[3]"] > 1100) & (main.columns["rcCommand[3]"] < 1600) & (np.abs(p) < 400)
    both = np.column_stack([wanted, -gyro])[flown]
    slopes = np.linalg.lstsq(both, (p + 0.5 * np.sign(p))[flown], rcond=None)[0]
    assert slopes[0] == pytest.approx(slopes[1], rel=0.01)
    header = settings[("p_roll", "p_pitch", "p_yaw")[axis]]
    assert slopes[1] == pytest.approx(0.032029 * header, rel=0.025)
