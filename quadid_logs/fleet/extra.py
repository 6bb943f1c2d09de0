"""The libraries that only a fleet or the local page needs, with one clear line where they are missing."""

from __future__ import annotations

from typing import Any

from quadid_logs.extra import load as load_or_hint


def load(name: str, extra: str = "fleet") -> Any:
    """Import a library of an extra.

    Raises
    ------
    SettingsError
        If it is not installed.
    """
    hint = f"Install it in the folder of quadid-logs' source with: pip install '.[{extra}]'"
    return load_or_hint(name, hint)
