"""Writing: all or nothing, and nothing over what is there."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from quadid_logs.data.result import Result
from quadid_logs.errors import OutputError
from quadid_logs.figures import figures_of
from quadid_logs.report import check_folder, report_folders, write_report
from quadid_logs.report.folder import PngChoice
from quadid_logs.report.text import result_lines
from quadid_logs.tuning import recommend


def test_a_report_is_result_page_and_the_picture_that_sums_it_up(report_folder: Path) -> None:
    """Every promised file is there, and nothing else."""
    names = {path.name for path in report_folder.iterdir()}
    assert names == {"result.json", "report.html", "summary.png"}


def test_nothing_is_left_beside_a_report(report_folder: Path) -> None:
    """The folder that it was written in first is gone."""
    assert [path.name for path in report_folder.parent.iterdir() if path.name.startswith(".")] == []


def pictures_of(result: Result, folder: Path, png: PngChoice, monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Return the names of the PNG files of a report; what they show is tested elsewhere."""
    monkeypatch.setattr("quadid_logs.figures.png.write_png", lambda _figure, path: path.write_bytes(b"PNG"))
    write_report(result, folder, png=png)
    return {path.stem for path in folder.glob("*.png")}


@pytest.mark.thorough
def test_all_pictures_are_every_figure_of_the_report(
    usable: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``--png all``: none of those that the page shows is missing, and the summary is there too."""
    every = {"summary", *(figure.key for figure in figures_of(usable).shown)}
    assert pictures_of(usable, tmp_path / "log", "all", monkeypatch) == every
    assert len(every) > 12


def test_no_pictures_leave_a_page_with_every_figure(
    usable: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``--png none``: the figures of the page are its own."""
    assert pictures_of(usable, tmp_path / "log", "none", monkeypatch) == set()
    page = (tmp_path / "log" / "report.html").read_text(encoding="utf-8")
    assert all(f'id="figure-{figure.key}"' in page for figure in figures_of(usable).shown)


def test_the_time_of_the_report_is_noted(report_folder: Path) -> None:
    """timings_s.report is what writing took, and total contains it."""
    timings = json.loads((report_folder / "result.json").read_text())["timings_s"]
    assert timings["report"] > 0.0
    assert timings["total"] == pytest.approx(1.05 + timings["report"])


def test_nothing_is_overwritten_without_force(refused: Result, tmp_path: Path) -> None:
    """The second run raises and leaves the first one's bytes."""
    write_report(refused, tmp_path / "log")
    (tmp_path / "log" / "result.json").write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        write_report(refused, tmp_path / "log")
    assert (tmp_path / "log" / "result.json").read_text() == "mine"


def test_force_replaces_what_is_there(refused: Result, tmp_path: Path) -> None:
    """With force the new result is written; files of others stay."""
    write_report(refused, tmp_path / "log")
    (tmp_path / "log" / "result.json").write_text("old")
    (tmp_path / "log" / "notes.txt").write_text("keep")
    write_report(refused, tmp_path / "log", force=True)
    assert json.loads((tmp_path / "log" / "result.json").read_text())["schema_version"] == "1.0"
    assert (tmp_path / "log" / "notes.txt").read_text() == "keep"


def test_force_removes_only_our_own_pictures_of_an_earlier_run(refused: Result, tmp_path: Path) -> None:
    """A refused log draws less than the usable one that was there; foreign pictures stay."""
    folder = tmp_path / "log"
    folder.mkdir()
    for name in ("lag.png", "condition-linear-9.png", "report.html", "photo.png", "lag.svg"):
        (folder / name).write_bytes(b"old")
    (folder / "fit.png").mkdir()
    write_report(refused, folder, force=True, drawings=False)
    assert {path.name for path in folder.iterdir()} == {"result.json", "photo.png", "lag.svg", "fit.png"}


def test_a_file_in_the_place_of_the_folder_is_a_clear_error(refused: Result, tmp_path: Path) -> None:
    """Also where the file is further up."""
    (tmp_path / "taken").write_text("")
    for folder in (tmp_path / "taken", tmp_path / "taken" / "below"):
        with pytest.raises(OutputError, match="is a file"):
            write_report(refused, folder)


def test_a_symbolic_link_is_not_followed_out_of_the_folder(refused: Result, tmp_path: Path) -> None:
    """Neither for the folder nor for a file in it."""
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "log").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match="symbolic link"):
        write_report(refused, tmp_path / "log", force=True)
    victim = tmp_path / "victim"
    victim.write_text("precious")
    folder = tmp_path / "other"
    folder.mkdir()
    (folder / "result.json").symlink_to(victim)
    write_report(refused, folder, force=True)
    assert victim.read_text() == "precious"
    assert not (folder / "result.json").is_symlink()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_a_clear_error(refused: Result, tmp_path: Path) -> None:
    """One error of ours, not the operating system's."""
    (tmp_path / "locked").mkdir(mode=0o555)
    with pytest.raises(OutputError, match="Cannot write"):
        write_report(refused, tmp_path / "locked" / "log")


def test_a_failure_in_the_middle_leaves_nothing(
    refused: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that fills up while the page is written leaves no folder and no temporary file."""

    def full(*_arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("quadid_logs.report.folder.write_drawings", full)
    with pytest.raises(OutputError, match="No space left"):
        write_report(refused, tmp_path / "log")
    assert list(tmp_path.iterdir()) == []


def test_an_interruption_leaves_nothing(
    refused: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C while the page is written."""

    def interrupted(*_arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("quadid_logs.report.folder.write_drawings", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_report(refused, tmp_path / "log")
    assert list(tmp_path.iterdir()) == []


def test_a_taken_folder_is_refused_before_the_work(refused: Result, tmp_path: Path) -> None:
    """check_folder sees what write_report would refuse."""
    write_report(refused, tmp_path / "log", drawings=False)
    with pytest.raises(OutputError, match=r"result\.json exists already"):
        check_folder(tmp_path / "log")
    check_folder(tmp_path / "log", force=True)
    check_folder(tmp_path / "new")


def test_without_drawings_only_the_result_is_written(refused: Result, tmp_path: Path) -> None:
    """As --no-report asks for."""
    write_report(refused, tmp_path / "log", drawings=False)
    assert [path.name for path in (tmp_path / "log").iterdir()] == ["result.json"]


def test_logs_of_the_same_name_get_folders_of_their_own(tmp_path: Path) -> None:
    """Also where a file system does not tell upper from lower case."""
    logs = [Path("a/flight.BIN"), Path("b/flight.bin"), Path("c/Flight.tlog"), Path("d/flight.bin")]
    names = [folder.name.lower() for folder in report_folders(logs, tmp_path)]
    assert names[0] == "flight"
    assert len(set(names)) == 4


@pytest.mark.parametrize("name", ["..", "...bin", "a\nb.bin", " .bin", "\x1b[31m.bin"])
def test_an_odd_log_name_cannot_leave_the_folder(name: str, tmp_path: Path) -> None:
    """The folder is always a visible, direct child of the output folder."""
    (folder,) = report_folders([Path("logs") / name], tmp_path)
    assert folder.parent == tmp_path
    assert folder.name not in {"", ".", ".."}
    assert folder.name.isprintable()


def test_each_log_of_a_file_has_a_folder_of_its_own(tmp_path: Path) -> None:
    """Else the second one chosen with --log would be refused, or replace the first."""
    first, second = (report_folders([Path("f.bbl")], tmp_path, number)[0].name for number in (1, 2))
    assert (first, second) == ("f-log1", "f-log2")


def test_gains_are_recommended_once_for_the_page_and_the_verdict(
    usable: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The result that is handed back differs in what the report took alone."""
    asked = []
    monkeypatch.setattr(
        "quadid_logs.tuning.recommend", lambda result: (asked.append(result), recommend(result))[1]
    )
    timed = write_report(replace(usable), tmp_path / "flight", png="none")
    result_lines(timed)
    assert len(asked) == 1
