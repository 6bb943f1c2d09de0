"""Effects beside a linear response, in air that moves the vehicle: taken out, ruled out, or in the interval.

The flights are integrated here, sample by sample, and share nothing with the package's simulator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from operator import mul

import numpy as np
import pytest
from scipy.signal import lfilter

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData, InputDescription, Segment
from quadid_logs.data.model import SpectralFit
from quadid_logs.data.torque import AssumedExpo
from quadid_logs.identify.effect_columns import _late
from quadid_logs.identify.rotors import Rotors
from quadid_logs.identify.spectral import fit_axes, solve_flight
from quadid_logs.identify.spectral_effects import average_over_effects, fit_by_spectra
from quadid_logs.maths.recurrence import lag
from tests.marks import thorough

PERIOD_S, LAG_S, ANGLE_GAIN = 0.005, 0.04, 4.0
GAIN, DAMPING = np.array([180.0, 140.0, 16.0]), np.array([-1.0, -1.2, -0.3])
#: Quad X: thrusts of the rotors to torques about roll, pitch and yaw.
PER_THRUST = 0.25 * np.array([[-1.0, 1.0, 1.0, -1.0], [1.0, -1.0, 1.0, -1.0], [1.0, 1.0, -1.0, -1.0]])
TO_THRUST = np.linalg.pinv(PER_THRUST)

#: Thrust of a rotor in hover, in the unit of the torques.
HOVER = 2.0

#: In plain floats: sample by sample, numpy takes several times as long.
Torque = Sequence[float]
Loss = Callable[[Torque], Torque]
_TO_TORQUES, _TO_THRUSTS = PER_THRUST.tolist(), TO_THRUST.tolist()


def _clipped(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _product(rows: Sequence[Sequence[float]], values: Sequence[float]) -> list[float]:
    return [sum(map(mul, row, values)) for row in rows]


def _as_commanded(torque: Torque) -> Torque:
    return torque


def _dead(torque: Torque) -> Torque:
    """Nothing below 0.012, taken off any larger torque."""
    return [one - _clipped(one, 0.012) for one in torque]


def _dead_rotors(torque: Torque) -> Torque:
    """Each rotor ignores 0.02 of its command."""
    return _product(_TO_TORQUES, [one - _clipped(one, 0.02) for one in _product(_TO_THRUSTS, torque)])


def _limited(torque: Torque) -> Torque:
    return [_clipped(one, 0.045) for one in torque]


def _limited_pitch(torque: Torque) -> Torque:
    return [torque[0], _clipped(torque[1], 0.03), torque[2]]


def _fly(
    seed: int,
    loss: Loss = _as_commanded,
    *,
    gusts: float = 0.6,
    air_rad_s: float = np.pi,
    tilt_1_s2: float = 0.0,
    per_speed: float = 0.0,
    late_steps: int = 0,
    worth: np.ndarray | None = None,
    throttle: np.ndarray | None = None,
    spin_down: float = 1.0,
    hover: float = HOVER,
) -> FlightData:
    """Fly a minute in angle mode, in air of a density of power that falls above ``air_rad_s``.

    ``per_speed``: by how much 1 m/s turns roll and pitch back [rad/s^2]; ``late_steps``: the torque is logged
    so much later than it was given; ``worth`` (12000,): how much of it the rotors make, sample by sample;
    ``throttle``: as logged; ``spin_down``: so many times as slowly as up do rotors slow down, whose thrust
    goes with their speed squared; ``hover``: thrust of a rotor, so little that such rotors are hardly linear.
    """
    rng, n = np.random.default_rng(seed), 12000
    worths = [1.0] * n if worth is None else worth.tolist()
    steps = np.repeat(rng.uniform(-1.0, 1.0, (n // 60, 3)), 60, axis=0) * 0.15
    keep = np.exp(-PERIOD_S * air_rad_s)
    fresh = np.sqrt(1.0 - keep**2) * rng.standard_normal((n, 3))
    gust = gusts * lfilter([1.0], [1.0, -keep], fresh, axis=0) * np.array([1.0, 1.0, 0.1])
    lead, pace = (12.0 / GAIN).tolist(), PERIOD_S / LAG_S
    gains, dampings, leveled = GAIN.tolist(), DAMPING.tolist(), (1.0, 1.0, 0.0)
    rate = angle = thrust = over_ground = [0.0, 0.0, 0.0]
    speed = [math.sqrt(hover)] * 4
    rate_rows, setpoint_rows, torque_rows = [], [], []
    for step, blow, share in zip(steps.tolist(), gust.tolist(), worths, strict=True):
        setpoint = [ANGLE_GAIN * (to - at) for to, at in zip(step, angle, strict=True)]
        command = [k * (to - at) for k, to, at in zip(lead, setpoint, rate, strict=True)]
        rate_rows.append(rate)
        setpoint_rows.append(setpoint)
        if hover != HOVER:
            # What outputs do, and logs tell: a rotor gives nothing below none.
            command = _product(_TO_TORQUES, [max(one, -hover) for one in _product(_TO_THRUSTS, command)])
        torque_rows.append(command)
        if spin_down == 1.0 and hover == HOVER:
            thrust = [one + pace * (to - one) for one, to in zip(thrust, loss(command), strict=True)]
        else:
            for place, lift in enumerate(_product(_TO_THRUSTS, loss(command))):
                lacking = math.sqrt(max(hover + lift, 0.0)) - speed[place]
                speed[place] += pace / (1.0 if lacking > 0.0 else spin_down) * lacking
            thrust = _product(_TO_TORQUES, [one * one for one in speed])
        if per_speed:
            over_ground = [
                v + PERIOD_S * (9.81 * a - 0.3 * v) for v, a in zip(over_ground, angle, strict=True)
            ]
        rate = [
            w + PERIOD_S * (share * B * one + A * w + (tilt_1_s2 * a - per_speed * v) * level + air)
            for w, B, one, A, a, v, level, air in zip(
                rate, gains, thrust, dampings, angle, over_ground, leveled, blow, strict=True
            )
        ]
        angle = [a + PERIOD_S * w for a, w in zip(angle, rate, strict=True)]
    rates, setpoints, torque = (np.array(rows) for rows in (rate_rows, setpoint_rows, torque_rows))
    turned = np.vstack([np.zeros(3), PERIOD_S * np.cumsum(rates, axis=0)[:-1]])
    return FlightData(
        sample_period_s=PERIOD_S,
        segments=(
            Segment(
                time_s=PERIOD_S * np.arange(n),
                body_rate_rad_s=rates,
                torque=np.roll(torque, late_steps, axis=0),
                attitude_rad=turned,
                throttle=throttle,
                saturated=np.zeros(n, dtype=bool),
                reference=setpoints,
                command=setpoints + ANGLE_GAIN * turned,
                rotor_thrust=np.maximum(hover + torque @ TO_THRUST.T, 0.0),
            ),
        ),
        flights=(),
        sources={},
        input=InputDescription(kind="torque_command", unit="1", source="", torque_per_thrust=PER_THRUST),
        start_s=0.0,
        duration_s=n * PERIOD_S,
    )


@cache
def _flown(seed: int, loss: Loss = _as_commanded, **air: float) -> FlightData:
    """Return a flight that several tests look at, flown once."""
    return _fly(seed, loss, **air)  # type: ignore[arg-type]


@cache
def _fits(seed: int, loss: Loss = _as_commanded, **air: float) -> tuple[SpectralFit, ...]:
    """Return what is found in one of them, worked out once."""
    return fit_by_spectra(_flown(seed, loss, **air))


@cache
def _told_beside_asymmetry() -> tuple[tuple[SpectralFit, ...], tuple[SpectralFit, ...]]:
    """Return what is found beside rotors that slow down late, and beside a known effect of them."""
    data = _fly(3, gusts=0.3, spin_down=2.5)
    solution = solve_flight(data)
    assert solution is not None
    told = average_over_effects(solution, data)
    # The effects that were found are taken out of these axes, as if their size were known.
    known, _ = fit_axes(solution.axes)
    return tuple(told), tuple(known)


def _holds(fit: SpectralFit, axis: int) -> bool:
    return abs(fit.gain - GAIN[axis]) <= fit.half_width


@pytest.fixture(scope="module", params=[(0, 1, 2), thorough((3, 4, 5))], ids=str)
def without(request: pytest.FixtureRequest) -> list[tuple[SpectralFit, ...]]:
    """Flights without any effect."""
    return [_fits(seed) for seed in request.param]


def test_a_flight_without_effects_shows_none(without: list[tuple[SpectralFit, ...]]) -> None:
    """On any axis of any flight: at 95 % one in twenty was allowed before it was seen."""
    assert not any(fit.effects for fits in without for fit in fits)


def test_what_a_flight_rules_out_costs_little(without: list[tuple[SpectralFit, ...]]) -> None:
    """The intervals of roll and pitch stay below a fifth, and hold the truth."""
    assert all(fits[axis].is_sound and _holds(fits[axis], axis) for fits in without for axis in (0, 1))


def test_what_a_flight_leaves_open_widens_the_interval() -> None:
    """In air that hides small torques, a dead zone that may be there is part of the interval."""
    data = _fly(0, gusts=2.5)
    solution = solve_flight(data)
    assert solution is not None
    plain, averaged = solution.fits, fit_by_spectra(data)
    assert all(averaged[axis].half_width > 1.02 * plain[axis].half_width for axis in (0, 1))


def test_what_a_flight_leaves_open_moves_the_effectiveness_by_what_it_makes_on_the_mean() -> None:
    """A dead zone that air hides: it is not called found, and takes the effectiveness half of the way."""
    data = _fly(1, _dead, gusts=3.0)
    solution = solve_flight(data)
    assert solution is not None
    told = average_over_effects(solution, data)
    for axis in (0, 1):
        before, after = (fits[axis].gain / GAIN[axis] - 1.0 for fits in (solution.fits, told))
        assert not told[axis].effects
        assert before < 0.0
        assert 0.7 * before < after < 0.2 * before


@pytest.mark.parametrize(
    ("loss", "names"),
    [
        thorough(_dead, {"threshold", "rotor threshold"}),
        thorough(_dead_rotors, {"threshold", "rotor threshold"}),
        (_limited, {"limit"}),
    ],
    ids=["dead zone", "dead zone of rotors", "limit"],
)
@pytest.mark.parametrize("seed", [0, thorough(1)])
def test_torque_that_is_lost_is_taken_out(seed: int, loss: Loss, names: set[str]) -> None:
    """Without the effect the effectiveness is low, by 3 % at least; with it the truth is inside."""
    solution = solve_flight(_flown(seed, loss))
    assert solution is not None
    assert all(solution.fits[axis].gain < 0.97 * GAIN[axis] for axis in (0, 1))
    fits = _fits(seed, loss)
    assert names & set(fits[0].effects + fits[1].effects)
    assert all(_holds(fits[axis], axis) for axis in (0, 1))


@pytest.mark.thorough
@pytest.mark.parametrize("loss", [_dead, _limited], ids=["dead zone", "limit"])
def test_the_form_of_an_effect_is_part_of_the_interval(loss: Loss) -> None:
    """Known to half of what the effect takes, in 95 of 100 flights."""
    solution, fits = solve_flight(_flown(0, loss)), _fits(0, loss)
    assert solution is not None
    shown = [axis for axis in (0, 1) if fits[axis].effects]
    assert shown
    for axis in shown:
        assert fits[axis].half_width >= 0.5 * abs(fits[axis].gain - solution.fits[axis].gain)


def test_in_calm_air_a_dead_zone_leaves_the_truth_known_to_a_tenth() -> None:
    """Its size is known by what it does at other frequencies than the command's."""
    fits = _fits(2, _dead, gusts=0.1)
    for axis in range(2):
        assert "threshold" in fits[axis].effects
        assert abs(fits[axis].gain - GAIN[axis]) < 0.1 * GAIN[axis]


@pytest.mark.parametrize("tilt_1_s2", [-9.0, thorough(6.0)])
def test_a_moment_of_the_tilt_leaves_the_effectiveness_where_it_is(tilt_1_s2: float) -> None:
    """A pendulum, and a vehicle that tips over."""
    fits = fit_by_spectra(_fly(1, gusts=0.2, tilt_1_s2=tilt_1_s2))
    assert all(fits[axis].is_sound and _holds(fits[axis], axis) for axis in (0, 1))


@pytest.mark.parametrize("tilt_1_s2", [4.0, thorough(-4.0)])
def test_a_moment_of_the_tilt_that_no_flight_would_show_biases_by_less_than_a_third_of_the_interval(
    tilt_1_s2: float,
) -> None:
    """Every vehicle has one of some size: what the torque does against it is no lack of effectiveness."""
    off = []
    for seed in (0, 1):
        fits = fit_by_spectra(_fly(seed, gusts=0.2, tilt_1_s2=tilt_1_s2))
        off += [(fits[axis].gain - GAIN[axis]) / fits[axis].half_width for axis in (0, 1)]
    assert abs(float(np.mean(off))) < 0.3


@pytest.mark.parametrize("per_speed", [4.0, thorough(9.0)])
def test_a_moment_of_the_speed_leaves_the_effectiveness_where_it_is(per_speed: float) -> None:
    """What flies faster is pitched up: below some frequency the torque holds against that."""
    fits = fit_by_spectra(_fly(2, gusts=0.2, per_speed=per_speed))
    assert all(fits[axis].is_sound and _holds(fits[axis], axis) for axis in (0, 1))


@pytest.mark.thorough
def test_where_no_moment_of_the_speed_is_seen_low_frequencies_count() -> None:
    """They tell the effectiveness to a tenth of what it is with such a moment, or less."""
    calm, pitched_up = (_fits(2, gusts=0.2, per_speed=each)[0] for each in (0.0, 9.0))
    assert calm.half_width < 0.06 * GAIN[0]
    assert calm.half_width < pitched_up.half_width


@pytest.mark.thorough
def test_a_fit_in_time_is_told_of_moments_that_it_knows_nothing_of() -> None:
    """By a third of what they widen the interval of the spectra, or more; without them of next to nothing."""
    calm, pitched_up = (_fits(2, gusts=0.2, per_speed=each)[0] for each in (0.0, 9.0))
    wider = np.sqrt(pitched_up.half_width**2 - calm.half_width**2) / pitched_up.gain
    assert calm.by_effects < 0.25 * wider
    assert wider / 3.0 < pitched_up.by_effects < 2.0 * wider


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, thorough(1)])
def test_rotors_that_slow_down_late_are_taken_for_that(seed: int) -> None:
    """Three times as slowly as they speed up: no dead zone explains it, and the truth is inside."""
    fits = _fits(seed, spin_down=3.0)
    assert all(set(fits[axis].effects) == {"asymmetry"} for axis in (0, 1))
    assert all(_holds(fits[axis], axis) for axis in range(3))


@pytest.mark.parametrize("seed", [0, thorough(1), thorough(2)])
def test_large_torques_of_rotors_whose_speeds_lag_leave_the_effectiveness_where_it_is(seed: int) -> None:
    """A linear lag of the torque takes it for lower; nothing of that is an asymmetry."""
    data = _flown(seed, gusts=0.05, hover=0.15)
    linear = fit_by_spectra(replace(data, input=None))
    fits = fit_by_spectra(data)
    for axis in (0, 1):
        assert linear[axis].gain < 0.95 * GAIN[axis]
        assert abs(fits[axis].gain - GAIN[axis]) < 0.5 * abs(linear[axis].gain - GAIN[axis])
        assert fits[axis].is_sound
        assert _holds(fits[axis], axis)
    assert not any("asymmetry" in fit.effects for fit in fits)


def test_rotors_whose_thrust_is_not_known_are_not_asked_how_they_slow_down() -> None:
    """Torques alone do not tell which rotors slow down."""
    data = replace(_flown(0, spin_down=3.0), input=None)
    assert not any("asymmetry" in fit.effects for fit in fit_by_spectra(data))


def test_what_late_rotors_take_is_what_they_lack_behind_one_lag() -> None:
    """Integrated rotor by rotor: behind the lag, the torque without it is the one that rotors made."""
    rng, n, up_s, down_s = np.random.default_rng(5), 6000, 0.03, 0.09
    mean_s = 2.0 / (1.0 / up_s + 1.0 / down_s)
    torque = lag(rng.standard_normal((n, 3)), PERIOD_S, 0.1) * np.array([0.05, 0.05, 0.03])
    mixing, speed = np.linalg.pinv(PER_THRUST), np.full(4, np.sqrt(HOVER))
    made = np.empty((n, 3))
    for row, target in enumerate(np.sqrt(HOVER + torque @ mixing.T)):
        lacking = target - speed
        speed = target - lacking * np.exp(-PERIOD_S / np.where(lacking > 0.0, up_s, down_s))
        made[row] = PER_THRUST @ speed**2
    (late,) = _late(torque, np.full((n, 4), HOVER), [Rotors(up_s, down_s)], (PER_THRUST, mixing), PERIOD_S)
    left = lag(torque - late, PERIOD_S, mean_s) - made
    without = lag(torque, PERIOD_S, mean_s) - made
    assert np.std(left[200:]) < 0.15 * np.std(without[200:])


TIME_S = PERIOD_S * np.arange(12000)


@pytest.mark.parametrize(
    "period_s", [thorough(2.3), 6.0, thorough(80.0)], ids=["fast", "slow", "a battery that is emptied"]
)
def test_an_effectiveness_that_comes_and_goes_is_taken_out(period_s: float) -> None:
    """By a fifth about its mean, on all axes alike."""
    worth = 1.0 + 0.2 * np.cos(2.0 * np.pi * TIME_S / period_s)
    fits = fit_by_spectra(_fly(3, worth=worth / worth.mean()))
    assert all("varying gain" in fits[axis].effects and _holds(fits[axis], axis) for axis in (0, 1))
    assert fits[0].variation == pytest.approx(np.std(worth) / worth.mean(), abs=0.05)


@pytest.mark.thorough
def test_an_effectiveness_that_goes_with_the_throttle_is_taken_out() -> None:
    """As of a thrust curve that nobody straightened."""
    throttle = 0.4 + 0.1 * np.repeat(np.random.default_rng(4).uniform(-1.0, 1.0, 80), 150)
    fits = fit_by_spectra(_fly(4, worth=throttle / throttle.mean(), throttle=throttle))
    assert all("varying gain" in fits[axis].effects and _holds(fits[axis], axis) for axis in (0, 1))
    assert fits[0].variation == pytest.approx(np.std(throttle) / np.mean(throttle), abs=0.04)


@pytest.mark.thorough
def test_a_limit_of_one_axis_is_none_of_all() -> None:
    """What one axis does is explained by that axis: a variation of all would be seen on the others."""
    fits = fit_by_spectra(_fly(5, _limited_pitch, gusts=0.3))
    assert fits[1].effects == ("limit",)
    assert not fits[0].effects


def test_what_effects_move_is_told_beside_the_estimate() -> None:
    """An estimate that knows of none is off by at least the shift."""
    with_none, limited = _fits(0), _fits(0, _limited)
    assert limited[0].by_effects >= abs(limited[0].shift) > 0.03
    assert with_none[0].by_effects < 0.5 * with_none[0].half_width / with_none[0].gain


def test_a_torque_from_another_time_has_a_negative_delay() -> None:
    """Logged 20 ms late, the torque follows the motion: the effectiveness is right all the same."""
    fits = fit_by_spectra(_fly(2, late_steps=4))
    assert all(_holds(fits[axis], axis) for axis in (0, 1))
    assert fits[0].mean[2] + fits[0].mean[3] == pytest.approx(LAG_S - 4 * PERIOD_S, abs=0.006)


@pytest.mark.thorough
def test_without_rotors_their_dead_zone_is_not_asked() -> None:
    """A table holds torques only."""
    data = replace(_flown(0, _dead_rotors), input=None)
    assert not any("rotor threshold" in fit.effects for fit in fit_by_spectra(data))


def test_a_dead_zone_of_all_commands_is_told_by_all_axes_together() -> None:
    """About each axis alone it is too small to be seen, and takes a tenth of the effectiveness."""
    fits = fit_by_spectra(_fly(6, _dead, gusts=1.2))
    assert all(_holds(fits[axis], axis) for axis in range(3))


@pytest.mark.thorough
def test_steps_that_were_cut_toward_zero_are_put_back() -> None:
    """What was logged lacks half a step, as seen in the effectiveness of the commands that were cut."""
    data, step = _flown(0, gusts=0.2), 0.012
    segment = data.segments[0]
    cut = replace(segment, torque=np.trunc(segment.torque / step) * step)
    described = replace(data.input, grid=(step, step, step))
    blind, told = (
        fit_by_spectra(replace(data, segments=(cut,), input=each)) for each in (data.input, described)
    )
    assert blind[2].gain > 1.04 * GAIN[2]
    assert "cut steps" in told[2].effects
    assert all(_holds(told[axis], axis) for axis in range(3))


def test_what_coarse_steps_hide_of_commands_below_them_is_put_back() -> None:
    """Most of what was logged is zero: half a step in the direction of the rest would not be enough."""
    data = _flown(0, gusts=0.2)
    segment = data.segments[0]
    step = 1.5 * float(np.std(segment.torque[:, 1]))
    steps = np.array([step, step, 0.0])
    cut = replace(segment, torque=np.column_stack([*_cut(segment.torque.T[:2], step), segment.torque[:, 2]]))
    assert np.mean(cut.torque[:, 1] == 0.0) > 0.7
    described = replace(data.input, grid=tuple(steps))
    blind, told = (
        fit_by_spectra(replace(data, segments=(cut,), input=each)) for each in (data.input, described)
    )
    assert blind[1].gain > 1.3 * GAIN[1]
    assert "cut steps" in told[1].effects
    assert all(_holds(told[axis], axis) for axis in range(3))


def _cut(torques: FloatArray, step: float) -> FloatArray:
    return np.asarray(np.trunc(torques / step) * step)


def test_steps_that_were_rounded_are_left_as_they_are() -> None:
    """They lack nothing on the mean."""
    data, step = _flown(0, gusts=0.2), 0.008
    segment = data.segments[0]
    rounded = replace(segment, torque=np.rint(segment.torque / step) * step)
    described = replace(data.input, grid=(step, step, step))
    fits = fit_by_spectra(replace(data, segments=(rounded,), input=described))
    assert not any("cut steps" in fit.effects for fit in fits)
    assert all(_holds(fits[axis], axis) for axis in range(2))


def _in_other_units(segment: Segment, scale: float) -> Segment:
    thrust = segment.rotor_thrust
    return replace(
        segment, torque=scale * segment.torque, rotor_thrust=None if thrust is None else scale * thrust
    )


@pytest.mark.thorough
def test_small_dead_zones_are_likelier_than_large_ones() -> None:
    """The same flight, per unit of other commands, is as open to one that is smaller in proportion."""
    data = _fly(8, gusts=3.0)
    gentle, vigorous = (
        replace(data, segments=(_in_other_units(data.segments[0], scale),)) for scale in (0.1, 10.0)
    )
    plain, scaled = solve_flight(gentle), solve_flight(vigorous)
    assert plain is not None
    assert scaled is not None
    assert plain.fits[1].gain == pytest.approx(100.0 * scaled.fits[1].gain, rel=1e-3)
    assert fit_by_spectra(gentle)[1].by_effects > 1.2 * fit_by_spectra(vigorous)[1].by_effects


#: Of the thrust curve T = (1 - e) u + e u^2: what the firmware takes it for, and what it is.
_BELIEVED, _TRUE, _LIFT = 0.8, 0.4, 1.0


def _command_of(thrust: np.ndarray) -> np.ndarray:
    """Return the command u of the thrust that the firmware believes."""
    linear = 1.0 - _BELIEVED
    return (np.sqrt(linear**2 + 4.0 * _BELIEVED * np.maximum(thrust, 0.0)) - linear) / (2.0 * _BELIEVED)


_AT_LIFT = float(_command_of(np.array(_LIFT)))
#: Slopes of both curves by u where the vehicle hovers.
_SLOPES = 1.0 - _BELIEVED + 2.0 * _BELIEVED * _AT_LIFT, 1.0 - _TRUE + 2.0 * _TRUE * _AT_LIFT


def _bent(torque: Torque) -> Torque:
    """Make the torque with propellers of another curve, whose thrust in hover has the same slope."""
    command = _command_of(_LIFT + TO_THRUST @ torque)
    thrust = (1.0 - _TRUE) * command + _TRUE * command**2
    made: list[float] = (PER_THRUST @ thrust * _SLOPES[0] / _SLOPES[1]).tolist()
    return made


def _with_curve(data: FlightData) -> FlightData:
    """Return a flight whose log says which curve the firmware believes."""
    (segment,) = data.segments
    thrust = np.maximum(_LIFT + segment.torque @ TO_THRUST.T, 0.0)
    command = _command_of(thrust)
    by_expo = command**2 - command - thrust * (2.0 * _AT_LIFT - 1.0) / _SLOPES[0]
    assert data.input is not None
    return replace(
        data,
        segments=(replace(segment, rotor_thrust=thrust, thrust_by_expo=by_expo),),
        input=replace(data.input, expo=AssumedExpo(value=_BELIEVED, parameter="MOT_THST_EXPO")),
    )


@pytest.mark.thorough
def test_another_thrust_curve_is_taken_for_that() -> None:
    """Not for a dead zone of the rotors, with which the effectiveness would be another one."""
    fits = fit_by_spectra(_with_curve(_fly(7, _bent, gusts=0.2)))
    assert all(fits[axis].effects == ("varying gain",) and _holds(fits[axis], axis) for axis in (0, 1))


def test_a_thrust_curve_that_is_right_shows_nothing() -> None:
    """The firmware's expo is that of the propellers."""
    fits = fit_by_spectra(_with_curve(_flown(0, gusts=0.2)))
    assert not any(fits[axis].effects for axis in range(3))
    assert all(_holds(fits[axis], axis) for axis in (0, 1))


def test_commands_of_flight_modes_with_other_laws_are_told_apart() -> None:
    """In the second half of the flight the torque answers a third of each command, and the other way."""
    (segment,) = _flown(0).segments
    assert segment.command is not None
    law = (np.arange(segment.n_samples) >= segment.n_samples // 2).astype(np.int64)
    command = np.where(law[:, np.newaxis] == 1, -3.0, 1.0) * segment.command
    apart, mixed = (
        solve_flight(replace(_flown(0), segments=(replace(segment, command=command, law=each),)))
        for each in (law, None)
    )
    alone = solve_flight(_flown(0))
    assert apart is not None
    assert mixed is not None
    assert alone is not None
    assert apart.fits[0].commanded > 0.9 * alone.fits[0].commanded
    assert mixed.fits[0].commanded < 0.5 * alone.fits[0].commanded
    assert _holds(apart.fits[0], 0)


def test_what_slow_air_hides_says_nothing_about_the_response() -> None:
    """Below a hertz commands drown in air; above they tell roll and pitch."""
    fits = solve_flight(_fly(0, gusts=20.0, air_rad_s=0.3))
    assert fits is not None
    assert all(fits.fits[axis].is_sound and _holds(fits.fits[axis], axis) for axis in (0, 1))


@pytest.mark.thorough
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_moments_of_an_effect_tell_its_size_and_no_lag(axis: int) -> None:
    """Beside an effect of unknown size lag and effectiveness are known no better than beside a known one."""
    told, known = _told_beside_asymmetry()
    assert told[axis].effects == ("asymmetry",)
    for of in (0, 2):
        assert told[axis].covariance[of, of] >= 0.999 * known[axis].covariance[of, of]
