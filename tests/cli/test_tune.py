"""``quadid-log tune``: each log has its folder, and the way back to a flight's gains is never lost."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from quadid_logs.cli import main
from quadid_logs.cli.tune import _earlier_words
from quadid_logs.data.result import PooledLog, Result
from quadid_logs.data.tuning import GOOD, Limits, Tuning
from quadid_logs.earlier import with_earlier
from quadid_logs.serve.entries import Kind
from quadid_logs.serve.jobs import Job, do
from quadid_logs.tuning import recommend
from tests.control.test_earlier_flights import calmer, gusty
from tests.tuned_flights import flown, of_axes, with_parameters

pytestmark = pytest.mark.usefixtures("quick_multisines")

ROLL_P = "ATC_RAT_RLL_P"


@cache
def changed(result: Result) -> Result:
    """Roll with a quarter of its gains, which did not fly; of pitch there is something to raise."""
    gains = {f"ATC_RAT_RLL_{one}": 0.25 * result.log.parameters[f"ATC_RAT_RLL_{one}"] for one in "PID"}
    return with_parameters(of_axes(result, "roll", "pitch"), **gains)


@cache
def _searched(closed_loop: int, limits: Limits, **choices: object) -> Tuning:
    return recommend(_RESULTS[closed_loop], limits, **choices)  # type: ignore[arg-type]


#: By the identity of their loops, which a copy under another path keeps.
_RESULTS: dict[int, Result] = {}


def recommended(result: Result, limits: Limits = GOOD, **choices: object) -> Tuning:
    """Search once for the gains of each flight: what is held here is what becomes of them."""
    if result.pooled:
        return recommend(result, limits, **choices)  # type: ignore[arg-type]
    return _searched(id(_RESULTS.setdefault(id(result.closed_loop), result).closed_loop), limits, **choices)


@pytest.fixture
def fly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Return what makes a log of some flight, which `tune` then reads as that flight."""
    flights: dict[bytes, Result] = {}
    monkeypatch.chdir(tmp_path)

    def analyzed(log: Path, *_a: object, **_k: object) -> Result:
        result = flights[log.read_bytes()]
        return replace(result, log=replace(result.log, path=str(log)))

    monkeypatch.setattr("quadid_logs.pipeline.analyze", analyzed)
    monkeypatch.setattr("quadid_logs.tuning.recommend", recommended)
    # What takes long and is on no file but the page.
    monkeypatch.setattr("quadid_logs.report.tune_folder.autotune_forecasts", lambda *_a: {})
    monkeypatch.setattr("quadid_logs.report.tune_folder.what_if_grids", lambda *_a: {})

    def make(name: str, result: Result) -> Path:
        log = tmp_path / name
        log.parent.mkdir(parents=True, exist_ok=True)
        content = f"flight {len(flights)}".encode()
        log.write_bytes(content)
        flights[content] = result
        return Path(name)

    return make


def refused(result: Result) -> Result:
    """Of two logs no gains are recommended."""
    return replace(result, pooled=(PooledLog(path="a", used_s=1.0), PooledLog(path="b", used_s=1.0)))


def values(path: Path) -> dict[str, float]:
    """Return the parameters of a file."""
    lines = [line.split(",") for line in path.read_text().splitlines() if not line.startswith("#")]
    return {name: float(value) for name, value in lines}


def files(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_the_documented_loop_goes_on_with_the_next_log(fly: Callable[..., Path]) -> None:
    """Fly, tune, load, fly, tune the next log: the second `tune` stopped with exit code 2."""
    first = fly("00000001.BIN", changed(flown("ardupilot")))
    second = fly("00000002.BIN", refused(flown("ardupilot")))
    assert main(["tune", str(first)]) != 2
    before = files(Path("quadid-tune/00000001"))
    assert main(["tune", str(second)]) != 2
    assert files(Path("quadid-tune/00000001")) == before
    assert Path("quadid-tune/00000002/tune.html").is_file()


def test_another_log_of_the_same_name_gets_a_folder_of_its_own(fly: Callable[..., Path]) -> None:
    """Autopilots count from 1 on every new card."""
    weak = changed(flown("ardupilot"))
    main(["tune", str(fly("monday/1.BIN", weak)), "-o", "out"])
    main(["tune", str(fly("tuesday/1.BIN", weak)), "-o", "out", "--force"])
    main(["tune", str(fly("wednesday/1.BIN", weak)), "-o", "out", "--force"])
    assert {folder.name for folder in Path("out").iterdir()} == {"1", "1-bin", "1-bin-2"}
    assert all((folder / "back.param").is_file() for folder in Path("out").iterdir())


def test_a_refused_log_takes_no_file_of_another(fly: Callable[..., Path]) -> None:
    """`--force` deleted next and back of the flight before without a word."""
    main(["tune", str(fly("monday/1.BIN", changed(flown("ardupilot")))), "-o", "out"])
    before = files(Path("out/1"))
    assert main(["tune", str(fly("tuesday/1.BIN", refused(flown("ardupilot")))), "-o", "out", "--force"]) == 1
    assert files(Path("out/1")) == before


def test_a_log_is_tuned_anew_only_when_asked(
    fly: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """And into its own folder."""
    log = fly("1.BIN", changed(flown("ardupilot")))
    main(["tune", str(log)])
    assert main(["tune", str(log)]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["tune", str(log), "--force"]) != 2
    assert [folder.name for folder in Path("quadid-tune").iterdir()] == ["1"]


@pytest.mark.parametrize(
    "options",
    [(), ("--apart",), pytest.param(("--gain-margin-db", "12"), marks=pytest.mark.thorough)],
    ids=" ".join,
)
def test_the_way_back_of_a_log_is_the_same_whatever_is_asked(
    options: tuple[str, ...], fly: Callable[..., Path]
) -> None:
    """Other options change other gains: one file leads back from all of them."""
    log = fly("1.BIN", changed(flown("ardupilot")))
    main(["tune", str(log)])
    back = Path("quadid-tune/1/back.param")
    content, written_ns = back.read_bytes(), back.stat().st_mtime_ns
    assert main(["tune", str(log), "--force", *options]) != 2
    assert back.read_bytes() == content
    assert back.stat().st_mtime_ns == written_ns
    assert values(Path("quadid-tune/1/next.param")).keys() <= values(back).keys()


def test_a_refusal_with_other_options_keeps_the_way_back_and_says_what_it_removed(
    fly: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The pilot may have loaded the gains that are no longer recommended."""
    weak = changed(flown("ardupilot"))
    log = fly("1.BIN", weak)
    main(["tune", str(log)])
    folder = Path("quadid-tune/1")
    before = files(folder)
    monkeypatch.setattr("quadid_logs.pipeline.analyze", lambda *_a, **_k: refused(weak))
    capsys.readouterr()
    assert main(["tune", str(log), "--force"]) == 1
    assert files(folder)["back.param"] == before["back.param"]
    assert "next.param" not in files(folder)
    assert "removed files of an earlier run: " in capsys.readouterr().out


def test_the_page_of_the_server_comes_with_the_confirming_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It says that plan.md stands beside it."""
    weak = changed(flown("ardupilot"))
    monkeypatch.setattr("quadid_logs.serve.jobs._result_of", lambda *_a: (weak, {}))
    job = Job(
        kind=Kind.TUNE,
        logs=("x",),
        names=("x",),
        numbers=(0,),
        sha256=("0",),
        n_bytes=1,
        options={},
        folder=str(tmp_path),
    )
    do(job, lambda _stage, _summary: None)
    assert "plan.md" in (tmp_path / "report.html").read_text()
    assert {"next.param", "back.param", "plan.md", "sweep-off.param"} <= files(tmp_path).keys()


def test_a_way_back_to_other_values_is_never_replaced(
    fly: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever made it; and nothing else of the folder is touched."""
    log = fly("1.BIN", changed(flown("ardupilot")))
    main(["tune", str(log)])
    folder = Path("quadid-tune/1")
    (folder / "back.param").write_text(f"{ROLL_P},0.2\n")
    before = files(folder)
    capsys.readouterr()
    assert main(["tune", str(log), "--force"]) == 2
    assert "not replaced" in capsys.readouterr().err
    assert files(folder) == before


@pytest.mark.parametrize("option", ["--mass-range", "--density-range", "--propeller-range"])
def test_a_range_without_the_vehicle_that_flew_is_refused(option: str, fly: Callable[..., Path]) -> None:
    """Before the log is read."""
    assert main(["tune", str(fly("1.BIN", changed(flown("ardupilot")))), option, "1.1", "1.2"]) == 2


def test_tune_json_holds_the_ranges_and_the_margins_over_them(fly: Callable[..., Path]) -> None:
    """For programs; the next flight's command asks for the same ranges."""
    main(["tune", str(fly("1.BIN", changed(flown("ardupilot")))), "--mass-range", "1", "1.5"])
    told = json.loads(Path("quadid-tune/1/tune.json").read_text())
    assert told["ranges"] == {"mass": [1.0, 1.5], "density": [0.82, 1.1], "propeller": [1.0, 1.07]}
    # Roll's loop is not that of its parameters, and has no margins.
    off_nominal = told["axes"]["pitch"]["off_nominal"]
    assert [one["mass"] for one in off_nominal if one["condition"] == "heavier"] == [1.5]
    assert not [one for one in off_nominal if one["condition"] == "lighter"]
    assert sum(one["worst"] for one in off_nominal) == 1
    assert "--mass-range 1 1.5" in Path("quadid-tune/1/tune.html").read_text()


@pytest.mark.thorough
def test_the_terminal_and_the_file_name_the_axes_that_an_earlier_flight_narrows(
    fly: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    result = of_axes(flown("ardupilot"), "roll", "pitch")
    rows = tuple(replace(one, torque=one.torque + 1e-6) for one in result.data.segments)
    before = replace(result, data=replace(result.data, segments=rows))
    main(["tune", str(fly("now.bin", result)), "--earlier", str(fly("before.bin", before)), "-o", "tune"])
    assert "before.bin narrows roll and pitch" in capsys.readouterr().out
    content = json.loads(Path("tune/now/tune.json").read_text(encoding="ascii"))
    told = {"log": "before.bin", "axes": ["roll", "pitch"], "differ": []}
    assert content["earlier"] == [told]


def test_the_terminal_tells_which_axes_are_left_to_an_earlier_flight() -> None:
    result = with_earlier(gusty(flown("ardupilot"), "QL504"), [calmer(flown("ardupilot"))])
    (earlier,) = result.earlier
    assert _earlier_words(result, earlier) == (
        "narrows pitch and yaw and gives roll, of which this flight shows too little"
    )


def test_an_earlier_log_of_another_frame_ends_with_what_to_do(
    fly: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    result = flown("ardupilot")
    other = replace(result, log=replace(result.log, frame="another frame"))
    code = main(
        ["tune", str(fly("now.bin", result)), "--earlier", str(fly("other.bin", other)), "-o", "tune"]
    )
    assert code == 2
    assert "other.bin is from another vehicle" in capsys.readouterr().err
