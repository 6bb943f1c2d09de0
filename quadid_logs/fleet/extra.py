"""The libraries that only a fleet or the local page needs, with one clear line where they are missing."""

from __future__ import annotations

import importlib
from typing import Any

from quadid_logs.errors import SettingsError


def load(name: str, extra: str = "fleet") -> Any:
    """Import a library of an extra.

    Raises
    ------
    SettingsError
        If it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise SettingsError(
            f"{error.name or name} is not installed.",
            hint=f"Install it in the folder of quadid-logs' source with: pip install '.[{extra}]'",
        ) from error
