"""Conversion of columns to a pandas table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from quadid_logs.extra import load

if TYPE_CHECKING:
    import pandas as pd


def data_frame(columns: dict[str, Any], index: str = "") -> pd.DataFrame:
    """Return columns as a DataFrame.

    Parameters
    ----------
    columns : dict of str to array_like
        Columns of equal length by name.
    index : str
        Name of the column that becomes the index; "" keeps a plain row number.

    Returns
    -------
    pandas.DataFrame

    Raises
    ------
    SettingsError
        If pandas is not installed.
    """
    frame: pd.DataFrame = load("pandas").DataFrame(columns)
    return frame.set_index(index) if index else frame
