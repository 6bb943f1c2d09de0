"""Moment of inertia from a bifilar swing: the truth within a per cent, through real logs."""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadid_logs.bifilar import Bifilar, swing
from quadid_logs.cli import main
from quadid_logs.data.log import FlightLog
from quadid_logs.errors import LogError, SettingsError, VehicleFileError
from quadid_logs.load import read_log
from quadid_logs.simulator import simulate
from quadid_logs.vehicle_file import read_vehicle
from quadid_logs.writers import write_log
from tests.bifilar import Hung, swing_log, swing_rate
from tests.marks import thorough, thorough_but

TIME_S = np.arange(0.0, 60.0, 0.01)


def strings(hung: Hung, **changes: float) -> Bifilar:
    return Bifilar(mass_kg=hung.mass, length_m=hung.length, distance_m=hung.distance, **changes)


@pytest.fixture(scope="module")
def log() -> FlightLog:
    """Return a swing from 10 degrees with drag, 100 Hz."""
    return swing_log(swing_rate(Hung(), TIME_S, 10.0), TIME_S)


@pytest.mark.parametrize("suffix", [".bin", *map(thorough, (".ulg", ".usd", ".tlog"))])
def test_the_truth_comes_back_through_every_format(log: FlightLog, suffix: str, tmp_path: Path) -> None:
    """Within 1 %, from 10 degrees at 100 Hz with linear and quadratic drag, as each autopilot writes it."""
    write_log(log, tmp_path / f"swing{suffix}")
    found = swing(read_log(tmp_path / f"swing{suffix}"), strings(Hung()))
    assert found.axis == "roll"
    assert found.moment_kg_m2 == pytest.approx(Hung().moment, rel=0.01)
    assert found.ci95[0] < Hung().moment < found.ci95[1]


#: Drag in proportion to rate and to its square.
DRAGS = ((1e-3, 0.0), (0.0, 2e-3), (2e-4, 2e-4))
SWINGS = [(angle_deg, *drag) for angle_deg in (3.0, 10.0, 30.0, 60.0) for drag in DRAGS]
EACH_ONCE = ((3.0, *DRAGS[0]), (30.0, *DRAGS[2]), (60.0, *DRAGS[1]))


@pytest.mark.parametrize("amplitude_deg_and_drag", thorough_but(EACH_ONCE, SWINGS), ids=str)
def test_large_angles_and_any_drag_move_the_moment_by_less_than_a_thousandth(
    amplitude_deg_and_drag: tuple[float, float, float],
) -> None:
    """The period of 60 degrees is 7 % longer than that of small swings."""
    amplitude_deg, linear, quadratic = amplitude_deg_and_drag
    hung = Hung(linear=linear, quadratic=quadratic)
    found = swing(swing_log(swing_rate(hung, TIME_S, amplitude_deg), TIME_S), strings(hung))
    assert found.moment_kg_m2 == pytest.approx(hung.moment, rel=1e-3)


def test_the_damping_is_that_of_the_drag() -> None:
    """Linear and quadratic, over the moment of inertia."""
    hung = Hung(linear=3e-4, quadratic=6e-4)
    (run,) = swing(swing_log(swing_rate(hung, TIME_S, 20.0), TIME_S), strings(hung)).runs
    assert run.linear_1_s * hung.moment == pytest.approx(3e-4, rel=0.05)
    assert run.quadratic * hung.moment == pytest.approx(6e-4, rel=0.05)


@pytest.mark.thorough
@given(
    moment=st.floats(1e-5, 1.0),
    ratio=st.floats(0.3, 3.0),
    length=st.floats(0.3, 2.0),
    amplitude_deg=st.floats(5.0, 40.0),
    seed=st.integers(0, 1000),
)
@settings(max_examples=8, deadline=None)
def test_any_vehicle_on_any_strings_is_measured(
    moment: float, ratio: float, length: float, amplitude_deg: float, seed: int
) -> None:
    """A minute, and twelve periods at least; the radius of gyration is 0.3 to 3 times half the distance."""
    distance = 0.3 * length
    hung = Hung(
        moment=moment,
        mass=moment / (0.5 * distance * ratio) ** 2,
        length=length,
        distance=distance,
        linear=0.01 * moment,
        quadratic=0.01 * moment,
    )
    period_s = 2.0 * math.pi * ratio * math.sqrt(length / 9.81)
    time_s = np.arange(0.0, max(60.0, 12.0 * period_s), 0.01)
    found = swing(swing_log(swing_rate(hung, time_s, amplitude_deg), time_s, seed=seed), strings(hung))
    assert found.moment_kg_m2 == pytest.approx(moment, rel=0.01)


def test_a_slow_swing_that_was_logged_too_shortly_is_refused_with_what_to_log() -> None:
    """Seven swings of 8.5 s: the push takes more than one of them."""
    hung = Hung(moment=1.0, mass=1.0 / 0.9**2, length=2.0, distance=0.6)
    with pytest.raises(LogError) as raised:
        swing(swing_log(swing_rate(hung, TIME_S, 5.0), TIME_S), strings(hung))
    assert "ten swings" in raised.value.hint


@cache
def pushed_thrice() -> tuple[np.ndarray, np.ndarray]:
    """Two minutes, pushed every forty seconds: times, and rates."""
    time_s = np.arange(0.0, 120.0, 0.01)
    return time_s, swing_rate(Hung(), time_s, 10.0, pushes_s=(0.0, 40.0, 80.0))


@pytest.mark.thorough
def test_each_push_is_a_swing_of_its_own() -> None:
    """Three of them; none reaches over a push."""
    time_s, rate = pushed_thrice()
    found = swing(swing_log(rate, time_s, axis=2), strings(Hung()))
    assert [round(run.start_s / 40.0) for run in found.runs] == [0, 1, 2]
    assert all(run.end_s < 40.0 * (place + 1) for place, run in enumerate(found.runs))
    assert found.axis == "yaw"


@pytest.mark.thorough
def test_only_the_swings_of_the_chosen_part_count(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The first of three pushes went wrong: the part after it holds two swings."""
    time_s, rate = pushed_thrice()
    path = tmp_path / "swing.bin"
    write_log(swing_log(rate, time_s), path)
    asked = ["swing", str(path), "--mass", "1.6", "--length", "0.9", "--distance", "0.4", "--json"]
    assert main(asked) == 0
    runs = json.loads(capsys.readouterr().out)["swings"]
    start_s = runs[1]["start_s"] - 1.0
    assert main([*asked, "--start-s", str(start_s)]) == 0
    assert len(json.loads(capsys.readouterr().out)["swings"]) == len(runs) - 1 == 2
    assert main([*asked, "--start-s", "5000"]) == 2
    assert "The chosen part of the log has no body rates" in capsys.readouterr().err


def test_the_strings_are_most_of_the_interval(log: FlightLog) -> None:
    """A millimetre of 100 mm counts 2 %, as the distance is squared."""
    hung = Hung(distance=0.1, length=0.5)
    rate = swing_rate(hung, TIME_S, 10.0)
    low, high = swing(swing_log(rate, TIME_S), strings(hung, mass_half_width_kg=0.0)).ci95
    assert 0.5 * (high - low) / hung.moment == pytest.approx(math.hypot(0.02, 0.002, 0.0027), rel=0.02)


@pytest.mark.thorough
def test_air_that_swings_along_lowers_the_lower_end_alone(log: FlightLog) -> None:
    """A disc of 0.5 m that turns about its diameter moves 16/45 rho a^5 of air (Lamb); in yaw none."""
    without, with_air = (swing(log, strings(Hung(), span_m=span)) for span in (0.0, 0.5))
    assert with_air.ci95[1] == without.ci95[1]
    assert without.ci95[0] - with_air.ci95[0] == pytest.approx(16 / 45 * 1.225 * 0.25**5, rel=1e-9)
    yaw = swing_log(swing_rate(Hung(), TIME_S, 10.0), TIME_S, axis=2)
    assert swing(yaw, strings(Hung(), span_m=0.5)).air_kg_m2 == 0.0


def test_a_flight_is_no_swing() -> None:
    """Doublets repeat, and do not die away as a swing does."""
    flight = simulate("doublets", seed=1, duration_s=40.0, rate_hz=100.0)
    with pytest.raises(LogError, match="shows no swing"):
        swing(flight.log, strings(Hung()))


def test_noise_is_no_swing() -> None:
    with pytest.raises(LogError, match="shows no swing"):
        swing(swing_log(np.zeros(TIME_S.size), TIME_S), strings(Hung()))


def test_four_periods_are_too_few() -> None:
    """A hand that turns the vehicle to and fro is no swing."""
    time_s = np.arange(0.0, 4.0, 0.01)
    with pytest.raises(LogError, match="five periods"):
        swing(swing_log(swing_rate(Hung(), time_s, 10.0), time_s), strings(Hung()))


@pytest.mark.parametrize(
    "wrong",
    [
        {"mass_kg": 0.0},
        {"length_m": -1.0},
        {"distance_m": math.nan},
        {"distance_m": 3.0},
        {"span_m": math.inf},
        {"mass_half_width_kg": -1.0},
    ],
)
def test_impossible_strings_are_refused(wrong: dict[str, float]) -> None:
    """Before anything is read; millimetres are a likely mistake."""
    with pytest.raises(SettingsError):
        Bifilar(**({"mass_kg": 1.0, "length_m": 1.0, "distance_m": 0.3} | wrong))


def test_an_unknown_axis_is_refused(log: FlightLog) -> None:
    with pytest.raises(SettingsError, match="roll, pitch, yaw"):
        swing(log, strings(Hung()), "up")


def test_the_command_prints_the_moment_and_the_line_of_the_vehicle_file(
    log: FlightLog, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line is one that the vehicle file takes; moments of other axes are kept."""
    monkeypatch.chdir(tmp_path)
    write_log(log, Path("swing.bin"))
    Path("quad.toml").write_text("mass_kg = 1.6\ninertia_kg_m2 = [1.0, 0.0162, nan]\n")
    asked = ["swing", "swing.bin", "--length", "0.9", "--distance", "0.4", "--vehicle", "quad.toml"]
    assert main(asked) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("swing.bin: roll Ixx = 0.0145")
    assert lines[-1] == "  vehicle file: inertia_kg_m2 = [0.0145, 0.0162, nan]"
    Path("new.toml").write_text(lines[-1].split(": ", 1)[1])
    inertia = read_vehicle(Path("new.toml")).inertia_kg_m2
    assert inertia is not None
    np.testing.assert_array_equal(np.diagonal(inertia), [0.0145, 0.0162, np.nan])
    assert main([*asked, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["inertia_kg_m2"]["value"] == pytest.approx(0.0145, rel=0.01)
    assert printed["axis"] == "roll"


@pytest.mark.parametrize("more", [[], ["--mass", "0"], ["--mass", "1.6", "--axis", "up"]])
def test_wrong_usage_ends_with_2_and_one_line(
    more: list[str], log: FlightLog, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No mass, no mass above zero, no such axis."""
    path = tmp_path / "swing.bin"
    write_log(log, path)
    assert main(["swing", str(path), "--length", "0.9", "--distance", "0.4", *more]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    "text", ["[nan, nan, nan]", "[[nan, 0, 0], [0, 1, 0], [0, 0, 1]]", "[nan, -1.0, 2.0]"]
)
def test_a_vehicle_file_needs_one_moment_that_is_known(text: str, tmp_path: Path) -> None:
    path = tmp_path / "quad.toml"
    path.write_text(f"inertia_kg_m2 = {text}")
    with pytest.raises(VehicleFileError):
        read_vehicle(path)


@pytest.mark.thorough
def test_every_log_of_the_corpus_is_measured_or_refused(corpus: Path) -> None:
    """Damaged ones, flights, walks: never another exception."""
    for path in sorted((corpus / "damaged").iterdir()):
        try:
            swing(read_log(path), strings(Hung()))
        except (LogError, SettingsError):
            continue
