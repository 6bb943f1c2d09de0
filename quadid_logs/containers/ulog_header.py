"""How a ULog begins: all that tells it from other logs, without what reads it."""

from __future__ import annotations

from typing import Final

HEADER_MAGIC: Final = b"\x55\x4c\x6f\x67\x01\x12\x35"
HEADER_SIZE: Final = 16


def is_mine(head: bytes) -> bool:
    """Tell whether a file beginning with `head` is a ULog."""
    return head.startswith(HEADER_MAGIC)
