"""What is said of tracking is what the flight was made with."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.data.health import AxisSteps, Quantity
from quadid_logs.health.steps import Response, find_angle_lags, find_responses, find_steps, without_chirp
from quadid_logs.health.tracking import find_tracking
from tests.health.flights import coloured, delayed, grid, series


def flight(rate_hz: float, lag_s: float, time_constant_s: float, noise: float = 0.01):
    """Return a flight that follows with a known lag."""
    t = grid(rate_hz)
    asked = coloured(1, t.size, rate_hz, 4.0)
    rates = delayed(asked, rate_hz, lag_s, time_constant_s)
    rates += noise * np.random.default_rng(2).standard_normal(rates.shape)
    return series("body_rate", t, rates), series("body_rate_setpoint", t, asked), ((t[0], t[-1]),)


@pytest.mark.parametrize(("rate_hz", "lag_s"), [(1000.0, 0.008), (400.0, 0.025), (50.0, 0.06), (25.0, 0.09)])
def test_a_known_delay_is_found_from_slow_and_fast_logs(rate_hz: float, lag_s: float) -> None:
    """By cross-correlation: within 2 ms, or a tenth of a sample, and within the interval that is given."""
    rate, setpoint, intervals = flight(rate_hz, lag_s, 0.0)
    for one in find_responses(rate, setpoint, intervals).values():
        assert one.lag.value == pytest.approx(lag_s, abs=max(0.002, 0.1 / rate_hz))
        assert one.lag.ci95 is not None
        rounding_s = 0.1 / rate_hz
        assert one.lag.ci95[0] - rounding_s <= lag_s <= one.lag.ci95[1] + rounding_s


def test_the_step_response_of_a_first_order_loop_is_measured() -> None:
    """Half of the step is reached a delay and ln 2 time constants after it, and nothing overshoots."""
    rate, setpoint, intervals = flight(400.0, 0.01, 0.04)
    steps = find_steps(find_responses(rate, setpoint, intervals))
    assert steps is not None
    assert set(steps.axes) == {"roll", "pitch", "yaw"}
    for one in steps.axes.values():
        assert one.half_time.value == pytest.approx(0.01 + 0.04 * np.log(2.0), abs=0.006)
        assert one.overshoot.value < 0.05


def second_order(
    frequency_hz: float,
    damping: float,
    lag_s: float,
    asked_hz: float,
    noise: float = 0.0,
    most: float = 9.0,
    rate_hz: float = 400.0,
):
    """Return a flight whose loop is of second order, behind set-points that end at `asked_hz`."""
    t = grid(rate_hz)
    asked = np.clip(coloured(1, t.size, rate_hz, asked_hz), -most, most)
    s = 2j * np.pi * np.fft.rfftfreq(t.size, 1.0 / rate_hz)
    w = 2.0 * np.pi * frequency_hz
    response = np.exp(-lag_s * s) * w**2 / (s**2 + 2.0 * damping * w * s + w**2)
    rates = np.fft.irfft(np.fft.rfft(asked, axis=0) * response[:, None], t.size, axis=0)
    rates += noise * np.random.default_rng(3).standard_normal(rates.shape)
    return series("body_rate", t, rates), series("body_rate_setpoint", t, asked), ((t[0], t[-1]),)


@pytest.mark.parametrize(
    ("frequency_hz", "asked_hz", "noise"), [(4.0, 12.0, 0.0), (4.0, 3.0, 0.02), (9.0, 3.0, 0.02)]
)
def test_an_overshooting_loop_is_seen_to_overshoot(
    frequency_hz: float, asked_hz: float, noise: float
) -> None:
    """A damping ratio of 0.4 overshoots a step by 25 %, also where the loop is faster than the sticks."""
    found = find_responses(*second_order(frequency_hz, 0.4, 0.006, asked_hz, noise))
    assert set(found) == {"roll", "pitch", "yaw"}
    for one in found.values():
        assert one.steps is not None
        assert one.steps.overshoot.value == pytest.approx(0.254, abs=0.05)


def test_a_step_response_leaves_out_where_a_system_id_mode_injects() -> None:
    """From 20 to 30 s, with a pause of half a second in it, and from 40 to 50 s."""
    t = grid(100.0, 60.0)
    running = ((t >= 20.0) & (t <= 30.0)) | ((t >= 40.0) & (t <= 50.0))
    running &= ~((t > 24.0) & (t < 24.5))
    values = np.where(running, 0.1, 0.0)[:, np.newaxis]
    left = without_chirp(((10.0, 55.0),), series("sysid_chirp", t, values))
    assert np.array(left) == pytest.approx(np.array([[10.0, 20.0], [30.0, 40.0], [50.0, 55.0]]), abs=0.02)
    assert without_chirp(((10.0, 55.0),), None) == ((10.0, 55.0),)
    assert without_chirp(((10.0, 55.0),), series("sysid_chirp", t, 0.0 * values)) == ((10.0, 55.0),)


def test_an_end_that_is_not_one_widens_the_overshoot() -> None:
    """A rate a tenth too large shows a step that ends at 1.1: how much of it is overshoot nobody knows."""
    rate, setpoint, intervals = second_order(4.0, 1.0, 0.006, 6.0, 0.002)
    large = series("body_rate", rate.time_s, 1.1 * rate.values)
    for one in find_responses(large, setpoint, intervals).values():
        assert one.steps is not None
        assert one.steps.overshoot.ci95 is not None
        low, high = one.steps.overshoot.ci95
        assert low <= 0.0 <= high


def test_small_steps_are_judged_where_large_ones_meet_a_limit() -> None:
    """Half of the flight asks for ten times as much, and there the loop has no overshoot."""
    (calm, asked, _), (limited, fast, _) = (
        second_order(4.0, damping, 0.006, 6.0, 0.002, most=0.3) for damping in (0.4, 1.0)
    )
    step_s = float(calm.time_s[1] - calm.time_s[0])
    t = step_s * np.arange(2 * calm.time_s.size)
    rates = np.concatenate([0.1 * calm.values, limited.values])
    setpoint = np.concatenate([0.1 * asked.values, fast.values])
    found = find_responses(
        series("body_rate", t, rates), series("body_rate_setpoint", t, setpoint), ((t[0], t[-1]),)
    )
    told = find_steps(found)
    assert told is not None
    for one in told.axes.values():
        assert one.overshoot_large is not None
        assert one.overshoot.value == pytest.approx(0.254, abs=0.06)
        assert one.overshoot_large.value == pytest.approx(0.0, abs=0.05)
    assert "(large steps" in told.sentence


def test_a_slow_loop_reaches_half_of_a_step_when_it_does() -> None:
    """A loop of 4 Hz and half of critical damping needs 51.5 ms after its delay, as its closed form says."""
    for one in find_responses(*second_order(4.0, 0.5, 0.01, 1.0, 0.002)).values():
        assert one.steps is not None
        assert one.steps.half_time.value == pytest.approx(0.0615, abs=0.0015)


def test_between_the_samples_of_a_log_a_step_response_is_what_it_is() -> None:
    """Ten samples a tenth of a second: as the closed form says within 0.1 ms and a quarter of a percent."""
    damping, w = 0.4, 2.0 * np.pi * 9.0
    root = np.sqrt(1.0 - damping**2)
    t = np.arange(0.0, 0.1, 1e-5)
    step = 1.0 - np.exp(-damping * w * t) * (np.cos(root * w * t) + damping / root * np.sin(root * w * t))
    for one in find_responses(*second_order(9.0, damping, 0.01, 12.0, rate_hz=100.0)).values():
        assert one.steps is not None
        assert one.steps.half_time.value == pytest.approx(0.01 + t[np.argmax(step >= 0.5)], abs=1e-4)
        assert one.steps.overshoot.value == pytest.approx(step.max() - 1.0, abs=0.0025)


def test_what_a_slow_log_cannot_hold_widens_its_step_response() -> None:
    """Of 50 samples a second, 9 Hz and no noise: half of a step is half a millisecond off, and held."""
    damping, w = 0.7, 2.0 * np.pi * 9.0
    root = np.sqrt(1.0 - damping**2)
    t = np.arange(0.0, 0.1, 1e-5)
    step = 1.0 - np.exp(-damping * w * t) * (np.cos(root * w * t) + damping / root * np.sin(root * w * t))
    truth_s = 0.01 + t[np.argmax(step >= 0.5)]
    for one in find_responses(*second_order(9.0, damping, 0.01, 8.0, rate_hz=50.0)).values():
        assert one.steps is not None
        low, high = one.steps.half_time.ci95 or (np.nan, np.nan)
        assert low <= truth_s <= high
        assert high - low < 0.002


def test_of_three_axes_the_one_that_overshoots_is_named() -> None:
    """ "roll 5 %, pitch 21 %, yaw 5 %, more than the normal 20 %"."""

    def axis(overshoot: float, known_within: float = 0.004) -> Response:
        t = np.linspace(0.0, 0.5, 50)
        steps = AxisSteps(
            time_s=t,
            ideal=np.ones_like(t),
            curves=(),
            split_rad_s=0.0,
            overshoot=Quantity(overshoot, "1", (overshoot - known_within, overshoot + known_within)),
            half_time=Quantity(0.02, "s"),
        )
        return Response(Quantity(0.01, "s"), steps)

    found = find_steps({"roll": axis(0.05), "pitch": axis(0.21), "yaw": axis(0.05)})
    assert found is not None
    assert found.level == "high"
    assert "on pitch more than the normal 20 %" in found.sentence
    every = find_steps({"roll": axis(0.3)})
    assert every is not None
    assert "roll 30 ± 0 %, more than the normal 20 %" in every.sentence
    unsure = find_steps({"roll": axis(0.23, 0.09), "pitch": axis(0.05)})
    assert unsure is not None
    assert unsure.level == "fact"
    assert "roll 23 ± 9 %, pitch 5 ± 0 %, on roll possibly more than the normal 20 %" in unsure.sentence
    assert unsure.says_what_is_normal
    both = find_steps({"roll": axis(0.3), "pitch": axis(0.15, 0.18), "yaw": axis(0.05)})
    assert both is not None
    assert both.level == "high"
    assert "on roll more than the normal 20 %" in both.sentence
    assert both.sentence.endswith("and on pitch possibly more.")


def test_an_overshoot_that_may_be_more_than_normal_is_not_called_normal() -> None:
    """ "roll 15 ± 18 %, which is normal (below 20 %)" was said of a flown vehicle."""
    response = find_responses(*second_order(4.0, 0.5, 0.006, 1.0, 0.3))["roll"]
    assert response.steps is not None
    assert response.steps.overshoot.ci95 is not None
    assert response.steps.overshoot.value < 0.2 < response.steps.overshoot.ci95[1]
    found = find_steps({"roll": response})
    assert found is not None
    assert found.level == "fact"
    assert "possibly more than the normal 20 %" in found.sentence


def test_the_intervals_of_a_step_response_hold_the_truth() -> None:
    """Of 60 loops of second order in gusts, with sticks slower and faster than they are (docs/health.md)."""
    over_inside, over_below, half_inside = [], [], []
    for seed in range(60):
        rng = np.random.default_rng(10_000 + seed)
        rate_hz = float(rng.choice([50.0, 100.0, 250.0, 500.0]))
        flown_s = float(rng.choice([30.0, 60.0, 120.0]))
        frequency_hz, damping, lag_s = (
            rng.uniform(3.0, 10.0),
            rng.uniform(0.25, 0.9),
            rng.uniform(0.003, 0.012),
        )
        asked_hz, size = 10.0 ** rng.uniform(0.2, 1.0), 10.0 ** rng.uniform(-2.5, -0.7)
        t = grid(rate_hz, flown_s)
        asked = 2.0 * coloured(seed, t.size, rate_hz, asked_hz)
        s = 2j * np.pi * np.fft.rfftfreq(t.size, 1.0 / rate_hz)
        w = 2.0 * np.pi * frequency_hz
        response = np.exp(-lag_s * s) * w**2 / (s**2 + 2.0 * damping * w * s + w**2)
        rates = np.fft.irfft(np.fft.rfft(asked, axis=0) * response[:, np.newaxis], t.size, axis=0)
        rates += size * (
            3.3 * coloured(seed + 1000, t.size, rate_hz, 6.0)
            + 0.3 * np.random.default_rng(seed + 2000).standard_normal(rates.shape)
        )
        root = np.sqrt(1.0 - damping**2)
        after = np.arange(0.0, 0.5, 1e-4)
        step = 1.0 - np.exp(-damping * w * after) * (
            np.cos(root * w * after) + damping / root * np.sin(root * w * after)
        )
        half_s = lag_s + after[np.argmax(step >= 0.5)]
        overshoot = np.exp(-np.pi * damping / root)
        found = find_responses(
            series("body_rate", t, rates), series("body_rate_setpoint", t, asked), ((t[0], t[-1]),)
        )
        for one in found.values():
            if one.steps is None:
                continue
            low, high = one.steps.overshoot.ci95 or (np.nan, np.nan)
            over_inside.append(low <= overshoot <= high)
            over_below.append(overshoot > high)
            low, high = one.steps.half_time.ci95 or (np.nan, np.nan)
            half_inside.append(low <= half_s <= high)
    assert len(over_inside) > 150
    assert np.mean(over_inside) > 0.9
    assert np.mean(over_below) < 0.05
    assert np.mean(half_inside) > 0.9


def test_set_points_that_answer_the_rate_tell_no_response() -> None:
    """Hover in gusts: the angle loop makes the set-point of what the rate did, coherent and backwards."""
    t = grid(400.0)
    rates = coloured(5, t.size, 400.0, 3.0)
    angle = np.cumsum(rates - rates.mean(axis=0), axis=0) / 400.0
    angle -= delayed(angle, 400.0, 0.0, 1.0)  # it does not drift away
    asked = -4.5 * angle
    found = find_responses(
        series("body_rate", t, rates), series("body_rate_setpoint", t, asked), ((t[0], t[-1]),)
    )
    assert not found


def test_a_slow_log_gives_a_lag_and_no_step_response() -> None:
    """25 samples a second hold nothing of a step's first tenth."""
    found = find_responses(*flight(25.0, 0.09, 0.0))
    assert found
    assert all(one.steps is None for one in found.values())


def test_the_tracking_error_is_the_rms_of_what_is_missed() -> None:
    """An offset of a tenth, and nothing else."""
    t = grid(100.0)
    asked = coloured(1, t.size, 100.0)
    tracking = find_tracking(
        series("body_rate", t, asked + 0.1),
        series("body_rate_setpoint", t, asked),
        ((t[0], t[-1]),),
        {},
        of="rates",
    )
    assert tracking is not None
    for one in tracking.axes.values():
        assert one.error_rms.value == pytest.approx(0.1)
        assert one.setpoint_rms.value == pytest.approx(0.3, rel=0.02)


def test_an_error_of_heading_does_not_jump_at_north() -> None:
    """From 179 to -179 degrees are two degrees."""
    t = grid(50.0)
    angle = np.full((t.size, 3), np.radians(179.0))
    asked = np.full((t.size, 3), np.radians(-179.0))
    tracking = find_tracking(
        series("attitude", t, angle), series("attitude_setpoint", t, asked), ((t[0], t[-1]),), {}, of="angles"
    )
    assert tracking is not None
    assert tracking.axes["yaw"].error_rms.value == pytest.approx(np.radians(2.0))


def test_the_error_of_a_slow_log_is_that_of_its_own_rows() -> None:
    """Between uneven rows of 10 Hz a straight line took a sixth off the error of a flown hover."""
    rng = np.random.default_rng(5)
    t = grid(10.0) + rng.uniform(-0.04, 0.04, grid(10.0).size)
    asked, rates = (rng.standard_normal((t.size, 3)) for _ in range(2))
    one, other = series("body_rate", t, rates), series("body_rate_setpoint", t, asked)
    found = find_tracking(one, other, ((t[0] - 1.0, t[-1] + 1.0),), {}, of="rates")
    assert found is not None
    expected = np.sqrt(np.mean((asked - rates) ** 2, axis=0))
    assert [each.error_rms.value for each in found.axes.values()] == pytest.approx(expected)


def angles_off(by_deg: float, for_s: float):
    """Return angles that follow, but for one stretch in which roll is off while one angle is asked for."""
    t = grid(20.0)
    asked = np.radians(10.0) * coloured(5, t.size, 20.0, 1.0)
    asked[360 : 420 + round(20.0 * for_s), 0] = np.radians(3.0)
    flown = asked.copy()
    flown[400 : 400 + round(20.0 * for_s), 0] += np.radians(by_deg)
    return series("attitude", t, flown), series("attitude_setpoint", t, asked), ((t[0], t[-1]),)


@pytest.mark.parametrize(
    ("by_deg", "for_s", "level"),
    [(4.0, 10.0, "normal"), (9.0, 0.15, "normal"), (7.0, 1.0, "high"), (25.0, 1.0, "severe")],
)
def test_angles_that_stay_off_their_set_points_are_judged(by_deg: float, for_s: float, level: str) -> None:
    """As a published analyzer does: 5 and 10 degrees, for a quarter of a second, of a still set-point."""
    found = find_tracking(*angles_off(by_deg, for_s), {}, of="angles")
    assert found is not None
    assert found.level == level
    assert found.off is not None
    assert found.off.value == pytest.approx(0.0 if level == "normal" else for_s / 60.0, rel=0.01)


def test_the_time_of_the_largest_miss_is_told() -> None:
    """From 30 to 31 s; of a vehicle that crashed, a report said by how much and not when."""
    found = find_tracking(*angles_off(25.0, 1.0), {}, of="angles")
    assert found is not None
    assert "by up to 25 deg (at 30." in found.sentence


def test_a_vehicle_that_follows_quick_sticks_late_follows() -> None:
    """A flown hover with quick sticks, 117 ms late at 5 to 18 degrees, was told not to follow at all."""
    t = grid(20.0)
    asked = 0.6 * coloured(3, t.size, 20.0, 1.0)
    flown = delayed(asked, 20.0, 0.05, 0.15)
    assert np.degrees(np.abs(asked - flown).max()) > 10.0
    found = find_tracking(
        series("attitude", t, flown), series("attitude_setpoint", t, asked), ((t[0], t[-1]),), {}, of="angles"
    )
    assert found is not None
    assert found.level == "normal"


@pytest.mark.parametrize(("tilt_deg", "told"), [(2.0, "does not show whether"), (12.0, "Either these are")])
def test_set_points_that_never_change_tell_nothing_of_following(tilt_deg: float, told: str) -> None:
    """Flown logs hold zeros for set-points: some were called normal, others severe."""
    t = grid(100.0)
    angles = np.radians(tilt_deg) * np.sin(t)[:, np.newaxis] * [1.0, 1.0, 0.0]
    found = find_tracking(
        series("attitude", t, angles),
        series("attitude_setpoint", t, np.zeros((t.size, 3))),
        ((t[0], t[-1]),),
        {},
        of="angles",
    )
    assert found is not None
    assert found.level == "fact"
    assert told in found.sentence
    assert "normal" not in found.sentence


def test_a_nose_that_lags_behind_its_set_point_is_not_judged() -> None:
    """A turn is asked for at once, and takes its time."""
    actual, setpoint, intervals = angles_off(0.0, 1.0)
    turned = setpoint.values.copy()
    turned[400:500, 2] += np.radians(90.0)
    found = find_tracking(
        actual, series("attitude_setpoint", setpoint.time_s, turned), intervals, {}, of="angles"
    )
    assert found is not None
    assert found.level == "normal"


def test_rates_that_do_not_follow_are_told_from_those_that_do() -> None:
    """A loop that does not follow at all misses by all that is asked of it."""
    rate, setpoint, intervals = flight(100.0, 0.02, 0.0)
    still = rate.values.copy()
    still[:, 1] = 0.5 * np.random.default_rng(3).standard_normal(still.shape[0])
    following = find_tracking(rate, setpoint, intervals, {}, of="rates")
    lost = find_tracking(series("body_rate", rate.time_s, still), setpoint, intervals, {}, of="rates")
    assert following is not None
    assert lost is not None
    assert "Every axis follows" in following.sentence
    assert "Pitch misses the set-points by as much" in lost.sentence


def test_an_axis_that_turns_against_its_set_points_is_told_with_time_and_angle() -> None:
    """A flown one spun to the left for six seconds while the set-point asked for a turn to the right."""
    t = grid(10.0)
    asked = 0.02 * coloured(1, t.size, 10.0)
    rates = 0.5 * asked
    spins = (t >= 40.0) & (t < 46.0)
    asked[spins, 2], rates[spins, 2] = 1.7, -1.0
    rate, setpoint = series("body_rate", t, rates), series("body_rate_setpoint", t, asked)
    found = find_tracking(rate, setpoint, ((t[0], t[-1]),), {}, of="rates")
    assert found is not None
    assert found.level == "severe"
    assert "From 40.0 s on, yaw turned against its set-points for 6.0 s, at 57 deg/s" in found.sentence
    assert "Yaw miss" not in found.sentence
    assert found.findings == ("QL437",)
    # A system-ID mode moves a vehicle past its set-points.
    free = ((t[0], 39.0), (47.0, t[-1]))
    swept = find_tracking(rate, setpoint, ((t[0], t[-1]),), {}, of="rates", undisturbed=free)
    assert swept is not None
    assert not swept.findings
    assert "Yaw misses" in swept.sentence


@pytest.mark.parametrize(("pushed_rad_s", "for_s"), [(2.0, 0.5), (0.3, 2.0)])
def test_what_is_late_or_pushed_does_not_turn_against_its_set_points(
    pushed_rad_s: float, for_s: float
) -> None:
    """Half a second is late; 34 degrees in two seconds may be a gust."""
    t = grid(10.0)
    asked = np.full((t.size, 3), 0.1) + 0.01 * coloured(1, t.size, 10.0)
    rates = 0.5 * np.abs(coloured(2, t.size, 10.0))
    rates[(t >= 40.0) & (t < 40.0 + for_s), 2] = -pushed_rad_s
    rate, setpoint = series("body_rate", t, rates), series("body_rate_setpoint", t, asked)
    found = find_tracking(rate, setpoint, ((t[0], t[-1]),), {}, of="rates")
    assert found is not None
    assert "Roll, pitch and yaw miss" in found.sentence
    assert found.level == "fact"


@pytest.mark.parametrize(("missed", "normal"), [(0.6, True), (0.8, False)])
def test_a_loop_that_misses_more_than_it_follows_is_not_normal(missed: float, normal: bool) -> None:
    """A flown vehicle that missed 49 of the 60 deg/s which were asked was called normal."""
    t = grid(100.0)
    asked, gusts = (coloured(seed, t.size, 100.0) for seed in (1, 2))
    found = find_tracking(
        series("body_rate", t, asked + missed * gusts),
        series("body_rate_setpoint", t, asked),
        ((t[0], t[-1]),),
        {},
        of="rates",
    )
    assert found is not None
    assert ("which is normal" in found.sentence) is normal


@pytest.mark.parametrize(("rate_hz", "lag_s"), [(20.0, 0.16), (50.0, 0.12), (400.0, 0.09)])
def test_the_lag_of_angles_is_that_of_their_changes(rate_hz: float, lag_s: float) -> None:
    """A vehicle that leans by 15 degrees all the time, and follows late."""
    t = grid(rate_hz)
    asked = coloured(1, t.size, rate_hz, 1.5)
    flown = delayed(asked, rate_hz, lag_s)
    lean = np.radians([15.0, -10.0, 0.0])
    found = find_angle_lags(
        series("attitude", t, flown + lean), series("attitude_setpoint", t, asked + lean), ((t[0], t[-1]),)
    )
    # A slow log may leave an axis open; yaw is never told.
    assert found
    assert set(found) <= {"roll", "pitch"}
    for one in found.values():
        assert one.value == pytest.approx(lag_s, abs=max(0.005, 0.15 / rate_hz))
