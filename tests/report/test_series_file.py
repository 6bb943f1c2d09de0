"""The exported table: the aligned series, unchanged, in three formats."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat

from quadid_logs.data.result import Result
from quadid_logs.errors import EmptyLogError, OutputError, SettingsError
from quadid_logs.report.series_file import aligned_table, write_table
from quadid_logs.vocabulary import SIGNALS


def read(path: Path) -> pd.DataFrame:
    """Read a table back with a library that we do not write with, where there is one."""
    if path.suffix == ".mat":
        return pd.DataFrame(
            {name: values[:, 0] for name, values in loadmat(path).items() if not name.startswith("_")}
        )
    return pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)


@pytest.mark.parametrize("ending", [".csv", ".parquet", ".mat"])
def test_the_table_comes_back_as_it_was(ending: str, usable: Result, tmp_path: Path) -> None:
    """Every column of every segment, to the last digit."""
    n_rows = write_table(usable.data, tmp_path / f"series{ending}")
    table = read(tmp_path / f"series{ending}")
    assert len(table) == n_rows == usable.data.n_samples
    first, second = usable.data.segments
    np.testing.assert_array_equal(table["q_rad_s"][: first.n_samples], first.body_rate_rad_s[:, 1])
    np.testing.assert_array_equal(table["N_command"][first.n_samples :], second.torque[:, 2])
    assert table["segment"].tolist() == [0] * first.n_samples + [1] * second.n_samples
    assert table["saturated"].sum() == first.saturated.sum() + second.saturated.sum()


def test_a_signal_that_a_segment_lacks_is_nan(usable: Result) -> None:
    """Columns are always the same."""
    segments = tuple(replace(segment, attitude_rad=None, throttle=None) for segment in usable.data.segments)
    table = aligned_table(replace(usable.data, segments=segments))
    assert np.isnan(table["phi_rad"]).all()
    assert np.isnan(table["throttle"]).all()


def test_a_log_without_flight_has_no_table(refused: Result, tmp_path: Path) -> None:
    """The reason is in the error, and no file is made."""
    with pytest.raises(EmptyLogError, match="never armed"):
        write_table(refused.data, tmp_path / "series.csv")
    assert list(tmp_path.iterdir()) == []


def test_an_existing_table_is_kept_without_force(usable: Result, tmp_path: Path) -> None:
    """And replaced with it."""
    path = tmp_path / "series.csv"
    path.write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        write_table(usable.data, path)
    assert path.read_text() == "mine"
    write_table(usable.data, path, force=True)
    assert path.read_text().startswith('"time_s"')


def test_an_unknown_ending_is_refused(usable: Result, tmp_path: Path) -> None:
    """The known ones are named."""
    with pytest.raises(SettingsError, match=r"\.parquet"):
        write_table(usable.data, tmp_path / "series.xlsx")


def test_the_set_points_are_exported_beside_what_was_flown(usable: Result) -> None:
    """They were dropped, and without them no closed loop can be looked at."""
    first, second = usable.data.segments
    wanted = np.arange(3.0 * first.n_samples).reshape(-1, 3)
    data = replace(usable.data, segments=(replace(first, reference=wanted), replace(second, reference=None)))
    table = aligned_table(data)
    for column, name in enumerate(SIGNALS["body_rate_setpoint"].columns):
        np.testing.assert_array_equal(table[name][: first.n_samples], wanted[:, column])
        assert np.isnan(table[name][first.n_samples :]).all()
    assert "sysid_chirp" not in table


def test_an_injected_chirp_is_exported(usable: Result) -> None:
    """With the set-points it is all that came from outside the rate loop."""
    first, second = usable.data.segments
    chirp = np.column_stack([np.zeros((first.n_samples, 3)), np.arange(first.n_samples)])
    data = replace(usable.data, segments=(replace(first, reference=chirp), second))
    np.testing.assert_array_equal(aligned_table(data)["sysid_chirp"][: first.n_samples], chirp[:, 3])
