"""The libraries that only a fleet needs, with one clear line where they are missing."""

from __future__ import annotations

import importlib
from typing import Any

from quadid_logs.errors import SettingsError


def load(name: str) -> Any:
    """Import a library of the extra ``fleet``.

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
            hint="Install it in the folder of quadid-logs' source with: pip install '.[fleet]'",
        ) from error
