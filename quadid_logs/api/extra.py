"""Libraries that only some methods need, with one clear line where they are missing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from quadid_logs import extra

if TYPE_CHECKING:
    import pandas as pd


def load(name: str) -> Any:
    """Import a library that a system's own packaging may have left out.

    Parameters
    ----------
    name : str

    Returns
    -------
    module

    Raises
    ------
    SettingsError
        If it is not installed.
    """
    return extra.load(name, "Install it with: pip install pandas control")


def data_frame(columns: dict[str, Any], index: str = "") -> pd.DataFrame:
    """Return columns as a DataFrame.

    Parameters
    ----------
    columns : dict of str to array_like
    index : str
        Name of the column that becomes the index, "" for none.

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
