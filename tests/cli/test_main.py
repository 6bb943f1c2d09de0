"""The command line: exit codes, one clear line per failure, results on stdout only."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import quadid_logs
from quadid_logs.cli import main
from quadid_logs.data.result import Result
from quadid_logs.data.settings import AlignSettings, IdentifySettings, Settings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.errors import UnknownFormatError
from tests.synthetic_results import hostile_result, refused_result, usable_result, write_placeholder_log


class FakePipeline:
    """Stands in for the analysis: the file's name says what comes out."""

    def __init__(self) -> None:
        self.settings: list[Settings] = []
        self.vehicles: list[Vehicle | None] = []

    def __call__(
        self,
        path: str | Path,
        settings: Settings,
        *,
        vehicle: Vehicle | None = None,
        published: bool = True,
        progress: Callable[[str], None] | None = None,
    ) -> Result:
        assert published
        self.settings.append(settings)
        self.vehicles.append(vehicle)
        if progress is not None:
            progress("read")
        name = Path(path).stem
        if name == "broken":
            raise UnknownFormatError(f"{path} is no flight log.", hint="Give a log.")
        if name == "bug":
            raise ZeroDivisionError("a \x1b[31mbug")
        if name == "interrupted":
            raise KeyboardInterrupt
        make = {"usable": _SHORT, "refused": refused_result, "hostile": hostile_result}[name]
        return make(path=str(path))


def _SHORT(path: str) -> Result:
    return usable_result(8.0, path)


@pytest.fixture
def pipeline(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakePipeline:
    """Replace the analysis, and work in an empty folder with three logs."""
    fake = FakePipeline()
    monkeypatch.setattr("quadid_logs.pipeline.analyze", fake)
    # Drawing is tested elsewhere, and takes long; so does a machine with other work to do.
    monkeypatch.setattr("quadid_logs.figures.png.write_png", lambda _figure, path: path.write_bytes(b"PNG"))
    monkeypatch.setattr("quadid_logs.cli.progress._PATIENCE_S", 60.0)
    monkeypatch.chdir(tmp_path)
    for name in ("usable", "refused", "hostile", "broken", "bug", "interrupted"):
        write_placeholder_log(tmp_path / f"{name}.bin")
    return fake


def one_clear_line(err: str) -> str:
    """Return the only line of stderr, which is no traceback and steers no terminal."""
    lines = err.splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith("quadid-log: ")
    assert "Traceback" not in err
    assert lines[0].isprintable()
    return lines[0]


def test_a_usable_log_exits_with_0(pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]) -> None:
    """Verdicts on stdout, nothing on stderr, and every file where the contract says."""
    assert main(["analyze", "usable.bin", "-o", "out"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "roll   usable" in out
    assert "yaw    caution" in out
    assert "effectiveness " in out
    assert str(Path("out/usable/report.html")) in out
    names = {path.name for path in Path("out/usable").iterdir()}
    assert {"result.json", "report.html", "summary.png"} <= names


@pytest.mark.parametrize(
    ("choice", "n_least", "n_most"), [("summary", 1, 1), ("all", 12, 40), ("none", 0, 0)]
)
def test_png_says_which_figures_are_written_as_png(
    choice: str, n_least: int, n_most: int, pipeline: FakePipeline
) -> None:
    """The page is there whatever the choice."""
    assert main(["analyze", "usable.bin", "-o", "out", "-q", "--png", choice]) == 0
    assert n_least <= len(list(Path("out/usable").glob("*.png"))) <= n_most
    assert Path("out/usable/report.html").exists()


def test_an_unknown_choice_of_figures_is_wrong_usage(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """The line names what can be chosen."""
    assert main(["analyze", "usable.bin", "--png", "some"]) == 2
    assert "'summary', 'all', 'none'" in one_clear_line(capsys.readouterr().err)


def test_an_axis_that_is_refused_exits_with_1(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every file is written, and the reason and the advice are said."""
    assert main(["analyze", "refused.bin", "-o", "out"]) == 1
    out, err = capsys.readouterr()
    assert err == ""
    assert "QL001" in out
    assert "next: Log a flight" in out
    assert Path("out/refused/report.html").exists()


def test_an_unreadable_log_exits_with_2_and_one_line(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """What was expected and what to do, and no folder."""
    assert main(["analyze", "broken.bin", "-o", "out"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "is no flight log. Give a log." in one_clear_line(err)
    assert not Path("out").exists()


def test_a_bug_exits_with_2_and_asks_for_a_report(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """No traceback, no control characters from the message."""
    assert main(["analyze", "bug.bin"]) == 2
    line = one_clear_line(capsys.readouterr().err)
    assert "unexpected ZeroDivisionError" in line
    assert "report it" in line


def test_the_traceback_is_shown_on_demand(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """QUADID_DEBUG=1 is for those who want to mend it."""
    monkeypatch.setenv("QUADID_DEBUG", "1")
    assert main(["analyze", "bug.bin"]) == 2
    assert "Traceback" in capsys.readouterr().err


def test_an_interruption_exits_with_130(pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]) -> None:
    """Ctrl-C is no error of the log, and leaves no folder."""
    assert main(["analyze", "interrupted.bin", "-o", "out"]) == 130
    told = capsys.readouterr().err
    assert "interrupted: no file was left half-written" in told
    assert "Traceback" not in told
    assert not Path("out").exists()


def test_several_logs_get_a_line_each_and_the_worst_code(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """A broken log in the middle does not stop the others."""
    assert main(["analyze", "usable.bin", "broken.bin", "refused.bin", "-o", "out"]) == 2
    out, err = capsys.readouterr()
    assert [line.split(":")[0] for line in out.splitlines()] == ["usable.bin", "refused.bin", "index"]
    one_clear_line(err)
    assert {path.name for path in Path("out").iterdir()} == {"usable", "refused", "index.html"}
    assert main(["analyze", "usable.bin", "refused.bin", "-o", "out2"]) == 1


def test_the_index_links_every_report_and_names_what_could_not_be_read(pipeline: FakePipeline) -> None:
    """One row per log, in the order of the arguments, with texts of the log as text."""
    assert main(["analyze", "hostile.bin", "broken.bin", "refused.bin", "-o", "out"]) == 2
    page = Path("out/index.html").read_text(encoding="utf-8")
    places = [page.index(f'href="{name}/report.html"') for name in ("hostile", "refused")]
    assert places == sorted(places)
    assert places[0] < page.index("broken.bin") < places[1]
    assert "could not be read" in page
    assert "<script" not in page
    assert main(["analyze", "hostile.bin", "refused.bin", "-o", "out"]) == 2
    assert main(["analyze", "hostile.bin", "refused.bin", "-o", "out", "--force"]) == 1


def test_a_pattern_that_the_shell_left_is_expanded(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the order of the names; a pattern without a match is an error."""
    assert main(["analyze", "*usab*.bin", "ref?sed.bin", "-o", "out"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["usable.bin", "refused.bin", "index"]
    assert main(["analyze", "*.nothing"]) == 2
    assert "*.nothing" in one_clear_line(capsys.readouterr().err)


def test_quiet_prints_problems_only(pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]) -> None:
    """A refused axis is one; of a usable log the exit code and the files say all."""
    assert main(["analyze", "usable.bin", "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["analyze", "refused.bin", "-q"]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert "roll refused (QL001)" in one_clear_line(err)
    assert main(["analyze", "broken.bin", "--quiet"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    one_clear_line(err)


def test_quiet_does_not_hide_the_json_that_was_asked_of_it(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """-q is about words for people."""
    assert main(["analyze", "usable.bin", "--json", "--no-report", "-q"]) == 0
    assert json.loads(capsys.readouterr().out)["axes"]["roll"]["verdict"] == "usable"


def test_a_folder_is_sent_to_fleet(pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]) -> None:
    """It is what a user with many logs looks for."""
    assert main(["analyze", "."]) == 2
    assert "quadid-log fleet" in one_clear_line(capsys.readouterr().err)


@pytest.mark.parametrize("verb", ["analyze", "compare", "export", "repeat"])
def test_a_place_that_cannot_be_written_is_found_before_the_work(
    verb: str, pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not after 15 s of it."""
    where = {
        "analyze": ["usable.bin", "-o", "/proc/out"],
        "compare": ["usable.bin", "usable.bin", "-o", "/proc/out"],
        "export": ["usable.bin", "-o", "/proc/out/model.mat", "--model"],
        "repeat": ["usable.bin", "usable.bin", "-o", "/proc/out"],
    }
    assert main([verb, *where[verb]]) == 2
    assert "cannot be written to" in one_clear_line(capsys.readouterr().err)
    assert pipeline.settings == []


def test_looking_whether_a_place_can_be_written_leaves_nothing(pipeline: FakePipeline) -> None:
    """Neither a file to try nor a folder above."""
    before = sorted(Path.cwd().iterdir())
    assert main(["analyze", "broken.bin", "-o", "new/folder"]) == 2
    assert sorted(Path.cwd().iterdir()) == before


def test_a_wrong_option_names_the_help_of_its_own_verb(capsys: pytest.CaptureFixture[str]) -> None:
    """The general help does not list it."""
    assert main(["plan", "--axles", "roll"]) == 2
    assert "See `quadid-log plan --help`." in one_clear_line(capsys.readouterr().err)


@pytest.mark.parametrize("arguments", [["-h"], ["analyze", "-h"]])
def test_a_single_h_is_help(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """As everywhere."""
    assert main(arguments) == 0
    assert "Usage: quadid-log" in capsys.readouterr().out


def test_the_help_cuts_no_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    """Half of the verbs ended in three dots."""
    assert main(["--help"]) == 0
    verbs = capsys.readouterr().out.split("Commands:")[1]
    assert "..." not in verbs


def test_a_finding_is_explained_by_its_number_alone(capsys: pytest.CaptureFixture[str]) -> None:
    """QL is what all of them begin with."""
    assert main(["explain", "303"]) == 0
    assert capsys.readouterr().out.startswith("QL303: ")


def test_a_mistyped_file_gets_the_nearest_name(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """For every verb that reads a log."""
    for verb in (["analyze"], ["info"], ["export", "-o", "x.csv"], ["compare", "usable.bin"]):
        assert main([*verb, "usabel.bin"]) == 2
        assert "Did you mean usable.bin?" in one_clear_line(capsys.readouterr().err)


def test_the_same_log_twice_gives_two_folders(pipeline: FakePipeline) -> None:
    """Two logs of the same name in one call do not overwrite each other."""
    assert main(["analyze", "refused.bin", "./refused.bin", "-o", "out"]) == 1
    assert len(list(Path("out").glob("*/result.json"))) == 2


def test_nothing_is_overwritten_without_force(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second run refuses before it works; --force replaces."""
    assert main(["analyze", "refused.bin"]) == 1
    capsys.readouterr()
    assert main(["analyze", "refused.bin"]) == 2
    assert "--force" in one_clear_line(capsys.readouterr().err)
    assert len(pipeline.settings) == 1
    assert main(["analyze", "refused.bin", "--force"]) == 1


def test_json_on_stdout_is_the_result_and_nothing_else(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same content as the file, and no picture with --no-report."""
    assert main(["analyze", "usable.bin", "--json", "--no-report", "-o", "out"]) == 0
    printed = json.loads(capsys.readouterr().out)
    written = json.loads(Path("out/usable/result.json").read_text())
    assert printed == written
    assert [path.name for path in Path("out/usable").iterdir()] == ["result.json"]


def test_json_without_report_and_folder_writes_no_file(pipeline: FakePipeline) -> None:
    """A script that reads stdout can run again and again."""
    assert main(["analyze", "usable.bin", "--json", "--no-report"]) == 0
    assert not Path("quadid-report").exists()


def test_json_of_several_logs_is_one_line_each(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """JSON Lines, in the order of the arguments."""
    assert main(["analyze", "usable.bin", "refused.bin", "--json", "--no-report"]) == 1
    paths = [json.loads(line)["log"]["path"] for line in capsys.readouterr().out.splitlines()]
    assert paths == ["usable.bin", "refused.bin"]


def test_a_hostile_log_cannot_steer_the_terminal(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every printed line consists of visible characters."""
    assert main(["analyze", "hostile.bin"]) == 0
    out = capsys.readouterr().out
    assert all(line.isprintable() for line in out.splitlines())
    assert "alert(1)" in out


def test_options_become_settings(pipeline: FakePipeline) -> None:
    """Each option arrives under its own name."""
    arguments = (
        "--structure linear-9 --start-s 5 --end-s 60.5 --sample-rate-hz 200 --window 12 --stride 3 "
        "--system 7 --band 1 8.5"
    )
    main(["analyze", "usable.bin", "--json", "--no-report", *arguments.split()])
    expected = Settings(
        system=7,
        align=AlignSettings(start_s=5.0, end_s=60.5, sample_rate_hz=200.0),
        identify=IdentifySettings(
            structure="linear-9", window=12, stride=3, high_pass_hz=1.0, smoothing_hz=8.5
        ),
    )
    assert pipeline.settings == [expected]


def test_a_vehicle_file_reaches_the_analysis(pipeline: FakePipeline) -> None:
    """--vehicle is read before the log."""
    Path("quad.toml").write_text('name = "test"\nmass_kg = 1.5\n')
    main(["analyze", "usable.bin", "--json", "--no-report", "--vehicle", "quad.toml"])
    (vehicle,) = pipeline.vehicles
    assert vehicle is not None
    assert vehicle.mass_kg == 1.5


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["analyze"], "Missing argument"),
        (["analyze", "usable.bin", "--windw", "3"], "--window"),
        (["analyze", "usable.bin", "--window", "many"], "--window"),
        (["analyze", "usable.bin", "--window", "-1"], "at least 0"),
        (["analyze", "usable.bin", "--structure", "magic"], "damped"),
        (["analyze", "usable.bin", "--start-s", "9", "--end-s", "3"], "empty"),
        (["analyze", "usable.bin", "--sample-rate-hz", "nan"], "sample_rate_hz"),
        (["analyze", "usable.bin", "--band", "8", "1"], "8 to 1 Hz is not a possible band"),
        (["analyze", "usable.bin", "--band", "0", "8"], "0 to 8 Hz is not a possible band"),
        (["analyze", "usable.bin", "--band", "-1", "8"], "-1 to 8 Hz is not a possible band"),
        (["analyze", "usable.bin", "--band", "1", "nan"], "not a possible band"),
        (["analyze", "usable.bin", "--band", "1"], "--band"),
        (["compare", "usable.bin", "usable.bin", "--band", "3", "2"], "3 to 2 Hz is not a possible band"),
        (["analyze", "usable.bin", "--vehicle", "none.toml"], "none.toml"),
        (["analyse", "usable.bin"], "analyze"),
        (["info", "nothing-here.bin"], "nothing-here.bin"),
        (["export", "usable.bin", "-o", "table.xlsx"], ".parquet"),
        (["explain", "QL999"], "QL999"),
    ],
)
def test_wrong_usage_is_one_clear_line(
    arguments: list[str], words: str, pipeline: FakePipeline, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2, and the line names what is wrong or what to do."""
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert words in one_clear_line(err)


def test_every_finding_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    """The list names each code, and each code has a meaning."""
    from quadid_logs.cli.explain import explain
    from quadid_logs.data.catalogue import CATALOGUE

    assert main(["explain"]) == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert listed == list(CATALOGUE)
    for code in listed:
        assert explain(code.lower()) == 0
        assert CATALOGUE[code].title in capsys.readouterr().out


def test_a_full_disk_is_one_clear_line(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The operating system's error becomes ours, and nothing is left."""

    def full(*_arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("quadid_logs.report.folder.write_drawings", full)
    assert main(["analyze", "usable.bin", "-o", "out"]) == 2
    assert "No space left" in one_clear_line(capsys.readouterr().err)
    assert not Path("out").exists()


def test_what_takes_long_is_told_on_stderr(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plain line per stage once the patience is over; stdout stays the result's."""
    monkeypatch.setattr("quadid_logs.cli.progress._PATIENCE_S", 0.0)
    assert main(["analyze", "refused.bin"]) == 1
    out, err = capsys.readouterr()
    assert "writing the report" in err
    assert "writing" not in out
    assert "\x1b" not in err


def test_no_report_is_told_of_where_none_is_written(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With --no-report the numbers alone are written."""
    monkeypatch.setattr("quadid_logs.cli.progress._PATIENCE_S", 0.0)
    assert main(["analyze", "refused.bin", "--no-report"]) == 1
    assert "report" not in capsys.readouterr().err


def quadid_log(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the package in a process of its own, as where its script is not on the path."""
    command = [sys.executable, "-m", "quadid_logs", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_help_names_every_verb_and_imports_nothing_heavy() -> None:
    """No plotting, no parsing, no table library: that is what keeps it quick."""
    script = (
        "import sys; from quadid_logs.cli import main; code = main(['--help']);"
        "heavy = {'numpy', 'scipy', 'pandas', 'matplotlib', 'plotly', 'jinja2', 'pymavlink', 'rich'};"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules); sys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    for verb in ("analyze", "info", "export", "explain"):
        assert verb in done.stdout


def test_the_core_needs_no_library_of_the_extras(tmp_path: Path) -> None:
    """Telemetry and a table are written and read where none of them can be imported."""
    script = (
        "import sys; from quadid_logs.cli import main;"
        "extras = ['pyarrow', 'pymavlink', 'plotly', 'pandas', 'control', 'duckdb'];"
        "sys.modules.update(dict.fromkeys(extras));"
        "codes = [main(arguments.split()) for arguments in sys.argv[1:]]; sys.exit(max(codes))"
    )
    verbs = [
        "simulate hover --duration-s 15 --rate-hz 50 -o f.tlog",
        "info f.tlog",
        "export f.tlog -o f.csv",
        "info f.csv",
    ]
    done = subprocess.run(
        [sys.executable, "-c", script, *verbs],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr


def test_the_version_is_printed() -> None:
    """One line, exit code 0."""
    done = quadid_log("--version")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("quadid-log 0.")


def test_the_version_is_that_of_the_project() -> None:
    """pyproject.toml and the package agree."""
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["version"] == quadid_logs.__version__


def test_a_reader_that_goes_away_is_no_error() -> None:
    """``quadid-log explain | head -0``: quiet, and neither 0, 1 nor 2."""
    script = (
        "import os, sys; r, w = os.pipe(); os.close(r); os.dup2(w, 1);"
        "from quadid_logs.cli import main; sys.exit(main(['explain']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], stderr=subprocess.PIPE, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (141, "")


def test_the_public_names_are_what_the_package_says() -> None:
    """Every name in __all__ can be had, and an unknown one is refused."""
    for name in quadid_logs.__all__:
        assert getattr(quadid_logs, name) is not None
    assert set(quadid_logs.__all__) <= set(dir(quadid_logs))
    with pytest.raises(AttributeError, match="nonsense"):
        _ = quadid_logs.nonsense


def test_a_verdict_of_caution_is_still_exit_code_0(
    pipeline: FakePipeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only a refused axis makes 1."""
    result = usable_result(8.0)
    worst = replace(
        result.diagnosis, axes=dict.fromkeys(("roll", "pitch", "yaw"), result.diagnosis.axes["yaw"])
    )
    monkeypatch.setattr("quadid_logs.pipeline.analyze", lambda *_a, **_k: replace(result, diagnosis=worst))
    assert main(["analyze", "usable.bin", "--json", "--no-report"]) == 0


def test_a_terminal_gets_a_table_and_no_colour_is_respected(
    pipeline: FakePipeline, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same words as in a pipe; colours only where NO_COLOR is not set."""
    monkeypatch.setattr("quadid_logs.cli.analyze.is_terminal", lambda _stream: True)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert main(["analyze", "usable.bin", "-o", "one"]) == 0
    coloured = capsys.readouterr().out
    assert "\x1b[32musable" in coloured
    monkeypatch.setenv("NO_COLOR", "1")
    assert main(["analyze", "usable.bin", "-o", "two"]) == 0
    plain = capsys.readouterr().out
    assert "\x1b[32m" not in plain
    assert "effectiveness " in plain
    assert main(["analyze", "hostile.bin", "-o", "three"]) == 0
    assert "\x1b[31m" not in capsys.readouterr().out.replace("\x1b[1m", "")
