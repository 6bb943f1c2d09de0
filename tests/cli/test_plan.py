"""``quadid-log plan``: parameters within their ranges, a card, and a prediction that was flown."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.cli import main
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.planning import Prediction, make_plan, predict
from quadid_logs.report.plan import card_lines, excitation_lines, live_files, parameter_files, settings_lines
from quadid_logs.simulator.sweep import Sweep, sweep_wave
from tests.synthetic_results import synthetic_prediction

pytestmark = pytest.mark.usefixtures("quick_multisines")

#: ArduCopter, mode_systemid.cpp: the ranges of its parameters; the mixer takes a fraction of 1.
RANGES = {
    "SID_AXIS": (10, 12),
    "SID_MAGNITUDE": (0.0, 0.3),
    "SID_F_START_HZ": (0.01, 100),
    "SID_F_STOP_HZ": (0.01, 100),
    "SID_T_FADE_IN": (0, 20),
    "SID_T_REC": (0, 255),
    "SID_T_FADE_OUT": (0, 5),
}


@pytest.mark.parametrize("axis", ["roll", "pitch", "yaw"])
def test_every_parameter_of_a_sweep_is_within_the_firmware_s_range(axis: str) -> None:
    """And the record is longer than the two cycles at its first frequency, or it would not start."""
    plan = make_plan("ardupilot", [axis])
    found = dict(plan.settings_of(axis))
    assert found.keys() == RANGES.keys()
    for name, (low, high) in RANGES.items():
        assert low <= found[name] <= high, name
    assert found["SID_T_REC"] > 2.0 / found["SID_F_START_HZ"]


def test_each_axis_gets_its_own_number_of_the_mixer() -> None:
    """10 roll, 11 pitch, 12 yaw."""
    plan = make_plan("ardupilot")
    assert [dict(plan.settings_of(axis))["SID_AXIS"] for axis in ("roll", "pitch", "yaw")] == [10, 11, 12]


def test_parameter_files_are_what_the_ground_stations_read() -> None:
    """NAME,VALUE for ArduPilot, five tab-separated columns for PX4."""
    files = parameter_files(make_plan("ardupilot", ["yaw"]))
    assert files.keys() == {"logging.param", "sweep-yaw.param", "sweep-off.param", "excite.lua"}
    assert "LOG_BITMASK,176127\n" in files["logging.param"]
    for text in (text for name, text in files.items() if name.endswith(".param")):
        for line in text.splitlines():
            assert line.startswith("#") or len(line.split(",")) == 2
    text = parameter_files(make_plan("px4"))["logging.params"]
    assert text.splitlines()[-1].split("\t") == ["1", "1", "SDLOG_PROFILE", "25", "6"]


def written(text: str) -> dict[str, str]:
    """Return names and values of a file of NAME,VALUE or of QGroundControl's columns, as they stand there."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return dict(line.split(",") if "," in line else line.split("\t")[2:4] for line in lines)


#: Beside ATTITUDE_FAST (bit 0, ArduCopter/defines.h): PID (12) and IMU_FAST (18); seven digits; the highest
#: of 16 bits; what a log of single precision holds exactly no more.
@pytest.mark.parametrize("mask", [176126, 407550, 1224702, 16777214, -22530])
def test_a_vehicle_keeps_the_bits_of_its_mask_and_gets_them_back(mask: int) -> None:
    """`logging.param` was the default with a bit: it took PID and IMU_FAST out of the log for good."""
    files = parameter_files(make_plan("ardupilot", ["yaw"], None, {"LOG_BITMASK": float(mask)}))
    assert written(files["logging.param"]) == {"LOG_BITMASK": str(mask + 1)}
    assert written(files["logging-back.param"]) == {"LOG_BITMASK": str(mask)}


@pytest.mark.parametrize(
    ("profile", "logged"), [(1, 25), (3, 27), (2, 27), (1025, 1049)], ids=lambda value: str(value)
)
def test_a_vehicle_keeps_the_bits_of_its_profile_and_gets_them_back(profile: int, logged: int) -> None:
    """PX4, src/modules/logger/params.c: bits 0, 3 and 4 are needed; on the vehicle of that number."""
    files = parameter_files(make_plan("px4", [], None, {"SDLOG_PROFILE": float(profile), "MAV_SYS_ID": 7.0}))
    assert written(files["logging.params"]) == {"SDLOG_PROFILE": str(logged)}
    assert written(files["logging-back.params"]) == {"SDLOG_PROFILE": str(profile)}
    rows = [line.split("\t") for text in files.values() for line in text.splitlines() if "SDLOG" in line]
    assert {row[0] for row in rows} == {"7"}


@pytest.mark.parametrize(
    ("autopilot", "parameters"),
    [
        ("ardupilot", {"LOG_BITMASK": 407551.0}),
        ("ardupilot", {"LOG_BITMASK": 2.0**24}),
        ("ardupilot", {"LOG_BITMASK": float("nan")}),
        ("ardupilot", {"SCHED_LOOP_RATE": 400.0}),
        ("px4", {"SDLOG_PROFILE": 27.0}),
    ],
)
def test_a_mask_that_has_its_bits_or_is_not_known_exactly_is_written_into_no_file(
    autopilot: str, parameters: dict[str, float], yaw_flight: Prediction
) -> None:
    """The card says what to do with it."""
    plan = make_plan(autopilot, ["yaw"], None, parameters)
    assert not [name for name in parameter_files(plan) if name.startswith("logging")]
    card = "\n".join(card_lines(plan, yaw_flight))
    assert "LOG_BITMASK" in card or "SDLOG_PROFILE is 27" in card


def test_a_plan_like_a_log_keeps_what_is_set_on_its_vehicle(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    yaw_flight: Prediction,
) -> None:
    """The sample's own mask is 176126; of another autopilot nothing can be kept."""
    monkeypatch.setattr("quadid_logs.planning.predict", lambda *_a: yaw_flight)
    like = ["--like", "sample_logs/default-logging.bin", "-o", str(tmp_path / "plan")]
    assert main(["plan", "--autopilot", "ardupilot", "--axis", "yaw", *like]) == 0
    assert "LOG_BITMASK 176126 -> 176127" in capsys.readouterr().out
    assert written((tmp_path / "plan" / "logging-back.param").read_text()) == {"LOG_BITMASK": "176126"}
    assert main(["plan", "--autopilot", "px4", *like, "--force"]) == 2
    assert "is a log of ardupilot" in capsys.readouterr().err
    # The log says whose it is.
    assert main(["plan", "--axis", "yaw", *like, "--force"]) == 0
    assert written((tmp_path / "plan" / "logging-back.param").read_text()) == {"LOG_BITMASK": "176126"}


def test_without_autopilot_and_log_nothing_is_planned(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "--axis", "yaw"]) == 2
    assert "--like" in capsys.readouterr().err


@pytest.mark.corpus
def test_no_multirotor_is_planned_for_by_the_log_of_a_plane(
    corpus: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It got doublets and a mask of a copter."""
    assert main(["plan", "--like", str(corpus / "real/plane423-fastlog-real.bin")]) == 2
    assert "a fixed-wing aircraft" in capsys.readouterr().err


def test_a_plan_like_a_log_without_a_model_says_whose_model_it_is_computed_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The card spoke of the model of the log, of which there was none."""
    monkeypatch.setattr("quadid_logs.planning.predict", lambda *_a: synthetic_prediction())
    like = ["--like", "sample_logs/default-logging.bin", "-o", str(tmp_path / "plan")]
    assert main(["plan", "--axis", "roll", *like]) == 0
    printed = capsys.readouterr().out
    assert "the log shows nothing of roll" in printed
    assert "model of the log" not in printed


def test_a_plan_for_a_vehicle_that_nobody_knows_says_when_not_to_load_its_mask() -> None:
    """Only who looks at the vehicle can tell whether another one is set."""
    files = parameter_files(make_plan("ardupilot")) | parameter_files(make_plan("px4"))
    assert "if your value is not 176126, do not load" in files["logging.param"]
    assert "if your value is not 1, do not load" in files["logging.params"]


def test_the_sweep_is_taken_off_the_vehicle_by_a_file() -> None:
    """SID_AXIS 0 does not start (mode_systemid.cpp); no value is set that is dangerous on a mixer axis."""
    assert written(parameter_files(make_plan("ardupilot", ["roll"]))["sweep-off.param"]) == {"SID_AXIS": "0"}


def test_before_system_id_mode_the_pilot_flies_doublets() -> None:
    """And the card says why, and what the logger cannot do."""
    plan = make_plan("ardupilot", ["roll"], (3, 4))
    assert not plan.sweeps
    assert parameter_files(plan).keys() == {"logging.param"}
    notes = plan.advice.version_notes(plan.version)
    assert any("needs 4.0 or later" in note for note in notes)
    assert any("at 25 Hz" in note for note in notes)


def test_the_sweep_starts_slow_ends_fast_and_fades() -> None:
    """Its frequency by zero crossings is that of the parameters, at both ends."""
    sweep = Sweep(magnitude=0.1, start_hz=0.5, stop_hz=8.0, record_s=40.0)
    time_s = np.arange(0.0, 40.0, 1e-3)
    wave = sweep_wave(sweep, time_s)
    crossings = time_s[1:][np.diff(np.signbit(wave)) != 0]
    gaps = np.diff(crossings[(crossings > 0.1) & (crossings < 39.9)])
    assert 0.5 / gaps[0] == pytest.approx(0.5, rel=0.03)
    assert 0.5 / gaps[-1] == pytest.approx(8.0, rel=0.03)
    assert abs(wave[0]) < 1e-9
    assert abs(wave[-1]) < 1e-3
    assert np.abs(wave).max() <= 0.1


#: A heavier quadrotor, and its file.
HEAVY = Vehicle(name="heavy", mass_kg=1.8)
HEAVY_FILE = 'name = "heavy"\nmass_kg = 1.8\n'


@pytest.fixture
def yaw_flight() -> Prediction:
    """Return what a planned flight might give, for tests of what stands around it."""
    return synthetic_prediction()


@pytest.fixture(scope="module")
def flown_yaw() -> Prediction:
    """Return what the planned yaw sweep gives on a heavier quadrotor."""
    return predict(make_plan("ardupilot", ["yaw"], vehicle=HEAVY), HEAVY)


@pytest.mark.thorough
def test_the_planned_axis_is_usable_and_no_other(flown_yaw: Prediction) -> None:
    """A sweep on one axis teaches that axis only."""
    verdicts = {axis: found.verdict for axis, found in flown_yaw.diagnosis.axes.items()}
    assert verdicts == {"roll": "refused", "pitch": "refused", "yaw": "usable"}


@pytest.mark.thorough
def test_the_card_predicts_for_the_vehicle_that_was_given(flown_yaw: Prediction) -> None:
    """With the interval, and only for the planned axis."""
    planned = make_plan("ardupilot", ["yaw"], vehicle=HEAVY)
    text = "\n".join(card_lines(planned, flown_yaw))
    assert "heavy" in text
    assert "- yaw: usable, effectiveness " in text
    assert "known to ±" in text
    assert "- roll:" not in text
    magnitude = planned.sweeps["yaw"].magnitude
    assert f"READ BACK that SID_AXIS is 12 and SID_MAGNITUDE is {magnitude:g}" in text


def test_nothing_is_set_on_the_ground_before_the_landing() -> None:
    """ "Set SID_AXIS back to 0" stood before "Land", though files are loaded on the ground."""
    steps = make_plan("ardupilot", ["roll", "yaw"]).steps_by_hand()
    assert "and land" in steps[-2]
    assert steps[-1] == "After the last landing, load sweep-off.param: it sets SID_AXIS back to 0."


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_card_lands_once_a_flight(autopilot: str, yaw_flight: Prediction) -> None:
    """A sweep ends with its own landing; doublets with one."""
    planned = make_plan(autopilot, ["yaw"])
    text = "\n".join(card_lines(planned, yaw_flight)).split("## Without the script")[0]
    assert len(re.findall(r"\bland\b", text, re.IGNORECASE)) == 1


def test_every_sweep_is_loaded_twice_and_read_back_before_it_is_flown() -> None:
    """Loaded once it leaves SID_MAGNITUDE at its default of 15 on a mixer axis: the vehicle flips."""
    steps = make_plan("ardupilot").steps_by_hand()
    for axis in ("roll", "pitch", "yaw"):
        own = [step for step in steps if step.startswith(f"{axis.capitalize()}, ")]
        words = ["A SECOND TIME", "READ BACK", "switch to System ID"]
        assert [next(word for word in words if word in step) for step in own] == words


def test_parameters_are_loaded_on_the_ground_before_the_first_sweep() -> None:
    """A pilot who flies has no hand for a ground station."""
    steps = make_plan("ardupilot", ["roll"]).steps_by_hand()
    (on_ground,) = (place for place, step in enumerate(steps) if "on the ground, disarmed" in step)
    assert "second person" in steps[on_ground]
    assert on_ground < next(place for place, step in enumerate(steps) if step.startswith("Roll, load"))


@pytest.mark.thorough
def test_stick_doublets_are_planned_where_there_is_no_sweep() -> None:
    """PX4: all three axes are usable after 30 s each."""
    plan = make_plan("px4")
    prediction = predict(plan)
    assert {found.verdict for found in prediction.diagnosis.axes.values()} == {"usable"}
    assert "doublets" in "\n".join(card_lines(plan, prediction))


@pytest.mark.thorough
def test_a_betaflight_plan_is_flown_by_stick_or_chirp_and_gives_every_axis(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What to type in, after what keeps the settings; the simulated flight of it is usable."""
    folder = tmp_path / "plan"
    assert main(["plan", "--autopilot", "betaflight", "--firmware", "2025.12", "-o", str(folder), "-q"]) == 0
    assert capsys.readouterr().out == ""
    card = (folder / "plan.md").read_text()
    assert card.index("diff all") < card.index("blackbox_sample_rate = 1/4") < card.index("CHIRP")
    assert [axis for axis in ("roll", "pitch", "yaw") if f"- {axis}: usable, effectiveness" in card] == [
        "roll",
        "pitch",
        "yaw",
    ]
    assert {path.name for path in folder.iterdir()} == {
        "plan.md",
        "plan.html",
        "chirp.txt",
        "chirp-off.txt",
    }


def test_a_plan_for_a_betaflight_without_a_chirp_mode_names_none() -> None:
    """It was added in 2025.12: a table of its sweeps and two files would have been of no use."""
    plan = make_plan("betaflight", [], (4, 5))
    assert not plan.script_files()
    assert "CHIRP" not in "\n".join([*excitation_lines(plan), *plan.steps()])
    assert sum("doublets" in step for step in plan.steps()) == 3


def test_a_plan_for_an_old_betaflight_sets_what_it_has() -> None:
    """blackbox_p_ratio before 4.3."""
    card = "\n".join(settings_lines(make_plan("betaflight", ["roll"], (4, 2))))
    assert "blackbox_p_ratio = 32" in card
    assert "blackbox_sample_rate" not in card


def test_card_and_files_are_written_together(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    yaw_flight: Prediction,
) -> None:
    """What is printed is what is written, and a second run needs --force."""
    monkeypatch.setattr("quadid_logs.planning.predict", lambda *_a: yaw_flight)
    arguments = ["plan", "--autopilot", "ardupilot", "--axis", "yaw", "-o", str(tmp_path / "plan")]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert (tmp_path / "plan" / "plan.md").read_text() in printed
    assert {path.name for path in (tmp_path / "plan").iterdir()} == {
        "plan.md",
        "plan.html",
        "logging.param",
        "sweep-yaw.param",
        "sweep-off.param",
        "excite.lua",
        "live.param",
        "live-back.param",
    }
    assert main(arguments) == 2
    assert "--force" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--autopilot", "inav"], "ardupilot, betaflight, crazyflie, px4"),
        (["--autopilot", "px4", "--axis", "heave"], "roll,pitch,yaw"),
        (["--autopilot", "ardupilot", "--firmware", "four"], "4.5.7"),
        ([], "--autopilot"),
    ],
)
def test_wrong_usage_is_one_clear_line(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2 and what to choose from."""
    assert main(["plan", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert len(err.splitlines()) == 1


@pytest.mark.thorough
def test_the_plan_as_json_holds_what_the_card_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Settings by name, steps in order, and what the simulated flight gave; nothing else on stdout."""
    file = tmp_path / "heavy.toml"
    file.write_text(HEAVY_FILE)
    given = ["--autopilot", "ardupilot", "--axis", "yaw", "--vehicle", str(file)]
    assert main(["plan", *given, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["logging"] == {"LOG_BITMASK": 176127.0}
    planned = make_plan("ardupilot", ["yaw"], vehicle=HEAVY)
    assert content["sweeps"]["yaw"] == dict(planned.settings_of("yaw"))
    assert any("excite.lua" in step for step in content["steps"])
    assert content["excitation"]["axes"]["yaw"]["half_width"] > 0.01
    assert list(content["expected"]["axes"]) == ["yaw"]
    gain = content["expected"]["axes"]["yaw"]["gain"]
    assert gain["ci95"][0] < gain["value"] < gain["ci95"][1]
    low, high = content["expected"]["lag_s"]["ci95"]
    assert low <= content["expected"]["lag_s"]["value"] <= high


def test_the_plan_writes_what_makes_the_vehicle_stream_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, yaw_flight: Prediction
) -> None:
    """ArduPilot's bitmask with a way back to what flew; PX4's list of topics, each as its logger reads it."""
    monkeypatch.setattr("quadid_logs.planning.predict", lambda *_a: yaw_flight)
    made = make_plan("ardupilot", [], None, {"LOG_BACKEND_TYPE": 4.0})
    files = {name: written(text) for name, text in live_files(made).items()}
    assert files == {"live.param": {"LOG_BACKEND_TYPE": "7"}, "live-back.param": {"LOG_BACKEND_TYPE": "4"}}
    assert main(["plan", "--autopilot", "px4", "-o", str(tmp_path / "plan")]) == 0
    topics = [line.split() for line in (tmp_path / "plan" / "logger_topics.txt").read_text().splitlines()]
    assert ["vehicle_rates_setpoint", "4"] in topics
    assert all(len(line) == 1 or line[1].isdecimal() for line in topics)


def test_the_card_says_what_to_set_to_watch_the_flight(yaw_flight: Prediction) -> None:
    """With the link that it takes; nothing for an autopilot that streams no log."""
    cards = {
        name: "\n".join(card_lines(make_plan(name, ["yaw"]), yaw_flight))
        for name in ("ardupilot", "px4", "crazyflie")
    }
    assert "LOG_BACKEND_TYPE = 3" in cards["ardupilot"]
    assert "SDLOG_BACKEND = 3" in cards["px4"]
    assert all("kB/s" in card for card in (cards["ardupilot"], cards["px4"]))
    assert "quadid-log live" not in cards["crazyflie"]
