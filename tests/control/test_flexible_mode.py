"""A frame that bends adds gain to a loop: what is told of the gain margin is not more than it leaves."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from quadid_logs import analyze
from quadid_logs.control.flexible_mode import Measured, frame_modes, with_earlier
from quadid_logs.control.frequency_response import Response
from quadid_logs.control.loop import close, gyro_filters, rate_loop
from quadid_logs.data.closed_loop import FrameModes, Modes, Plant
from quadid_logs.data.flight import FlightData
from quadid_logs.simulator import simulate
from tests.control.loop_flights import PERIOD_S, Vehicle, flight
from tests.marks import thorough, thorough_but

VEHICLE = Vehicle(P=0.05, D=0.0008)
PLANT = Plant(*(np.array([value]) for value in (300.0, -2.0, 0.03, PERIOD_S)))
FREQUENCY_HZ = np.geomspace(0.5, 150.0, 12_000)


def loop_of(natural_hz: float, damping: float, gain: float) -> np.ndarray:
    """Return the open rate loop of a vehicle whose gyro stands on a mode, by its equation of motion."""
    s, w = 2j * np.pi * FREQUENCY_HZ, 2.0 * np.pi * natural_hz
    mode = 1.0 - gain * s**2 / (s**2 + 2.0 * damping * w * s + w**2)
    return rate_loop(VEHICLE.controller, PLANT, FREQUENCY_HZ)[0] * mode


def gain_margin_db(loop: np.ndarray) -> float:
    crosses = (loop.imag[:-1] * loop.imag[1:] < 0.0) & (loop.real[:-1] < 0.0)
    return float(-20.0 * np.log10(np.max(-loop.real[:-1][crosses])))


def hover(
    loop: np.ndarray, seconds: float, noise: float = 1e-3, air: float = 0.0, line_hz: float = 0.0
) -> FlightData:
    """Return a flight: the gyro's noise, filtered, as the closed loop lets it pass.

    With ``air`` times as much power of torque, which passes the frame, and with a propeller's line.
    """
    still = flight({"roll": VEHICLE, "pitch": VEHICLE, "yaw": VEHICLE}, seconds=1.0)
    n = int(seconds / PERIOD_S)
    every_hz = np.maximum(np.fft.rfftfreq(n, PERIOD_S), 0.5)
    passes = gyro_filters(VEHICLE.controller, every_hz) / (
        1.0 + np.interp(every_hz, FREQUENCY_HZ, loop.real) + 1j * np.interp(every_hz, FREQUENCY_HZ, loop.imag)
    )
    white = np.fft.rfft(np.random.default_rng(5).standard_normal((n, 3)), axis=0)
    frame = np.abs(loop / loop_of(30.0, 0.05, 0.0))
    shape = np.abs(passes) * np.sqrt(1.0 + air * np.interp(every_hz, FREQUENCY_HZ, frame) ** 2)
    shape = shape * (1.0 + 6.0 * (np.abs(every_hz - line_hz) < 0.3))
    rate = noise * np.fft.irfft(white * shape[:, np.newaxis], n, axis=0)
    segment = replace(
        still.segments[0],
        time_s=PERIOD_S * np.arange(n),
        body_rate_rad_s=rate,
        torque=np.zeros((n, 3)),
        saturated=np.zeros(n, dtype=bool),
        reference=np.zeros((n, 3)),
    )
    return replace(still, segments=(segment,), flights=((0.0, seconds),), duration_s=seconds)


def allowed(data: FlightData, known_hz: float = 5.0, measured: Measured | None = None) -> FrameModes:
    found = frame_modes(
        data, 0, VEHICLE.controller, PLANT, fitted_hz=5.0, known_hz=known_hz, n=160, measured=measured
    )
    assert found is not None
    return found


def lowest_db(found: FrameModes) -> float:
    """Return the 2.5 % quantile of the gain margins of drawn vehicles."""
    modes = (loop_of(*each) for each in zip(*found.modes, strict=True))
    margins = [gain_margin_db(one) for one in modes]
    return float(np.quantile(margins[1:], 0.025))


@cache
def seen_with(natural_hz: float, damping: float, gain: float) -> tuple[float, FrameModes]:
    loop = loop_of(natural_hz, damping, gain)
    return gain_margin_db(loop), allowed(hover(loop, 40.0))


_LOW, _MIDDLE, _HIGH = (16.0, 0.03, 0.3), (27.0, 0.015, 0.5), (44.0, 0.02, 1.2)
MODES = [_LOW, (20.0, 0.01, 0.15), _MIDDLE, (35.0, 0.015, 0.7), _HIGH]


@pytest.mark.parametrize("mode", thorough_but([_MIDDLE], MODES))
def test_the_gain_margin_that_is_told_of_a_frame_that_bends_is_not_above_its_own(
    mode: tuple[float, float, float],
) -> None:
    """A mode leaves less than the rigid vehicle has, at a frequency that no manoeuvre reaches."""
    truth_db, found = seen_with(*mode)
    assert truth_db < gain_margin_db(loop_of(30.0, 0.05, 0.0)) - 1.0
    assert lowest_db(found) <= truth_db + 1.0


@pytest.mark.parametrize("air", [thorough(0.03), 0.3, thorough(3.0), thorough(30.0)])
@pytest.mark.parametrize("mode", thorough_but([_LOW], MODES))
def test_torque_of_the_air_that_shakes_the_frame_does_not_hide_how_much_it_bends(
    mode: tuple[float, float, float], air: float
) -> None:
    """A little of it makes a high line of a small part of the noise: the line alone tells no gain."""
    loop = loop_of(*mode)
    assert lowest_db(allowed(hover(loop, 40.0, air=air))) <= gain_margin_db(loop) + 1.0


@pytest.mark.thorough
def test_a_line_of_a_propeller_does_not_hide_a_mode_at_another_frequency() -> None:
    """Each third of an octave is looked at alone."""
    loop = loop_of(20.0, 0.01, 0.15)
    assert lowest_db(allowed(hover(loop, 40.0, line_hz=52.0))) <= gain_margin_db(loop) + 1.0


@pytest.mark.parametrize("mode", [(22.0, 0.01, 0.3), (27.0, 0.01, 0.6), (35.0, 0.01, 0.9)])
def test_a_line_that_a_sharp_mode_makes_in_a_minute_is_seen(mode: tuple[float, float, float]) -> None:
    """Above and below the mode the loop makes a line of it: not at its own frequency, but near it."""
    found = allowed(hover(loop_of(*mode), 60.0))
    assert found.seen
    assert found.line_hz == pytest.approx(mode[0], rel=0.25)
    assert found.line_height > 1.3


def test_a_stiff_frame_keeps_its_gain_margin_but_for_what_a_minute_cannot_rule_out() -> None:
    rigid = loop_of(30.0, 0.05, 0.0)
    found = allowed(hover(rigid, 60.0))
    assert not found.seen
    assert found.modes.gain[0] == 0.0
    assert gain_margin_db(rigid) - 6.0 < lowest_db(found)


def measured_up_to(highest_hz: float, loop: np.ndarray) -> Measured:
    """Return the response of a vehicle in third octaves, each as a mean over it, known to 3 %."""
    at_hz = 5.0 * 2.0 ** (np.arange(12) / 3.0)
    at_hz = at_hz[at_hz <= highest_hz]
    over_rigid = loop / loop_of(30.0, 0.05, 0.0)
    means = [np.mean(over_rigid[np.abs(np.log2(FREQUENCY_HZ / each)) < 1.0 / 6.0]) for each in at_hz]
    return Measured(Response(at_hz, np.array(means), np.full(at_hz.size, 0.03)))


@pytest.mark.thorough
def test_a_measured_response_without_a_skirt_rules_out_the_mode_above_it() -> None:
    """A propeller's line at 50 Hz might be a mode, if the response up to 33 Hz were not a stiff vehicle's."""
    stiff = loop_of(30.0, 0.05, 0.0)
    with_line = hover(stiff, 40.0, line_hz=50.0)
    blind, known = (
        lowest_db(allowed(with_line, measured=one)) for one in (None, measured_up_to(33.0, stiff))
    )
    assert blind < gain_margin_db(stiff) - 3.0
    assert known > gain_margin_db(stiff) - 1.0


@pytest.mark.thorough
@pytest.mark.parametrize("mode", thorough_but([_HIGH], [_LOW, _MIDDLE, _HIGH]))
def test_a_measured_response_hides_no_mode_whose_skirt_it_shows(mode: tuple[float, float, float]) -> None:
    loop = loop_of(*mode)
    found = allowed(hover(loop, 40.0), measured=measured_up_to(0.8 * mode[0], loop))
    assert lowest_db(found) <= gain_margin_db(loop) + 1.0


@pytest.mark.thorough
def test_a_log_that_shows_no_noise_rules_nothing_out() -> None:
    """Five seconds are no spectrum: what is told then is what a frame may do."""
    rigid = loop_of(30.0, 0.05, 0.0)
    short, long = (allowed(hover(rigid, seconds)) for seconds in (5.0, 60.0))
    assert short.visible_hz == 0.0
    assert lowest_db(short) < lowest_db(long) - 2.0


def test_no_mode_is_looked_for_where_the_measured_response_is_the_models() -> None:
    found = allowed(hover(loop_of(20.0, 0.01, 0.15), 40.0), known_hz=30.0)
    assert found.modes.natural_hz.min() > 29.5
    high = frame_modes(
        hover(loop_of(20.0, 0.01, 0.15), 40.0),
        0,
        VEHICLE.controller,
        PLANT,
        fitted_hz=5.0,
        known_hz=70.0,
        n=9,
    )
    assert high is None


def test_a_flight_that_excites_a_band_hard_leaves_no_line_at_its_edge() -> None:
    """A chirp ends where its band does: what the model leaves of it is no mode."""
    rigid = loop_of(30.0, 0.05, 0.0)
    still = hover(rigid, 60.0)
    time_s = still.segments[0].time_s
    swept = 0.3 * np.sin(2.0 * np.pi * (2.0 * time_s + 16.0 * time_s**2 / 120.0))
    moved = still.segments[0].body_rate_rad_s + swept[:, np.newaxis]
    assert not allowed(replace(still, segments=(replace(still.segments[0], body_rate_rad_s=moved),))).seen


def with_doublets(
    about: int, part: float, *, noise: float = 1e-3, width_s: float = 0.25, echo: float = 0.0
) -> FlightData:
    """Return a stiff vehicle with doublets about an axis, a part of which reaches all axes 2.5 ms late.

    With an echo 60 ms later, as nothing linear and small that the model knows of makes it.
    """
    still = hover(loop_of(30.0, 0.05, 0.0), 60.0, noise)
    segment = still.segments[0]
    cycle_s = segment.time_s % (20.0 * width_s)
    target = np.zeros((segment.n_samples, 3))
    target[:, about] = 1.2 * ((cycle_s < width_s) * 1.0 - ((cycle_s >= width_s) & (cycle_s < 2.0 * width_s)))
    every_hz = np.fft.rfftfreq(segment.n_samples, PERIOD_S)
    follows = close(VEHICLE.controller, PLANT, np.maximum(every_hz, 0.5)).target_to_rate[0]
    late = np.exp(-2j * np.pi * every_hz * 0.0025) + echo * np.exp(-2j * np.pi * every_hz * 0.06)
    followed = np.fft.irfft(np.fft.rfft(target[:, about]) * part * follows * late, segment.n_samples)
    rate = segment.body_rate_rad_s + followed[:, np.newaxis]
    return replace(still, segments=(replace(segment, body_rate_rad_s=rate, reference=target),))


def test_what_the_model_leaves_of_doublets_is_no_mode() -> None:
    """Their spectrum is a comb of lines every 4 Hz; here set-points reach the loop 2.5 ms late."""
    assert not allowed(with_doublets(about=0, part=1.0)).seen


@pytest.mark.parametrize("noise", [1e-4, thorough(1e-5)])
def test_a_comb_that_is_louder_than_the_noise_is_no_mode(noise: float) -> None:
    """It is as wide as its gaps: the noise is what stands in these, not the median."""
    assert not allowed(with_doublets(about=0, part=1.0, noise=noise, width_s=0.175, echo=0.5)).seen


@pytest.mark.parametrize("part", [0.02, 0.2])
def test_what_another_axis_doublets_do_to_an_axis_is_no_mode(part: float) -> None:
    """A vehicle couples its axes: roll and pitch then leave their comb in yaw."""
    assert not allowed(with_doublets(about=1, part=part)).seen


def test_doublets_of_another_axis_hide_no_mode_of_this_one() -> None:
    loop, shaken = loop_of(27.0, 0.01, 0.6), with_doublets(about=1, part=0.2)
    bends, stiff = hover(loop, 60.0).segments[0], hover(loop_of(30.0, 0.05, 0.0), 60.0).segments[0]
    segment = shaken.segments[0]
    rate = segment.body_rate_rad_s + bends.body_rate_rad_s - stiff.body_rate_rad_s
    found = allowed(replace(shaken, segments=(replace(segment, body_rate_rad_s=rate),)))
    assert found.seen
    assert found.line_hz == pytest.approx(27.0, rel=0.25)


def test_noise_that_falls_or_rises_towards_an_end_of_the_spectrum_is_no_mode() -> None:
    """As where the loop runs twice as fast as its rows, and its filters fall less than theirs would."""
    rigid = loop_of(30.0, 0.05, 0.0)
    still = hover(rigid, 60.0)
    segment = still.segments[0]
    every_hz = np.fft.rfftfreq(segment.n_samples, PERIOD_S)
    for power in (-2.0, 2.0):
        tilt = np.maximum(every_hz / 40.0, 0.1) ** power
        rate = np.fft.irfft(
            np.fft.rfft(segment.body_rate_rad_s, axis=0) * tilt[:, np.newaxis], segment.n_samples, axis=0
        )
        assert not allowed(replace(still, segments=(replace(segment, body_rate_rad_s=rate),))).seen


@pytest.mark.thorough
def test_rough_air_is_no_mode_of_the_frame() -> None:
    """A stiff vehicle, logged at 125 Hz: what its loop leaves of the gusts falls with frequency."""
    result = analyze(simulate("rough-air", seed=1, duration_s=50.0, rate_hz=125.0, autopilot="px4").log)
    assert not any(loop.frame.seen for loop in result.closed_loop.axes.values() if loop.frame is not None)


def test_modes_of_a_plant_are_cut_with_it() -> None:
    modes = Modes(*(np.array(each) for each in ([20.0, 30.0], [0.01, 0.02], [0.3, 0.0])))
    plants = Plant(*(np.repeat(value, 2) for value in PLANT[:4]), 0.0, modes)
    one = plants.at(slice(0, 1)).response(FREQUENCY_HZ[:10], PERIOD_S)
    assert one == pytest.approx(plants.response(FREQUENCY_HZ[:10], PERIOD_S)[:1])


def thirds(loop: np.ndarray) -> tuple[FrameModes, list[FrameModes]]:
    """Return what the last of three flights of 14 s allows, and what those before it allow."""
    whole = hover(loop, 42.0)
    (segment,) = whole.segments
    found = []
    for rows in np.array_split(np.arange(segment.n_samples), 3):
        arrays = {
            name: getattr(segment, name)[rows]
            for name in ("time_s", "body_rate_rad_s", "torque", "saturated", "reference")
        }
        part = replace(segment, **arrays)
        found.append(allowed(replace(whole, segments=(part,), duration_s=14.0)))
    return found[2], found[:2]


@pytest.mark.thorough
def test_three_short_flights_rule_out_more_than_one() -> None:
    now, earlier = thirds(loop_of(30.0, 0.05, 0.0))
    together = with_earlier(now, earlier, VEHICLE.controller, PLANT, 5.0)
    assert together is not None
    assert together.absent > now.absent
    assert lowest_db(together) > lowest_db(now)


@pytest.mark.thorough
def test_a_response_that_an_earlier_flight_confirms_leaves_no_mode_below() -> None:
    now, earlier = thirds(loop_of(30.0, 0.05, 0.0))
    together = with_earlier(now, earlier, VEHICLE.controller, PLANT, 40.0)
    assert together is not None
    assert np.min(together.modes.natural_hz) > 39.0
    assert with_earlier(now, earlier, VEHICLE.controller, PLANT, 70.0) is None


@pytest.mark.thorough
@pytest.mark.parametrize("mode", thorough_but([_MIDDLE], [mode for mode in MODES if mode[2] > 0.2]))
def test_flights_together_tell_no_more_gain_margin_than_a_frame_that_bends_has(
    mode: tuple[float, float, float],
) -> None:
    loop = loop_of(*mode)
    together = with_earlier(*thirds(loop), VEHICLE.controller, PLANT, 5.0)
    assert together is not None
    assert lowest_db(together) <= gain_margin_db(loop) + 1.0
