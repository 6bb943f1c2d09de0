"""Of one thing there is no plural, on any surface."""

from __future__ import annotations

from pathlib import Path

import pytest

from quadid_logs.counting import counted
from quadid_logs.load import read_log
from tests.containers import ulog_maker


@pytest.mark.parametrize(
    ("n", "many", "words"), [(1, "", "1 row"), (0, "", "0 rows"), (2, "rows have", "2 rows have")]
)
def test_one_thing_has_no_plural(n: int, many: str, words: str) -> None:
    """Nor does its verb."""
    assert counted(n, "row", many) == words


def test_the_remarks_about_one_row_and_one_cell_of_a_table_speak_of_one(tmp_path: Path) -> None:
    """They said "1 cells are no numbers"."""
    path = tmp_path / "log.csv"
    path.write_text("time_s,p_rad_s,q_rad_s,r_rad_s\n0,1,2,3\n1,x,2,3\n2,1\n3,1,2,3\n")
    remarks = read_log(path).remarks
    assert "1 cell is no number and counts as missing." in remarks
    assert "1 row has too few or too many cells." in remarks


def test_the_remarks_about_one_dropout_of_a_ulog_speak_of_one(tmp_path: Path) -> None:
    """They said "1 dropouts"."""
    path = tmp_path / "log.ulg"
    path.write_bytes(ulog_maker.small_log() + ulog_maker.dropout(250))
    remarks = read_log(path).remarks
    assert "The logger reports 1 dropout, 0.25 s in total." in remarks
    assert "1 parameter was written while logging; the last value is used." in remarks
