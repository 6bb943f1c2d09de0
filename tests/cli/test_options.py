"""Options are alike on all verbs."""

from __future__ import annotations

import json
import shutil
import webbrowser
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from quadid_logs import pipeline
from quadid_logs.cli import main
from quadid_logs.cli.app import command_of
from quadid_logs.cli.options import axes_of
from quadid_logs.data.result import Result
from quadid_logs.errors import SettingsError
from tests.conftest import REPOSITORY
from tests.marks import thorough
from tests.synthetic_results import synthetic_prediction, usable_result, write_placeholder_log

pytestmark = pytest.mark.usefixtures("quick_multisines")

SAMPLES = REPOSITORY / "sample_logs"
SYSID, TELEMETRY = SAMPLES / "sysid-quad-x.bin", SAMPLES / "doublets.tlog"
#: Refused for its rate of 10 Hz, and so analyzed in no time.
SLOW = SAMPLES / "default-logging.bin"
#: Of what analyzes logs; `compare` names the logs of its two files by --logs, `repeat` takes one of each.
ON_LOGS = {"--start-s", "--end-s", "--band", "--system", "--vehicle", "--quiet"}
ONE_LOG = {"--log"}
PAGES = {"--open"}


@pytest.mark.parametrize(
    ("verb", "wanted"),
    [
        ("analyze", ON_LOGS | ONE_LOG | PAGES),
        ("tune", ON_LOGS | ONE_LOG | PAGES),
        ("check", ON_LOGS | ONE_LOG),
        ("export", ON_LOGS | ONE_LOG),
        ("compare", ON_LOGS | PAGES),
        ("repeat", ON_LOGS | PAGES),
        ("info", {"--start-s", "--end-s", "--system", "--vehicle", "--quiet"} | ONE_LOG),
        ("swing", {"--start-s", "--end-s", "--system", "--vehicle", "--quiet"} | ONE_LOG),
        ("simulate", {"--vehicle", "--quiet"}),
        ("fleet", {"--band", "--vehicle", "--quiet"}),
        ("plan", ON_LOGS | ONE_LOG | PAGES | {"--axes"}),
    ],
)
def test_a_verb_takes_the_options_of_all(verb: str, wanted: set[str]) -> None:
    """What one verb takes a user tries on the next one."""
    command = command_of().commands[verb]  # type: ignore[attr-defined]
    assert wanted <= {option for each in command.params for option in each.opts}


@pytest.fixture(scope="module")
def of_roll(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight that moves roll only."""
    return write_placeholder_log(tmp_path_factory.mktemp("roll") / "roll.bin")


@pytest.fixture
def analyzed_once(of_roll: Path, of_roll_result: Result, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same flight, of which every verb finds what was found before."""
    monkeypatch.setattr(pipeline, "analyze", lambda *_given, **_named: of_roll_result)
    return of_roll


@pytest.fixture(scope="module")
def of_roll_result(of_roll: Path) -> Result:
    """What an analysis might find in it: a model of roll alone."""
    found = usable_result(8.0, str(of_roll))
    axes = {
        axis: verdict if axis == "roll" else replace(verdict, verdict="refused", reasons=("QL401",))
        for axis, verdict in found.diagnosis.axes.items()
    }
    log = replace(found.log, swept_axes=("roll",))
    return replace(found, log=log, diagnosis=replace(found.diagnosis, axes=axes))


@pytest.mark.parametrize(("axes", "code"), [("roll", 0), ("", 0), ("roll,pitch", 1), ("yaw", 1)])
def test_the_exit_code_is_that_of_the_axes_that_the_flight_was_for(
    axes: str, code: int, analyzed_once: Path, tmp_path: Path
) -> None:
    """A flight of roll ended with 1, however well roll was known."""
    given = ["--axes", axes] if axes else []
    assert main(["analyze", str(analyzed_once), "-o", str(tmp_path), "--no-report", "-q", *given]) == code


def test_an_axis_that_was_not_asked_for_is_no_problem_to_a_quiet_run(
    analyzed_once: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is printed; the files say everything as before."""
    main(["analyze", str(analyzed_once), "-o", str(tmp_path), "--no-report", "-q", "--axes", "roll"])
    assert capsys.readouterr() == ("", "")
    written = json.loads((tmp_path / "roll" / "result.json").read_text())
    assert written["axes"]["pitch"]["verdict"] == "refused"


@pytest.mark.parametrize(("swept", "code"), [(("roll",), 0), (("roll", "pitch"), 1), ((), 1)])
def test_a_log_that_names_the_axes_it_swept_is_judged_on_these(
    swept: tuple[str, ...], code: int, of_roll: Path, of_roll_result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A System ID flight of roll says nothing of pitch, and was never meant to."""
    result = replace(of_roll_result, log=replace(of_roll_result.log, swept_axes=swept))
    monkeypatch.setattr(pipeline, "analyze", lambda *_given, **_named: result)
    assert main(["analyze", str(of_roll), "--json", "--no-report", "-q"]) == code


def test_the_terminal_says_on_which_axes_a_sweep_is_judged(
    of_roll: Path,
    of_roll_result: Result,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Or an exit code of 0 beside a refused axis looks like a mistake."""
    result = replace(of_roll_result, log=replace(of_roll_result.log, swept_axes=("roll",)))
    monkeypatch.setattr(pipeline, "analyze", lambda *_given, **_named: result)
    main(["analyze", str(of_roll), "-o", str(tmp_path), "--no-report"])
    told = "The flight swept roll: the exit code is judged on that alone. --axes chooses other axes."
    assert told in capsys.readouterr().out
    main(["analyze", str(of_roll), "-o", str(tmp_path), "--no-report", "--force", "--axes", "roll"])
    assert told not in capsys.readouterr().out


def test_what_has_no_progress_to_show_is_quiet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`info` prints its result all the same."""
    log = tmp_path / "short.bin"
    assert main(["simulate", "hover", "-o", str(log), "--duration-s", "20", "--rate-hz", "50", "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["info", str(log), "-q"]) == 0
    out, err = capsys.readouterr()
    assert "Autopilot" in out
    assert err == ""


@pytest.mark.parametrize("given", [["--axes", "yaw,roll"], ["--axis", "roll", "--axis", "yaw"]])
def test_a_plan_names_its_axes_as_an_analysis_does(
    given: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between commas; one option for each is read as well."""
    # What the flight gives is no matter here: `test_the_plan_as_json_holds_what_the_card_says` flies one.
    monkeypatch.setattr("quadid_logs.planning.predict", lambda *_a: synthetic_prediction())
    assert main(["plan", "--autopilot", "px4", *given, "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)["expected"]["axes"]) == ["roll", "yaw"]


def test_axes_are_named_between_commas_in_any_order() -> None:
    """None where none is named: then the log says which, or all count."""
    assert axes_of("yaw, Roll") == ("roll", "yaw")
    assert axes_of("") == ()


@pytest.mark.parametrize("text", ["heave", "roll,", "roll;pitch", "\x1b[31m"])
def test_an_axis_that_is_none_is_refused(text: str) -> None:
    """With those that there are."""
    with pytest.raises(SettingsError, match="roll,pitch,yaw"):
        axes_of(text)


def test_logs_of_one_stem_and_two_endings_have_two_folders(tmp_path: Path) -> None:
    """The second one was refused, or with --force took the place of the first."""
    out = tmp_path / "out"
    first, second = tmp_path / "flight.BIN", tmp_path / "flight.tlog"
    shutil.copy(SLOW, first)
    shutil.copy(TELEMETRY, second)
    for log in (first, second, second):
        assert main(["analyze", str(log), "-o", str(out), "--no-report", "-q", "--force"]) in (0, 1)
    read = {
        folder.name: Path(json.loads((folder / "result.json").read_text())["log"]["path"]).name
        for folder in out.iterdir()
    }
    assert read == {"flight": "flight.BIN", "flight-tlog": "flight.tlog"}


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"log": {"path": 3}}', "[" * 100_000])
def test_a_folder_with_a_result_that_is_none_is_still_the_log_s_own(content: str, tmp_path: Path) -> None:
    """It is then refused without --force, as before."""
    from quadid_logs.report import report_folders

    (tmp_path / "flight").mkdir()
    (tmp_path / "flight" / "result.json").write_text(content)
    assert report_folders([Path("flight.bin")], tmp_path) == (tmp_path / "flight",)


def test_a_model_of_axes_that_must_not_be_trusted_is_exported_with_a_warning(
    analyzed_once: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 1 was all that told."""
    assert main(["export", str(analyzed_once), "--model", "-o", str(tmp_path / "model.py")]) == 1
    out, err = capsys.readouterr()
    assert "Wrote the model" in out
    (line,) = [each for each in err.splitlines() if "Do not trust" in each]
    assert "Do not trust pitch and yaw of this model" in line
    assert f"quadid-log analyze {analyzed_once}" in line


def test_a_part_of_the_log_is_exported(tmp_path: Path) -> None:
    """As analyze takes it."""
    file = tmp_path / "series.csv"
    part = ["--start-s", "40", "--end-s", "52", "-q"]
    assert main(["export", str(SYSID), "-o", str(file), *part]) == 0
    times = [float(line.split(",")[0]) for line in file.read_text().splitlines()[1:]]
    assert 40.0 <= times[0] < times[-1] <= 52.0


def test_a_part_that_holds_no_flight_is_not_exported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One clear line, and no file."""
    file = tmp_path / "series.csv"
    assert main(["export", str(SYSID), "-o", str(file), "--start-s", "5000"]) == 2
    assert "the log runs from" in capsys.readouterr().err
    assert not file.exists()


@pytest.mark.thorough
@pytest.mark.parametrize(
    "arguments",
    [
        lambda folder: ["tune", str(SYSID), "-o", folder],
        thorough(lambda folder: ["compare", str(SYSID), str(SYSID), "-o", folder]),
        thorough(lambda folder: ["repeat", str(SYSID), str(SAMPLES / "damaged.bin"), "-o", folder]),
    ],
    ids=["tune", "compare", "repeat"],
)
def test_a_quiet_verb_prints_problems_only_and_opens_its_page(
    arguments: Callable[[str], list[str]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nothing on stdout; on stderr one line where the exit code is not 0."""
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: opened.append(address) or True)
    code = main([*arguments(str(tmp_path / "out")), "-q", "--open"])
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == (code != 0)
    (address,) = opened
    assert address.endswith(".html")
    assert Path(address.removeprefix("file://")).is_file()


def test_a_band_set_by_hand_is_that_of_a_tuning(tmp_path: Path) -> None:
    """It reaches the fit: a band that cannot be is refused."""
    assert main(["tune", str(SYSID), "-o", str(tmp_path), "--band", "8", "1"]) == 2


def test_a_flight_is_compared_over_a_part_of_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each log on its own clock."""
    assert main(["compare", str(SYSID), str(SYSID), "--start-s", "5000"]) == 2
    assert "the log runs from 31.3 to 61.0 s" in capsys.readouterr().err
