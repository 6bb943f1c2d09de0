"""A page that goes to others says nothing about where its owner keeps files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from quadid_logs.data.result import Result
from quadid_logs.report.folder import write_drawings
from quadid_logs.report.provenance import Provenance
from quadid_logs.report.tune_page import tune_page
from quadid_logs.tuning import recommend
from tests.synthetic_results import usable_result

FOLDER = "/home/jo/secret flights"
COMMAND = f'quadid-log analyze "{FOLDER}/a.bin" -o {FOLDER.replace(" ", "-")} --vehicle="{FOLDER}/quad.toml"'


def _elsewhere() -> Result:
    result = usable_result()
    return replace(result, log=replace(result.log, path=f"{FOLDER}/a.bin"))


def _provenance() -> Provenance:
    return Provenance(version="1", command=COMMAND, log_sha256="")


def test_the_report_holds_no_folder_of_its_owner(tmp_path: Path) -> None:
    write_drawings(_elsewhere(), _provenance(), tmp_path, "none")
    page = (tmp_path / "report.html").read_text()
    assert "a.bin" in page
    assert "/home/jo" not in page


def test_the_page_of_gains_holds_no_folder_of_its_owner() -> None:
    result = _elsewhere()
    assert "/home/jo" not in tune_page(result, recommend(result), _provenance())


def test_the_command_of_the_report_keeps_its_options(tmp_path: Path) -> None:
    write_drawings(_elsewhere(), _provenance(), tmp_path, "none")
    page = (tmp_path / "report.html").read_text()
    assert "quadid-log analyze a.bin -o secret-flights --vehicle=quad.toml" in page
