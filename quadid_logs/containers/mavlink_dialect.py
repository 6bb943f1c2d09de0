"""Every MAVLink message's layout, in a table that was made of pymavlink's dialect: nothing by hand.

The table is `mavlink_messages.json`; benchmarks/make_mavlink_messages.py makes it anew.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MessageType:
    """Name and layout of a message: `struct_format` has one item per field, in wire order.

    ``definition_order`` holds the places of the fields on the wire, in the order of the message's definition.
    """

    name: str
    msg_id: int
    struct_format: str
    fields: tuple[str, ...]
    definition_order: tuple[int, ...]

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The untruncated payload."""
        # Translate a struct format with one item per field, as "<fHH16sB".
        fields: list[tuple[str, object]] = []
        for (count, code), name in zip(
            re.findall(r"(\d*)([A-Za-z])", self.struct_format), self.fields, strict=True
        ):
            if code == "s":
                fields.append((name, f"S{count or 1}"))
            elif code == "c":
                fields.append((name, "S1"))
            else:
                fields.append((name, (f"<{code}", (int(count),)) if count else f"<{code}"))
        return np.dtype(fields)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Dialect:
    """All known messages.

    Attributes
    ----------
    types : mapping of int to MessageType
        By message number.
    extra : ndarray of int32, shape (n,)
        Last byte that goes into a message's checksum, by number; -1 where unknown.
    longest : ndarray of int32, shape (n,)
        Size of the untruncated payload, by number.
    """

    types: Mapping[int, MessageType]
    extra: NDArray[np.int32]
    longest: NDArray[np.int32]


@cache
def _table() -> dict[str, Any]:
    """Return the table as it is written."""
    text = (Path(__file__).parent / "mavlink_messages.json").read_text(encoding="utf-8")
    table: dict[str, Any] = json.loads(text)
    return table


@cache
def load_dialect() -> Dialect:
    """Return the layouts of the dialect "all", which holds every message with a number of its own."""
    known = {int(number): message for number, message in _table()["messages"].items()}
    extra = np.full(max(known) + 2, -1, np.int32)
    longest = np.zeros(max(known) + 2, np.int32)
    types = {}
    for msg_id, (name, struct_format, fields, order, crc_extra) in known.items():
        types[msg_id] = MessageType(
            name=name,
            msg_id=msg_id,
            struct_format=struct_format,
            fields=tuple(fields),
            definition_order=tuple(order),
        )
        extra[msg_id] = crc_extra
        longest[msg_id] = struct.calcsize(struct_format)
    extra.flags.writeable = longest.flags.writeable = False
    return Dialect(types=MappingProxyType(types), extra=extra, longest=longest)


def enum_names(enum: str, prefix: str) -> dict[int, str]:
    """Return the entries of an enumeration without their common prefix, by value; empty if there is none."""
    entries = _table()["enums"].get(enum, {})
    return {
        int(value): name.removeprefix(prefix)
        for value, name in entries.items()
        if not name.endswith("_ENUM_END")
    }
