"""A terminal for the tests."""

from __future__ import annotations

import io


class Terminal(io.StringIO):
    """What a terminal would show, as text."""

    def isatty(self) -> bool:
        return True
