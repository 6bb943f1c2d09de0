"""Every MAVLink message's layout, taken from pymavlink's generated dialect: nothing by hand."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Numbers above belong to nobody so far; below, they sort as 16-bit integers, which is fast.
_NUMBERS: Final = 1 << 16


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MessageType:
    """Name and layout of a message: `struct_format` has one item per field, in wire order."""

    name: str
    msg_id: int
    struct_format: str
    fields: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The untruncated payload."""
        return _payload_dtype(self.struct_format, self.fields)


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
def load_dialect() -> Dialect:
    """Return the layouts of pymavlink's dialect "all", which holds every message with a number of its own.

    They are constants of the installed package, so they are gathered once.
    """
    from pymavlink.dialects.v20 import all as generated

    known = {
        int(msg_id): message for msg_id, message in generated.mavlink_map.items() if 0 <= msg_id < _NUMBERS
    }
    extra = np.full(max(known) + 2, -1, np.int32)
    longest = np.zeros(max(known) + 2, np.int32)
    types = {}
    for msg_id, message in known.items():
        types[msg_id] = MessageType(
            name=str(message.msgname),
            msg_id=msg_id,
            struct_format=str(message.unpacker.format),
            fields=tuple(message.ordered_fieldnames),
        )
        extra[msg_id] = message.crc_extra
        longest[msg_id] = message.unpacker.size
    extra.flags.writeable = longest.flags.writeable = False
    return Dialect(types=MappingProxyType(types), extra=extra, longest=longest)


def _payload_dtype(struct_format: str, names: tuple[str, ...]) -> np.dtype[np.void]:
    """Translate a struct format with one item per field, as "<fHH16sB"."""
    fields: list[tuple[str, object]] = []
    for (count, code), name in zip(re.findall(r"(\d*)([A-Za-z])", struct_format), names, strict=True):
        if code == "s":
            fields.append((name, f"S{count or 1}"))
        elif code == "c":
            fields.append((name, "S1"))
        else:
            fields.append((name, (f"<{code}", (int(count),)) if count else f"<{code}"))
    return np.dtype(fields)


def enum_names(enum: str, prefix: str) -> dict[int, str]:
    """Return the entries of an enumeration without their common prefix, by value; empty if there is none."""
    from pymavlink.dialects.v20 import all as generated

    entries = generated.enums.get(enum, {})
    return {
        int(value): str(entry.name).removeprefix(prefix)
        for value, entry in entries.items()
        if not str(entry.name).endswith("_ENUM_END")
    }
