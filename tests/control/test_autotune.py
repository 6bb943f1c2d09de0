"""The procedures by which autopilots tune themselves, run on given vehicles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.control.autotune import forecast
from quadid_logs.control.doubling import double
from quadid_logs.control.loop import close, gyro_filters
from quadid_logs.control.margins import fine_grid_hz, is_stable
from quadid_logs.control.pole_placement import _discrete_models, place_poles
from quadid_logs.control.twitch import _angle_up, _Answer, _Gains, _seen, twitch
from quadid_logs.data.autotune import Doubling, PolePlacement, ProcedureKind, Twitching
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.tuning import GainNames
from tests.control.loop_flights import Vehicle

VEHICLE = Vehicle()
NAMES = GainNames(
    scaled=("P", "I", "D"), proportional="P", integral="I", derivative="D", angle="A", ranges={}
)
PLACED = PolePlacement(
    title="placing", rise_time_s=0.14, model_period_s=0.01, excitation_per_s=5.0, detuning=0.7,
    angle_error_rad=1.0472, angle_gains=(2.0, 6.5), highest=(0.5, 10.0, 0.1), common="",
)  # fmt: skip
TWITCHED = Twitching(
    title="twitching", aggressiveness=0.075, filter_hz=40.0, derivative=(0.0005, 0.2),
    proportional=(0.01, 2.0), angle=(0.5, 40.0), integral_ratio=1.0, angle_back_off=0.9,
)  # fmt: skip
DOUBLED = Doubling(
    title="doubling", filters={}, kept=0.4, least_of_flown=0.8, integral_ratio=1.0,
    highest_proportional=np.inf, highest_derivative=np.inf, lowers_p=True,
)  # fmt: skip


def controller(changes: Mapping[str, float]) -> AxisController:
    gains = {"P": VEHICLE.P, "I": VEHICLE.I, "D": VEHICLE.D, "A": 4.5} | dict(changes)
    made = replace(VEHICLE, P=gains["P"], I=gains["I"], D=gains["D"]).controller
    return replace(made, angle_gain_per_s=gains["A"], gains=gains)


def plants(*effectiveness: float, damping: float = -2.0) -> Plant:
    n = len(effectiveness)
    return Plant(
        np.array(effectiveness), np.full(n, damping), np.full(n, 0.03), np.full(n, 0.003), lead_s=0.0
    )


def test_the_discrete_model_answers_as_the_vehicle_where_it_was_excited() -> None:
    """Least squares on second order, of a plant with lag, delay and gyro filter."""
    flown, vehicle = controller({}), plants(300.0)
    a1, a2, *b = _discrete_models(PLACED, flown, vehicle)[:, 0]
    frequency_hz = np.array([2.0, 4.0])
    late = np.exp(-2j * np.pi * frequency_hz * PLACED.model_period_s)
    model = late * (b[0] + b[1] * late + b[2] * late**2) / (1.0 + a1 * late + a2 * late**2)
    true = vehicle.response(frequency_hz, flown.period_s)[0] * gyro_filters(flown, frequency_hz)
    assert np.abs(model / true - 1.0).max() < 0.05


def test_the_law_of_pole_placement_is_that_of_the_firmware() -> None:
    """A plant of first order with a delay of one step, worked out by hand from pid_design.hpp."""
    found = place_poles(PLACED, controller({}), plants(300.0))
    a1, a2, *b = _discrete_models(PLACED, controller({}), plants(300.0))[:, 0]
    rho = 0.01 / 0.14
    e1 = -a1 - 2.0 * np.exp(-rho / 0.5) + 1.0
    f1, f2 = a1 * e1 - a2 * e1 + a2, a2 * e1
    assert found.proportional[0] == pytest.approx(-(f1 + 2.0 * f2) / (0.7 + (e1 + 1.0) * sum(b)))


def test_gains_that_the_firmware_does_not_accept_are_none() -> None:
    """A vehicle that hardly answers would get a P beyond 0.5."""
    assert np.isnan(place_poles(PLACED._replace(detuning=0.0), controller({}), plants(1.0)).proportional[0])


def test_twitches_give_an_effective_vehicle_lower_gains() -> None:
    """Twice as effective, half the gains, as far as steps of 5 and 10 % go."""
    found = twitch(TWITCHED, controller({}), plants(300.0, 600.0), NAMES, controller)
    assert found is not None
    assert found.proportional[0] / found.proportional[1] == pytest.approx(2.0, rel=0.08)
    assert found.derivative[0] / found.derivative[1] == pytest.approx(2.0, rel=0.15)


def test_an_aggressive_procedure_ends_at_more_derivative() -> None:
    """It bears more bounce back."""
    mild, bold = (
        twitch(TWITCHED._replace(aggressiveness=one), controller({}), plants(300.0), NAMES, controller)
        for one in (0.05, 0.10)
    )
    assert mild is not None
    assert bold is not None
    assert bold.derivative[0] > mild.derivative[0]


def test_the_start_hardly_matters_to_twitches() -> None:
    """From half and from twice the gains the procedure comes to the same place."""
    found = [
        twitch(TWITCHED, controller({"P": p, "D": d}), plants(300.0), NAMES, controller)
        for p, d in ((0.05, 0.001), (0.2, 0.006))
    ]
    assert found[0] is not None
    assert found[1] is not None
    assert found[0].proportional[0] == pytest.approx(found[1].proportional[0], rel=0.15)


@pytest.mark.parametrize("procedure", [PLACED, TWITCHED, DOUBLED])
def test_a_forecast_spans_the_vehicles(procedure: PolePlacement | Twitching) -> None:
    """A wider posterior gives wider gains."""
    narrow, wide = (
        forecast(procedure, controller({}), plants(*(300.0 * np.array(one))), NAMES, controller)
        for one in ((1.0, 0.99, 1.01), (1.0, 0.7, 1.3))
    )
    assert narrow is not None
    assert wide is not None
    low, high = wide.gains["P"]
    assert low < narrow.gains["P"][0]
    assert high > narrow.gains["P"][1]
    assert wide.phase_margin_deg is not None


def test_an_angle_whose_rate_reverses_ends_the_search_for_its_gain() -> None:
    """It overshoots and swings back, though by less than is looked for in the angle."""
    now, seen = _Gains(p=0.1, d=0.003, angle=10.0, stage=4), _Answer(1.01, 0.0, reverses=True)
    assert _angle_up(now, seen, TWITCHED).stage == 5
    assert _angle_up(now, seen._replace(reverses=False), TWITCHED).stage == 4


def test_a_twitch_of_a_rate_is_over_three_times_as_late_as_it_rose() -> None:
    """What comes later, a bounce back or a target that is reached, the procedure does not see."""
    rises = np.concatenate([np.linspace(0.0, 0.9, 11), np.full(30, 0.9)])
    steps = np.stack([np.append(rises, np.zeros(20)), np.append(rises, np.full(20, 1.2))])
    now = _Gains(p=0.1, d=0.003, angle=10.0)
    assert _seen(steps, [now, now], TWITCHED) == [_Answer(0.9, 0.9)] * 2


def test_each_twitch_is_seen_by_itself() -> None:
    """Of one vehicle the rate reaches its target and of another it bounces; of a third the angle answers."""
    rates = np.array([[0.0, 0.5, 1.1, 0.2, 0.0], [0.0, 0.5, 0.3, 0.9, 1.2], [0.0, 0.8, 1.01, 0.6, 0.4]])
    now = _Gains(p=0.1, d=0.003, angle=10.0)
    together = _seen(rates, [now, now, now._replace(stage=4)], TWITCHED)
    assert together == [_Answer(1.1, 1.1), _Answer(0.5, 0.3), _Answer(1.01, 0.0, reverses=True)]


LOW = {"P": 0.01, "I": 0.01, "D": 0.0001}


def doubled(procedure: Doubling = DOUBLED, **gains: float) -> dict[str, float]:
    """Return P, I and D at which the doubling ends on one vehicle, from low gains unless others are given."""
    found = double(procedure, controller(LOW | gains), plants(300.0), NAMES, controller)
    assert found is not None
    return {name: float(values[0]) for name, values in zip("PID", found, strict=True)}


def flies(**gains: float) -> bool:
    made = controller(gains)
    loop = close(made, plants(300.0), fine_grid_hz(made.period_s)).full
    assert loop is not None
    return bool(is_stable(loop, 2, np.array([False]))[0])


@pytest.mark.parametrize("ratio", [1.0, 20.0])
def test_doubling_ends_at_two_fifths_of_the_p_that_oscillates(ratio: float) -> None:
    """With the I that rises with it."""
    end = doubled(DOUBLED._replace(integral_ratio=ratio))
    assert flies(P=2.4 * end["P"], I=2.4 * end["I"], D=end["D"])
    assert not flies(P=2.6 * end["P"], I=2.6 * end["I"], D=end["D"])


def test_doubling_ends_at_two_fifths_of_the_d_that_oscillates() -> None:
    """Before P rises."""
    end = doubled()
    assert flies(P=LOW["P"], I=LOW["I"], D=2.4 * end["D"])
    assert not flies(P=LOW["P"], I=LOW["I"], D=2.6 * end["D"])


def test_doubling_takes_no_flown_gain_down_by_more_than_a_fifth() -> None:
    """It sees oscillations that are none, and a low rate gain beside a high angle gain is dangerous."""
    high = doubled(D=10.0 * doubled()["D"], P=0.4)
    assert high["D"] == pytest.approx(8.0 * doubled()["D"])
    assert high["P"] >= 0.8 * 0.4


def test_doubling_stops_at_the_highest_gains_of_yaw() -> None:
    limited = doubled(DOUBLED._replace(highest_proportional=0.02, highest_derivative=0.0002))
    assert limited["P"] == pytest.approx(0.02)
    assert limited["D"] == pytest.approx(0.0002)


def test_i_goes_with_p_by_the_ratio_or_stays() -> None:
    tenth = doubled(DOUBLED._replace(integral_ratio=0.1))
    assert tenth["I"] == pytest.approx(0.1 * tenth["P"])
    assert doubled(DOUBLED._replace(integral_ratio=None))["I"] == LOW["I"]


def test_doubling_ends_on_each_of_several_vehicles_as_on_it_alone() -> None:
    """One that oscillates early waits for none that rises longer."""
    effectiveness = (900.0, 300.0, 100.0)
    together = double(DOUBLED, controller(LOW), plants(*effectiveness), NAMES, controller)
    assert together is not None
    for number, each in enumerate(effectiveness):
        alone = double(DOUBLED, controller(LOW), plants(each), NAMES, controller)
        assert alone is not None
        np.testing.assert_array_equal([ends[number] for ends in together], np.ravel(alone))


def test_d_of_none_rises_too() -> None:
    """As many users have it in yaw."""
    assert doubled(D=0.0)["D"] == pytest.approx(doubled()["D"], rel=0.02)


def test_a_forecast_tells_the_filters_that_the_procedure_sets() -> None:
    procedure = DOUBLED._replace(filters={"FLTD": 10.0})
    found = forecast(procedure, controller(LOW), plants(300.0, 310.0), NAMES, controller)
    assert found is not None
    assert found.kind is ProcedureKind.QUIKTUNE
    assert found.gains["FLTD"] == (10.0, 10.0)
