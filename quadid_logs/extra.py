"""Libraries of the extras: imported where they are needed, with one clear line where they are missing."""

from __future__ import annotations

import importlib
from typing import Any

from quadid_logs.errors import SettingsError


def load(name: str, hint: str) -> Any:
    """Import a library that an installation may lack.

    Parameters
    ----------
    name : str
    hint : str
        How to install it.

    Returns
    -------
    module

    Raises
    ------
    SettingsError
        If it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise SettingsError(f"{error.name or name} is not installed.", hint=hint) from error
