"""Tables: canonical names, and clear words where they are not."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.autopilots.generic import table
from quadid_logs.containers.table import read_cells
from quadid_logs.errors import EmptyLogError, LogError, UnknownFormatError
from quadid_logs.load import read_log

NAMES = ["time_s", "p_rad_s", "q_rad_s", "r_rad_s"]


def write(folder: Path, *lines: str, encoding: str = "utf-8") -> Path:
    """Write a table under a name that means nothing."""
    path = folder / "table"
    path.write_bytes("\n".join(lines).encode(encoding))
    return path


def test_columns_become_signals_in_file_order(tmp_path: Path) -> None:
    """Any order of columns; rows are numbered and not sorted."""
    path = write(tmp_path, "r_rad_s,time_s,q_rad_s,p_rad_s", "3,0.1,2,1", "6,0.0,5,4")
    rate = read_log(path).candidates("body_rate")[0]
    assert rate.values.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert rate.time_s.tolist() == [0.1, 0.0]
    assert rate.position.tolist() == [0, 1]


def test_a_table_is_assumed_to_be_of_a_multirotor_and_says_so(tmp_path: Path) -> None:
    """Nothing in a table tells what flew."""
    log = read_log(write(tmp_path, ",".join(NAMES), "0,0,0,0"))
    assert log.vehicle_type == "multirotor"
    assert any("assumed" in remark for remark in log.remarks)


def test_every_signal_of_the_vocabulary_can_be_given(tmp_path: Path) -> None:
    """Torque in both kinds, throttle, setpoints, and numbered motors."""
    names = [*NAMES, "L_n_m", "M_n_m", "N_n_m", "L_command", "M_command", "N_command", "throttle"]
    names += ["p_setpoint_rad_s", "q_setpoint_rad_s", "r_setpoint_rad_s", "motor_thrust_2", "motor_thrust_1"]
    log = read_log(write(tmp_path, ",".join(names), ",".join(str(k) for k in range(len(names)))))
    assert set(log.signals) == {
        "body_rate", "torque_n_m", "torque_command", "throttle", "body_rate_setpoint", "motor_thrust",
    }  # fmt: skip
    assert log.candidates("motor_thrust")[0].values.tolist() == [[15.0, 14.0]]


def test_columns_of_public_data_sets_are_known_by_their_own_names(tmp_path: Path) -> None:
    """Set-points of angles, and velocity north, east and down."""
    names = [
        *NAMES,
        "vx_m_s",
        "vy_m_s",
        "vz_m_s",
        "roll_setpoint_rad",
        "pitch_setpoint_rad",
        "yaw_setpoint_rad",
    ]
    log = read_log(write(tmp_path, ",".join(names), ",".join(str(k) for k in range(len(names)))))
    assert log.candidates("velocity")[0].values.tolist() == [[4.0, 5.0, 6.0]]
    assert log.candidates("attitude_setpoint")[0].values.tolist() == [[7.0, 8.0, 9.0]]
    assert log.candidates("velocity")[0].source == "CSV columns vx_m_s, vy_m_s, vz_m_s"


def test_a_canonical_name_comes_before_another_one_for_the_same(tmp_path: Path) -> None:
    """Both in one table."""
    names = [*NAMES, "vx_m_s", "v_north_m_s", "v_east_m_s", "v_down_m_s"]
    log = read_log(write(tmp_path, ",".join(names), "0,1,2,3,4,5,6,7"))
    assert log.candidates("velocity")[0].values.tolist() == [[5.0, 6.0, 7.0]]


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("\ufefftime_s,p_rad_s,q_rad_s,r_rad_s", "0.5,1.5,2.5,3.5"),
        ("time_s;p_rad_s;q_rad_s;r_rad_s", "0.5;1.5;2.5;3.5"),
        ("time_s;p_rad_s;q_rad_s;r_rad_s", "0,5;1,5;2,5;3,5"),
        ("time_s\tp_rad_s\tq_rad_s\tr_rad_s", "0.5\t1.5\t2.5\t3.5"),
        ('"time_s", "p_rad_s", "q_rad_s", "r_rad_s"', "0.5,1.5,2.5,3.5"),
        ("# exported by hand\n\ntime_s,p_rad_s,q_rad_s,r_rad_s", "0.5,1.5,2.5,3.5"),
        ("time_s,p_rad_s,q_rad_s,r_rad_s\r", "0.5,1.5,2.5,3.5\r"),
        ("time_s,note,p_rad_s,q_rad_s,r_rad_s", '0.5,"a, b",1.5,2.5,3.5'),
    ],
    ids=["bom", "semicolon", "decimal-comma", "tab", "quoted", "comment", "crlf", "text-column"],
)
def test_ways_to_write_a_table(header: str, row: str, tmp_path: Path) -> None:
    """What spreadsheets and scripts write is read alike."""
    rate = read_log(write(tmp_path, header, row, row)).candidates("body_rate")[0]
    assert rate.values.tolist() == [[1.5, 2.5, 3.5]] * 2
    assert rate.time_s.tolist() == [0.5, 0.5]


def test_cells_that_are_no_numbers_become_nan_and_are_counted(tmp_path: Path) -> None:
    """Empty cells, and n/a or null, are only missing; other words are counted."""
    path = write(tmp_path, ",".join([*NAMES, "landed"]), "0,1,bad,3,true", "1,,5,oops,false", "2,7,8,9,1")
    log = read_log(path)
    expected = [[1, np.nan, 3], [np.nan, 5, np.nan], [7, 8, 9]]
    np.testing.assert_array_equal(log.candidates("body_rate")[0].values, expected)
    assert log.candidates("landed")[0].values.ravel().tolist() == [1.0, 0.0, 1.0]
    assert any(remark.startswith("2 cells are no numbers") for remark in log.remarks)


def test_rows_of_another_length_are_skipped_and_counted(tmp_path: Path) -> None:
    """A row cut off by a full disk costs itself."""
    log = read_log(write(tmp_path, ",".join(NAMES), "0,1,2,3", "1,2", "2,1,2,3,4,5", "3,1,2,3"))
    assert log.candidates("body_rate")[0].time_s.tolist() == [0.0, 3.0]
    assert any(remark.startswith("2 rows have too few") for remark in log.remarks)


def test_text_that_is_not_utf8_is_read_all_the_same(tmp_path: Path) -> None:
    """Latin-1 in a note, also in a row of another length, raises nothing."""
    path = write(
        tmp_path, ",".join([*NAMES, "note"]), "0,1,2,3,B\xf6e", "\xe9,1", "1,1,2,3,x", encoding="latin-1"
    )
    assert read_log(path).candidates("body_rate")[0].time_s.tolist() == [0.0, 1.0]


def test_a_table_without_time_is_refused_with_what_is_there(tmp_path: Path) -> None:
    """The message lists the columns and the hint the names."""
    with pytest.raises(
        UnknownFormatError, match=r"without a column time_s.*p_rad_s, q_rad_s, speed.*r_rad_s"
    ):
        read_log(write(tmp_path, "p_rad_s,q_rad_s,speed", "1,2,3"))


def test_missing_body_rates_are_named_with_what_is_there(tmp_path: Path) -> None:
    """One of three rates is missing: no guess."""
    with pytest.raises(
        UnknownFormatError, match=r"without q_rad_s. Its columns are: time_s, p_rad_s, r_rad_s"
    ):
        read_log(write(tmp_path, "time_s,p_rad_s,r_rad_s", "0,1,2"))


def test_an_incomplete_other_signal_is_left_out_with_a_remark(tmp_path: Path) -> None:
    """The rest of the table is still used."""
    log = read_log(write(tmp_path, ",".join([*NAMES, "L_n_m", "M_n_m"]), "0,0,0,0,0,0"))
    assert log.candidates("torque_n_m") == ()
    assert any("N_n_m" in remark for remark in log.remarks)


def test_columns_without_a_canonical_name_are_named(tmp_path: Path) -> None:
    """A misspelt column does not vanish silently."""
    log = read_log(write(tmp_path, ",".join([*NAMES, "Throttle"]), "0,0,0,0,0"))
    assert any("Throttle" in remark for remark in log.remarks)


@pytest.mark.parametrize("tail", ["", "\n", "\n\n"])
def test_a_header_without_rows_is_called_empty(tail: str, tmp_path: Path) -> None:
    """No row, no flight."""
    with pytest.raises(EmptyLogError, match="no rows"):
        read_log(write(tmp_path, ",".join(NAMES) + tail))


def test_parquet_gives_the_same_signals_as_csv(tmp_path: Path) -> None:
    """The same columns, the same values."""
    import pyarrow as pa
    from pyarrow import parquet

    values = np.random.default_rng(1).normal(size=(50, 4))
    parquet.write_table(pa.table({name: values[:, k] for k, name in enumerate(NAMES)}), tmp_path / "log")
    rows = [",".join(repr(float(value)) for value in row) for row in values]
    binary = read_log(tmp_path / "log").candidates("body_rate")[0]
    text = read_log(write(tmp_path, ",".join(NAMES), *rows)).candidates("body_rate")[0]
    np.testing.assert_array_equal(binary.values, text.values)
    np.testing.assert_array_equal(binary.time_s, values[:, 0])


def test_parquet_columns_of_other_types_are_converted(tmp_path: Path) -> None:
    """Integers, truth values and text that holds numbers."""
    import pyarrow as pa
    from pyarrow import parquet

    columns = {"time_s": [0, 1], "p_rad_s": ["1.5", "x"], "q_rad_s": [1.0, None], "r_rad_s": [1, 2]}
    parquet.write_table(pa.table(columns | {"armed": [True, False]}), tmp_path / "log")
    log = read_log(tmp_path / "log")
    expected = [[1.5, 1.0, 1.0], [np.nan, np.nan, 2.0]]
    np.testing.assert_array_equal(log.candidates("body_rate")[0].values, expected)
    assert log.candidates("armed")[0].values.ravel().tolist() == [1.0, 0.0]


def test_a_damaged_parquet_file_is_one_clear_line(tmp_path: Path) -> None:
    """Cut at every tenth byte, it opens or raises a LogError."""
    import pyarrow as pa
    from pyarrow import parquet

    parquet.write_table(pa.table({name: np.arange(50.0) for name in NAMES}), tmp_path / "whole")
    content = (tmp_path / "whole").read_bytes()
    for cut in range(4, len(content), 10):
        (tmp_path / "cut").write_bytes(content[:cut])
        with pytest.raises(LogError):
            read_log(tmp_path / "cut")


def test_prose_is_no_table() -> None:
    """A text that mentions a column somewhere is not mistaken for a table."""
    assert not table.is_mine(b"Please send me the column time_s of your log, p_rad_s too.\n")


@pytest.mark.corpus
@pytest.mark.parametrize("corpus_log", ["real/x8coax_moments_hover.csv"], indirect=True)
def test_every_number_of_the_real_table_is_read(corpus_log: Path) -> None:
    """Values equal numpy's reading of the same text."""
    expected = np.genfromtxt(corpus_log, delimiter=",", names=True)
    log = read_log(corpus_log)
    for name, columns in {"body_rate": NAMES[1:], "torque_n_m": ["L_n_m", "M_n_m", "N_n_m"]}.items():
        signal = log.candidates(name)[0]
        np.testing.assert_array_equal(signal.time_s, expected["time_s"])
        np.testing.assert_array_equal(
            signal.values, np.column_stack([expected[column] for column in columns])
        )


def test_a_parquet_file_without_the_library_that_reads_it_is_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """CSV needs none; what reads Parquet is an extra."""
    path = tmp_path / "flight.parquet"
    path.write_bytes(b"PAR1" + bytes(40))
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(UnknownFormatError, match=r"pip install '\.\[parquet\]'"):
        read_log(path)


def test_cells_for_a_missing_value_do_not_count_as_damaged(tmp_path: Path) -> None:
    """As spreadsheets write them; a quotation mark without its partner costs its row only."""
    path = tmp_path / "flight.csv"
    path.write_text('time_s,throttle,note\n0,NULL,a\n1,n/a,b\n2,"0.5",c\n3,0.5,"d\n4,x,e\n\n5,0.7,f\n')
    cells = read_cells(path, lambda _names: ["time_s", "throttle"])
    np.testing.assert_array_equal(cells.columns["throttle"], [np.nan, np.nan, 0.5, 0.5, np.nan, 0.7])
    assert (cells.n_not_numeric, cells.n_broken_rows) == (1, 0)
