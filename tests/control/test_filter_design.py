"""Filters and gains together: what is proposed, what never is, and what it promises."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from quadid_logs import analyze
from quadid_logs.autopilots import named
from quadid_logs.control import recommend as recommend_module
from quadid_logs.control.axis_without_model import AxisWithoutModel
from quadid_logs.control.filter_design import Changes, Together, design_filters, together
from quadid_logs.control.filter_guard import Refiltered, are_worth_it, is_no_worse
from quadid_logs.control.loop import gyro_filters
from quadid_logs.control.separate_gains import Quick, aliases
from quadid_logs.data.health import Line, LineSource
from quadid_logs.data.log import FlightLog
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import AxisTuning, FilterChoices, Tuning, TuningVerdict
from quadid_logs.load import read_log
from quadid_logs.maths.spectra import averaged_spectra
from quadid_logs.promise import promise_of
from quadid_logs.report.gain_files import gain_files
from quadid_logs.report.provenance import Provenance
from quadid_logs.report.tune_page import tune_page
from quadid_logs.simulator import fly
from quadid_logs.simulator.logger import log_flights
from quadid_logs.tuning import recommend
from quadid_logs.vocabulary import AXES
from quadid_logs.writers import write_log
from study import filters as study
from study.filter_bound import Filters, TrueAxis
from tests import tuned_flights

#: Of the study's vehicles, one whose notch stands at a wrong place; its frame rings at 60.74 Hz.
WRONG_NOTCH = 2


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Result:
    scenario, setting, kind = study.draw_vehicle(1, WRONG_NOTCH)
    assert kind == "wrong notch"
    path = tmp_path_factory.mktemp("filters") / "flight.bin"
    record = fly(study._setup(scenario, setting, 1))
    log = log_flights((record,), scenario.logging)
    # Without the rotors' speed no notch can follow them: what is left is where the fixed one stands.
    signals = {name: sources for name, sources in log.signals.items() if name != "rotor_speed"}
    write_log(replace(log, signals=signals), path)
    # Which modes are drawn that the log merely cannot rule out would decide what a notch costs.
    return tuned_flights.stiff(analyze(path))


@pytest.fixture(scope="module", autouse=True)
def searched_once() -> Iterator[None]:
    """Search once for the gains and filters of the same axes: what is held here is what becomes of them."""

    def once(search: Callable[..., Any], key_of: Callable[..., object]) -> Callable[..., Any]:
        found: dict[object, Any] = {}

        def kept(*given: Any, **named: Any) -> Any:
            key = key_of(*given, **named)
            if key not in found:
                found[key] = search(*given, **named)
            return found[key]

        return kept

    with pytest.MonkeyPatch.context() as patch:
        # Logged and flown as most of this firmware are: this vehicle's frame is worth a notch then.
        patch.setattr(study, "_RATE_HZ", 400.0)
        # One flight, and limits that are never changed.
        for where, name, key_of in (
            (recommend_module, "_searched", lambda axis, *_, **choice: (axis.case.axis, *choice.items())),
            (recommend_module, "_decided", lambda search, *_, **choice: (search, *choice.items())),
            (recommend_module, "design_filters", lambda searches, *_, **choice: (*searches, *choice.items())),
            (recommend_module._Search, "with_filters", lambda search, chosen: (search, repr(chosen))),
        ):
            search = getattr(where, name)
            if name == "design_filters":
                search = _all_of(search)
            patch.setattr(where, name, once(search, key_of))
        yield


def _all_of(design: Callable[..., Iterator[Changes]]) -> Callable[..., Any]:
    """Return a search that keeps the best of what it finds, to be asked for more than once."""
    return lambda *given, **named: [one for one in [next(design(*given, **named), None)] if one is not None]


@pytest.fixture(scope="module")
def tuned(flown: Result) -> Tuning:
    return recommend(flown, filters=True)


def _next(gusts: float, verdict: TuningVerdict = "change") -> AxisTuning:
    return AxisTuning(verdict=verdict, reasons=(), attitude_error=gusts)


def _refiltered(gusts: float, won: float = -0.5, lost: float = 0.0) -> Refiltered:
    return Refiltered(_next(gusts), Together(won, won, lost))


def test_filters_that_help_in_the_end_may_leave_the_next_flight_more_gust_error_than_gains_alone() -> None:
    assert is_no_worse(_refiltered(0.9), _next(0.5))


def test_the_next_flight_has_no_more_gust_error_than_the_flown_one() -> None:
    assert not is_no_worse(_refiltered(1.01), _next(0.5))


def test_the_next_flight_may_lose_as_much_as_margins_cost_gains_alone() -> None:
    assert is_no_worse(_refiltered(1.2), _next(1.2))
    assert not is_no_worse(_refiltered(1.3), _next(1.2))


def test_an_axis_that_loses_in_the_end_keeps_its_filters() -> None:
    assert not is_no_worse(_refiltered(0.5, lost=0.06), _next(0.9))


def test_gust_error_that_nobody_can_tell_is_no_reason_to_change_filters() -> None:
    assert not is_no_worse(_refiltered(float("nan")), _next(float("nan")))
    assert not is_no_worse(_refiltered(1.5), _next(float("nan")))


def test_filters_leave_no_axis_worse_that_no_gains_alone_help() -> None:
    """It was left with four times its gust error: a refused axis had no error to compare."""
    refused = _next(float("nan"), verdict="refused")
    assert not is_no_worse(_refiltered(1.01), refused)
    assert is_no_worse(_refiltered(0.9), refused)


@pytest.mark.parametrize(("each", "worth"), [((-0.09, 0.0), False), ((-0.06, -0.06), True)])
def test_filters_are_to_bring_a_tenth_over_all_axes_that_they_change(
    each: tuple[float, ...], worth: bool
) -> None:
    assert are_worth_it(_refiltered(0.9, one) for one in each) is worth


class _Behind:
    """The best gains behind some filters, of which all is known that a choice of filters asks."""

    def __init__(self, cost: float, noise: float = 1.0, passes: float = 1.0, missing: float = 0.0) -> None:
        self.quick_now, self._passes = Quick({}, cost, noise, missing), passes

    def quick(self, _factors: Mapping[str, float]) -> Quick:
        return self.quick_now

    def phase_lost_deg(self) -> float:
        return 1.0

    def passes(self, _line_hz: float) -> tuple[float, float]:
        return self._passes, 1.0


class _Axis:
    """An axis, and what is behind filters by their parameters."""

    too_noisy = 0.8

    def __init__(
        self, behind: Callable[[Mapping[str, float]], _Behind | None], alone: _Behind | None = None
    ) -> None:
        self._behind, self._alone = behind, alone

    def best(self) -> tuple[Any, Mapping[str, float]]:
        return self._alone or self._behind({}), {}

    def filtered(self, filters: Mapping[str, float]) -> Any:
        return self._behind(filters)


def _designed(others: Mapping[float, _Behind], *, shared: bool = True) -> float | None:
    """Return the frequency of the notch that is chosen, of an axis that flew with one on nothing."""
    choices = FilterChoices(notches=tuple({"NOTCH": each} for each in others))
    behind = {33.0: _Behind(1.0), **others}
    axes = {axis: _Axis(lambda filters: behind[filters.get("NOTCH", 33.0)]) for axis in AXES}
    found = next(design_filters(axes, choices, {"NOTCH": 33.0}, [60.0], shared=shared), None)
    return None if found is None else found.shared["NOTCH"]


def test_the_notch_is_chosen_that_leaves_least_of_what_is_the_larger_of_gust_error_and_noise() -> None:
    assert _designed({50.0: _Behind(0.8, 0.8), 60.0: _Behind(0.95, 0.3)}) == 50.0
    assert _designed({50.0: _Behind(0.9, 0.8), 60.0: _Behind(0.85, 0.7)}) == 60.0


def test_where_one_of_gust_error_and_noise_stays_the_other_decides() -> None:
    assert _designed({50.0: _Behind(1.0, 0.6), 60.0: _Behind(1.0, 0.3)}) == 60.0
    assert _designed({50.0: _Behind(0.3, 1.0), 60.0: _Behind(0.6, 1.0)}) == 50.0


def test_an_axis_may_lose_what_no_flight_would_tell() -> None:
    """Effectiveness differs by 5 % from flight to flight."""
    others = {60.0: _Behind(1.04, 0.5), 70.0: _Behind(1.06, 0.3)}
    assert _designed(others) == 60.0


def test_the_next_best_notch_follows_for_a_whole_search_that_turns_the_best_down() -> None:
    choices = FilterChoices(notches=({"NOTCH": 50.0}, {"NOTCH": 60.0}))
    behind = {33.0: _Behind(1.0), 50.0: _Behind(0.8, 0.8), 60.0: _Behind(0.6, 0.6)}
    axes = {axis: _Axis(lambda filters: behind[filters.get("NOTCH", 33.0)]) for axis in AXES}
    found = design_filters(axes, choices, {"NOTCH": 33.0}, [], shared=True)
    assert [one.shared["NOTCH"] for one in found] == [60.0, 50.0]


@pytest.mark.parametrize("worse", [_Behind(0.5, 1.1), _Behind(1.1, 0.5)])
def test_no_notch_is_moved_that_leaves_more_gust_error_or_noise_than_gains_alone(worse: _Behind) -> None:
    assert _designed({60.0: worse}) is None


def test_no_notch_is_moved_for_less_than_a_tenth_over_all_axes() -> None:
    assert _designed({60.0: _Behind(0.985, 0.985)}) is None
    assert _designed({60.0: _Behind(0.96, 0.96)}) == 60.0


def test_no_notch_is_chosen_behind_which_no_gains_keep_the_limits() -> None:
    assert _designed({60.0: _Behind(0.5, 0.5, missing=0.1)}) is None


def test_no_notch_is_chosen_that_lets_a_line_close_the_loop() -> None:
    assert _designed({50.0: _Behind(0.7, 0.7, passes=1.5), 60.0: _Behind(0.85, 0.85)}) == 60.0


def test_a_notch_of_all_axes_is_not_moved_where_one_is_not_known() -> None:
    assert _designed({60.0: _Behind(0.8, 0.8)}, shared=False) is None


def _low_passes(axes: Mapping[str, _Axis]) -> Changes | None:
    choices = FilterChoices(
        shared=({"GYRO": (10.0, 200.0)},), own={axis: ({f"D_{axis}": (10.0, 200.0)},) for axis in axes}
    )
    flown = {"GYRO": 40.0, **{f"D_{axis}": 40.0 for axis in axes}}
    return next(design_filters(axes, choices, flown, [], shared=True), None)


def test_the_low_pass_of_d_opens_where_that_of_the_gyro_closes() -> None:
    """Each alone makes it worse: noise is either in both paths or in the one of D."""

    def behind(axis: str) -> Callable[[Mapping[str, float]], _Behind]:
        def found(filters: Mapping[str, float]) -> _Behind:
            gyro, d = (math.log(filters.get(name, 40.0) / 40.0) for name in ("GYRO", f"D_{axis}"))
            left = math.exp(1.5 * (gyro + d) ** 2 + 0.3 * (gyro - d))
            return _Behind(left, left)

        return found

    found = _low_passes({axis: _Axis(behind(axis)) for axis in AXES})
    assert found is not None
    assert found.shared["GYRO"] < 30.0
    assert all(found.own[axis][f"D_{axis}"] > 50.0 for axis in AXES)


def test_a_low_pass_of_all_axes_stays_where_one_of_them_loses_by_it() -> None:
    def behind(lost: float) -> Callable[[Mapping[str, float]], _Behind]:
        return lambda filters: _Behind(*2 * (1.0 + lost * math.log(filters.get("GYRO", 40.0) / 40.0),))

    assert _low_passes({axis: _Axis(behind(-0.5)) for axis in AXES}) is not None
    assert _low_passes({axis: _Axis(behind(0.0 if axis == "yaw" else -0.5)) for axis in AXES}) is not None
    one_loses = {axis: _Axis(behind(0.4 if axis == "yaw" else -0.5)) for axis in AXES}
    assert _low_passes(one_loses) is None


def test_limits_that_a_rough_search_misses_behind_the_flown_filters_are_no_reason_to_change_them() -> None:
    """A low-pass of D was closed in one flight and opened in the next: the whole search had kept them."""

    def behind(filters: Mapping[str, float]) -> _Behind:
        return _Behind(1.0, missing=0.0 if filters else 1.0)

    assert _low_passes({axis: _Axis(behind, alone=_Behind(1.0)) for axis in AXES}) is None


def test_a_cut_off_at_most_doubles_in_one_flight() -> None:
    found = _low_passes(
        {axis: _Axis(lambda filters: _Behind(*2 * (40.0 / filters.get("GYRO", 40.0),))) for axis in AXES}
    )
    assert found is not None
    assert found.shared["GYRO"] == 80.0


@pytest.mark.thorough
def test_a_notch_at_a_wrong_place_is_moved_to_the_line(tuned: Tuning) -> None:
    for one in tuned.axes.values():
        assert one.filters["INS_HNTCH_FREQ"].next == pytest.approx(60.74, abs=1.0)
        assert "QL673" in [reason.code for reason in one.reasons]


@pytest.mark.thorough
def test_the_true_loop_behind_other_filters_has_the_margins_that_are_promised(tuned: Tuning) -> None:
    scenario, setting, _ = study.draw_vehicle(1, WRONG_NOTCH)
    flown = study.loaded(setting, {name: one.next for name, one in tuned.changes.items()})
    for number, (axis, one) in enumerate(tuned.axes.items()):
        true = study.true_loops(study._setup(scenario, flown, 0), number).margins().rate.phase_margin_deg
        assert one.next is not None
        told = one.next.rate.phase_margin_deg
        assert told is not None
        assert true is not None
        assert told.ci95[0] <= true.value <= told.ci95[1], axis


@pytest.mark.thorough
def test_what_filters_bring_in_the_end_is_what_the_best_gains_of_the_true_vehicle_bring(
    tuned: Tuning,
) -> None:
    """The first flight leaves vehicles possible that later ones rule out: no filter is chosen for these."""
    scenario, setting, _ = study.draw_vehicle(1, WRONG_NOTCH)
    setup = study._setup(scenario, setting, 0)
    then = study.loaded(setting, {name: one.next for name, one in tuned.changes.items()})
    for number, (axis, one) in enumerate(tuned.axes.items()):
        true = TrueAxis(setup, number, study.rotors_hz(setup))
        best = [
            true.best(
                Filters(each.gyro_hz, each.notch),
                [
                    np.log([*factors, each.derivative_hz[number]])
                    for factors in ((1.0,) * 4, (1.5, 2.0, 3.0, 1.5))
                ],
                None,
                of_d=False,
            )
            for each in (setting, then)
        ]
        old, new = (found for found in best if found is not None)
        (told,) = (reason.evidence for reason in one.reasons if reason.code == "QL670")
        assert told["attitude_error_ratio"] == pytest.approx(new.gusts_rad / old.gusts_rad, rel=0.15), axis


@pytest.mark.parametrize(("axes", "shared"), [(AXES, True), (("roll",), False)])
def test_filters_of_all_axes_are_looked_at_where_every_axis_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, axes: tuple[str, ...], shared: bool
) -> None:
    asked = []

    def noted(*_: object, shared: bool) -> tuple[()]:
        asked.append(shared)
        return ()

    monkeypatch.setattr(recommend_module, "_decided", lambda search, *_, **__: (_next(1.0), search))
    monkeypatch.setattr(recommend_module, "design_filters", noted)
    recommend(tuned_flights.flown("ardupilot"), axes=axes, filters=True)
    assert asked == [shared]


@pytest.mark.parametrize(("refused", "beside", "shared"), [("yaw", ["yaw"], True), ("roll", [], False)])
def test_filters_of_all_axes_are_looked_at_beside_a_yaw_axis_that_tells_too_little(
    monkeypatch: pytest.MonkeyPatch, refused: str, beside: list[str], shared: bool
) -> None:
    """Yaw's loop crosses over below those of roll and pitch; where theirs do, nobody knows without them."""
    asked = []
    searched = recommend_module._searched

    def refusing(axis: recommend_module.Axis, *given: Any, **named: Any) -> Any:
        return None if axis.case.axis == refused else searched(axis, *given, **named)

    def noted(axes: Mapping[str, object], *_: object, shared: bool) -> tuple[()]:
        asked.append(([axis for axis, one in axes.items() if isinstance(one, AxisWithoutModel)], shared))
        return ()

    monkeypatch.setattr(recommend_module, "_searched", refusing)
    monkeypatch.setattr(recommend_module, "_decided", lambda search, *_, **__: (_next(1.0), search))
    monkeypatch.setattr(recommend_module, "design_filters", noted)
    recommend(tuned_flights.flown("ardupilot"), filters=True)
    assert asked == [(beside, shared)]


@pytest.mark.thorough
def test_filters_of_all_axes_stay_where_an_axis_is_not_asked_for(flown: Result) -> None:
    for one in recommend(flown, axes=("roll",), filters=True).axes.values():
        assert all(name.startswith("ATC_RAT_RLL_") for name in one.filters)


@pytest.mark.thorough
def test_one_factor_changes_no_filters(flown: Result) -> None:
    assert not any(
        one.filters for one in recommend(flown, axes=("roll",), apart=False, filters=True).axes.values()
    )


@pytest.mark.thorough
def test_files_hold_each_filter_once_and_its_way_back(flown: Result, tuned: Tuning) -> None:
    files = gain_files(flown, tuned)
    for name in ("next.param", "back.param"):
        rows = [line.split(",")[0] for line in files[name].splitlines() if line.startswith("INS_HNTCH_FREQ")]
        assert len(rows) == 1, name
    assert "INS_HNTCH_FREQ,61" in files["next.param"].replace(", ", ",")


@pytest.mark.thorough
def test_the_promise_holds_filters_as_it_holds_gains(flown: Result, tuned: Tuning) -> None:
    promise = promise_of(flown, tuned)
    assert promise is not None
    told = promise.axes["roll"].gains["INS_HNTCH_FREQ"]
    assert told.next == tuned.axes["roll"].filters["INS_HNTCH_FREQ"].next
    assert told.back == flown.log.parameters["INS_HNTCH_FREQ"]


@pytest.mark.thorough
def test_the_page_shows_where_the_filters_stand(flown: Result, tuned: Tuning) -> None:
    page = tune_page(flown, tuned, Provenance(version="0", command="", log_sha256=""))
    assert "Noise against phase" in page
    assert page.count("<circle") > 10


def _line(frequency_hz: float, source: LineSource = LineSource.FIXED, harmonic: int = 0) -> Line:
    return Line(
        frequency_hz=frequency_hz,
        height_db=20.0,
        p_value=1e-6,
        share=1.0,
        rms=0.1,
        source=source,
        harmonic=harmonic,
    )


def _choices(autopilot: str, parameters: Mapping[str, float], *lines: Line, **followed: Any) -> Any:
    log = FlightLog(
        path="x",
        format="",
        n_bytes=0,
        signals={},
        autopilot=autopilot,
        parameters=parameters,
        followed=followed,
    )
    return named(autopilot).filter_choices(log, parameters, lines)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4", "betaflight"])
def test_nothing_is_proposed_that_the_log_does_not_hold(autopilot: str) -> None:
    found = _choices(autopilot, {}, _line(70.0), _line(90.0, LineSource.ROTOR, 1))
    assert found.shared == ()
    assert found.notches == ()
    assert not any(found.own.values())


def test_a_second_notch_takes_the_second_set_where_the_first_stands_on_a_line() -> None:
    flown = {
        "INS_HNTCH_ENABLE": 1.0,
        "INS_HNTCH_MODE": 0.0,
        "INS_HNTCH_FREQ": 70.0,
        "INS_HNTCH_BW": 30.0,
        "INS_HNTCH_ATT": 40.0,
        "INS_HNTCH_HMNCS": 1.0,
        "INS_HNTC2_ENABLE": 0.0,
    }
    (only,) = _choices("ardupilot", flown, _line(70.0), _line(110.0)).notches
    assert only["INS_HNTC2_FREQ"] == 110.0
    assert not any(name.startswith("INS_HNTCH") for name in only)


def test_each_of_two_lines_is_tried_where_there_is_one_notch() -> None:
    rotors_hz = np.full((50, 4), 80.0)
    lines = _line(80.0, LineSource.ROTOR, 1), _line(110.0)
    tried = _choices("ardupilot", {"INS_HNTCH_ENABLE": 0.0}, *lines, rotors_hz=rotors_hz).notches
    assert [one["INS_HNTCH_MODE"] for one in tried] == [3.0, 0.0]
    flown = {"IMU_GYRO_NF0_FRQ": 0.0, "IMU_GYRO_NF0_BW": 20.0}
    tried = _choices("px4", flown, _line(70.0), _line(110.0)).notches
    assert {one["IMU_GYRO_NF0_FRQ"] for one in tried} == {70.0, 110.0}


def test_a_notch_that_follows_rotors_is_set_to_follow_the_speeds_that_the_log_holds() -> None:
    rotors_hz = np.full((50, 4), 100.0)
    line = _line(100.0, LineSource.ROTOR, 1)
    (only,) = _choices("ardupilot", {"INS_HNTCH_ENABLE": 0.0}, line, rotors_hz=rotors_hz).notches
    assert only["INS_HNTCH_MODE"] == 3.0
    assert only["INS_HNTCH_REF"] == 1.0
    assert only["INS_HNTCH_FREQ"] == 90.0
    assert _choices("ardupilot", {"INS_HNTCH_ENABLE": 0.0}, line).notches == ()


@pytest.mark.parametrize(
    ("autopilot", "flown", "name", "value"),
    [
        ("ardupilot", {"INS_HNTCH_ENABLE": 0.0}, "INS_HNTCH_HMNCS", 1.0),
        ("px4", {"IMU_GYRO_DNF_EN": 0.0}, "IMU_GYRO_DNF_HMC", 1.0),
    ],
)
def test_a_notch_that_follows_rotors_is_tried_where_their_speed_moves_too_much_for_a_line(
    autopilot: str, flown: dict[str, float], name: str, value: float
) -> None:
    (only,) = _choices(autopilot, flown, rotors_hz=np.full((50, 4), 100.0)).notches
    assert only[name] == value


def test_a_notch_that_follows_the_rotors_is_not_switched_off_for_want_of_a_line() -> None:
    """What it takes away is in no log."""
    flown = {
        "INS_HNTCH_ENABLE": 1.0,
        "INS_HNTCH_MODE": 3.0,
        "INS_HNTCH_FREQ": 80.0,
        "INS_HNTCH_BW": 40.0,
        "INS_HNTCH_ATT": 40.0,
        "INS_HNTCH_HMNCS": 1.0,
        "INS_HNTCH_REF": 1.0,
    }
    assert _choices("ardupilot", flown, rotors_hz=np.full((50, 4), 100.0)).notches == ()


def test_a_notch_on_nothing_is_switched_off_and_the_other_is_put_on_the_line() -> None:
    flown = {
        "IMU_GYRO_NF0_FRQ": 40.0,
        "IMU_GYRO_NF0_BW": 10.0,
        "IMU_GYRO_NF1_FRQ": 0.0,
        "IMU_GYRO_NF1_BW": 20.0,
    }
    off, moved = _choices("px4", flown, _line(80.0)).notches
    assert off == {"IMU_GYRO_NF0_FRQ": 0.0}
    assert moved == {"IMU_GYRO_NF0_FRQ": 80.0, "IMU_GYRO_NF0_BW": 20.0}


def test_an_oscillation_of_the_loop_gets_no_notch() -> None:
    assert _choices("px4", {"IMU_GYRO_NF0_FRQ": 0.0}, _line(8.0, LineSource.LOOP)).notches == ()


def test_a_notch_that_stands_on_an_oscillation_of_the_loop_is_switched_off() -> None:
    """It cures none, and costs the loop phase."""
    flown = {"IMU_GYRO_NF0_FRQ": 8.0, "IMU_GYRO_NF0_BW": 4.0}
    assert _choices("px4", flown, _line(8.0, LineSource.LOOP)).notches == ({"IMU_GYRO_NF0_FRQ": 0.0},)


def test_both_ends_of_a_range_move_together() -> None:
    flown = {"gyro_lpf1_dyn_hz[0]": 250.0, "gyro_lpf1_dyn_hz[1]": 500.0, "gyro_lpf1_static_hz": 250.0}
    (gyro,) = _choices("betaflight", flown).shared
    assert set(gyro) == {"gyro_lpf1_dyn_hz[0]", "gyro_lpf1_dyn_hz[1]"}


def test_noise_above_half_of_the_logs_rate_may_be_any_of_what_folds_there() -> None:
    frequency_hz = np.linspace(1.0, 200.0, 200)
    found = {float(frequency_hz[places[29]]) for places in aliases(frequency_hz, 100.0)}
    # 30 Hz in rows at 100 Hz may be 70, 130 or 170 Hz.
    assert found - {30.0} == {70.0, 130.0, 170.0}


def test_rows_at_the_loops_rate_hide_nothing() -> None:
    frequency_hz = np.linspace(1.0, 199.6, 100)
    for places in aliases(frequency_hz, 400.0):
        np.testing.assert_array_equal(places, np.arange(100))


def test_noise_below_a_step_of_an_output_counts_for_nothing() -> None:
    """A thousandth of the range, where 5 % are accepted: of noise at half of that, 4 % of what flew."""
    alone = Quick({}, 1.0, 0.02, 0.0)
    more, less = (together(Quick({}, 0.7, noise, 0.0), alone, 0.5) for noise in (0.04, 0.01))
    assert more == less
    assert more.won < -0.3
    assert more.lost == 0.0
    assert together(Quick({}, 0.7, 0.05, 0.0), alone, 0.5).lost == pytest.approx(math.log(0.05 / 0.04))


def test_noise_that_the_log_does_not_tell_is_not_to_be_won_and_not_to_rise() -> None:
    alone = Quick({}, 1.0, 1.0, 0.0)
    more, less, none = (together(Quick({}, 0.7, noise, 0.0), alone, math.nan) for noise in (1.1, 1.0, 0.3))
    assert more.lost == pytest.approx(math.log(1.1))
    assert less == none
    assert less.won < -0.3


def test_the_gyro_behind_its_filters_is_the_gyro_before_them_through_the_replayed_ones(corpus: Path) -> None:
    """Within 1 dB from 5 to 20 Hz; above, that log's filtered rate has a floor that is not the gyro's."""
    log = read_log(corpus / "firmware" / "ac47_quadx_sid_roll.BIN")
    before = next(one for one in log.candidates("body_rate") if one.raw)
    after = next(one for one in log.candidates("body_rate") if not one.raw)
    controllers = named(log.autopilot).controllers(log, log.parameters)
    assert controllers is not None
    rows = (after.time_s >= before.time_s[0]) & (after.time_s <= before.time_s[-1])
    period_s = float(np.median(np.diff(before.time_s)))
    for column, axis in enumerate(("roll", "pitch", "yaw")):
        spectra = [
            averaged_spectra([(one, one)], period_s=period_s, n_per_segment=800)
            for one in (before.values[:, column], after.values[rows][:, column])
        ]
        frequency_hz = spectra[0].frequency_hz[1:]
        passed = np.abs(gyro_filters(controllers.axes[axis], frequency_hz)) ** 2
        for low_hz in (5.0, 7.0, 10.0, 14.0):
            band = (frequency_hz >= low_hz) & (frequency_hz < 1.4 * low_hz)
            told = np.sum((spectra[0].input_psd[1:] * passed)[band])
            assert abs(10.0 * np.log10(told / np.sum(spectra[1].input_psd[1:][band]))) < 1.0
